import os
import subprocess
import sys
import time

import pytest

from minihuman.display.windows.blocking_window import list_windows, open_window
from minihuman.errors import WindowError
from tests.counts import PATIENCE_S

pytestmark = pytest.mark.program


def test_both_toolkits_are_installed_pygame_first() -> None:
    assert list_windows()[:2] == ("pygame", "pyglet")


def test_an_unknown_window_is_named_with_those_there_are() -> None:
    with pytest.raises(WindowError, match=r"unknown window 'sdl'; use one of auto, pygame, pyglet"):
        open_window("sdl", time.monotonic_ns)


@pytest.mark.parametrize("window", ["auto", "pygame", "pyglet"])
def test_without_a_display_one_clear_line_and_exit_2(window: str) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "minihuman", "play", "minihuman/MiniGrid-FourRooms-v0", "--window", window]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2
    said = [line for line in done.stderr.splitlines() if line.startswith("minihuman: ")]
    assert len(said) == 1
    assert "cannot open a window here" in said[0]
    assert "simulate" in said[0]
    assert "Traceback" not in done.stderr
