"""Make the pictures of these pages again.

python docs/pictures.py FOLDER

Figures and windows need nothing but minihuman; the report's page is photographed by Chromium and the replays by rerun's
viewer, under a virtual display. ``pictures.md`` says the same command by command.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from minihuman.lab.protocol_file import read_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.players.choose import make_player
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.expand import enrol, expand
from minihuman.study.screens import PlayScreen, Screen, TextScreen
from minihuman.study.session import Session
from minihuman.windows.compose import compose
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World

ROOT = Path(__file__).parents[1]
STUDY = "fourrooms-transfer"
WINDOW_PX = (800, 450)


def figures(folder: Path, work: Path) -> None:
    """Figures and the report of ten simulated people."""
    cli = [sys.executable, "-m", "minihuman"]
    people = ["--participants", "10", "--data", str(work)]
    subprocess.run([*cli, "simulate", str(ROOT / f"protocols/{STUDY}.toml"), *people], check=True)
    subprocess.run([*cli, "plot", str(work / STUDY), "--out", str(work / "figures")], check=True)
    one = work / STUDY / "sub-01/ses-01"
    subprocess.run([*cli, "plot", str(one), "--out", str(work / "figures")], check=True)
    for name, pattern in (("learning", "learning_*.png"), ("occupancy", "occupancy_*.png")):
        shutil.copy(sorted((work / "figures").glob(pattern))[-1], folder / f"{name}.png")
    for name in ("overview", "paths"):
        shutil.copy(next((work / "figures").glob(f"*/{name}.png")), folder / f"{name}.png")


def windows(folder: Path) -> None:
    """What a participant of the demo sees, as every window composes it."""
    wanted = {"window_keyboard_check": _is_check, "window_grid": _in_grid, "window_first_person": _in_room}
    for name, is_it in wanted.items():
        screen = next(screen for screen in _screens() if is_it(screen))
        Image.fromarray(compose(screen, WINDOW_PX)).save(folder / f"{name}.png")


def _screens() -> list[Screen]:
    """Every screen of a demo's session, as a simulated person comes past it."""
    protocol = read_protocol(ROOT / "protocols/demo.toml")
    clock = VirtualClock()
    session = Session(expand(protocol, enrol(protocol, 0, None)), World, {}, picture_px=(600, 450))
    seen: list[Screen] = []

    class Watching(SimulatedWindow):
        def show(self, screen: Screen):  # type: ignore[no-untyped-def]
            seen.append(screen)
            return super().show(screen)

    window = Watching(make_player("optimal", np.random.default_rng(1)), session, clock)
    run_session(session, window, MemoryRecorder(), clock)
    return seen


def _is_check(screen: Screen) -> bool:
    return isinstance(screen, TextScreen) and bool(getattr(screen, "keys", ()))


def _in_grid(screen: Screen) -> bool:
    return isinstance(screen, PlayScreen)


def _in_room(screen: Screen) -> bool:
    return isinstance(screen, PlayScreen) and screen.picture.shape[0] != screen.picture.shape[1]  # a grid is square


def main(folder: Path) -> None:
    """Make them all that need no display."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        figures(folder, Path(work))
    windows(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
