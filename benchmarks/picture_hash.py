"""CPU time that a picture's hash adds to a step that is shown: step, render, encode for the page; in one run.

    python -m benchmarks.picture_hash [WORLD ...] [--steps 1000]

Every picture of a world that is not ours is hashed for the log. The page's cache of images tells pictures apart by the
same hash, and takes the log's where there is one. ``encode`` is a picture that is not hashed for the log, ``hashed``
one that is, each a copy of the same picture, and in turn first; their difference is what the log's hash adds, as a
share of the step without it. The copy that a transposed picture needs is counted with the rendering: the encoder makes
it in any case.
"""

import argparse
import platform
import time
from collections.abc import Callable
from contextlib import closing
from importlib.metadata import version
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

import minihuman
from minihuman.web.screen_values import ImageCache
from minihuman.worlds.adapters.world import World
from minihuman.worlds.picture_hash import hash_picture

WORLDS = ("CartPole-v1", "MountainCar-v0", "FrozenLake-v1", "minigrid:MiniGrid-DoorKey-8x8-v0")
PARTS = ("step", "render", "encode", "hashed")
T = TypeVar("T")


def send_picture(picture: NDArray[np.uint8], *, is_hashed: bool) -> None:
    """Encode a picture as the page is sent it, with the log's hash or without."""
    picture_hash = hash_picture(picture) if is_hashed else 0
    ImageCache().number(picture, picture_hash=picture_hash)


def time_parts(world_id: str, steps: int) -> dict[str, float]:
    """Measure a world's parts of a shown step: process CPU in microseconds per step."""
    spent_ns = dict.fromkeys(PARTS, 0)

    def timed(part: str, call: Callable[[], T]) -> T:
        started_ns = time.process_time_ns()
        returned = call()
        spent_ns[part] += time.process_time_ns() - started_ns
        return returned

    rng = np.random.default_rng(1)
    with closing(World(world_id)) as world:
        world.reset(1)
        hash_picture(world.frame())  # the first picture opens what draws
        for step in range(steps):
            action = int(rng.choice(len(world.action_names)))
            taken = timed("step", lambda action=action: world.step(action))
            picture = timed("render", lambda: np.ascontiguousarray(world.frame()))
            for part in ("encode", "hashed") if step % 2 else ("hashed", "encode"):
                picture = picture.copy()
                picture[0, 0] = step % 251, step // 251, part == "hashed"  # new to the cache of all sessions
                timed(part, lambda part=part, picture=picture: send_picture(picture, is_hashed=part == "hashed"))
            if taken.terminated or taken.truncated:
                world.reset(step)
    return {part: spent / steps / 1000 for part, spent in spent_ns.items()}


def main() -> None:
    """Print a line per world."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--steps", type=int, default=1000)
    arguments = parser.parse_args()
    packages = ", ".join(f"{name} {version(name)}" for name in ("gymnasium", "numpy", "xxhash"))
    print(f"minihuman {minihuman.__version__}, {packages}; Python {platform.python_version()}; {platform.machine()}")
    print(f"{'CPU us per shown step':36}{'step':>8}{'render':>8}{'encode':>8}{'hashed':>8}{'added %':>9}")
    for world_id in arguments.worlds:
        us = time_parts(world_id, arguments.steps)
        shown_us = us["step"] + us["render"] + us["encode"]
        columns = "".join(f"{us[part]:8.0f}" for part in PARTS)
        print(f"{world_id:36}{columns}{100 * (us['hashed'] - us['encode']) / shown_us:9.2f}")


if __name__ == "__main__":
    main()
