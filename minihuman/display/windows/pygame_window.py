"""The window in pygame-ce (SDL 2). Keys are identified by position (scancode), whatever the layout."""

import os
import sys
import time
from collections.abc import Iterator

import numpy as np
import pygame
from numpy.typing import NDArray

# Experimental in pygame-ce, but the one way to SDL's table of gamepads, by which "south" is south on every one; if it
# goes, so do gamepads in a window.
from pygame._sdl2 import controller

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.blocking_window import DEFAULT_SIZE_PX, TITLE, BlockingWindow
from minihuman.display.windows.keyboard import (
    MAIN_BUTTON,
    ON_RECEIPT,
    SERVER_TIME,
    X11KeyTimes,
    key_from_scancode,
    key_to_scancode,
)
from minihuman.display.windows.window import Clock
from minihuman.errors import WindowError
from minihuman.experiment.keys import PAD_AXES, PAD_DEAD_ZONE, PAD_LEVELS, PadAxes
from minihuman.experiment.machine.inputs import (
    AxisChanged,
    Input,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    Stop,
)

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


_NS_PER_MS = 1_000_000
_SAY_WHERE = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")
_NO_DISPLAY = ("offscreen", "dummy")  # what SDL falls back to by itself
_TO_REPAINT = (  # after these SDL's surface may be another, and black
    pygame.WINDOWEXPOSED,
    pygame.WINDOWSHOWN,
    pygame.WINDOWRESTORED,
    pygame.WINDOWSIZECHANGED,
    pygame.WINDOWDISPLAYCHANGED,
)
_KEYS = (pygame.KEYDOWN, pygame.KEYUP)
_POINTER = (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION, pygame.MOUSEBUTTONUP)
_EVENTS = (
    *_KEYS,
    pygame.WINDOWFOCUSGAINED,
    pygame.WINDOWFOCUSLOST,
    pygame.QUIT,
    *_TO_REPAINT,
)


class PygameWindow(BlockingWindow):
    """A pygame window, or the whole screen.

    Args:
        clock: stamps inputs and flips.
        fullscreen: take the whole screen; ``size_px`` is then the screen's.
        size_px: width and height of a window; smaller on a screen that is smaller.

    Raises:
        WindowError: if there is no display.
    """

    def __init__(self, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> None:
        super().__init__(clock)
        # Without vsync a frame goes straight to the X server in about 1 ms; through an OpenGL texture, which is SDL's
        # preference, it takes 17 ms where OpenGL is done in software.
        os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
        try:
            if sys.platform == "linux" and not any(map(os.environ.get, _SAY_WHERE)):
                raise pygame.error("none of DISPLAY, WAYLAND_DISPLAY and SDL_VIDEODRIVER is set")
            pygame.display.init()  # never pygame.init(): it opens the sound device
            driver = pygame.display.get_driver()
            if driver in _NO_DISPLAY and os.environ.get("SDL_VIDEODRIVER") != driver:
                raise pygame.error("SDL found no screen")
            pygame.display.set_caption(TITLE)
            self._open(size_px, fullscreen=fullscreen)
        except pygame.error as error:
            pygame.display.quit()
            raise WindowError(
                f"pygame cannot open a window here ({error}); log in to a desktop or set DISPLAY, "
                "or use `minihuman simulate` to play without a window"
            ) from error
        self._fullscreen = fullscreen
        self._closed = False
        self._gamepad: Gamepad | None = None
        self._key_times = _key_times(clock) if driver == "x11" else None
        pygame.mouse.set_visible(False)
        pygame.key.stop_text_input()  # an input method would swallow keys
        pygame.event.set_blocked(None)
        pygame.event.set_allowed(_EVENTS)

    @staticmethod
    def _open(size_px: Size, *, fullscreen: bool) -> None:
        """Open with vsync where the display has a refresh rate and the driver grants it, else without."""
        screen_px = pygame.display.get_desktop_sizes()[0]
        size_px = screen_px if fullscreen else (min(size_px[0], screen_px[0]), min(size_px[1], screen_px[1]))
        flags = pygame.FULLSCREEN if fullscreen else pygame.RESIZABLE
        if any(pygame.display.get_desktop_refresh_rates()):
            try:
                pygame.display.set_mode(size_px, flags | pygame.SCALED, vsync=1)
                return
            except pygame.error:
                pass  # a driver without vsync; the facts say so
        pygame.display.set_mode(size_px, flags)

    @property
    def size_px(self) -> Size:
        """Width and height of what is drawn."""
        return _surface().get_size()

    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        _surface().blit(pygame.image.frombuffer(frame.data, self.size_px, "RGB"), changed, changed)
        pygame.display.update(changed)

    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        events = []
        if timeout_ns is None:
            events.append(pygame.event.wait())
        elif timeout_ns >= _NS_PER_MS:
            events.append(pygame.event.wait(timeout_ns // _NS_PER_MS))
        else:
            time.sleep(timeout_ns * 1e-9)
        events += pygame.event.get()
        t_ns = self._clock()
        if any(event.type in _TO_REPAINT for event in events):
            self._repaint()
        return [arrived for event, at_ns in self._timed(events, t_ns) for arrived in self._inputs(event, at_ns)]

    def _timed(self, events: list[pygame.event.Event], now_ns: int) -> Iterator[tuple[pygame.event.Event, int]]:
        """Events and when they came: SDL does not tell, so keys and clicks are looked up at the X server, if any."""
        moves = [move for event in events if (move := _name_move(event)) is not None]
        times = iter(self._key_times.of(moves) if self._key_times and moves else ())
        for event in events:
            at_ns = next(times, None) if _name_move(event) is not None else None
            yield event, now_ns if at_ns is None else at_ns

    def _inputs(self, event: pygame.event.Event, t_ns: int) -> list[Input]:
        match event.type:
            case pygame.KEYDOWN:
                return self._key(True, key_from_scancode(event.scancode), _symbol(event), t_ns)
            case pygame.KEYUP:
                return self._key(False, key_from_scancode(event.scancode), _symbol(event), t_ns)
            case pygame.WINDOWFOCUSGAINED:
                return self._focus(t_ns, True)
            case pygame.WINDOWFOCUSLOST:
                return self._focus(t_ns, False)
            case pygame.TEXTINPUT:
                return self._typed(event.text)
            case pygame.MOUSEBUTTONDOWN if event.button == pygame.BUTTON_LEFT:
                return self._pointer(PointerPressed, *self._along(event.pos), t_ns)
            case pygame.MOUSEMOTION:
                return self._pointer(PointerMoved, *self._along(event.pos), t_ns)
            case pygame.MOUSEBUTTONUP if event.button == pygame.BUTTON_LEFT:
                return self._pointer(PointerReleased, *self._along(event.pos), t_ns)
            case pygame.QUIT:
                return [Stop(t_ns, "window_closed")]
            case kind if self._gamepad is not None and kind in GAMEPAD_EVENTS:
                found = []
                for name, value in self._gamepad.read(event):
                    if isinstance(value, bool):
                        found += self._key(value, name, "gamepad", t_ns)
                    else:
                        found.append(AxisChanged(t_ns, name, value))
                return found
        return []

    def open_gamepad(self) -> dict[str, str]:
        """Take inputs of the first gamepad that is connected.

        Raises:
            WindowError: if there is none.
        """
        self._gamepad = Gamepad()
        return self._gamepad.facts()

    def _along(self, place_px: tuple[int, int]) -> tuple[float, float]:
        width, height = self.size_px
        return (place_px[0] + 0.5) / width, (place_px[1] + 0.5) / height

    def _want(self, *, text: bool, pointer: bool) -> None:
        (pygame.key.start_text_input if text else pygame.key.stop_text_input)()  # an input method swallows keys
        pygame.mouse.set_visible(pointer)
        (pygame.event.set_allowed if text else pygame.event.set_blocked)(pygame.TEXTINPUT)
        (pygame.event.set_allowed if pointer else pygame.event.set_blocked)(_POINTER)

    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into SDL's queue; from any thread."""
        for kind in (pygame.KEYDOWN, pygame.KEYUP):
            pygame.event.post(pygame.event.Event(kind, scancode=key_to_scancode(key), key=pygame.K_UNKNOWN))

    def facts(self) -> dict[str, str]:
        """Toolkit, version, display size, refresh rate, how keys are identified."""
        width, height = self.size_px
        return {
            "window": "pygame",
            "window_version": f"pygame-ce {pygame.version.ver}, SDL {'.'.join(map(str, pygame.get_sdl_version()))}",
            "window_driver": pygame.display.get_driver(),
            "window_size_px": f"{width}x{height}",
            "fullscreen": str(self._fullscreen).lower(),
            "vsync": "on" if pygame.display.is_vsync() else "off",
            "refresh_hz_reported": str(pygame.display.get_current_refresh_rate() or "unknown"),
            "key_times": ON_RECEIPT if self._key_times is None else SERVER_TIME,
            "key_identity": "position (SDL scancode)",
        }

    def close(self) -> None:
        """Give the display back."""
        if not self._closed:
            self._closed = True
            if self._gamepad is not None:
                self._gamepad.close()
            if self._key_times is not None:
                self._key_times.close()
            pygame.display.quit()


def _key_times(clock: Clock) -> X11KeyTimes | None:
    """The X server's key times; None where there are none."""
    try:
        return X11KeyTimes(clock)
    except OSError:
        return None


def _surface() -> pygame.Surface:
    """What is drawn on; another one after each change of size."""
    surface = pygame.display.get_surface()
    assert surface is not None, "the window is open"
    return surface


def _name_move(event: pygame.event.Event) -> tuple[str, bool] | None:
    """The key, or the mouse's main button, that an event is about, and whether it went down; None: neither."""
    if event.type in _KEYS:
        return key_from_scancode(event.scancode), event.type == pygame.KEYDOWN
    is_click = event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP) and event.button == pygame.BUTTON_LEFT
    return (MAIN_BUTTON, event.type == pygame.MOUSEBUTTONDOWN) if is_click else None


def _symbol(event: pygame.event.Event) -> str:
    """What the key is called on this layout, without modifiers."""
    return pygame.key.name(event.key, use_compat=False)
