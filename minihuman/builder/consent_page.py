"""Drafts of consent pages in each of the package's languages; a lab replaces the texts in brackets.

They state what the Declaration of Helsinki (2013, paragraph 26) and the GDPR (article 13) require: purpose, procedure,
storage, rights and contact. What they state about storage is what a session's log contains.
"""

import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import MappingProxyType

_PATH = Path(__file__).with_name("consent_texts.toml")


@cache
def load_consent_pages() -> Mapping[str, Mapping[str, str | bool]]:
    """Return the fields of a consent page, "title", "text" and "asks_consent", by language code."""
    texts = tomllib.loads(_PATH.read_text(encoding="utf-8"))
    return MappingProxyType(
        {
            language: MappingProxyType({"title": page["title"], "text": page["text"].strip(), "asks_consent": True})
            for language, page in texts.items()
        }
    )
