"""Limits on how much a page may send and how long it may keep a server waiting. No I/O, no clock."""

from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address

MESSAGES_PER_S = 200.0  # 60 steps per second, with their pictures and keys, take some 150
MESSAGE_BURST = 200
HELLO_TIMEOUT_S = 10.0  # a socket without a hello by then is closed
MAX_TARGET_BYTES = 2_048  # of a request's path and query
MAX_WAITING = 200  # sockets without a hello
HANDLES_PER_SESSION = 3  # its log, and its socket or the two requests of a page over HTTP
_OTHER_HANDLES = 2 * MAX_WAITING + 128  # sockets without a hello, journals, the database
PREFETCH_BACKLOG = 300  # unacknowledged messages above which nothing is prefetched
_IPV6_NETWORK_CHARACTERS = 19  # of the first 64 bits, as in 2001:0db8:0000:0001
MAX_BACKLOG = 3_000  # unacknowledged messages above which the page has to start anew


@dataclass(slots=True)
class RateLimit:
    """Limits the messages of a socket by a rate per second and a burst, as a token bucket."""

    now_s: float  # the time of the last message
    tokens: float = MESSAGE_BURST  # messages that may arrive at once

    def take(self, now_s: float, n_messages: int = 1) -> int:
        """Count messages that arrive now, as many as the limit admits; return how many those are."""
        self.tokens = min(MESSAGE_BURST, self.tokens + (now_s - self.now_s) * MESSAGES_PER_S)
        self.now_s = now_s
        admitted = min(n_messages, int(self.tokens))
        self.tokens -= admitted
        return admitted


def count_handles(max_concurrent_sessions: int) -> int:
    """Return the largest number of files and sockets that a server may have open at once."""
    return HANDLES_PER_SESSION * max_concurrent_sessions + _OTHER_HANDLES


def find_network(address: str) -> str:
    """Return the network whose sessions are limited together: the /64 of an IPv6 address, or an IPv4 address itself.

    A text that is no IP address is returned as it is.
    """
    with suppress(ValueError):
        return ip_address(address).exploded[:_IPV6_NETWORK_CHARACTERS]  # an IPv4 address is shorter
    return address
