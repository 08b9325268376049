"""Logs are regular files: a pipe or a device that is named like one is not opened, as that could wait for ever."""

import os
import stat
from pathlib import Path
from typing import BinaryIO

from minihuman.errors import LogError


def open_regular(path: Path) -> BinaryIO:
    """Open a file to read it.

    Raises:
        LogError: if it cannot be opened, or is a pipe, a device or anything else that is no regular file.
    """
    try:
        fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)  # opening a pipe would wait for its writer
        if stat.S_ISREG(os.fstat(fd).st_mode):
            return os.fdopen(fd, "rb")
        os.close(fd)
    except OSError as error:
        raise LogError(f"{path} cannot be opened: {error.strerror}") from error
    raise LogError(f"{path} is no regular file; name a session log")
