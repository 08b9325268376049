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
    """Call ``shut`` from another thread if the context lasts longer than ``timeout_s``.

    Args:
        timeout_s: the longest duration of the context, in seconds.
        shut: closes the socket or process that the context waits for, so that the wait ends with an error.

    Yields:
        The timer, which is alive until it has called ``shut`` or the context has ended.
    """
    timer = threading.Timer(timeout_s, shut)
    timer.daemon = True
    timer.start()
    try:
        yield timer
    finally:
        timer.cancel()


class _Call(Generic[T]):
    """A call of a function in a thread, with the function's result or error."""

    def __init__(self, function: Callable[[], T]) -> None:
        self._function = function
        self._results: list[T] = []  # empty until the function has returned
        self._error: BaseException | None = None
        self.ended = threading.Event()

    def run(self) -> None:
        try:
            self._results.append(self._function())
        except BaseException as error:
            self._error = error
        finally:
            self.ended.set()

    def get_result(self) -> T:
        """Return the function's result or raise its error; call this only once ``ended`` is set."""
        if self._error is not None:
            raise self._error
        return self._results[0]


def call_within(timeout_s: float, function: Callable[[], T], *, shut: Callable[[], None] = lambda: None) -> T:
    """Call a function in a new thread, wait for it no longer than ``timeout_s``, and return its result.

    Args:
        timeout_s: the total time in seconds, which no progress of the function extends.
        function: the function. After the deadline its result is discarded, so it must change nothing that others still
            use.
        shut: called after the deadline; it should close whatever the function waits for, so that its thread ends.

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
    return call.get_result()
