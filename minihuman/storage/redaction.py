"""Removes secrets from third parties' errors: passwords in addresses, keys, and values of variables.

Libraries put addresses and settings into their errors as they were given, or parts of them as they understood them. Any
such text goes through ``redact`` before it reaches a person, a log or another error. A caller that reads an address
from a file passes it to ``remember_address``, since a part of a mistyped address cannot be recognized by itself.
"""

import os
import re
from urllib.parse import quote, unquote

REDACTED = "[...]"
_MIN_SECRET_LETTERS = 6  # a shorter value of a variable is a dummy, and may be part of a word
_USER_INFO = re.compile(
    r"(?<=://)[^\s/@'\"]*(?:/[^\s@'\"]*)?@"  # a password may hold a slash
    r"|(?<![\w.@-])[^\s/:@'\"]+:[^\s@'\"]+@(?=[\w\[])"  # an address whose scheme was forgotten
)
_SETTING = re.compile(
    r"(?i)\b((?:[a-z0-9_.-]*(?:password|passwd|secret|token|signature|credential|api[-_]?key|access[-_]?key)[a-z0-9_.-]*"
    r"|authorization|sig)\s*[=:]\s*)(?:bearer\s+|basic\s+)?(?:\"[^\"]*\"|'[^']*'|[^\s&,;'\")]+)"
)
_SECRET_VARIABLE = re.compile(r"(?i)(password|passwd|secret|token|key)")
_PARAMETER = re.compile(r"(?i)[?&][^=&]*(?:password|passwd|secret|token|signature|credential|key)[^=&]*=([^&#]*)")
_ADDRESS_SECRETS: set[str] = set()  # of this process's addresses


def remember_address(address: str) -> None:
    """Remember the secrets in the address of a store or a database, so that ``redact`` removes them from all texts.

    The secrets are the password, and the values of parameters with names such as ``token``.
    """
    secrets = _PARAMETER.findall(address)
    password = address.partition("://")[2].rpartition("@")[0].partition(":")[2]  # it may contain an at sign
    secrets += [password, *password.split("@")]  # an error may quote only the part that was parsed as the password
    for secret in secrets:
        _ADDRESS_SECRETS.update({secret, unquote(secret), quote(secret, safe="")})


def redact(text: str) -> str:
    """Return a text with a placeholder in place of each secret."""
    for secret in _find_secrets():
        text = text.replace(secret, REDACTED)
    text = _USER_INFO.sub(f"{REDACTED}@", text)
    return _SETTING.sub(rf"\1{REDACTED}", text)


def _find_secrets() -> list[str]:
    """Return the secrets of addresses and of environment variables, each also percent-decoded, longest first.

    If a secret is a part of another one, the longer one must be replaced first.
    """
    secrets = set(_ADDRESS_SECRETS)
    for name, text in os.environ.items():
        if _SECRET_VARIABLE.search(name):
            secrets |= {text, unquote(text)}
        for info in _USER_INFO.findall(text):
            user, _, password = info.removesuffix("@").partition(":")
            if password:
                secrets |= {password, unquote(password)}
            else:
                secrets.add(user)  # an address of the form TOKEN@HOST
    return sorted((secret for secret in secrets if len(secret) >= _MIN_SECRET_LETTERS), key=len, reverse=True)
