"""What is being done, on a terminal, wherever more than a moment passes; on standard error, gone when it is done."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from minihuman.errors import printable


@contextmanager
def waiting(words: str) -> Iterator[Callable[[str], None]]:
    """Show a line while something is done; what it yields changes the line. A file's name in it may be any."""
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(words)) as status:
        yield lambda line: status.update(Text(printable(line)))
