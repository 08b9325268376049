"""How often a long proof runs, and how long a test waits: more under ``MINIHUMAN_NIGHTLY=1``."""

import os
from typing import TypeVar

T = TypeVar("T")  # a number of times, or what is gone through


def count(small: T, full: T) -> T:
    return full if os.environ.get("MINIHUMAN_NIGHTLY") == "1" else small


PATIENCE_S = count(
    300, 1_800
)  # for what has to come: busy machines are slow, and in a long proof they stop for minutes
