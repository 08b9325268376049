"""How often a long proof runs: a small count by default, the full one under ``MINIHUMAN_LONG=1``."""

import os


def count(small: int, full: int) -> int:
    return full if os.environ.get("MINIHUMAN_LONG") == "1" else small
