"""One total deadline for a wait on a store, a database or a model's endpoint: a peer that drips is late, too.

A timeout of a socket counts from one byte to the next, so that a peer which sends a byte now and then holds its caller
for ever. Here the whole of a call counts.
"""

import errno
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import copy_context
from typing import Generic, TypeVar

T = TypeVar("T")


@contextmanager
def cut_off_late(timeout_s: float, shut: Callable[[], None]) -> Iterator[threading.Timer]:
    """Call ``shut`` if what is done inside takes longer: it lets go of whatever the caller waits for.

    Yields:
        The timer, which is alive until it has called that.
    """
    timer = threading.Timer(timeout_s, shut)
    timer.daemon = True
    timer.start()
    try:
        yield timer
    finally:
        timer.cancel()


class _Call(Generic[T]):
    """A call in a thread of its own, and how it ended."""

    def __init__(self, function: Callable[[], T]) -> None:
        self._function = function
        self._answer: list[T] = []
        self._error: BaseException | None = None
        self.ended = threading.Event()

    def run(self) -> None:
        try:
            self._answer.append(self._function())
        except BaseException as error:
            self._error = error
        finally:
            self.ended.set()

    def get(self) -> T:
        if self._error is not None:
            raise self._error
        return self._answer[0]


def call_within(timeout_s: float, function: Callable[[], T], *, shut: Callable[[], None] = lambda: None) -> T:
    """Call a function in a thread of its own, and wait no longer than ``timeout_s`` in all.

    Args:
        timeout_s: how long; whatever the function does meanwhile does not extend it.
        function: what is called. After the deadline nobody hears how it ends, so it must change nothing that others
            still use.
        shut: called after the deadline: closes what the function waits for, so that its thread ends, too.

    Raises:
        TimeoutError: if it has not ended by then.
        Exception: what the function raised.
    """
    call = _Call(function)
    thread = threading.Thread(target=copy_context().run, args=[call.run], name="minihuman-call", daemon=True)
    thread.start()
    if not call.ended.wait(timeout_s):
        shut()
        raise TimeoutError(errno.ETIMEDOUT, f"no whole answer within {timeout_s:.3g} s")
    return call.get()
