"""Latency that a process of its own adds to a foreign world's shown step, and the memory of that process; in one run.

    python -m benchmarks.world_processes [WORLD ...] [--steps 1000]

A shown step is a step and its picture. Each is done twice with the same seed and action, once in this process and once
in a world's own, in turn first. ``here`` and ``there`` are medians in milliseconds; ``added`` is the median of the
differences, then that of the 10th and 95th percentiles. ``CPU`` is what a shown step costs more in CPU time, both
processes counted. ``own`` is the process's memory that no other shares, ``at most`` its peak with what it shares with
the process from which it is forked. On a machine that other programs keep busy, a process waits for a core twice a
step, which is their cost, not its own: there, run it before them (``nice -n -10``). Linux only.
"""

import argparse
import platform
import time
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

import minihuman
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation.isolated_world import IsolatedWorld, IsolatedWorlds
from minihuman.worlds.isolation.process_pool import MIB

WORLDS = ("CartPole-v1", "MountainCar-v0", "FrozenLake-v1", "minigrid:MiniGrid-DoorKey-8x8-v0")


def time_shown_step(world: World, action: int) -> tuple[float, bool]:
    """Step a world and draw it; return the time in milliseconds, and whether the episode is over."""
    started_s = time.perf_counter()
    taken = world.step(action)
    world.frame()
    return 1000 * (time.perf_counter() - started_s), taken.terminated or taken.truncated


@dataclass(frozen=True, slots=True)
class Costs:
    """What a world's shown steps cost here and in a process of its own."""

    ms: np.ndarray  # [2, steps]
    cpu_ms: tuple[float, float]  # a step
    own_mib: float
    peak_mib: float

    def __str__(self) -> str:
        here, there = np.median(self.ms, axis=1)
        added = float(np.median(self.ms[1] - self.ms[0]))
        low, high = (float(np.diff(np.quantile(self.ms, share, axis=1))[0]) for share in (0.1, 0.95))
        cpu = self.cpu_ms[1] - self.cpu_ms[0]
        times = "".join(f"{ms:8.2f}" for ms in (here, there, added, low, high, cpu))
        return f"{times}{self.own_mib:9.0f}{self.peak_mib:9.0f}"


def time_steps(world_id: str, steps: int, worlds: IsolatedWorlds) -> Costs:
    """Time a world here and in a process of its own."""
    rng = np.random.default_rng(1)
    ms = np.empty((2, steps))
    cpu_s = [0.0, 0.0]
    with closing(World(world_id)) as here, closing(worlds(world_id, {})) as there:
        assert isinstance(there, IsolatedWorld), f"{world_id} runs in this process"
        for world in (here, there):
            world.reset(1)
            world.frame()  # the first picture opens what draws
        reply_before = there._process.reply.cpu_s
        for step in range(steps):
            action = int(rng.choice(len(here.action_names)))
            order = (0, 1) if step % 2 else (1, 0)
            for place in order:
                started_s = time.process_time()
                ms[place, step], is_over = time_shown_step((here, there)[place], action)
                cpu_s[place] += time.process_time() - started_s
            if is_over:
                here.reset(step)
                there.reset(step)
        cpu_s[1] += there._process.reply.cpu_s - reply_before
        own = sum(_read_kib(there.pid, part) for part in ("Private_Clean", "Private_Dirty")) / 1024
        peak = there._process.reply.peak_bytes / MIB
    return Costs(ms, (1000 * cpu_s[0] / steps, 1000 * cpu_s[1] / steps), own, peak)


def _read_kib(pid: int, part: str) -> int:
    lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{part}:"))


def main() -> None:
    """Print a line per world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--steps", type=int, default=1000)
    arguments = parser.parse_args()
    packages = ", ".join(f"{name} {version(name)}" for name in ("gymnasium", "numpy"))
    print(f"minihuman {minihuman.__version__}, {packages}; Python {platform.python_version()}; {platform.machine()}")
    columns = ("here", "there", "added", "10 %", "95 %", "CPU")
    print(f"{'ms per shown step':36}{''.join(f'{name:>8}' for name in columns)}{'own MiB':>9}{'at most':>9}")
    with closing(IsolatedWorlds(World)) as worlds:
        for world_id in arguments.worlds:
            print(f"{world_id:36}{time_steps(world_id, arguments.steps, worlds)}", flush=True)


if __name__ == "__main__":
    main()
