"""A gamepad in a pygame window: its buttons and axes by name. The module depends on no session."""

from collections.abc import Iterator

import pygame

# Experimental in pygame-ce, but the only access to SDL's table of gamepads, in which "south" is the same button on each
# gamepad. Gamepads in a window depend on it.
from pygame._sdl2 import controller

from minihuman.errors import WindowError
from minihuman.experiment.keys import PAD_AXES, PAD_DEAD_ZONE, PAD_LEVELS, PadAxes

_BUTTONS = (  # the names of SDL's buttons, by number; two act as keys of the session, and the guide button does nothing
    *("pad_south", "pad_east", "pad_west", "pad_north", "escape", "", "enter", "pad_left_stick", "pad_right_stick"),
    *("pad_left_shoulder", "pad_right_shoulder", "pad_up", "pad_down", "pad_left", "pad_right"),
)
_FULL = 32767  # SDL's number for an axis at its end
GAMEPAD_EVENTS = (
    *(
        pygame.JOYAXISMOTION,
        pygame.JOYBUTTONDOWN,
        pygame.JOYBUTTONUP,
        pygame.JOYHATMOTION,
    ),  # SDL derives its controller events from these
    *(pygame.CONTROLLERAXISMOTION, pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP),
    *(pygame.CONTROLLERDEVICEADDED, pygame.CONTROLLERDEVICEREMOVED),
)


class Gamepad:
    """The first connected gamepad; if it is disconnected, the next one takes its place.

    Raises:
        WindowError: if no gamepad is connected.
    """

    def __init__(self) -> None:
        controller.init()
        self._axes = PadAxes()
        self._held_axes: set[str] = set()  # axes not at rest when the focus was lost, and not since
        self._pad = self._open()
        if self._pad is None:
            controller.quit()
            raise WindowError("the protocol needs a gamepad, but none is connected; connect one that SDL knows")
        pygame.event.set_allowed(GAMEPAD_EVENTS)

    @staticmethod
    def _open() -> "controller.Controller | None":
        """Open the first connected gamepad that SDL knows; return None if there is none."""
        for number in range(controller.get_count()):
            if controller.is_controller(number):
                return controller.Controller(number)
        return None

    def facts(self) -> dict[str, str]:
        """Return the gamepad's name, axes, dead zone and polling rate, as facts for the log."""
        assert self._pad is not None
        return {
            "gamepad": self._pad.name,
            "gamepad_axes": f"{', '.join(PAD_AXES)}: -1 to 1 of 65536 levels, logged in steps of 1/{PAD_LEVELS}",
            "gamepad_dead_zone": f"{PAD_DEAD_ZONE}",
            "gamepad_polling": "each millisecond by SDL while the session waits for input",
        }

    def read(self, event: pygame.event.Event) -> Iterator[tuple[str, bool | float]]:
        """Yield the buttons that an event presses (name, True) or releases (name, False), and axes (name, position).

        If the event says that a gamepad was connected or disconnected, open the first one that is connected now.
        """
        match event.type:
            case pygame.CONTROLLERBUTTONDOWN | pygame.CONTROLLERBUTTONUP:
                if event.button < len(_BUTTONS) and _BUTTONS[event.button]:
                    yield _BUTTONS[event.button], event.type == pygame.CONTROLLERBUTTONDOWN
            case pygame.CONTROLLERAXISMOTION if event.axis < len(PAD_AXES):
                axis = PAD_AXES[event.axis]
                position, buttons = self._axes.move(axis, event.value / _FULL)
                if position is not None and axis not in self._held_axes:
                    yield axis, position
                elif position == 0:
                    self._held_axes.discard(axis)
                yield from buttons
            case pygame.CONTROLLERDEVICEADDED if self._pad is None:
                self._pad = self._open()
            case pygame.CONTROLLERDEVICEREMOVED if self._pad is not None and not self._pad.attached():
                self._pad = self._open()

    def lose_focus(self) -> list[str]:
        """Return the axes that are not at rest when the window loses the focus.

        They report nothing until they have been at rest again.
        """
        self._held_axes.update(self._axes.moved)
        return self._axes.moved

    def close(self) -> None:
        """Close SDL's gamepad support."""
        controller.quit()
