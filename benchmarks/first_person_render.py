"""How fast pictures are drawn: milliseconds of CPU a picture, ours, and ViZDoom's where it is installed.

    python benchmarks/first_person_render.py [WORLD ...]

Prints one line a world and size: the median of five rounds of process CPU time over random headings. ViZDoom's line is
a whole step of its basic scenario at 160x120 (``make_action`` with frame skip 1), game rules included.
"""

import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import minihuman  # noqa: F401  registers the worlds

SIZES = ((80, 60), (160, 120), (800, 600))
WORLDS = ("FourRooms", "Hallway", "Maze", "PickupObjects")


def cpu_ms(action: Callable[[], object], repeats: int) -> float:
    action()
    rounds = []
    for _ in range(5):
        start = time.process_time_ns()
        for _ in range(repeats):
            action()
        rounds.append((time.process_time_ns() - start) / repeats / 1e6)
    return statistics.median(rounds)


def ours(name: str, size: tuple[int, int]) -> float:
    world = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", obs_width=size[0], obs_height=size[1]).unwrapped
    world.reset(seed=1)
    rng = np.random.default_rng(0)

    def draw() -> None:
        world.stage.agent.dir = float(rng.uniform(-np.pi, np.pi))
        world.picture(view="partial", size_px=size)

    return cpu_ms(draw, max(1, 400_000 // (size[0] * size[1])))


def vizdoom_step() -> float | None:
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

    # its engine is another process, so wall time stands for CPU time
    step()
    start = time.perf_counter_ns()
    for _ in range(500):
        step()
    taken = (time.perf_counter_ns() - start) / 500 / 1e6
    game.close()
    return taken


if __name__ == "__main__":
    for name in sys.argv[1:] or WORLDS:
        for size in SIZES:
            print(f"{name:15s} {size[0]:4d}x{size[1]:<4d} {ours(name, size):8.3f} ms")
    doom = vizdoom_step()
    print("vizdoom basic    160x120  " + ("is not installed" if doom is None else f"{doom:8.3f} ms"))
