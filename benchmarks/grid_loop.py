"""FourRooms in batches: ours, beside a plain C loop of the same rules, in turn in one run, per CPU-second.

    python -m benchmarks.grid_loop [--short]

The loop, `four_rooms.c`, is compiled here (`cc -O3 -march=native`) and first checked to give the same bytes: images,
directions, rewards and ends, resets included. It writes into the same arrays in each step; ours gives new ones. Rates
are medians over the rounds, of single worlds' steps, resets included. Then ours by one thread and by two, in steps per
second of wall time, which needs two idle cores, with the CPU-seconds of both.
"""

import argparse
import ctypes
import platform
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

import minihuman
from minihuman.worlds.rng import read_rng_state

WORLD = "minihuman/MiniGrid-FourRooms-v0"
SIZES = 64, 1_024, 4_096
STEPS, ROUNDS = 1_000_000, 7  # single worlds' steps of a round
THREADED = 4_096
Observed = tuple[NDArray[np.generic], ...]  # images, directions, rewards, terminated, truncated


class Loop:
    """The C loop over some worlds."""

    def __init__(self, library: ctypes.CDLL, count: int, seed: int) -> None:
        library.world_bytes.restype = ctypes.c_int64
        self._step, self._worlds = library.step, np.zeros((count, library.world_bytes()), np.uint8)
        images, directions, rewards = np.empty((count, 7, 7, 3), np.uint8), np.empty(count, np.int64), np.empty(count)
        terminated, truncated = np.empty(count, np.bool_), np.empty(count, np.bool_)
        self._observed = images, directions, rewards, terminated, truncated
        states = np.zeros((count, 6), np.uint64)
        for number, state in enumerate(states):
            read_rng_state(seeding.np_random(seed + number)[0], state)
        self._count, self._given = ctypes.c_int64(count), [_at(array) for array in self._observed]
        self._begun = _at(self._worlds)
        library.reset(self._begun, self._count, _at(states), *self._given[:2])

    def step(self, actions: NDArray[np.int64]) -> Observed:
        """Step all worlds; the arrays are the same each time."""
        self._step(self._begun, self._count, _at(actions), *self._given)
        return self._observed


def _at(array: NDArray[np.generic]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def build(folder: Path) -> ctypes.CDLL:
    """Compile the loop."""
    library = folder / "four_rooms.so"
    source = Path(__file__).with_name("four_rooms.c")
    exact = "-ffp-contract=off"  # else a reward is rounded once where Minigrid rounds twice
    command = ["cc", "-O3", "-march=native", exact, "-shared", "-fPIC", "-o", library, source]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library))


def make_batch(count: int, **options: object) -> gymnasium.vector.VectorEnv:
    """Our batch."""
    return gymnasium.make_vec(WORLD, num_envs=count, vectorization_mode="vector_entry_point", **options)


def require_equal(library: ctypes.CDLL, count: int, steps: int) -> None:
    """Play both from the same seeds; every array of every step must be the same."""
    ours, loop = make_batch(count), Loop(library, count, 5)
    ours.reset(seed=5)
    ends = 0
    for actions in np.random.default_rng(1).choice(7, (steps, count), p=[0.15, 0.15, 0.5, 0.05, 0.05, 0.05, 0.05]):
        (seen, rewards, terminated, truncated, _), theirs = ours.step(actions), loop.step(actions)
        for mine, its in zip((seen["image"], seen["direction"], rewards, terminated, truncated), theirs, strict=True):
            assert mine.dtype == its.dtype
            assert mine.tobytes() == its.tobytes()
        ends += int(terminated.sum() + truncated.sum())
    print(f"the loop gives the same bytes: {count} worlds x {steps} steps, {ends} ends", flush=True)


def rate(step: Callable[[NDArray[np.int64]], object], actions: NDArray[np.int64], clock: Callable[[], float]) -> float:
    """Single worlds' steps per second of a clock."""
    began = clock()
    for each in actions:
        step(each)
    return actions.size / (clock() - began)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="one round of a hundredth of the steps")
    asked = parser.parse_args()
    rounds, steps = (1, STEPS // 100) if asked.short else (ROUNDS, STEPS)
    compiler = subprocess.run(["cc", "--version"], capture_output=True, text=True, check=True).stdout.split("\n")[0]
    print(f"minihuman {minihuman.__version__}, NumPy {np.__version__}, Python {platform.python_version()}; {compiler}")
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name:
        library = build(Path(name))
        require_equal(library, 64, 100 if asked.short else 3_000)
        print(f"{'worlds':>8}{'ours':>14}{'C loop':>14}{'ratio':>8}   steps per CPU-second")
        for count in SIZES:
            ours, loop = make_batch(count), Loop(library, count, 0)
            ours.reset(seed=0)
            actions = np.random.default_rng(0).integers(0, 7, (max(2, steps // count), count))
            pairs = [
                (rate(ours.step, actions, time.process_time), rate(loop.step, actions, time.process_time))
                for _ in range(rounds + 1)
            ][1:]
            mine, its = (statistics.median(column) for column in zip(*pairs, strict=True))
            ratio = statistics.median(mine / its for mine, its in pairs)
            print(f"{count:8}{mine:14,.0f}{its:14,.0f}{ratio:8.2f}", flush=True)
    actions = np.random.default_rng(0).integers(0, 7, (max(2, steps // THREADED), THREADED))
    one, two = (make_batch(THREADED, threads=threads) for threads in (1, 2))
    one.reset(seed=0), two.reset(seed=0)
    cpu = dict.fromkeys((1, 2), 0.0)
    walls = []
    for _ in range(rounds + 1):
        each = []
        for threads, batch in ((1, one), (2, two)):
            began_s = time.process_time()
            each.append(rate(batch.step, actions, time.perf_counter))
            cpu[threads] += time.process_time() - began_s
        walls.append(each)
    mine, its = (statistics.median(column) for column in zip(*walls[1:], strict=True))
    ratio = statistics.median(b / a for a, b in walls[1:])
    print(
        f"{THREADED} worlds, steps per second of wall time: two threads {its:,.0f}, one thread {mine:,.0f}, "
        f"{ratio:.2f} times; CPU-seconds {cpu[2] / cpu[1]:.2f} times"
    )


if __name__ == "__main__":
    main()
