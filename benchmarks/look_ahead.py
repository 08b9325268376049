"""What a step of looking ahead costs: save, a step without observation, the picture a person would see, restore.

Microseconds of CPU time, one thread, the best of a few rounds:

    python -m benchmarks.look_ahead [--rounds 5] [--steps 200]
"""

import argparse
import platform
import time

import gymnasium

import minihuman
from minihuman.worlds.contract import NativeWorld

WORLDS = {
    "MiniGrid-FourRooms-v0": (224, 224),
    "MiniGrid-DoorKey-8x8-v0": (224, 224),
    "MiniGrid-Dynamic-Obstacles-8x8-v0": (224, 224),
    "MiniWorld-FourRooms-v0": (80, 60),
    "MiniWorld-Maze-v0": (80, 60),
    "MiniWorld-PickupObjects-v0": (80, 60),
}
PARTS = ("save", "advance", "picture", "restore")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--steps", type=int, default=200)
    asked = parser.parse_args()
    print(f"minihuman {minihuman.__version__}, Python {platform.python_version()}, us of CPU time")
    print(f"{'world':36} {'picture':>9} " + " ".join(f"{name:>8}" for name in (*PARTS, "all", "scene")))
    for name, size_px in WORLDS.items():
        best = [
            min(column)
            for column in zip(*(measure(name, size_px, asked.steps) for _ in range(asked.rounds)), strict=True)
        ]
        *parts, together, scene = best
        cells = " ".join(f"{value:8.1f}" for value in (*parts, together, scene))
        print(f"{name:36} {size_px[0]:4} x {size_px[1]:3} {cells}", flush=True)


def measure(name: str, size_px: tuple[int, int], steps: int) -> list[float]:
    """Microseconds of each part, of all in a row, and of a scene's hash."""
    env = gymnasium.make(f"minihuman/{name}", disable_env_checker=True).unwrapped
    assert isinstance(env, NativeWorld)
    env.reset(seed=0)
    env.picture(size_px=size_px), env.restore(env.save()), env.scene_hash()
    spent = [0.0] * 6
    for step in range(steps):
        action = step % 3
        start = time.process_time_ns()
        saved = env.save()
        spent[0] += time.process_time_ns() - start
        start = time.process_time_ns()
        env.advance(action)
        spent[1] += time.process_time_ns() - start
        start = time.process_time_ns()
        env.picture(size_px=size_px)
        spent[2] += time.process_time_ns() - start
        start = time.process_time_ns()
        env.restore(saved)
        spent[3] += time.process_time_ns() - start
    start = time.process_time_ns()
    for step in range(steps):
        saved = env.save()
        env.advance(step % 3)
        env.picture(size_px=size_px)
        env.restore(saved)
    spent[4] = time.process_time_ns() - start
    start = time.process_time_ns()
    for _ in range(steps):
        env.scene_hash()
    spent[5] = time.process_time_ns() - start
    return [value / steps / 1000 for value in spent]


if __name__ == "__main__":
    main()
