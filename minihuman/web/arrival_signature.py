"""Signed arrivals: proof that a visitor from a recruiting platform came through one of the study's own links.

The signature is an HMAC-SHA256 of the study, the platform and the visitor's id on that platform. The key is kept in the
environment of the server and of the program that makes links. It is in no protocol, because protocols are published.
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
    """No usable key for signing arrivals is configured."""


def read_arrival_key(environment: Mapping[str, str] = os.environ) -> bytes:
    """Read the signing key from the environment, or from the file that the environment names.

    Raises:
        ArrivalKeyError: if there is no key, its file cannot be read, or it is too short to be a secret.
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
    """Return the signature of a visitor whose id on a platform is ``person``, as 64 hexadecimal digits."""
    return hmac.new(key, f"{study}:{platform}:{person}".encode(), hashlib.sha256).hexdigest()


def is_signed(key: bytes, study: str, platform: str, person: str, signature: str) -> bool:
    """Return whether a signature is the one that ``sign_arrival`` returns; False if the key is empty."""
    expected = sign_arrival(key, study, platform, person)
    return bool(key) and hmac.compare_digest(expected.encode(), signature.encode())
