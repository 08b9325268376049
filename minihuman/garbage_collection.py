"""Makes garbage collection rare while objects are made by the thousand, of which hardly any are garbage."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

SELDOM = 50_000, 20, 100  # thresholds of the garbage collector's generations; Python's default begins at 700


@contextmanager
def infrequent_collection() -> Iterator[None]:
    """Run the enclosed code with less frequent garbage collection.

    Collection took a tenth of the time of drawing figures, and with the rows of 100,000 sessions more than half, and
    freed little memory.
    """
    usual = gc.get_threshold()
    gc.set_threshold(*SELDOM)
    try:
        yield
    finally:
        gc.set_threshold(*usual)
