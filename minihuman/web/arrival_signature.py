"""Signed arrivals: proof that a recruiting platform's visitor came through a link or redirect of the study's own.

The signature is an HMAC-SHA256 of the study, the platform and the visitor's id there. Its key is in the environment of
the server and of the program that makes links, and in no protocol: a protocol is published.
"""

import hashlib
import hmac
import os
from collections.abc import Mapping
from pathlib import Path

from minihuman.errors import MinihumanError

SIGNATURE_PARAMETER = "signature"
KEY_VARIABLE = "MINIHUMAN_ARRIVAL_KEY"
KEY_FILE_VARIABLE = "MINIHUMAN_ARRIVAL_KEY_FILE"
_MIN_KEY_CHARACTERS = 32


class ArrivalKeyError(MinihumanError, ValueError):
    """There is no key that arrivals can be signed with."""


def read_arrival_key(environment: Mapping[str, str] = os.environ) -> bytes:
    """Read the key from the environment, or from the file that it names.

    Raises:
        ArrivalKeyError: if there is none, or it is too short to be a secret.
    """
    key = environment.get(KEY_VARIABLE, "")
    file_name = environment.get(KEY_FILE_VARIABLE, "")
    if not key and file_name:
        try:
            key = Path(file_name).read_text(encoding="utf-8")
        except (OSError, UnicodeError) as error:
            raise ArrivalKeyError(f"{KEY_FILE_VARIABLE} names {file_name!r}, which cannot be read: {error}") from error
    key = key.strip()
    if len(key) < _MIN_KEY_CHARACTERS:
        if key and not file_name:
            source = KEY_VARIABLE
        else:
            source = f"{KEY_VARIABLE} or {KEY_FILE_VARIABLE}"
        raise ArrivalKeyError(
            f"require_signed_arrival is true, but the key for signatures has {len(key)} characters; set {source} to at "
            f'least {_MIN_KEY_CHARACTERS}, such as `python -c "import secrets; print(secrets.token_hex(32))"` prints'
        )
    return key.encode()


def sign_arrival(key: bytes, study: str, platform: str, person: str) -> str:
    """Return the signature of a visitor, 64 hexadecimal digits."""
    return hmac.new(key, f"{study}:{platform}:{person}".encode(), hashlib.sha256).hexdigest()


def is_signed(key: bytes, study: str, platform: str, person: str, signature: str) -> bool:
    """Whether a signature is this visitor's; without a key none is."""
    expected = sign_arrival(key, study, platform, person)
    return bool(key) and hmac.compare_digest(expected.encode(), signature.encode())
