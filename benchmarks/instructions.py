"""Steps and resets per CPU-second of levels with instructions, ours and Minigrid's, in one process, taking turns.

    python -m benchmarks.instructions [--short]

Steps are of random play without resets; resets go on with the random stream. Each ratio is the median over rounds.
"""

import argparse
import contextlib
import io
import statistics
import time
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import minigrid  # noqa: F401
import numpy as np

import minihuman  # noqa: F401

LEVELS = ("GoTo-v0", "Unlock-v0", "BossLevel-v0", "PutNextLocal-v0")
ROUNDS = 5
N = 64


def stepping(env: Any, steps: int) -> Callable[[], float]:
    """A round of random play: steps per CPU-second, resets left out."""
    actions = np.random.default_rng(0).integers(0, 7, steps).tolist()

    def round_() -> float:
        env.reset(seed=0)
        spent, start = 0.0, time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                spent += time.process_time() - start
                env.reset()
                start = time.process_time()
        return steps / (spent + time.process_time() - start)

    return round_


def resetting(env: Any, resets: int) -> Callable[[], float]:
    """A round of resets: resets per CPU-second."""

    def round_() -> float:
        env.reset(seed=0)
        start = time.process_time()
        for _ in range(resets):
            env.reset()
        return resets / (time.process_time() - start)

    return round_


def batched(batch: Any, steps: int) -> Callable[[], float]:
    """A round of random play in a batch, resets included: steps per CPU-second."""
    actions = np.random.default_rng(0).integers(0, 7, (steps, N))

    def round_() -> float:
        batch.reset(seed=0)
        start = time.process_time()
        for each in actions:
            batch.step(each)
        return steps * N / (time.process_time() - start)

    return round_


def main() -> None:
    """Print a table of ratios, and of what they are ratios of."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one level, one round: shows only that it runs")
    short = parser.parse_args().short
    warnings.simplefilter("ignore")
    print("| level | steps | resets | batch of 64, resets included | Minigrid: steps/s, resets/s, both |")
    print("|---|---|---|---|---|")
    for name in LEVELS[:1] if short else LEVELS:
        ours, theirs = gymnasium.make(f"minihuman/BabyAI-{name}"), gymnasium.make(f"BabyAI-{name}").unwrapped
        batch = gymnasium.make_vec(
            f"minihuman/BabyAI-{name}", num_envs=N, vectorization_mode="vector_entry_point", autoreset_mode="SameStep"
        )
        both = _both(theirs, 1500)
        pairs = (
            (stepping(ours, 20_000), stepping(theirs, 1500)),
            (resetting(ours, 1500), resetting(theirs, 30)),
            (batched(batch, 600), both),
        )
        ratios, rates = [], []
        with contextlib.redirect_stdout(io.StringIO()):  # Minigrid prints every layout that it rejects
            for one, other in pairs:
                one(), other()
                rounds = [(one(), other()) for _ in range(1 if short else ROUNDS)]
                ratios.append(statistics.median(a / b for a, b in rounds))
                rates.append(statistics.median(b for _, b in rounds))
        told = [*(f"{ratio:.0f}" for ratio in ratios), ", ".join(f"{rate:.0f}" for rate in rates)]
        print("|", name, "|", " | ".join(told), "|", flush=True)


def _both(env: Any, steps: int) -> Callable[[], float]:
    """A round of random play with its resets: steps per CPU-second."""
    actions = np.random.default_rng(0).integers(0, 7, steps).tolist()

    def round_() -> float:
        env.reset(seed=0)
        start = time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return steps / (time.process_time() - start)

    return round_


if __name__ == "__main__":
    main()
