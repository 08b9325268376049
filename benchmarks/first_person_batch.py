"""CPU time of a first-person step with its picture, in a batch and of worlds one by one, in turn in one run.

    python -m benchmarks.first_person_batch [WORLD ...] [--count 64] [--threads 1 2] [--rounds 9] [--steps 20]

"alone" is one world that is stepped again and again, so that all it needs is near the processor; "apart" are as many
worlds as the batch has, stepped in turn with the batch's actions, so what they see is what the batch sees. Each line
has the median over rounds, microseconds a step of one world, and the medians of the rounds' ratios. Resets count.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable

import gymnasium
import numpy as np

import minihuman  # noqa: F401  registers the worlds

WORLDS = ("FourRooms", "Hallway", "Maze", "PickupObjects", "PutNext", "CollectHealth", "Sign")


def timed_us(play: Callable[[np.ndarray], None], actions: np.ndarray) -> float:
    """CPU time of all threads, microseconds a step."""
    begun = time.process_time_ns()
    for each in actions:
        play(each)
    return (time.process_time_ns() - begun) / actions.size / 1000


def step_each(worlds: list[gymnasium.Env], over: list[bool], actions: np.ndarray) -> None:
    """A step of each world; one that is over is reset instead, as in a batch."""
    for nth, action in enumerate(actions.tolist()):
        world = nth % len(worlds)
        if over[world]:
            worlds[world].reset()
            over[world] = False
        else:
            _, _, terminated, truncated, _ = worlds[world].step(action)
            over[world] = terminated or truncated


def measure(name: str, count: int, threads: int, *, rounds: int, steps: int) -> None:
    """Print a line."""
    made = f"minihuman/MiniWorld-{name}-v0"
    batch = gymnasium.make_vec(made, num_envs=count, vectorization_mode="vector_entry_point", threads=threads)
    alone, *apart = worlds = [gymnasium.make(made, disable_env_checker=True) for _ in range(count + 1)]
    for nth, world in enumerate(worlds):
        world.reset(seed=max(nth - 1, 0))
    batch.reset(seed=0)
    over_alone, over = [False], [False] * count
    rng = np.random.default_rng(0)
    times: list[tuple[float, ...]] = []
    for _ in range(rounds + 1):
        actions = rng.integers(batch.single_action_space.n, size=(steps, count))
        one = timed_us(lambda each: step_each([alone], over_alone, each), actions)
        each = timed_us(lambda each: step_each(apart, over, each), actions)
        times.append((timed_us(lambda each: batch.step(each) and None, actions), one, each))
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
