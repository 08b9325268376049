"""Online recruitment: the links that were issued, who arrived by which, and whether more participants are accepted.

Kept in the journal ``arrivals.jsonl`` beside the enrolment log, which many servers share. A link is stored as the
SHA-256 of its token, a participant of a recruiting platform as the HMAC of the platform's id. The id itself, which
paying a bonus needs, is in the journal ``platform-ids.jsonl``, which only the owner may read.
"""

import hashlib
import hmac
import secrets
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from minihuman.storage.durable_files import sync_folder, write_durably
from minihuman.storage.journal import Journal, JournalState, LockedJournal
from minihuman.storage.study_journals import ARRIVALS_FILE_NAME, find_database_url, open_journal
from minihuman.storage.system import current_system, now_text

IDS_FILE_NAME = "platform-ids.jsonl"
SECRET_FILE_NAME = "arrivals.secret"
_OWNER_ONLY = 0o600


class LinkIssued(msgspec.Struct, frozen=True):
    """A link, good for one slot."""

    issued: str  # "link:" and the SHA-256 of its token, hexadecimal
    at: str  # ISO 8601 UTC


class ParticipantArrived(msgspec.Struct, frozen=True):
    """A participant came and has this slot; who comes by the same link or id again is the same participant."""

    came: str  # "link:..." or "prolific:..." with an HMAC
    participant: str
    at: str


class RecruitmentSwitched(msgspec.Struct, frozen=True):
    """Recruitment was opened or closed; participants with a slot may always resume."""

    recruiting: bool
    at: str


class PlatformId(msgspec.Struct, frozen=True):
    """A participant's id on the platform that sent them."""

    participant: str
    platform: str
    id: str


class PlatformSecret(msgspec.Struct, frozen=True):
    """The secret with which platforms' ids are hashed."""

    secret: str  # hexadecimal


RecruitmentEntry = LinkIssued | ParticipantArrived | RecruitmentSwitched
_ENTRY_TYPES: dict[str, type[RecruitmentEntry]] = {
    "issued": LinkIssued,
    "came": ParticipantArrived,
    "recruiting": RecruitmentSwitched,
}


@dataclass(slots=True)
class RecruitmentState:
    """The state of recruitment after all entries."""

    issued: set[str] = field(default_factory=set)
    came: dict[str, str] = field(default_factory=dict)  # by what they came -> participant
    recruiting: bool = True

    def take(self, line: RecruitmentEntry) -> None:
        """Take an entry into account."""
        match line:
            case LinkIssued(issued=key):
                self.issued.add(key)
            case ParticipantArrived(came=key, participant=participant):
                self.came[key] = participant
            case RecruitmentSwitched(recruiting=now):
                self.recruiting = now


class Recruitment:
    """The arrivals of one study, shared by every process that has its folder.

    Args:
        study_dir: the study's folder; made when first written to.
    """

    def __init__(self, study_dir: Path) -> None:
        self._journal: Journal[RecruitmentEntry] = open_journal(study_dir, ARRIVALS_FILE_NAME, _decode_entry)
        self._ids = open_journal(study_dir, IDS_FILE_NAME, _platform_id, mode=_OWNER_ONLY)
        self._in_database = bool(find_database_url(study_dir))
        self._secrets = open_journal(study_dir, SECRET_FILE_NAME, _secret, mode=_OWNER_ONLY)
        self._secret_path = study_dir / SECRET_FILE_NAME
        self._state = JournalState(RecruitmentState, RecruitmentState.take)
        self._known_ids: JournalState[PlatformId, set[PlatformId]] = JournalState(set, set.add)

    @property
    def begun(self) -> bool:
        """Tell whether a place was ever offered online."""
        return self._journal.begun

    def issue(self, count: int) -> list[str]:
        """Make links: their tokens, which are kept nowhere.

        Raises:
            OSError: if the folder cannot be written.
        """
        tokens = [secrets.token_urlsafe(16) for _ in range(count)]
        with self._journal.hold() as journal:
            journal.append(*(LinkIssued(hash_link_token(token), now_text()) for token in tokens))
        return tokens

    def recruit(self, recruiting: bool) -> None:
        """Open or close recruitment, for every server of the study."""
        with self.exclusive() as arrivals:
            if arrivals.standing.recruiting != recruiting:
                arrivals.journal.append(RecruitmentSwitched(recruiting, now_text()))

    def standing(self) -> RecruitmentState:
        """Return what all entries together say now."""
        return JournalState(RecruitmentState, RecruitmentState.take).after(self._journal.read())

    def find_participant(self, key: str) -> str | None:
        """Find the participant who came by a link or from a platform; None for a new visitor."""
        return self._state.after(self._journal.read()).came.get(key)

    def has_issued(self, key: str) -> bool:
        """Tell whether a link was issued."""
        return key in self._state.after(self._journal.read()).issued

    def count_sources(self) -> dict[str, int]:
        """Count who came, by source: personal links, and each platform."""
        sources = Counter(key.partition(":")[0] for key in self._state.after(self._journal.read()).came)
        return {"personal link" if source == "link" else source: count for source, count in sorted(sources.items())}

    @contextmanager
    def exclusive(self) -> Iterator["RecruitmentTransaction"]:
        """Lock the arrivals while a participant is given a slot."""
        with self._journal.hold() as journal:
            yield RecruitmentTransaction(journal, self._state.after(journal.lines))

    def hash_platform_id(self, platform: str, person: str) -> str:
        """Hash a person's platform id: an HMAC with the study's own secret."""
        digest = hmac.new(self._secret(), f"{platform}:{person}".encode(), hashlib.sha256).hexdigest()
        return f"{platform}:{digest}"

    def remember(self, platform_id: PlatformId) -> None:
        """Keep a platform's id where only the owner can read it; a repeated one is written once."""
        with self._ids.hold() as journal:
            if platform_id not in self._known_ids.after(journal.lines):
                journal.append(platform_id)

    def ids(self) -> dict[str, PlatformId]:
        """Return the participants' latest ids on their platforms, by code; none of those who came by a link."""
        return {platform_id.participant: platform_id for platform_id in self._ids.read()}

    def forget(self, participant: str) -> None:
        """Erase how a participant came and who they are elsewhere, for ever."""
        for journal in (self._journal, self._ids):
            journal.keep(lambda line: not _names(line, "participant", participant))

    def _secret(self) -> bytes:
        """Return the study's secret; the first process to ask makes it for all."""
        if not self._in_database:
            return _secret_in(self._secret_path)
        known = self._secrets.read()
        if not known:
            with self._secrets.hold() as journal:
                if not journal.lines:
                    journal.append(PlatformSecret(secrets.token_hex(32)))
                known = journal.lines
        return bytes.fromhex(known[0].secret)


@dataclass(frozen=True, slots=True)
class RecruitmentTransaction:
    """The arrivals while no other process can add to them."""

    journal: LockedJournal[RecruitmentEntry]
    standing: RecruitmentState


def hash_link_token(token: str) -> str:
    """Hash a link's token to the key that stands for it."""
    return f"link:{hashlib.sha256(token.encode()).hexdigest()}"


def _decode_entry(line: bytes, number: int) -> RecruitmentEntry | None:
    """Decode a whole line; None of a cut-off one, which was never acknowledged, and of other kinds."""
    try:
        fields = msgspec.json.decode(line, type=dict[str, Any])
        kind = next((kind for field, kind in _ENTRY_TYPES.items() if field in fields), None)
        if kind is None:
            return None
        return msgspec.convert(fields, kind)
    except msgspec.DecodeError:
        return None


def _names(line: bytes, field: str, value: str) -> bool:
    try:
        return bool(msgspec.json.decode(line, type=dict[str, Any]).get(field) == value)
    except msgspec.DecodeError:
        return False


def _platform_id(line: bytes, number: int) -> PlatformId | None:
    with suppress(msgspec.DecodeError):  # half a line, of a crash
        return msgspec.json.decode(line, type=PlatformId)
    return None


def _secret_in(path: Path) -> bytes:
    """Read the secret in a file; the first process to ask makes it for all."""
    while not path.exists():
        unnamed = path.with_name(f"{SECRET_FILE_NAME}.{secrets.token_hex(4)}")
        disk = current_system().disk
        disk.make_folder(path.parent)
        with write_durably(unnamed, _OWNER_ONLY, new=True) as file:
            file.write(secrets.token_bytes(32))
        with suppress(FileExistsError):
            disk.link(unnamed, path)
        disk.unlink(unnamed)
        sync_folder(path.parent)
    return path.read_bytes()


def _secret(line: bytes, number: int) -> PlatformSecret | None:
    with suppress(msgspec.DecodeError):
        return msgspec.json.decode(line, type=PlatformSecret)
    return None
