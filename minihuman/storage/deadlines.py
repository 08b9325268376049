"""Total deadlines for waiting on a store, a database or a model's endpoint, which also apply to peers that send slowly.

A socket's timeout restarts at every byte, so a peer that sends a byte now and then could hold its caller for ever. Here
the duration of the whole call counts.
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
    """Call ``shut`` if the context lasts too long; ``shut`` must release whatever the caller waits for.

    Yields:
        The timer, which is alive until it has called ``shut``.
    """
    timer = threading.Timer(timeout_s, shut)
    timer.daemon = True
    timer.start()
    try:
        yield timer
    finally:
        timer.cancel()


class _Call(Generic[T]):
    """A call that runs in a thread of its own, with its result or error."""

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
        timeout_s: the total time in seconds, which no progress of the function extends.
        function: the function. After the deadline its result is discarded, so it must change nothing that others still
            use.
        shut: called after the deadline, to close what the function waits for, so that its thread ends, too.

    Raises:
        TimeoutError: if the function has not returned by the deadline.
        Exception: any error of the function.
    """
    call = _Call(function)
    thread = threading.Thread(target=copy_context().run, args=[call.run], name="minihuman-call", daemon=True)
    thread.start()
    if not call.ended.wait(timeout_s):
        shut()
        raise TimeoutError(errno.ETIMEDOUT, f"no whole answer within {timeout_s:.3g} s")
    return call.get()
