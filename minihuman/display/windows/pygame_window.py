"""The window in pygame-ce (SDL 2), which identifies keys by position (scancode), independently of the layout."""

import contextlib
import os
import sys
import time
from collections.abc import Iterator, Sequence

import numpy as np
import pygame
from numpy.typing import NDArray

from minihuman.display.drawing.play_screens import Box
from minihuman.display.drawing.sheet import Size
from minihuman.display.windows.blocking_window import DEFAULT_SIZE_PX, TITLE, BlockingWindow
from minihuman.display.windows.desk_field import Clipboard
from minihuman.display.windows.keyboard import key_from_scancode, key_to_scancode
from minihuman.display.windows.pygame_gamepad import GAMEPAD_EVENTS, Gamepad
from minihuman.display.windows.window import Clock
from minihuman.display.windows.x11_input import (
    MAIN_BUTTON,
    ON_RECEIPT,
    SERVER_TIME,
    KeyMove,
    X11InputRecord,
    has_shared_clock,
)
from minihuman.errors import WindowError
from minihuman.experiment.machine.inputs import (
    AxisChanged,
    Input,
    PointerCause,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    PressCause,
    Stop,
)

_NS_PER_MS = 1_000_000
_DISPLAY_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER")  # variables that name a display
_NO_DISPLAY = ("offscreen", "dummy")  # drivers without a display, to which SDL falls back
_TO_REPAINT = (  # after these events, SDL may have replaced its surface by a black one
    pygame.WINDOWEXPOSED,
    pygame.WINDOWSHOWN,
    pygame.WINDOWRESTORED,
    pygame.WINDOWSIZECHANGED,
    pygame.WINDOWDISPLAYCHANGED,
)
_KEYS = (pygame.KEYDOWN, pygame.KEYUP)
_UNKNOWN = KeyMove(None, is_in_window=True)
_SHORTCUT_MODIFIERS = pygame.KMOD_CTRL | pygame.KMOD_ALT | pygame.KMOD_GUI
_MODIFIER_KEYS = frozenset(
    {
        *(pygame.K_LCTRL, pygame.K_RCTRL, pygame.K_LALT, pygame.K_RALT, pygame.K_LGUI, pygame.K_RGUI),
        *(pygame.K_LSHIFT, pygame.K_RSHIFT, pygame.K_CAPSLOCK, pygame.K_NUMLOCK, pygame.K_MODE),
    }
)
_POINTER = (pygame.MOUSEBUTTONDOWN, pygame.MOUSEMOTION, pygame.MOUSEBUTTONUP)
_TEXT = (pygame.TEXTINPUT, pygame.TEXTEDITING)
_EVENTS = (
    *_KEYS,
    pygame.WINDOWFOCUSGAINED,
    pygame.WINDOWFOCUSLOST,
    pygame.QUIT,
    *_TO_REPAINT,
)


class _SystemClipboard(Clipboard):
    """The system's clipboard, as SDL reaches it."""

    def read(self) -> str:
        """Return the clipboard's text; "" if it has none."""
        try:
            return pygame.scrap.get_text()
        except pygame.error:
            return ""

    def write(self, text: str) -> None:
        """Replace the clipboard's text."""
        with contextlib.suppress(pygame.error):  # the text stays selected
            pygame.scrap.put_text(text)


class PygameWindow(BlockingWindow):
    """A pygame window, or a full screen.

    Args:
        clock: the clock that stamps inputs and flips
        fullscreen: whether to use the full screen, which determines the size
        size_px: the width and height of a window, which is at most as large as the screen

    Raises:
        WindowError: if there is no display.
    """

    def __init__(self, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> None:
        super().__init__(clock)
        # Without vsync a frame goes straight to the X server in about 1 ms; through an OpenGL texture, which is SDL's
        # preference, it takes 17 ms where OpenGL is done in software.
        os.environ.setdefault("SDL_FRAMEBUFFER_ACCELERATION", "0")
        # SDL swallows the click that brings the focus; where the X server says which one that is, it is logged.
        os.environ.setdefault("SDL_MOUSE_FOCUS_CLICKTHROUGH", str(int(has_shared_clock())))
        try:
            if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAY_VARIABLES)):
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
        self._down_at_focus: list[str] = []  # keys that were down when the window got the focus, and still are
        self._down_in_sdl: set[str] = set()  # keys whose press SDL saw
        self._record: X11InputRecord | None = None
        if driver == "x11":
            self._record = _open_record(clock)
        pygame.mouse.set_visible(False)
        pygame.key.stop_text_input()  # an input method would swallow keys
        pygame.event.set_blocked(None)
        pygame.event.set_allowed(_EVENTS)

    def _open_clipboard(self) -> Clipboard:
        return _SystemClipboard()

    @staticmethod
    def _open(size_px: Size, *, fullscreen: bool) -> None:
        """Open the window, with vsync if the display has a refresh rate and the driver permits it."""
        screen_px, *_ = pygame.display.get_desktop_sizes()
        if fullscreen:
            flags = pygame.FULLSCREEN
            size_px = screen_px
        else:
            flags = pygame.RESIZABLE
            width, height = size_px
            screen_width, screen_height = screen_px
            size_px = (min(width, screen_width), min(height, screen_height))
        if any(pygame.display.get_desktop_refresh_rates()):
            try:
                pygame.display.set_mode(size_px, flags | pygame.SCALED, vsync=1)
                return
            except pygame.error:
                pass  # a driver without vsync; the facts say so
        pygame.display.set_mode(size_px, flags)

    @property
    def size_px(self) -> Size:
        """The width and height of the drawn picture."""
        return _get_surface().get_size()

    def _flip(self, frame: NDArray[np.uint8], changed: Box) -> None:
        _get_surface().blit(pygame.image.frombuffer(frame.data, self.size_px, "RGB"), changed, changed)
        pygame.display.update(changed)

    def _arrived(self, timeout_ns: int | None) -> list[Input]:
        """Wait for events of SDL until the time is up (None: no limit), and return the inputs that they mean."""
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
        inputs = []
        for event, move in _drop_invented_releases(list(self._match_moves(events))):
            inputs += self._convert_event(event, move, t_ns)
        return [*inputs, *self._release_unseen(t_ns)]

    def _release_unseen(self, t_ns: int) -> list[Input]:
        """Return releases of keys that were down when the window got the focus and are up now.

        SDL drops the release of a key whose press it did not see.
        """
        if self._record is None:
            return []
        unseen = [key for key in self._down_at_focus if key not in self._down_in_sdl]
        up = [key for key in unseen if not self._record.is_down(key)]
        return [released for key in up for released in self._release_key(key, t_ns)]

    def _release_key(self, key: str, t_ns: int) -> list[Input]:
        """Return the release of a key that was down when the window got the focus; [] if it is up already."""
        self._down_at_focus = [held_key for held_key in self._down_at_focus if held_key != key]
        if self._repeater.is_down(key):
            return self._key(False, key, "", t_ns)  # a release
        return []

    def _match_moves(self, events: list[pygame.event.Event]) -> Iterator[tuple[pygame.event.Event, KeyMove]]:
        """Yield each event with the X server's record of it, because SDL reports no times and invents some events.

        The record of an event that the server does not report has no time.
        """
        names = [name for name in map(_name_move, events) if name is not None]
        moves: Iterator[KeyMove] = iter(())
        if self._record and names:
            moves = iter(self._record.find_moves(names))
        for event in events:
            move = _UNKNOWN
            if _name_move(event) is not None:
                move = next(moves, _UNKNOWN)
            yield event, move

    def _convert_event(self, event: pygame.event.Event, move: KeyMove, now_ns: int) -> list[Input]:
        """Convert an event to inputs; events without a time of the X server get the time ``now_ns``."""
        t_ns = move.t_ns
        if t_ns is None:
            t_ns = now_ns
        match event.type:
            case pygame.KEYDOWN:
                return self._press_key(event, move, now_ns)
            case pygame.KEYUP:
                key = key_from_scancode(event.scancode)
                self._down_in_sdl.discard(key)
                return self._key(False, key, _name_symbol(event), t_ns)
            case pygame.WINDOWFOCUSGAINED:
                return self._focus(now_ns, True)
            case pygame.WINDOWFOCUSLOST:
                return self._lose_focus(now_ns)
            case pygame.TEXTINPUT:
                return self._typed(event.text)
            case pygame.TEXTEDITING:
                self._field.show_composition(event.text)
            case kind if kind in _POINTER:
                return self._read_mouse(event, move, t_ns)
            case pygame.QUIT:
                return [Stop(t_ns, "window_closed")]
            case kind if self._gamepad is not None and kind in GAMEPAD_EVENTS:
                return self._read_gamepad(self._gamepad, event, t_ns)
        return []

    def _press_key(self, event: pygame.event.Event, move: KeyMove, now_ns: int) -> list[Input]:
        """Convert a key press to inputs.

        If the key was down when the window got the focus and SDL dropped its release, a release comes first.
        """
        cause = self._find_cause(event, move)
        key = key_from_scancode(event.scancode)
        pressed_ns = now_ns  # also of a key that was pressed before the window had the focus
        released: list[Input] = []
        if cause != "held_before_focus" and move.t_ns is not None:
            pressed_ns = move.t_ns
            if key not in self._down_in_sdl and key in self._down_at_focus:
                released = self._release_key(key, pressed_ns)
        self._down_in_sdl.add(key)
        return [*released, *self._key(True, key, _name_symbol(event), pressed_ns, cause)]

    def _lose_focus(self, now_ns: int) -> list[Input]:
        """Return inputs that bring the gamepad's axes to rest and release every key."""
        self._down_in_sdl.clear()
        axes: list[str] = []
        if self._gamepad is not None:
            axes = self._gamepad.lose_focus()
        return [*(AxisChanged(now_ns, axis, 0.0) for axis in axes), *self._focus(now_ns, False)]

    def _read_mouse(self, event: pygame.event.Event, move: KeyMove, t_ns: int) -> list[Input]:
        """Convert an event of the mouse to inputs: a captured mouse's motion, or what the main button does."""
        if event.type == pygame.MOUSEMOTION and self._mouse_axes:
            right_px, down_px = event.rel
            return self._move_mouse(right_px, down_px, t_ns)
        if event.type == pygame.MOUSEMOTION:
            return self._convert_button(PointerMoved, *self._convert_to_shares(event.pos), t_ns)
        if event.button != pygame.BUTTON_LEFT:
            return []
        if event.type == pygame.MOUSEBUTTONUP:
            return self._convert_button(PointerReleased, *self._convert_to_shares(event.pos), t_ns)
        cause: PointerCause = "held_before_focus"
        if move.is_in_window:
            cause = "finger"
        return self._convert_button(PointerPressed, *self._convert_to_shares(event.pos), t_ns, cause)

    def _find_cause(self, event: pygame.event.Event, move: KeyMove) -> PressCause:
        """Return the cause of a key press: a finger, a press before the focus, or a shortcut with Ctrl, Alt or Meta.

        AltGr does not make a press a shortcut.
        """
        if not move.is_in_window:
            return "held_before_focus"
        modifiers = getattr(event, "mod", 0) & _SHORTCUT_MODIFIERS  # a posted event has no such field
        if modifiers == pygame.KMOD_RALT and self._record is not None and self._record.has_alt_graph:
            modifiers = 0
        if modifiers & pygame.KMOD_RALT and sys.platform == "win32":
            modifiers = 0  # where the system reports AltGr as Ctrl and right Alt
        if modifiers and event.key not in _MODIFIER_KEYS:
            return "shortcut"
        return "finger"

    def _read_gamepad(self, gamepad: Gamepad, event: pygame.event.Event, t_ns: int) -> list[Input]:
        """Convert an event of the gamepad to inputs: its buttons are keys, and its sticks and triggers are axes."""
        inputs: list[Input] = []
        for name, state in gamepad.read(event):
            if isinstance(state, bool):
                inputs += self._key(state, name, "gamepad", t_ns)
            else:
                inputs.append(AxisChanged(t_ns, name, state))
        return inputs

    def _find_held_keys(self) -> Sequence[str]:
        """Return, and remember, the keys that were down when the window got the focus."""
        self._down_at_focus = []
        if self._record is not None:
            self._down_at_focus = self._record.find_held_keys()
        return self._down_at_focus

    def open_gamepad(self) -> dict[str, str]:
        """Receive inputs of the first connected gamepad from now on; return its description.

        Raises:
            WindowError: if no gamepad is connected.
        """
        self._gamepad = Gamepad()
        return self._gamepad.facts()

    def _convert_to_shares(self, pixel: tuple[int, int]) -> tuple[float, float]:
        """Return the position of a pixel's middle as shares of the window's width and height."""
        width, height = self.size_px
        return (pixel[0] + 0.5) / width, (pixel[1] + 0.5) / height

    def _want(self, *, text: bool, pointer: bool) -> None:
        """Turn SDL's events of typed text and of the pointer on or off."""
        if text:
            pygame.key.start_text_input()
            pygame.event.set_allowed(_TEXT)
        else:
            pygame.key.stop_text_input()  # an input method swallows keys
            pygame.event.set_blocked(_TEXT)
        pygame.mouse.set_visible(pointer)
        if pointer:
            pygame.event.set_allowed(_POINTER)
        else:
            pygame.event.set_blocked(_POINTER)

    def _capture_mouse(self, captured: bool) -> None:
        """Hide the pointer and receive the mouse's motion alone; or, if not ``captured``, release the mouse."""
        pygame.mouse.set_relative_mode(captured)
        if captured:
            pygame.event.get(pygame.MOUSEMOTION)  # discard earlier motion
            pygame.event.set_allowed(pygame.MOUSEMOTION)
        elif not self._accepts[1]:
            pygame.event.set_blocked(pygame.MOUSEMOTION)

    def post_key(self, key: str) -> None:
        """Put a press and a release of a key into SDL's queue; any thread can call this."""
        for event_type in (pygame.KEYDOWN, pygame.KEYUP):
            pygame.event.post(pygame.event.Event(event_type, scancode=key_to_scancode(key), key=pygame.K_UNKNOWN))

    def facts(self) -> dict[str, str]:
        """Return facts for the log: toolkit, version, size, vsync, refresh rate, and how keys are timed and named."""
        width, height = self.size_px
        sdl_version = ".".join(map(str, pygame.get_sdl_version()))
        return {
            "window": "pygame",
            "window_version": f"pygame-ce {pygame.version.ver}, SDL {sdl_version}",
            "window_driver": pygame.display.get_driver(),
            "window_size_px": f"{width}x{height}",
            "fullscreen": str(self._fullscreen).lower(),
            "vsync": "on" if pygame.display.is_vsync() else "off",
            "refresh_hz_reported": str(pygame.display.get_current_refresh_rate() or "unknown"),
            "key_times": ON_RECEIPT if self._record is None else SERVER_TIME,
            "key_identity": "position (SDL scancode)",
        }

    def close(self) -> None:
        """Close the window; a second call does nothing."""
        if not self._closed:
            self._closed = True
            if self._gamepad is not None:
                self._gamepad.close()
            if self._record is not None:
                self._record.close()
            pygame.display.quit()


def _open_record(clock: Clock) -> X11InputRecord | None:
    """Return the X server's record of keys for the window; None if there is none."""
    try:
        return X11InputRecord(clock, pygame.display.get_wm_info()["window"])
    except OSError:
        return None


def _get_surface() -> pygame.Surface:
    """Return the surface to draw on; ask for it each time, since SDL replaces it when the size changes."""
    surface = pygame.display.get_surface()
    assert surface is not None, "the window is open"
    return surface


def _name_move(event: pygame.event.Event) -> tuple[str, bool] | None:
    """Return the key or "main_button" of an event and whether it went down; None for other kinds of events."""
    if event.type in _KEYS:
        return key_from_scancode(event.scancode), event.type == pygame.KEYDOWN
    is_click = event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP) and event.button == pygame.BUTTON_LEFT
    if is_click:
        return (MAIN_BUTTON, event.type == pygame.MOUSEBUTTONDOWN)
    return None


def _drop_invented_releases(
    timed: list[tuple[pygame.event.Event, KeyMove]],
) -> list[tuple[pygame.event.Event, KeyMove]]:
    """Return events without the key releases that SDL invents just before it reports that the window loses the focus.

    `_focus` adds such releases itself, with their cause.
    """
    real_moves: list[tuple[pygame.event.Event, KeyMove]] = []
    for event, move in timed:
        if event.type == pygame.WINDOWFOCUSLOST:
            releases = []
            while real_moves and real_moves[-1][0].type == pygame.KEYUP:
                releases.append(real_moves.pop())
            for release, release_move in reversed(releases):
                if release_move.t_ns is not None and release_move.is_in_window:
                    real_moves.append((release, release_move))
        real_moves.append((event, move))
    return real_moves


def _name_symbol(event: pygame.event.Event) -> str:
    """Return the key's name on the current layout, without modifiers."""
    return pygame.key.name(event.key, use_compat=False)
