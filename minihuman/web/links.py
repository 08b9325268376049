"""Links: an address with a token that nobody guesses, behind the #, which browsers send to no server."""

import re

_TOKEN = re.compile(r"[A-Za-z0-9_-]{22}")  # 16 random bytes, as secrets.token_urlsafe writes them


def link(address: str, token: str) -> str:
    """The link that a participant gets."""
    return f"{address}#t={token}"


def is_token(text: str) -> bool:
    """Whether it is written as a token is; most guesses are not."""
    return _TOKEN.fullmatch(text) is not None
