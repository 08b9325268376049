"""How far pictures are from what an eye would see, standing still and turning; each look in turn, in one run.

    python -m benchmarks.picture_quality [WORLD ...] [--frames 24] [--short]

A picture of 960x540 is compared with the same picture at sixteen times the samples: drawn at 3840x2160 and averaged,
in the same look. ``error`` is the mean difference of a channel, of 255. ``flicker`` is how much that difference changes
from one frame to the next in a turn of 0.3 degrees a frame: what stands still in the world and moves in the error is
seen as shimmer. Then the time of a picture of 1920x1080, milliseconds of process CPU (median of five rounds) and of
wall (best), which depends on how busy the machine is. ``--short`` shows that everything runs, and measures nothing.
"""

import argparse
import math
import os
import platform
from importlib.metadata import version

import gymnasium
import numpy as np
from numpy.typing import NDArray

import minihuman
from benchmarks.first_person_render import timed_ms

LOOKS = ("classic", "display")
WORLDS = ("FourRooms", "Maze", "Hallway", "CollectHealth", "PickupObjects", "YMaze")
SIZE, FINE = (960, 540), 4
TURN_RAD = math.radians(0.3)


def averaged(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Each square of ``FINE`` x ``FINE`` pixels as one."""
    high, wide = picture.shape[0] // FINE, picture.shape[1] // FINE
    return picture.reshape(high, FINE, wide, FINE, 3).astype(np.float32).mean(axis=(1, 3))


def errors(name: str, look: str, frames: int) -> tuple[float, float]:
    """Error and flicker over a turn, and over one more from another heading."""
    world = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", **({} if look == "classic" else {"look": look})).unwrapped
    world.reset(seed=1)
    begin_rad, off, changes = world.agent.dir, [], []
    for turn in range(2):
        before = None
        for frame in range(frames):
            world.agent.dir = begin_rad + 2.0 * turn + TURN_RAD * frame
            fine = averaged(world.picture(size_px=(FINE * SIZE[0], FINE * SIZE[1])))
            error = world.picture(size_px=SIZE).astype(np.float32) - fine
            off.append(float(np.abs(error).mean()))
            if before is not None:
                changes.append(float(np.abs(error - before).mean()))
            before = error
    return sum(off) / len(off), sum(changes) / len(changes)


def time_ms(name: str, look: str, repeats: int) -> tuple[float, float]:
    """CPU and wall time of a picture at 1920x1080, at random headings."""
    world = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", **({} if look == "classic" else {"look": look})).unwrapped
    world.reset(seed=1)
    rng = np.random.default_rng(0)

    def draw() -> None:
        world.agent.dir = float(rng.uniform(-np.pi, np.pi))
        world.picture(size_px=(1920, 1080))

    return timed_ms(draw, repeats)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--short", action="store_true")
    given = parser.parse_args()
    frames, repeats = (2, 1) if given.short else (given.frames, 10)
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    print(f"minihuman {minihuman.__version__}, {packages}; Python {platform.python_version()}; {platform.machine()}")
    print(f"{os.cpu_count()} cores", f"load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "")
    print(f"{'':26}{'error':>8}{'flicker':>9}{'CPU ms':>9}{'wall ms':>9}")
    for name in given.worlds[:1] if given.short else given.worlds:
        for look in LOOKS:
            row = (*errors(name, look, frames), *time_ms(name, look, repeats))
            print("{:16s}{:10s}{:8.2f}{:9.2f}{:9.1f}{:9.1f}".format(name, look, *row))


if __name__ == "__main__":
    main()
