"""Threads that share the work of a kernel: each takes the next part, all within one call, without Python in between.

Atomic counters, which the threads read and increment inside kernels, hand out the parts. The calling thread works too,
so a thread that starts late finds less to do.
"""

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import int64, kernel, llvm_function

Counters = NDArray[np.int64]
# Indices of the counters, each in a separate cache line: the number of parts that are done, and the number that are
# taken. If each thread has a share of the parts, each share has such a counter, APART numbers after the previous one.
DONE = 0
TAKEN = 8
APART = 8
_PATIENCE = 20_000  # readings of a counter before a thread stops polling, some tens of microseconds
_plain_lock = threading.Lock()


def _add(builder: Any, arguments: Any) -> Any:
    counters, at, number = arguments
    return builder.atomic_rmw("add", builder.gep(counters[1].start, [at[1]]), number[1], "acq_rel")


def _add_plain(counters: Counters, at: int, number: int) -> int:
    with _plain_lock:
        counters[at] += number
        return int(counters[at]) - number


# Adds a number to a counter; returns the counter's earlier value.
add_to_counter = llvm_function(_add, _add_plain, counts=True)


@kernel("(int64[::1], int64, int64)", hold_gil=True)
def count(counters: Counters, at: int, number: int) -> None:
    """Add a number to a counter atomically."""
    add_to_counter(counters, at, number)


@kernel("(int64[::1], int64)", nogil=True, polls=int64)
def finished(counters: Counters, parts: int) -> bool:
    """Wait a short time until all parts are done; return whether they are."""
    polls = 0
    while add_to_counter(counters, DONE, 0) < parts and polls < _PATIENCE:
        polls += 1
    return add_to_counter(counters, DONE, 0) >= parts


@cache
def helper_threads(process: int) -> ThreadPoolExecutor:
    """Return the pool of helper threads of a process. A forked process needs a pool of its own."""
    return ThreadPoolExecutor(os.cpu_count(), thread_name_prefix=f"worlds-{process}")


def share_work(work: Callable[..., Any], arguments: tuple[Any, ...], parts: int, helpers: int) -> None:
    """Run ``work`` in this thread and in ``helpers`` other threads until all parts are done.

    ``work`` is called with the counters, the ``arguments`` and the number of its thread; 0 is this thread.
    """
    counters = np.zeros(TAKEN + APART * (1 + helpers), np.int64)
    threads = helper_threads(os.getpid())
    futures = [threads.submit(work, counters, *arguments, 1 + nth) for nth in range(helpers)]
    try:
        work(counters, *arguments, 0)
    finally:
        if not finished(counters, parts):  # a thread is still at work, or has failed and raises its error here
            for future in futures:
                future.result()
