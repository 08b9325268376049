"""How fast pictures are drawn, ours, and ViZDoom's where it is installed; and how batches use a second core.

    python benchmarks/first_person_render.py [WORLD ...] [--display] [--batch 64]

Prints one line a world and size: the median of five rounds over random headings, milliseconds of process CPU time, and
the best of wall time, for a large picture is drawn on all cores. ViZDoom's line is a whole step of its basic scenario
at 160x120 (``make_action`` with frame skip 1), game rules included; its engine is another process, whose CPU time is
read from the system. ``--display`` adds a participant's step and picture at 1920x1080 and 3840x2160; ``--batch`` the
steps a second of so many worlds with 80x60 pictures, on one thread and on two.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import minihuman  # noqa: F401  registers the worlds

SIZES = ((80, 60), (160, 120), (800, 600))
DISPLAYS = ((1920, 1080), (3840, 2160))
WORLDS = ("FourRooms", "Hallway", "Maze", "PickupObjects")
DISPLAYED = ("FourRooms", "Maze", "CollectHealth")


def timed_ms(action: Callable[[], object], repeats: int) -> tuple[float, float]:
    """CPU time, the median of five rounds, and wall time, the best."""
    action()
    cpu, wall = [], []
    for _ in range(5):
        start, begun = time.process_time_ns(), time.perf_counter_ns()
        for _ in range(repeats):
            action()
        cpu.append((time.process_time_ns() - start) / repeats / 1e6)
        wall.append((time.perf_counter_ns() - begun) / repeats / 1e6)
    return statistics.median(cpu), min(wall)


def ours(name: str, size: tuple[int, int], *, step: bool = False) -> tuple[float, float]:
    """Pictures at random headings; with ``step``, a whole step without observation before each."""
    world = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", obs_width=80, obs_height=60).unwrapped
    world.reset(seed=1)
    rng = np.random.default_rng(0)

    def draw() -> None:
        if step and any(world.advance(0)[1:]):
            world.begin(seed=1)
        world.stage.agent.dir = float(rng.uniform(-np.pi, np.pi))
        world.picture(view="partial", size_px=size)

    return timed_ms(draw, max(1, 400_000 // (size[0] * size[1])))


def batch_steps(name: str, count: int, threads: int) -> float:
    """Steps a second of a batch, wall time, the best of twenty rounds."""
    worlds = gymnasium.make_vec(
        f"minihuman/MiniWorld-{name}-v0", num_envs=count, vectorization_mode="vector_entry_point", threads=threads
    )
    worlds.reset(seed=0)
    best = 0.0
    for nth in range(20):
        begun = time.perf_counter()
        worlds.step(np.full(count, nth % 3))
        best = max(best, count / (time.perf_counter() - begun))
    worlds.close()
    return best


def cpu_of_children_s() -> float:
    """CPU time so far of this process's living children; 0 where the system does not tell."""
    total = 0
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == os.getpid():
            total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


def vizdoom_step() -> tuple[str, float, float] | None:
    """Its version, CPU time of both processes and wall time of a step."""
    try:
        import vizdoom
    except ImportError:
        return None
    game = vizdoom.DoomGame()
    game.load_config(str(vizdoom.scenarios_path) + "/basic.cfg")
    game.set_screen_resolution(vizdoom.ScreenResolution.RES_160X120)
    game.set_window_visible(False)
    game.set_doom_config_path(str(Path(tempfile.gettempdir()) / "vizdoom.ini"))  # else it lies where one works
    game.init()
    buttons = [False] * game.get_available_buttons_size()

    def step() -> None:
        if game.is_episode_finished():
            game.new_episode()
        game.make_action(buttons)
        game.get_state()

    step()
    theirs, here = cpu_of_children_s(), time.process_time()
    steps, wall = 3000, float("inf")
    for _ in range(10):
        begun = time.perf_counter()
        for _ in range(steps // 10):
            step()
        wall = min(wall, (time.perf_counter() - begun) / steps * 10)
    cpu = (cpu_of_children_s() - theirs + time.process_time() - here) / steps
    game.close()
    return vizdoom.__version__, 1000 * cpu, 1000 * wall


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worlds", nargs="*", default=WORLDS)
    parser.add_argument("--display", action="store_true")
    parser.add_argument("--batch", type=int, default=0)
    given = parser.parse_args()
    print(f"{'':26}{'ms of CPU':>10}{'ms of wall':>11}")
    for name in given.worlds:
        for size in SIZES:
            print("{:15s} {:4d}x{:<4d} {:10.3f} {:10.3f}".format(name, *size, *ours(name, size)))
    for name in DISPLAYED if given.display else ():
        for size in DISPLAYS:
            print("{:15s} {:4d}x{:<4d} {:10.3f} {:10.3f}".format(name, *size, *ours(name, size, step=True)))
    doom = vizdoom_step()
    print("vizdoom is not installed" if doom is None else "vizdoom {:7s}  160x120  {:10.3f} {:10.3f}".format(*doom))
    for name in given.worlds if given.batch else ():
        one, two = (batch_steps(name, given.batch, threads) for threads in (1, 2))
        print(
            f"{name:15s} batch of {given.batch}: {one:8.0f} steps/s on one thread, {two:8.0f} on two: {two / one:.2f}"
        )


if __name__ == "__main__":
    main()
