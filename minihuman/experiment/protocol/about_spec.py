"""The `[about]` table of a protocol: the study as a publication, and the laboratory's data about participants."""

import re
from collections.abc import Iterator
from typing import Literal

import msgspec

from minihuman.experiment.protocol.validation_errors import FieldError

ColumnType = Literal["text", "integer", "number", "boolean"]
_ORCID = re.compile(r"\d{4}-\d{4}-\d{4}-\d{3}[\dX]")
_DOI = re.compile(r"10\.\d{4,9}/\S+")
_LICENCE = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+-]*|https?://\S+")
_COLUMN = re.compile(r"[a-z][a-z0-9_]*")
RESERVED_PERSON_COLUMNS = frozenset(  # minihuman's own columns of people, in its tables and in BIDS
    {"study", "version", "participant", "participant_id", "group", "player", "session", "session_id"}
)


class AuthorSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An author of the study; never a participant."""

    name: str  # as in print: "Ada Lovelace"
    orcid: str = ""  # "0000-0002-1825-0097"
    email: str = ""
    affiliation: str = ""


class ParticipantColumnSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A column of ``participants.csv`` in the study's folder: data about participants from outside the sessions."""

    name: str  # "age", "handedness"
    description: str
    type: ColumnType = "text"
    unit: str = ""  # "year"
    levels: dict[str, str] = {}  # the description of each allowed text; empty to allow any text


class AboutSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The study as a publication. Every field is optional; an export reports the fields that its standard lacks."""

    title: str = ""
    description: str = ""
    authors: tuple[AuthorSpec, ...] = ()
    licence: str = ""  # an SPDX identifier ("CC-BY-4.0") or the licence's address
    funding: tuple[str, ...] = ()
    ethics_approvals: tuple[str, ...] = ()  # approvals: board and number
    institution: str = ""
    department: str = ""
    address: str = ""  # of the institution
    keywords: tuple[str, ...] = ()
    doi: str = ""  # of the data, "10.1234/abcd"
    references: tuple[str, ...] = ()  # works to read or cite
    how_to_acknowledge: str = ""  # how users of the data should acknowledge it
    task_description: str = ""  # what participants did, in one sentence
    participant_columns: tuple[ParticipantColumnSpec, ...] = ()


def check_about(table: AboutSpec) -> Iterator[FieldError]:
    """Yield an error for each value of the table [about] that has the right type but is not valid."""
    if table.licence and not _LICENCE.fullmatch(table.licence):
        yield (
            "$.about.licence",
            f"is {table.licence!r}; use an SPDX identifier such as 'CC-BY-4.0', or an address",
        )
    if table.doi and not _DOI.fullmatch(table.doi):
        yield "$.about.doi", f"is {table.doi!r}; write it as 10.1234/abcd, without https://doi.org/"
    for number, author in enumerate(table.authors):
        yield from _check_author(author, f"$.about.authors[{number}]")
    for field in ("funding", "ethics_approvals", "keywords", "references"):
        for number, text in enumerate(getattr(table, field)):
            if not text.strip():
                yield f"$.about.{field}[{number}]", "is empty; remove it"
    yield from _check_participant_columns(table.participant_columns)


def _check_author(author: AuthorSpec, path: str) -> Iterator[FieldError]:
    if not author.name.strip():
        yield f"{path}.name", "is empty; write it as in print"
    if author.orcid and not is_orcid(author.orcid):
        yield (
            f"{path}.orcid",
            f"is {author.orcid!r}, which is not an ORCID; an ORCID looks like 0000-0002-1825-0097",
        )
    if author.email and "@" not in author.email:
        yield f"{path}.email", f"is {author.email!r}, which is not an e-mail address; write it as name@example.org"


def _check_participant_columns(columns: tuple[ParticipantColumnSpec, ...]) -> Iterator[FieldError]:
    names = [column.name for column in columns]
    for number, column in enumerate(columns):
        path = f"$.about.participant_columns[{number}]"
        name = column.name
        if not _COLUMN.fullmatch(name):
            yield f"{path}.name", f"is {name!r}; use lower-case letters, digits and '_'"
        elif name in ("participant", "participant_id"):
            yield f"{path}.name", f"is {name!r}, the column of participants' codes; use another name"
        if name in names[:number]:
            yield f"{path}.name", f"is {name!r} again; give each its own name"
        if not column.description.strip():
            yield f"{path}.description", "is empty; describe what the column contains"


def check_newer_person_columns(table: AboutSpec) -> Iterator[FieldError]:
    """Yield an error for each declared column of ``participants.csv`` whose name minihuman uses for a column."""
    for number, column in enumerate(table.participant_columns):
        if column.name in RESERVED_PERSON_COLUMNS - {"participant", "participant_id"}:
            other_name = name_person_column(column.name)
            message = f"is {column.name!r}, a column of minihuman's own; call it {other_name!r} here and in the file"
            yield f"$.about.participant_columns[{number}].name", message


def name_person_column(name: str) -> str:
    """Return the name that a laboratory's column of participants has in tables.

    It has the prefix ``person_`` if minihuman has a column of the same name; `check_newer_person_columns` refuses such
    names, but earlier studies may have them.
    """
    if name in RESERVED_PERSON_COLUMNS:
        return f"person_{name}"
    return name


def is_orcid(text: str) -> bool:
    """Return whether a text has the form of an ORCID with a correct check digit (ISO 7064, mod 11-2)."""
    if not _ORCID.fullmatch(text):
        return False
    digits = text.replace("-", "")
    total = 0
    for digit in digits[:-1]:
        total = (total + int(digit)) * 2
    check = (12 - total % 11) % 11
    return digits[-1] == ("X" if check == 10 else str(check))
