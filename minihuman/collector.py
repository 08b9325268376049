"""Python's collector of cycles, kept out of the way of work that makes millions of objects and soon ends."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_SELDOM = 50_000, 20, 100  # new objects before the youngest are looked at, and so on; Python's own begin at 700


@contextmanager
def seldom_collected() -> Iterator[None]:
    """Meanwhile look for cycles seldom: of drawing figures it is a tenth, and holds little back."""
    usual = gc.get_threshold()
    gc.set_threshold(*_SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


@contextmanager
def never_collected() -> Iterator[None]:
    """Meanwhile do not look for cycles at all: of compiling it is a tenth."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
