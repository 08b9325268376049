"""What a study is about: the facts that archives and standards ask for. Optional, and not needed to run a session."""

import re
from typing import Literal

import msgspec

Kind = Literal["text", "whole", "number", "yes_no"]

_ORCID = re.compile(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]")
_DOI = re.compile(r"10\.\d{4,9}/\S+")
_LICENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*|https?://\S+")
_COLUMN = re.compile(r"[a-z][a-z0-9_]*")


class Author(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Somebody who made the study; never somebody who took part in it."""

    name: str  # as in print: "Ada Lovelace"
    orcid: str = ""  # "0000-0002-1825-0097"
    email: str = ""
    affiliation: str = ""


class ParticipantColumn(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A column of ``participants.csv`` in the study's folder: what the laboratory knows of people beside their play."""

    name: str  # "age", "handedness"
    meaning: str
    kind: Kind = "text"
    unit: str = ""  # "year"
    levels: dict[str, str] = {}  # each word that may stand there, and what it means; empty: anything


class About(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study as a publication. Every field may be left out; an export says which ones a standard misses."""

    title: str = ""
    description: str = ""
    authors: tuple[Author, ...] = ()
    licence: str = ""  # an SPDX identifier ("CC-BY-4.0") or the licence's address
    funding: tuple[str, ...] = ()
    ethics: tuple[str, ...] = ()  # approvals: board and number
    institution: str = ""
    department: str = ""
    address: str = ""  # of the institution
    keywords: tuple[str, ...] = ()
    doi: str = ""  # of the data, "10.1234/abcd"
    references: tuple[str, ...] = ()  # works to read or cite
    acknowledge: str = ""  # how whoever uses the data should say so
    task: str = ""  # what participants did, in one sentence
    participants: tuple[ParticipantColumn, ...] = ()


def complaints(about: About) -> list[tuple[str, str]]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    found = []
    for number, author in enumerate(about.authors):
        path = f"$.about.authors[{number}]"
        if not author.name.strip():
            found.append((f"{path}.name", "is empty; write it as in print"))
        if author.orcid and not is_orcid(author.orcid):
            found.append((f"{path}.orcid", f"is {author.orcid!r}, which is no ORCID; one is like 0000-0002-1825-0097"))
        if author.email and "@" not in author.email:
            found.append((f"{path}.email", f"is {author.email!r}, which is no address"))
    if about.licence and not _LICENCE.fullmatch(about.licence):
        found.append(
            ("$.about.licence", f"is {about.licence!r}; use an SPDX identifier such as 'CC-BY-4.0', or an address")
        )
    if about.doi and not _DOI.fullmatch(about.doi):
        found.append(("$.about.doi", f"is {about.doi!r}; write it as 10.1234/abcd, without https://doi.org/"))
    for field in ("funding", "ethics", "keywords", "references"):
        for number, text in enumerate(getattr(about, field)):
            if not text.strip():
                found.append((f"$.about.{field}[{number}]", "is empty; remove it"))
    names = [column.name for column in about.participants]
    for number, column in enumerate(about.participants):
        path = f"$.about.participants[{number}]"
        if not _COLUMN.fullmatch(column.name) or column.name in ("participant", "participant_id"):
            found.append((f"{path}.name", f"is {column.name!r}; use lower-case letters, digits and '_'"))
        if column.name in names[:number]:
            found.append((f"{path}.name", f"is {column.name!r} again; give each its own name"))
        if not column.meaning.strip():
            found.append((f"{path}.meaning", "is empty; say what the column holds"))
    return found


def is_orcid(text: str) -> bool:
    """Whether it is written as an ORCID and its check digit (ISO 7064, mod 11-2) is right."""
    if not _ORCID.fullmatch(text):
        return False
    digits = text.replace("-", "")
    total = 0
    for digit in digits[:-1]:
        total = (total + int(digit)) * 2
    check = (12 - total % 11) % 11
    return digits[-1] == ("X" if check == 10 else str(check))
