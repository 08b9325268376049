"""CPU time of a first-person step with its picture, in a batch and of worlds one by one, in turn in one run.

    python -m benchmarks.first_person_batch [WORLD ...] [--count 64] [--threads 1 2] [--rounds 9] [--steps 20]

As many worlds as the batch has do what the batch's do, so they see the same: "alone" each does all its steps of a round
before the next one does, so that what it needs is near the processor; "apart" each does one in turn, as in the batch.
Each line has the median over rounds, microseconds a step of one world, and the medians of the rounds' ratios. Resets
count.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial

import gymnasium
import numpy as np

import minihuman  # noqa: F401  registers the worlds

WORLDS = ("FourRooms", "Hallway", "Maze", "PickupObjects", "PutNext", "CollectHealth", "Sign")


def timed_us(play: Callable[[np.ndarray], object], actions: np.ndarray) -> float:
    """CPU time of all threads, microseconds a step."""
    begun = time.process_time_ns()
    for each in actions:
        play(each)
    return (time.process_time_ns() - begun) / actions.size / 1000


class Single:
    """A world that is reset instead of stepped after its episode's end, as in a batch."""

    def __init__(self, name: str, seed: int) -> None:
        self.env, self.over = gymnasium.make(name, disable_env_checker=True), False
        self.env.reset(seed=seed)

    def step(self, action: int) -> None:
        """A step, or the reset."""
        if self.over:
            self.env.reset()
            self.over = False
        else:
            _, _, terminated, truncated, _ = self.env.step(action)
            self.over = terminated or truncated


def step_apart(worlds: list[Single], actions: np.ndarray) -> None:
    """A step of each."""
    for world, action in zip(worlds, actions.tolist(), strict=True):
        world.step(action)


def step_alone(worlds: Iterator[Single], actions: np.ndarray) -> None:
    """All steps of the next one."""
    world = next(worlds)
    for action in actions.tolist():
        world.step(action)


def measure(name: str, count: int, threads: int, *, rounds: int, steps: int) -> None:
    """Print a line."""
    made = f"minihuman/MiniWorld-{name}-v0"
    batch = gymnasium.make_vec(made, num_envs=count, vectorization_mode="vector_entry_point", threads=threads)
    alone, apart = ([Single(made, seed) for seed in range(count)] for _ in range(2))
    batch.reset(seed=0)
    rng = np.random.default_rng(0)
    times: list[tuple[float, ...]] = []
    for _ in range(rounds + 1):
        actions, in_turn = rng.integers(batch.single_action_space.n, size=(steps, count)), iter(alone)
        one = timed_us(partial(step_alone, in_turn), actions.T)
        each = timed_us(partial(step_apart, apart), actions)
        times.append((timed_us(batch.step, actions), one, each))
    batch.close()
    ours, one, each = (statistics.median(column) for column in zip(*times[1:], strict=True))
    of_one, of_each = (statistics.median(row[0] / row[k] for row in times[1:]) for k in (1, 2))
    print(
        f"{name:15s} {count} on {threads}: {ours:6.1f} us, alone {one:6.1f}, apart {each:6.1f}: "
        f"{of_one:.2f} of alone, {of_each:.2f} of apart",
        flush=True,
    )


def main() -> None:
    """Measure each world on each number of threads."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--count", type=int, default=64)
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args()
    print(f"80 x 60, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    for name in given.worlds:
        for threads in given.threads:
            measure(name, given.count, threads, rounds=given.rounds, steps=given.steps)
    print(f"load {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
