"""A session in a pygame window without a display, played with a gamepad of SDL's own: `python -m ... FOLDER [TOML]`.

Prints, as JSON, when each button was pressed by the session's clock, ns.
"""

import ctypes
import json
import os
import sys
import threading
from pathlib import Path

os.environ["SDL_VIDEODRIVER"] = "dummy"

import pygame

from minihuman.display.windows.pygame_window import PygameWindow
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock

SOUTH, START = 0, 6  # in SDL's order
PROTOCOL = """
[study]
name = "pad"
version = "1"
seed = 1
closing = ""
[keys]
pool = ["pad_south", "stick_up"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["levers"]
[[blocks]]
name = "levers"
world = "tests.worlds.levers:tests/Levers-v0"
success = "terminated and reward > 0"
options = { kind = "box" }
episodes = 1
actions = ["axis_1_plus"]
key_map = "fixed"
fixed_keys = { pad_south = "axis_1_plus" }
max_steps = 60
pace = "real_time"
step_period_ms = 25
noop_action = "rest"
hold = "repeat"
final_frame_ms = 0
axes = { pad_left_x = { component = 0, scale = -1.0 } }
"""


class VirtualGamepad:
    """A gamepad of SDL's own, on the library that pygame has loaded."""

    def __init__(self) -> None:
        maps = Path("/proc/self/maps").read_text().split()
        self._sdl = ctypes.CDLL(next(path for path in maps if "libSDL2-2" in path))
        self._sdl.SDL_JoystickFromInstanceID.restype = ctypes.c_void_p
        pygame.joystick.init()
        assert self._sdl.SDL_JoystickAttachVirtual(1, 6, 15, 0) >= 0

    @property
    def _pad(self) -> ctypes.c_void_p:
        return ctypes.c_void_p(self._sdl.SDL_JoystickFromInstanceID(0))

    def press(self, button: int, down: bool) -> None:
        self._sdl.SDL_JoystickSetVirtualButton(self._pad, button, int(down))

    def move(self, axis: int, value: float) -> None:
        self._sdl.SDL_JoystickSetVirtualAxis(self._pad, axis, round(value * 32767))


def main(data: Path, protocol: str = PROTOCOL) -> None:
    clock = SessionClock()
    window = PygameWindow(clock, size_px=(320, 240))
    pad, over, pressed_ns = VirtualGamepad(), threading.Event(), []

    def play() -> None:
        while not over.wait(0.05):
            for button in (START, SOUTH):
                pressed_ns.append((button, clock()))
                pad.press(button, True)
                pad.move(0, 0.55)
                over.wait(0.043)
                pad.press(button, False)
                pad.move(0, -0.05)
                over.wait(0.017)

    study = decode_protocol(protocol.encode())
    plan = expand_protocol(study, enrol_participant(study, 0))
    player = threading.Thread(target=play)
    player.start()
    try:
        host_session(plan, window, clock, data)
    finally:
        over.set()
        player.join()
        window.close()
    print(json.dumps([t_ns for button, t_ns in pressed_ns if button == SOUTH]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), *(Path(name).read_text() for name in sys.argv[2:]))
