"""Turns: counters that threads read and raise while others do, from inside kernels."""

import threading
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from minihuman.worlds.kernels import instructions

Counters = NDArray[np.int64]
_plainly = threading.Lock()


def _of(builder: Any, counters: Any, at: Any) -> Any:
    return builder.gep(counters[1].start, [at[1]])


def _read(builder: Any, given: Any) -> Any:
    return builder.load_atomic(_of(builder, *given), "acquire", 8)


def _read_plain(counters: Counters, at: int) -> int:
    return int(counters[at])


def _add(builder: Any, given: Any) -> Any:
    counters, at, number = given
    return builder.atomic_rmw("add", _of(builder, counters, at), number[1], "acq_rel")


def _add_plain(counters: Counters, at: int, number: int) -> int:
    with _plainly:
        counters[at] += number
        return int(counters[at]) - number


def _take(builder: Any, given: Any) -> Any:
    counters, at, number = given
    more = builder.add(number[1], ir.Constant(ir.IntType(64), 1))
    found = builder.cmpxchg(_of(builder, counters, at), number[1], more, "acq_rel", "acquire")
    return builder.zext(builder.extract_value(found, 1), ir.IntType(64))


def _take_plain(counters: Counters, at: int, number: int) -> int:
    with _plainly:
        free = int(counters[at]) == number
        counters[at] += free
        return int(free)


# what a counter is
read = instructions(_read, _read_plain, counts=True)
# add to a counter; what it was before
add = instructions(_add, _add_plain, counts=True)
# raise a counter by one if it is still so much: 1, or 0 where another thread was sooner
take = instructions(_take, _take_plain, counts=True)
