"""Which window: the installed ones, by name. Others register in the entry-point group ``minihuman.windows``."""

from importlib.metadata import entry_points

from minihuman.errors import WindowError
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
    installed = {entry.name for entry in entry_points(group=GROUP)}
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
    found = entry_points(group=GROUP, name=name)
    if not found:
        raise WindowError(f"window {name!r} is unknown; it is one of {', '.join((AUTO, *window_names()))}")
    (entry, *_) = found
    window = entry.load()(clock, fullscreen=fullscreen, size_px=size_px)
    assert isinstance(window, Window), f"{entry.value} is no minihuman.windows.port.Window"
    window.show(_OPENING)
    return window
