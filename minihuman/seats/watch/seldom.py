"""What takes long to find out, found out so seldom that all of it takes a small share of the time."""

import time
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Seldom(Generic[T]):
    """Calls ``find`` when it is asked, or hands out what that said before.

    Args:
        find: may take long.
        share: of the time, that calling it may take.
        clock: seconds.
    """

    def __init__(
        self, find: Callable[[], T], *, share: float = 0.05, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._find = find
        self._share = share
        self._clock = clock
        self._found: T | None = None
        self._again_s: float | None = None

    def __call__(self) -> T:
        """What ``find`` said when it was called last, which may be now."""
        began_s = self._clock()
        if self._again_s is None or began_s >= self._again_s:
            self._found = self._find()
            ended_s = self._clock()
            self._again_s = ended_s + (ended_s - began_s) / self._share
        return self._found  # type: ignore[return-value]
