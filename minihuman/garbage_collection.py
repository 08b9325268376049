"""Python's garbage collector, tuned or paused for work that allocates millions of objects and then ends."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

_SELDOM = 50_000, 20, 100  # new objects before the youngest are looked at, and so on; Python's own begin at 700


@contextmanager
def infrequent_collection() -> Iterator[None]:
    """Meanwhile look for cycles seldom: of drawing figures it is a tenth, and holds little back."""
    usual = gc.get_threshold()
    gc.set_threshold(*_SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*usual)


@contextmanager
def paused_collection() -> Iterator[None]:
    """Meanwhile do not look for cycles at all: of compiling it is a tenth."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
