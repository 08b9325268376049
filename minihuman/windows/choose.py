"""Which window: the installed ones, by name. Others register in the entry-point group ``minihuman.windows``."""

from minihuman.errors import WindowError
from minihuman.plugins import check_made, load, names
from minihuman.study.screens import TextScreen
from minihuman.windows.blocking import DEFAULT_SIZE_PX
from minihuman.windows.compose import Size
from minihuman.windows.port import Clock, Window

GROUP = "minihuman.windows"
AUTO = "auto"
_OPENING = TextScreen("", "One moment, please.", "")  # worlds and log take a second or two to get ready
_FIRST_CHOICE = ("pygame", "pyglet")  # pygame knows every key by position, on every system


def window_names() -> tuple[str, ...]:
    """What can be asked for beside "auto", in the order in which auto tries them."""
    installed = set(names(GROUP))
    first = tuple(name for name in _FIRST_CHOICE if name in installed)
    return first + tuple(sorted(installed.difference(first)))


def open_window(name: str, clock: Clock, *, fullscreen: bool = False, size_px: Size = DEFAULT_SIZE_PX) -> Window:
    """Open a window by name; "auto" takes the first that opens.

    Raises:
        WindowError: if the name is unknown, or no window can be opened here.
    """
    if name != AUTO:
        return _open(name, clock, fullscreen=fullscreen, size_px=size_px)
    refusals = []
    for candidate in window_names():
        try:
            return _open(candidate, clock, fullscreen=fullscreen, size_px=size_px)
        except WindowError as error:
            refusals.append(error)
    if refusals:
        raise refusals[0]
    raise WindowError(f"no window is registered under {GROUP!r}; install minihuman again with `pip install`")


def _open(name: str, clock: Clock, *, fullscreen: bool, size_px: Size) -> Window:
    if name not in window_names():
        raise WindowError(f"window {name!r} is unknown; it is one of {', '.join((AUTO, *window_names()))}")
    window = load(GROUP, name, WindowError, what="window")(clock, fullscreen=fullscreen, size_px=size_px)
    check_made(window, Window, WindowError, group=GROUP, name=name)
    assert isinstance(window, Window)  # checked just now
    window.show(_OPENING)
    return window
