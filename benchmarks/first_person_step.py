"""Whole steps with an 80 x 60 picture, and a reset, against miniworld without a display; ratios per CPU-second.

    python benchmarks/first_person_step.py [--rounds 3] [--steps 300] [--worlds all | FourRooms Maze ...]

Both run in turn, a fresh process each time, one world a process (several Miniworld worlds in one draw each other's
rooms). The best round of each counts: the others were disturbed by what else the machine did.
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

WORLDS = ("FourRooms", "Hallway", "Maze", "PickupObjects")


def measure(side: str, name: str, steps: int) -> dict[str, float]:
    """CPU-seconds a step and a reset."""
    if side == "miniworld":
        import pyglet

        pyglet.options["headless"] = True
    import gymnasium
    import numpy as np

    with contextlib.redirect_stdout(io.StringIO()):
        module = __import__(side)
        prefix = "minihuman/" if module.__name__ == "minihuman" else ""
        env = gymnasium.make(f"{prefix}MiniWorld-{name}-v0", disable_env_checker=True)
        actions = np.random.default_rng(0).integers(env.action_space.n, size=steps).tolist()
        env.reset(seed=0)
        for action in actions[:10]:
            if any(env.step(action)[2:4]):
                env.reset(seed=0)
        stepping = 0.0
        for number in range(0, steps, 100):
            env.reset(seed=number)  # not counted: it may read textures and meshes
            begun = time.process_time()
            for action in actions[number : number + 100]:
                _, _, terminated, truncated, _ = env.step(action)
                if terminated or truncated:
                    stepping += time.process_time() - begun
                    env.reset(seed=number)
                    begun = time.process_time()
            stepping += time.process_time() - begun
        resets = max(steps // 50, 3)
        for turn in range(2):  # what is read or made once, textures and meshes, is there the second time
            begun = time.process_time()
            for number in range(resets):
                env.reset(seed=1000 * (turn + 1) + number)  # no episode twice: nothing may be kept from the first time
            resetting = (time.process_time() - begun) / resets
    return {"step": stepping / steps, "reset": resetting}


def catalogue() -> list[str]:
    """The names of all worlds that Miniworld has, too."""
    import pyglet

    pyglet.options["headless"] = True
    import gymnasium

    with contextlib.redirect_stdout(io.StringIO()):
        import miniworld  # noqa: F401  registers the worlds
    import minihuman  # noqa: F401

    names = (name for name in gymnasium.registry if f"minihuman/{name}" in gymnasium.registry)
    return sorted(name.removeprefix("MiniWorld-").removesuffix("-v0") for name in names if "MiniWorld-" in name)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--worlds", nargs="+", default=WORLDS, help="names, or all")
    parser.add_argument("--one", nargs=2, metavar=("SIDE", "WORLD"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        print(json.dumps(measure(*given.one, given.steps)))
        sys.stdout.flush()
        os._exit(0)  # pyglet's own shutdown trips over its contexts
    names = ("minihuman-lab", "miniworld", "pyglet", "numpy", "numba")
    packages = ", ".join(f"{name} {version(name)}" for name in names)
    print(f"{packages}; Python {platform.python_version()}; {platform.machine()}, {os.cpu_count()} cores")
    print(f"{'':26}{'miniworld ms':>16}{'minihuman ms':>16}{'ratio':>8}")
    for name in catalogue() if given.worlds == ["all"] else given.worlds:
        best: dict[str, dict[str, float]] = {}
        for _ in range(given.rounds):
            for side in ("miniworld", "minihuman"):
                command = [sys.executable, __file__, "--steps", str(given.steps), "--one", side, name]
                found = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
                for what, seconds in found.items():
                    kept = best.setdefault(what, {})
                    kept[side] = min(kept.get(side, seconds), seconds)
        for what, sides in best.items():
            theirs, ours = 1000 * sides["miniworld"], 1000 * sides["minihuman"]
            print(f"{name + ' ' + what:26}{theirs:16.3f}{ours:16.3f}{theirs / ours:8.1f}")


if __name__ == "__main__":
    main()
