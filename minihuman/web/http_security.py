"""Protection of a server's pages: the headers of its answers, and the origins whose sockets it accepts. No I/O."""

from collections.abc import Iterable
from urllib.parse import urlsplit

_POLICY = (  # blob: is for pictures that came over the socket, wasm for the worlds' rules
    "default-src 'self'; script-src 'self' 'wasm-unsafe-eval'; img-src 'self' blob: data:; object-src 'none'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS: tuple[tuple[str, str], ...] = (
    ("content-security-policy", _POLICY),
    ("cross-origin-opener-policy", "same-origin"),  # with these three, a page's clock has a resolution of 5, not 100 µs
    ("cross-origin-embedder-policy", "require-corp"),
    ("cross-origin-resource-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
    ("cache-control", "no-store"),
)
_EMBEDDED = {  # instead of those above, where other sites may frame the page
    "x-frame-options": "",  # knows no list of hosts; browsers that know frame-ancestors ignore it
    "cross-origin-resource-policy": "cross-origin",  # a site that is isolated itself frames nothing else
}


def build_headers(embedding_hosts: Iterable[str] = (), *, policy: str = _POLICY) -> dict[str, str]:
    """Build the security headers of a server's responses.

    Args:
        embedding_hosts: the hosts whose pages may embed the server's pages in a frame; empty to allow none.
        policy: the content security policy, which allows no page to embed the server's pages.
    """
    headers = {**dict(HEADERS), "content-security-policy": policy}
    hosts = " ".join(embedding_hosts)
    if not hosts:
        return headers
    headers["content-security-policy"] = policy.replace("frame-ancestors 'none'", f"frame-ancestors {hosts}")
    return {name: text for name, text in {**headers, **_EMBEDDED}.items() if text}


def is_same_origin(origin: str | None, host: str | None) -> bool:
    """Return whether a socket's Origin is a page of this server, with the same host and port.

    A proxy in front of the server must pass both headers on as the browser sent them.
    """
    if not origin or not host:
        return False
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower() and not parts.path
