"""Reads the records that a site's pages saved: whole ones, and parts that a collector took one after the other.

No record is trusted: its form and sizes are checked here, before a session runs.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from minihuman.web.message_codec import decode_page_message
from minihuman.web.messages import BrowserFacts, MessageError, NumberedMessage
from minihuman.web.site.site_error import SiteError

FORMAT = "minihuman-site"
RECORD_VERSION = 1
MAX_RECORD_BYTES = 256 * 1024 * 1024
_FORMAT_BYTES = 200  # from a record's start, within which it states its format


class RecordPart(msgspec.Struct, frozen=True):
    """A record, or the part of a record that begins with the message of index ``first``."""

    format: str
    version: int
    id: Annotated[str, Meta(pattern=r"^[0-9a-f]{16}$")]
    study: str
    build: str
    slot: Annotated[int, Meta(ge=0)]
    started_unix_ms: Annotated[int, Meta(ge=0, le=2**53)]
    first: Annotated[int, Meta(ge=0)]
    messages: tuple[str, ...]
    facts: Annotated[BrowserFacts, Meta(max_length=40)] | None = None
    complete: bool = False


class SiteRecord(msgspec.Struct, frozen=True):
    """A participant's record.

    Attributes:
        id: the record's random name, which the page chose.
        digest: the SHA-256 of name, slot and messages, with which a repeated import is recognised.
        messages: the numbered messages, in order.
        missing: a description of the messages that are missing, as a part of the record did not arrive; "" for none.
    """

    id: str
    study: str
    build: str
    slot: int
    started_unix_ms: int
    facts: dict[str, Any]
    digest: str
    messages: tuple[NumberedMessage, ...]
    missing: str = ""


def read_records(paths: Iterable[Path]) -> list[SiteRecord]:
    """Read records, and join the parts of each record, which may be in several files.

    Raises:
        SiteError: if a file is no record, or two parts contradict each other.
    """
    parts_by_record: dict[str, list[RecordPart]] = defaultdict(list)
    for path in paths:
        for part in _read_parts(path):
            parts_by_record[part.id].append(part)
    return [_join_parts(parts) for parts in parts_by_record.values()]


def _read_parts(path: Path) -> list[RecordPart]:
    """Read the parts of records in a file, which has one part per line.

    Raises:
        SiteError: if the file is too large, or a line is no part of a record in the present format.
    """
    if path.stat().st_size > MAX_RECORD_BYTES:
        raise SiteError(f"{path} has {path.stat().st_size} bytes; a record has at most {MAX_RECORD_BYTES}")
    try:
        lines = [line for line in path.read_bytes().splitlines() if line.strip()]
        parts = [msgspec.json.decode(line, type=RecordPart) for line in lines]
    except (msgspec.DecodeError, RecursionError) as error:
        raise SiteError(f"{path} is no record of a site ({error}); is it the file that the page saved?") from error
    for part in parts:
        if part.format != FORMAT or part.version != RECORD_VERSION:
            raise SiteError(f"{path} is a {part.format!r} of version {part.version}; this reads {RECORD_VERSION}")
    return parts


def _join_parts(parts: Sequence[RecordPart]) -> SiteRecord:
    """Join the parts of one record, which may overlap, up to the first message that no part has.

    Raises:
        SiteError: if two parts have different messages at the same place, or a message is not valid.
    """
    newest = max(parts, key=lambda part: part.first + len(part.messages))
    texts: list[str] = []
    for part in sorted(parts, key=lambda part: part.first):
        if part.first > len(texts):  # a part between them is missing
            break
        overlap = texts[part.first :]
        if overlap != list(part.messages[: len(overlap)]):
            raise SiteError(f"record {part.id}: two of its parts differ in what both hold")
        texts += part.messages[len(overlap) :]
    n_messages = newest.first + len(newest.messages)
    missing = ""
    if len(texts) < n_messages:
        missing = f"messages from {len(texts) + 1} on, as the part that holds the next ones did not arrive"
    facts = next((part.facts for part in parts if part.facts), {})  # which only the first part has
    digest = hashlib.sha256(json.dumps([newest.id, newest.slot, texts]).encode()).hexdigest()
    return SiteRecord(
        newest.id,
        newest.study,
        newest.build,
        newest.slot,
        newest.started_unix_ms,
        dict(facts),
        digest,
        tuple(_decode_message(text, newest.id) for text in texts),
        missing,
    )


def _decode_message(text: str, record_id: str) -> NumberedMessage:
    """Decode a numbered message; raise SiteError, with the record's name, if it is none."""
    try:
        message = decode_page_message(text)
    except MessageError as error:
        raise SiteError(f"record {record_id}: {error}") from error
    if not isinstance(message, NumberedMessage):
        raise SiteError(f"record {record_id} holds a {type(message).__name__}, which no record does")
    return message
