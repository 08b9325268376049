"""Speed of this checkout's compiled worlds beside another checkout's: CPU-seconds of the same play, in turn.

    python -m benchmarks.library_speed OTHER_CHECKOUT [--only PART] [--rounds 15] [--short]

Each checkout plays in a process of its own, with the library in its ``minihuman/worlds/compiled``, so a library of
older processors is measured where that folder holds it alone. Each line is the median over rounds in which first the
one, then the other plays, and the ratio of speeds: above 1, ours is faster.
"""

import argparse
import os
import platform
import statistics
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).parents[1]
PLAYER = """
import sys, time, warnings
warnings.simplefilter("ignore")
import gymnasium, numpy as np
gymnasium.logger.min_level = gymnasium.logger.ERROR
import minihuman
from minihuman.worlds import kernels
library = kernels._library()
assert library is not None and library.has_all, "the library is not of this checkout's sources; build it"

def steps(name, count, **options):
    env = gymnasium.make(f"minihuman/{name}", **options)
    actions = np.random.default_rng(0).integers(0, env.action_space.n, count).tolist()
    def play():
        env.reset(seed=0)
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
    return play

def resets(name, count):
    env = gymnasium.make(f"minihuman/{name}")
    def play():
        env.reset(seed=0)
        for _ in range(count):
            env.reset()
    return play

def batch(name, count, size):
    worlds = gymnasium.make_vec(
        f"minihuman/{name}", num_envs=size, vectorization_mode="vector_entry_point", threads=1
    )
    actions = np.random.default_rng(0).integers(0, worlds.single_action_space.n, (count, size))
    def play():
        worlds.reset(seed=0)
        for row in actions:
            worlds.step(row)
    return play

def pictures(name, count, size_px):
    env = gymnasium.make(f"minihuman/{name}").unwrapped
    def play():
        env.reset(seed=0)
        for number in range(count):
            if any(env.step(number % 3)[2:4]):
                env.reset()
            env.picture(size_px=size_px)
    return play

parts = {}
for line in sys.stdin:
    part = line.strip()
    if part not in parts:
        parts[part] = eval(part)
        parts[part]()
    start = time.process_time()
    parts[part]()
    print(time.process_time() - start, flush=True)
"""
PARTS = {
    "grid, FourRooms": "steps('MiniGrid-FourRooms-v0', {})",
    "grid, DoorKey-8x8": "steps('MiniGrid-DoorKey-8x8-v0', {})",
    "grid, BabyAI BossLevel": "steps('BabyAI-BossLevel-v0', {})",
    "grid, FourRooms, reset": "resets('MiniGrid-FourRooms-v0', {} // 4)",
    "grid, BossLevel, reset": "resets('BabyAI-BossLevel-v0', {} // 40)",
    "grid, FourRooms, batch of 64": "batch('MiniGrid-FourRooms-v0', {} // 10, 64)",
    "grid, FourRooms, batch of 1,024": "batch('MiniGrid-FourRooms-v0', {} // 100, 1024)",
    "grid, DoorKey-8x8, batch of 1,024": "batch('MiniGrid-DoorKey-8x8-v0', {} // 100, 1024)",
    "grid, BabyAI GoTo, batch of 1,024": "batch('BabyAI-GoTo-v0', {} // 100, 1024)",
    "grid, FourRooms, pictures of 480 x 480": "pictures('MiniGrid-FourRooms-v0', {} // 20, (480, 480))",
    "first person, FourRooms, 80 x 60": "steps('MiniWorld-FourRooms-v0', {} // 20)",
    "first person, Maze, 80 x 60": "steps('MiniWorld-Maze-v0', {} // 20)",
    "first person, Maze, reset": "resets('MiniWorld-Maze-v0', {} // 200)",
    "first person, FourRooms, batch of 64": "batch('MiniWorld-FourRooms-v0', {} // 1000, 64)",
    "first person, PickupObjects, batch of 64": "batch('MiniWorld-PickupObjects-v0', {} // 1000, 64)",
    "first person, FourRooms, 960 x 540": "pictures('MiniWorld-FourRooms-v0', {} // 400, (960, 540))",
}


class Player:
    """A process that plays with one checkout's worlds."""

    def __init__(self, checkout: Path) -> None:
        environment = os.environ | {"PYTHONPATH": str(checkout)}
        self._process = subprocess.Popen(
            [sys.executable, "-c", PLAYER], cwd=checkout, env=environment, text=True, bufsize=1,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        )  # fmt: skip

    def cpu_s(self, part: str) -> float:
        """CPU-seconds that a part takes; the first time, it is played once before."""
        print(part, file=self._process.stdin, flush=True)
        return float(self._process.stdout.readline())

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path, metavar="OTHER_CHECKOUT")
    parser.add_argument("--ours", type=Path, default=HERE, help="instead of this checkout")
    parser.add_argument("--only", default="", help="parts with this in their name")
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--short", action="store_true", help="one round of few steps: it shows that everything runs")
    arguments = parser.parse_args()
    count, rounds = (1_000, 1) if arguments.short else (100_000, arguments.rounds)
    checkouts = {"ours": arguments.ours.resolve(), "other": arguments.other.resolve()}
    for side, checkout in checkouts.items():
        libraries = sorted(path.name for path in (checkout / "minihuman/worlds/compiled").glob("kernels-*"))
        print(f"{side}: {checkout}, {', '.join(libraries)}")
    print(f"Python {platform.python_version()}, load {os.getloadavg()[0]:.1f}, {time.strftime('%F')}")
    ours, other = (Player(checkout) for checkout in checkouts.values())
    print(f"{'':44}{'ours: CPU s':>12}{'other':>10}{'ratio':>8}")
    for name, part in PARTS.items():
        if arguments.only not in name:
            continue
        pairs = [(ours.cpu_s(part.format(count)), other.cpu_s(part.format(count))) for _ in range(rounds)]
        ours_s, other_s = (statistics.median(column) for column in zip(*pairs, strict=True))
        ratio = statistics.median(other_cpu_s / ours_cpu_s for ours_cpu_s, other_cpu_s in pairs)
        print(f"{name:44}{ours_s:12.4f}{other_s:10.4f}{ratio:8.3f}", flush=True)
    ours.close()
    other.close()


if __name__ == "__main__":
    main()
