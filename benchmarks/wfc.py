"""Resets per CPU-second of worlds by Wave Function Collapse, ours and Minigrid's, of the same pictures, taking turns.

    python -m benchmarks.wfc [--short]

Minigrid's package ships no pictures, so it is given ours. Both lay out the same mazes from the same seeds.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from minigrid.envs.wfc import WFCEnv
from minigrid.envs.wfc.config import WFCConfig
from PIL import Image

import minihuman  # noqa: F401
from minihuman.worlds.grid.wfc.family import PICTURES, PRESETS

ROUNDS = 3


def resetting(env: Any, resets: int) -> Callable[[], float]:
    """A round of resets from seed 0: resets per CPU-second."""

    def round_() -> float:
        start = time.process_time()
        for seed in range(resets):
            env.reset(seed=seed)
        return resets / (time.process_time() - start)

    return round_


def main() -> None:
    """Print a table of ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one world, one round: shows only that it runs")
    short = parser.parse_args().short
    print(f"minigrid {version('minigrid')}, networkx {version('networkx')}, numpy {version('numpy')}")
    print("| world | ours: resets/s | Minigrid's | ratio |\n|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, preset in list(PRESETS.items())[: 1 if short else None]:
            path = Path(folder, f"{preset.picture}.png")
            lines = [[255 * (sign != "#") for sign in line] for line in PICTURES[preset.picture].split()]
            Image.fromarray(np.stack([np.array(lines, np.uint8)] * 3, -1)).save(path)
            config = WFCConfig(path, pattern_width=preset.width, output_periodic=preset.periodic)
            ours = resetting(gymnasium.make(f"minihuman/MiniGrid-WFC-{name}-v0").unwrapped, 100)
            theirs = resetting(WFCEnv(config), 2)
            ours()
            rounds = [(ours(), theirs()) for _ in range(1 if short else ROUNDS)]
            mine, its = (statistics.median(rates) for rates in zip(*rounds, strict=True))
            ratio = statistics.median(a / b for a, b in rounds)
            print(f"| {name} | {mine:.0f} | {its:.2f} | {ratio:.0f} |", flush=True)


if __name__ == "__main__":
    main()
