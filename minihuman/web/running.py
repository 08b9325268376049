"""The server run: a socket on this machine alone, links printed, until it is told to stop."""

import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import uvicorn

from minihuman.errors import MinihumanError, ProtocolError
from minihuman.study.activities.registry import kind_of
from minihuman.study.protocol import Protocol
from minihuman.web.arrivals import Arrivals
from minihuman.web.guard import MAX_MESSAGE_BYTES
from minihuman.web.links import link
from minihuman.web.platforms import link_for
from minihuman.web.server import Server

HOST = "127.0.0.1"
_WAITING = 1024  # connections that the system keeps until they are looked at


class ServeError(MinihumanError, OSError):
    """The server cannot run."""


def refuse_unserved(protocol: Protocol) -> None:
    """Refuse a study that has a part which no page can do.

    Raises:
        ProtocolError: if it has one.
    """
    parts = [*((block.name, block.kind) for block in protocol.blocks)]
    parts += [(other.name, other.kind) for other in protocol.activities]
    for name, kind in parts:
        if not kind_of(kind).browser:
            raise ProtocolError(f"part {name!r} is of kind {kind!r}, which needs a window: use `minihuman run`")


def listen(port: int) -> socket.socket:
    """Take a port of this machine; 0 takes a free one.

    Raises:
        ServeError: if it is taken.
    """
    taken = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        taken.bind((HOST, port))
    except OSError as error:
        taken.close()
        raise ServeError(f"port {port} cannot be had ({error.strerror}); choose another --port") from error
    taken.listen(_WAITING)  # whoever comes before the server is ready waits
    return taken


def run(
    protocol: Protocol, data: Path, taken: socket.socket, *, links: int, say: Callable[[str], None], address: str = ""
) -> None:
    """Serve a study until the process is told to stop; ``say`` is given each link, to ``address`` or this machine.

    Ctrl-C is such a word: sessions are left as they are, for the next server to go on with.
    """
    arrivals = Arrivals(protocol, data)
    address = f"{address.rstrip('/')}/" if address else f"http://{HOST}:{taken.getsockname()[1]}/"
    for token in arrivals.recruits.issue(links):
        say(link(address, token))
    if not links:
        say(address)
    for platform in protocol.web.platforms:
        say(f"for {platform}: {link_for(platform, address)}")
    server = Server(arrivals, data)
    config = uvicorn.Config(
        server.app(),
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_ping_interval=20.0,
        ws_per_message_deflate=False,
        access_log=False,  # addresses are nobody's business
        log_level="warning",
        timeout_graceful_shutdown=2,
    )
    with suppress(KeyboardInterrupt):  # uvicorn has ended in order, and says again what it was told
        uvicorn.Server(config).run(sockets=[taken])
