"""A gamepad at this machine, by SDL: its buttons as keys, its sticks and triggers as axes. Knows no actions."""

from collections.abc import Iterator

import pygame

# Experimental in pygame-ce, but the one way to SDL's table of gamepads, by which "south" is south on every one; if it
# goes, so do gamepads in a window.
from pygame._sdl2 import controller

from minihuman.errors import WindowError
from minihuman.experiment.keys import PAD_AXES, PAD_DEAD_ZONE, PAD_LEVELS, PadAxes

_BUTTONS = (  # in SDL's order; two of them do what the session asks keys for
    *("pad_south", "pad_east", "pad_west", "pad_north", "escape", "", "enter", "pad_left_stick", "pad_right_stick"),
    *("pad_left_shoulder", "pad_right_shoulder", "pad_up", "pad_down", "pad_left", "pad_right"),
)
_FULL = 32767
GAMEPAD_EVENTS = (
    *(
        pygame.JOYAXISMOTION,
        pygame.JOYBUTTONDOWN,
        pygame.JOYBUTTONUP,
        pygame.JOYHATMOTION,
    ),  # SDL makes its own of these
    *(pygame.CONTROLLERAXISMOTION, pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP),
    *(pygame.CONTROLLERDEVICEADDED, pygame.CONTROLLERDEVICEREMOVED),
)


class Gamepad:
    """The first gamepad that is connected; another takes its place if it goes.

    Raises:
        WindowError: if none is connected.
    """

    def __init__(self) -> None:
        controller.init()
        self._axes = PadAxes()
        self._pad = self._open()
        if self._pad is None:
            controller.quit()
            raise WindowError("the protocol needs a gamepad, but none is connected; connect one that SDL knows")
        pygame.event.set_allowed(GAMEPAD_EVENTS)

    @staticmethod
    def _open() -> "controller.Controller | None":
        found = [number for number in range(controller.get_count()) if controller.is_controller(number)]
        return controller.Controller(found[0]) if found else None

    def facts(self) -> dict[str, str]:
        """Device, axes, dead zone and how often it is read."""
        assert self._pad is not None
        return {
            "gamepad": self._pad.name,
            "gamepad_axes": f"{', '.join(PAD_AXES)}: -1 to 1 of 65536 levels, logged in steps of 1/{PAD_LEVELS}",
            "gamepad_dead_zone": f"{PAD_DEAD_ZONE}",
            "gamepad_polling": "each millisecond by SDL while the session waits for input",
        }

    def read(self, event: pygame.event.Event) -> Iterator[tuple[str, bool | float]]:
        """The buttons that an event presses (True) or releases (False), and the axis that it moves, by name."""
        match event.type:
            case pygame.CONTROLLERBUTTONDOWN | pygame.CONTROLLERBUTTONUP:
                name = _BUTTONS[event.button] if event.button < len(_BUTTONS) else ""
                if name:
                    yield name, event.type == pygame.CONTROLLERBUTTONDOWN
            case pygame.CONTROLLERAXISMOTION if event.axis < len(PAD_AXES):
                value, buttons = self._axes.move(PAD_AXES[event.axis], event.value / _FULL)
                if value is not None:
                    yield PAD_AXES[event.axis], value
                yield from buttons
            case pygame.CONTROLLERDEVICEADDED if self._pad is None:
                self._pad = self._open()
            case pygame.CONTROLLERDEVICEREMOVED if self._pad is not None and not self._pad.attached():
                self._pad = self._open()

    def close(self) -> None:
        """Let go of it."""
        controller.quit()
