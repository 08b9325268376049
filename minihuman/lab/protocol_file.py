"""A protocol read from its file."""

import sys
from pathlib import Path

from minihuman.errors import ProtocolError
from minihuman.study.protocol import Protocol, decode


def read_protocol(path: Path) -> Protocol:
    """Read and check a protocol file; Python files beside it can be the modules of its worlds from then on.

    Raises:
        ProtocolError: if it cannot be read, or says something impossible; one line with the way out.
    """
    try:
        toml = path.read_bytes()
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)  # the last: nothing in it takes the place of a library
    return decode(toml, str(path))
