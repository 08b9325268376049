"""One guard around all that is done with what a log says: it can be wrong, and a traceback is never the answer."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from minihuman.errors import LogError, MinihumanError


@contextmanager
def guarded(path: Path, doing: str = "read") -> Iterator[None]:
    """Let our own errors through; anything else that a log's content leads to becomes a LogError that names the file.

    Raises:
        LogError: instead of whatever else was raised.
    """
    try:
        yield
    except (MinihumanError, OSError):
        raise
    except Exception as error:  # a foreign, changed or newer log can make any parser raise anything
        said = str(error).splitlines()[0] if str(error) else ""
        raise LogError(f"{path} cannot be {doing}: {type(error).__name__}: {said[:300]}") from error
