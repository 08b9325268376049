"""Continuous steps with an 80 x 60 picture against miniworld's discrete ones, and a batch of 64 against one world.

    python -m benchmarks.continuous_step [--rounds 3] [--steps 300] [--worlds FourRooms ...] [--out FILE]

Each side runs in turn, a fresh process each time, one kind of world a process. Steps are per CPU-second of all threads
of a process, and the batch and one world also per wall second; the best round of each counts, as the others were
disturbed by what else the machine did. `--out` writes the record as JSON.
"""

import argparse
import contextlib
import io
import json
import os
import platform
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

WORLDS = ("OneRoom", "FourRooms", "PickupObjects")
SIDES = ("miniworld", "one", "batch")
BATCH = 64
THREADS = 2
CONTROL = "continuous"


def measure_discrete(name: str, steps: int) -> dict[str, float]:
    """Return miniworld's steps per CPU-second and per wall second."""
    import pyglet

    pyglet.options["headless"] = True
    import gymnasium
    import numpy as np

    with contextlib.redirect_stdout(io.StringIO()):
        import miniworld  # noqa: F401  registers the worlds

        env = gymnasium.make(f"MiniWorld-{name}-v0", disable_env_checker=True)
        actions = np.random.default_rng(0).integers(env.action_space.n, size=steps).tolist()
        return _time_single(env, actions)


def measure_one(name: str, steps: int) -> dict[str, float]:
    """Return a continuous world's steps per CPU-second and per wall second."""
    import gymnasium

    import minihuman  # noqa: F401  registers the worlds

    env = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", disable_env_checker=True, control=CONTROL, trig=1)
    env.action_space.seed(0)
    return _time_single(env, [env.action_space.sample() for _ in range(steps)])


def measure_batch(name: str, steps: int) -> dict[str, float]:
    """Return a batch's steps, of all its worlds, per CPU-second and per wall second."""
    import gymnasium

    import minihuman  # noqa: F401  registers the worlds

    batch = gymnasium.make_vec(
        f"minihuman/MiniWorld-{name}-v0",
        num_envs=BATCH,
        vectorization_mode="vector_entry_point",
        threads=THREADS,
        control=CONTROL,
        trig=1,
    )
    batch.action_space.seed(0)
    rounds = max(steps // BATCH, 3)
    actions = [batch.action_space.sample() for _ in range(rounds + 2)]
    batch.reset(seed=0)
    for action in actions[:2]:
        batch.step(action)
    begun = time.process_time(), time.perf_counter()
    for action in actions[2:]:
        batch.step(action)
    return _per_second(rounds * BATCH, begun)


def _time_single(env: Any, actions: list[Any]) -> dict[str, float]:
    """Step a world, which begins again after an episode's end; resets count, as they do in a batch."""
    env.reset(seed=0)
    for action in actions[:10]:
        if any(env.step(action)[2:4]):
            env.reset()
    begun = time.process_time(), time.perf_counter()
    for action in actions:
        if any(env.step(action)[2:4]):
            env.reset()
    return _per_second(len(actions), begun)


def _per_second(steps: int, begun: tuple[float, float]) -> dict[str, float]:
    return {"per CPU-s": steps / (time.process_time() - begun[0]), "per s": steps / (time.perf_counter() - begun[1])}


MEASURES = dict(zip(SIDES, (measure_discrete, measure_one, measure_batch), strict=True))


def run(name: str, rounds: int, steps: int) -> dict[str, dict[str, float]]:
    """Return the best round of each side in a world."""
    best: dict[str, dict[str, float]] = {}
    for _ in range(rounds):
        for side in SIDES:
            command = [sys.executable, "-m", "benchmarks.continuous_step", "--steps", str(steps), "--one", side, name]
            found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
            kept = best.setdefault(side, found)
            best[side] = {what: max(kept[what], found[what]) for what in found}
    return best


def main() -> None:
    """Measure each world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--worlds", nargs="+", default=WORLDS)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--one", nargs=2, metavar=("SIDE", "WORLD"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        side, world = given.one
        print(json.dumps(MEASURES[side](world, given.steps)))
        sys.stdout.flush()
        os._exit(0)  # pyglet's own shutdown trips over its contexts
    packages = {name: version(name) for name in ("minihuman-lab", "miniworld", "pyglet", "numpy")}
    print(", ".join(f"{name} {number}" for name, number in packages.items()), f"load {os.getloadavg()[0]:.1f}")
    worlds = {}
    for name in given.worlds:
        best = run(name, given.rounds, given.steps)
        ratios = {
            "step against miniworld's, per CPU-s": best["one"]["per CPU-s"] / best["miniworld"]["per CPU-s"],
            f"batch of {BATCH} on {THREADS} threads against one, per s": best["batch"]["per s"] / best["one"]["per s"],
            f"batch of {BATCH} on {THREADS} threads against one, per CPU-s": (
                best["batch"]["per CPU-s"] / best["one"]["per CPU-s"]
            ),
        }
        worlds[name] = {"best of each": best, "ratios": ratios}
        print(name, "; ".join(f"{what} {ratio:.2f}" for what, ratio in ratios.items()), flush=True)
    if given.out:
        machine = {"python": platform.python_version(), "machine": platform.machine(), "cores": os.cpu_count()}
        record = {"packages": packages | machine, "load": os.getloadavg()[0], "rounds": given.rounds, "worlds": worlds}
        given.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
