"""A protocol read from its file."""

from pathlib import Path

from minihuman.errors import ProtocolError
from minihuman.study.protocol import Protocol, decode


def read_protocol(path: Path) -> Protocol:
    """Read and check a protocol file.

    Raises:
        ProtocolError: if it cannot be read, or says something impossible; one line with the way out.
    """
    try:
        toml = path.read_bytes()
    except OSError as error:
        raise ProtocolError(f"{path} cannot be read: {error.strerror}; name a protocol's TOML file") from error
    return decode(toml, str(path))
