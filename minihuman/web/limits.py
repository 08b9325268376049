"""What the server refuses: pages of other origins, floods, huge messages. Times come in as arguments; no I/O."""

from dataclasses import dataclass
from urllib.parse import urlsplit

MAX_MESSAGE_BYTES = 16 * 1024
MESSAGES_PER_S = 60.0
MESSAGE_BURST = 200
HELLO_TIMEOUT_S = 10.0  # a socket without a hello by then is closed
MAX_TARGET_BYTES = 2_048  # of a request's path and query
MAX_WAITING = 200  # sockets without a hello
PREFETCH_BACKLOG = 300  # unacknowledged messages above which nothing is prefetched
MAX_BACKLOG = 3_000  # and above which the page starts anew

_POLICY = (  # nothing from anywhere else; blob: is for pictures that came over the socket, wasm for the worlds' rules
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: tuple[tuple[str, str], ...] = (
    ("content-security-policy", _POLICY),
    ("cross-origin-opener-policy", "same-origin"),  # these three make clocks of 5 µs of 100
    ("cross-origin-embedder-policy", "require-corp"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
    ("cache-control", "no-store"),
)


@dataclass(slots=True)
class RateLimit:
    """How many messages a socket may still send: a rate per second, and a burst."""

    now_s: float  # of the last message
    left: float = MESSAGE_BURST

    def take(self, now_s: float) -> bool:
        """Whether a message that comes now is within it."""
        self.left = min(MESSAGE_BURST, self.left + (now_s - self.now_s) * MESSAGES_PER_S)
        self.now_s = now_s
        if self.left < 1:
            return False
        self.left -= 1
        return True


def is_same_origin(origin: str | None, host: str | None) -> bool:
    """Whether a socket's Origin is the page that this server gave: the same host and port.

    A proxy in front hands both on as the browser sent them.
    """
    if not origin or not host:
        return False
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower() and not parts.path
