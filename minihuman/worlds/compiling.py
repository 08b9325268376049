"""Compiling happens once on a machine: the line that a person reads meanwhile, and what else to do about it."""

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache

from numba.core import event

LOG = logging.getLogger("minihuman")
LINE = "compiling the worlds for this machine; this takes some seconds, and only the first time"


class Announcement(event.Listener):
    """Says `LINE` when the first function of ours is compiled in this process; code from the cache says nothing."""

    def __init__(self) -> None:
        self._said = False

    def on_start(self, event: event.Event) -> None:
        """A function is compiled: say so, unless it is somebody else's or was said before."""
        if not self._said and event.data["dispatcher"].py_func.__module__.startswith("minihuman."):
            self._said = True
            LOG.warning(LINE)  # a warning is what Python shows on stderr where nobody set up logging

    def on_end(self, event: event.Event) -> None:
        """Nothing more to say."""


@cache
def announce() -> None:
    """From now on, say so when worlds are compiled. Calling it again changes nothing."""
    event.register("numba:compile", Announcement())  # type: ignore[no-untyped-call]  # numba has no types


class _First(event.Listener):
    def __init__(self, act: Callable[[], None]) -> None:
        self._act: Callable[[], None] | None = act

    def on_start(self, event: event.Event) -> None:
        act, self._act = self._act, None
        if act is not None:
            act()

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def at_first_compile(act: Callable[[], None]) -> Iterator[None]:
    """Call ``act`` when the first function is compiled meanwhile, before that; code from the cache calls nothing."""
    with event.install_listener("numba:compile", _First(act)):
        yield
