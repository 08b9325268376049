"""What is being done, on a terminal, wherever more than a moment passes; on standard error, gone when it is done."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def waiting(words: str) -> Iterator[Callable[[str], None]]:
    """Show a line while something is done; what it yields changes the line."""
    from rich.console import Console

    with Console(stderr=True).status(words) as status:
        yield status.update
