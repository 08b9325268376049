"""A server's processes, seen from outside, and waiting for what they do."""

import time
from collections.abc import Callable
from pathlib import Path

from tests.counts import PATIENCE_S


def until(condition: Callable[[], object]) -> None:
    """Wait until something holds."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def below(pid: int) -> list[int]:
    """The processes that one has begun."""
    found = (task / "children" for task in Path(f"/proc/{pid}/task").iterdir())
    return [int(word) for children in found for word in children.read_text().split()]


def runs(pid: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
