"""A protocol read from its file."""

import sys
from pathlib import Path

import msgspec

from minihuman.errors import ProtocolError
from minihuman.players.agent import is_agent
from minihuman.study.activities.agent_plan import LATEST
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
    protocol = decode(toml, str(path))
    return msgspec.structs.replace(protocol, files=_pictures(protocol, path) | _policies(protocol, path))


def _policies(protocol: Protocol, path: Path) -> dict[str, bytes]:
    """The policy files of its agents, which lie beside it, by name."""
    found: dict[str, bytes] = {}
    for number, block in enumerate(protocol.blocks):
        name = block.agent.policy if block.agent is not None else ""
        if name and name != LATEST and not is_agent(name):
            try:
                found[name] = (path.parent / name).read_bytes()
            except OSError as error:
                where = f"{path}: $.blocks[{number}].agent.policy"
                reason = f"{path.parent / name} cannot be read: {error.strerror}"
                raise ProtocolError(f"{where}: {reason}; put it there, or name an agent that is registered") from error
    return found


def _pictures(protocol: Protocol, path: Path) -> dict[str, bytes]:
    """The pictures of its pages, which lie beside it, by name."""
    found: dict[str, bytes] = {}
    for number, page in enumerate(protocol.pages):
        for name in page.pictures:
            picture = path.parent / name
            try:
                found[name] = picture.read_bytes()
            except OSError as error:
                where = f"{path}: $.pages[{number}].pictures"
                raise ProtocolError(f"{where}: {picture} cannot be read: {error.strerror}; put it there") from error
            if not found[name].startswith(b"\x89PNG"):
                raise ProtocolError(f"{path}: $.pages[{number}].pictures: {picture} is no PNG; save it as one")
    return found
