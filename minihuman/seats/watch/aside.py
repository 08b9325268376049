"""Work that gives way to whatever else the machine has to do, while it comes to its turn at all."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")
_LATE_S = 0.5  # work that takes so long had to wait for others
_BUSY_S = 30.0  # for so long afterwards the machine is taken to be busy


class Aside:
    """Does work in a thread of the idle class (Linux), which makes room within microseconds when a key comes.

    A thread of that class stands still beside two busy programs. So where work came too late, what follows is done by
    the caller's own thread for a while.

    Args:
        clock: seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._idle = ThreadPoolExecutor(1, "aside", initializer=_give_way)
        self._busy_until_s = 0.0

    def __call__(self, work: Callable[[], T]) -> T:
        """What ``work`` returns or raises, one piece of work after the other."""
        began_s = self._clock()
        if began_s < self._busy_until_s:
            return work()
        try:
            return self._idle.submit(work).result()
        finally:
            ended_s = self._clock()
            if ended_s - began_s > _LATE_S:
                self._busy_until_s = ended_s + _BUSY_S


def _give_way() -> None:
    if hasattr(os, "SCHED_IDLE"):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
