"""Inputs: everything that can reach a session from outside. Times are ns on the session's monotonic clock."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class KeyDown:
    """A key went down. ``key`` is our physical name; ``symbol`` what the toolkit says it types, "" if unknown."""

    t_ns: int
    key: str
    symbol: str = ""
    repeat: bool = False  # the system's auto-repeat, not a finger


@dataclass(frozen=True, slots=True)
class KeyUp:
    """A key came up."""

    t_ns: int
    key: str
    symbol: str = ""


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passed. The session asks for ticks through ``Session.next_tick_ns``."""

    t_ns: int


@dataclass(frozen=True, slots=True)
class Shown:
    """The screen of ``Session.screen`` reached the display: handed over at submit, returned from the flip at flip."""

    t_ns: int
    submit_ns: int
    flip_ns: int


@dataclass(frozen=True, slots=True)
class FocusChanged:
    """The window lost or found the keyboard."""

    t_ns: int
    focused: bool


@dataclass(frozen=True, slots=True)
class Stop:
    """The session must end now: the window was closed, a signal came, the disk is full, the world broke."""

    t_ns: int
    reason: Literal["window_closed", "signal", "disk_full", "world_error", "internal_error"]
    detail: str = ""


@dataclass(frozen=True, slots=True)
class Asked:
    """The experimenter asks for something, from their desk."""

    t_ns: int
    what: Literal["pause", "go_on", "abort", "note"]
    text: str = ""  # the note, or why


Input = KeyDown | KeyUp | Tick | Shown | FocusChanged | Asked | Stop
