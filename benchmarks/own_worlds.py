"""Own grid worlds, untranslated and compiled in turn in one run: ``python -m benchmarks.own_worlds``.

Steps per CPU-second under random play, resets included: one world, 64 worlds one after the other as plain Python, and
a compiled batch of 1,024. Compiled and plain rounds alternate, so that a busy machine slows both.
"""

import argparse
import platform
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

from minihuman.worlds.grid.own.batch import make_batch
from tests.worlds.grid import own_world_examples as examples

WORLDS = (
    examples.Patrol,
    examples.Corridor,
    examples.Touch,
    examples.Bog,
    examples.Garden,
    examples.Sokoban,
    examples.Errand,
)
ROUND_S = 0.5
ROUNDS = 4


def count_single(world: Any) -> Callable[[], int]:
    """Return a function that makes a thousand steps of one world and returns how many it made."""
    world.reset(seed=0)
    actions = np.random.default_rng(0).choice([0, 1, 2, 2, 2, 3, 5], 1000).tolist()

    def run() -> int:
        for action in actions:
            _, _, terminated, truncated, _ = world.step(action)
            if terminated or truncated:
                world.reset()
        return len(actions)

    return run


def count_batch(batch: Any, steps: int) -> Callable[[], int]:
    """Return a function that makes some steps of a batch and returns how many steps of one world they are."""
    batch.reset(seed=0)
    actions = np.random.default_rng(0).choice([0, 1, 2, 2, 2, 3, 5], (steps, batch.num_envs))

    def run() -> int:
        for joint in actions:
            batch.step(joint)
        return int(actions.size)

    return run


def rates(runs: dict[str, Callable[[], int]]) -> dict[str, float]:
    """Return steps per CPU-second of each function, run in turn."""
    steps = dict.fromkeys(runs, 0)
    seconds = dict.fromkeys(runs, 0.0)
    for run in runs.values():
        run()
    for _ in range(ROUNDS):
        for name, run in runs.items():
            start = time.process_time()
            while time.process_time() - start < ROUND_S:
                steps[name] += run()
            seconds[name] += time.process_time() - start
    return {name: steps[name] / seconds[name] for name in runs}


def measure(world_class: Any) -> str:
    """Return a row of the table."""
    plain = type("Plain", (world_class,), {"is_translated": False, "__module__": world_class.__module__})
    start = time.process_time()
    batch = make_batch(world_class, num_envs=1024)
    batch_s = time.process_time() - start
    makers = [plain] * 64
    measured = rates(
        {
            "single": count_single(world_class()),
            "single plain": count_single(plain()),
            "batch": count_batch(batch, 20),
            "sync plain": count_batch(gymnasium.vector.SyncVectorEnv(makers), 10),
        }
    )
    single = measured["single"] / measured["single plain"]
    many = measured["batch"] / measured["sync plain"]
    name = f"{world_class.__name__} ({type(batch).__name__}, made in {batch_s:.2f} s)"
    return (
        f"| {name} | {measured['single plain']:,.0f} | "
        f"{measured['single']:,.0f} ({single:.1f}x) | {measured['sync plain']:,.0f} | "
        f"{measured['batch']:,.0f} ({many:.0f}x) |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one world alone")
    worlds = WORLDS
    if parser.parse_args().short:
        worlds = WORLDS[:1]
    print("# Own grid worlds, plain Python and compiled in turn, steps per CPU-second\n")
    print(f"Python {platform.python_version()}, NumPy {np.__version__}, Gymnasium {gymnasium.__version__}.\n")
    print("| world | one, plain | one, compiled | 64 in turn, plain | batch of 1,024 |\n|---|---|---|---|---|")
    for world_class in worlds:
        print(measure(world_class), flush=True)


if __name__ == "__main__":
    main()
