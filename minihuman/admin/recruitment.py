"""Online recruitment: the links issued, which participant arrived by which link, and whether recruitment is open.

The journal ``arrivals.jsonl`` beside the enrolment log, which several servers can share, stores a link as the SHA-256
of its token, and a participant of a recruiting platform as the HMAC of the platform's id. The id itself, which is
needed to pay a bonus, is in the journal ``platform-ids.jsonl``, which only the owner can read.
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
    """A personal link, valid for one slot."""

    issued: str  # "link:" and the SHA-256 of its token, hexadecimal
    at: str  # ISO 8601 UTC


class ParticipantArrived(msgspec.Struct, frozen=True):
    """A participant arrived and has a slot; a visitor with the same link or id is the same participant."""

    came: str  # "link:..." or "prolific:..." with an HMAC
    participant: str
    at: str


class RecruitmentSwitched(msgspec.Struct, frozen=True):
    """Recruitment was opened or closed; participants with a slot can always resume."""

    recruiting: bool
    at: str


class PlatformId(msgspec.Struct, frozen=True):
    """A participant's id on the platform that sent them."""

    participant: str
    platform: str
    id: str


class PlatformSecret(msgspec.Struct, frozen=True):
    """The secret key with which platform ids are hashed."""

    secret: str  # hexadecimal


RecruitmentEntry = LinkIssued | ParticipantArrived | RecruitmentSwitched
_ENTRY_TYPES: dict[str, type[RecruitmentEntry]] = {
    "issued": LinkIssued,
    "came": ParticipantArrived,
    "recruiting": RecruitmentSwitched,
}


@dataclass(slots=True)
class RecruitmentState:
    """The state of recruitment after a number of journal entries.

    Attributes:
        issued: the hashed keys of the links that were issued.
        came: the participant who arrived by each key.
        recruiting: whether recruitment is open.
    """

    issued: set[str] = field(default_factory=set)
    came: dict[str, str] = field(default_factory=dict)  # participant by link or hashed platform id
    recruiting: bool = True

    def take(self, line: RecruitmentEntry) -> None:
        """Update the state with an entry."""
        match line:
            case LinkIssued(issued=key):
                self.issued.add(key)
            case ParticipantArrived(came=key, participant=participant):
                self.came[key] = participant
            case RecruitmentSwitched(recruiting=now):
                self.recruiting = now


class Recruitment:
    """The arrivals of one study, shared by all processes that use its folder.

    Args:
        study_dir: the study's folder, created on the first write.
    """

    def __init__(self, study_dir: Path) -> None:
        self._journal: Journal[RecruitmentEntry] = open_journal(study_dir, ARRIVALS_FILE_NAME, _decode_entry)
        self._ids = open_journal(study_dir, IDS_FILE_NAME, _decode_platform_id, mode=_OWNER_ONLY)
        self._in_database = bool(find_database_url(study_dir))
        self._secrets = open_journal(study_dir, SECRET_FILE_NAME, _decode_secret, mode=_OWNER_ONLY)
        self._secret_path = study_dir / SECRET_FILE_NAME
        self._state = JournalState(RecruitmentState, RecruitmentState.take)
        self._known_ids: JournalState[PlatformId, set[PlatformId]] = JournalState(set, set.add)

    @property
    def begun(self) -> bool:
        """Return whether a slot was ever offered online."""
        return self._journal.begun

    def issue(self, count: int) -> list[str]:
        """Issue a number of links and return their tokens, which are stored nowhere.

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
        """Return the current state, a new object, after all entries."""
        return JournalState(RecruitmentState, RecruitmentState.take).after(self._journal.read())

    def find_participant(self, key: str) -> str | None:
        """Return the participant who arrived with a key; None for a new visitor.

        Args:
            key: the hash of a link's token, or of a person's platform id.
        """
        return self._state.after(self._journal.read()).came.get(key)

    def has_issued(self, key: str) -> bool:
        """Return whether a link was issued, given the hash of its token."""
        return key in self._state.after(self._journal.read()).issued

    def count_sources(self) -> dict[str, int]:
        """Return the number of arrivals by source: "personal link", or the name of a platform."""
        arrivals = self._state.after(self._journal.read()).came
        sources = Counter(key.partition(":")[0] for key in arrivals)
        counts = {}
        for source, count in sorted(sources.items()):
            label = "personal link" if source == "link" else source
            counts[label] = count
        return counts

    @contextmanager
    def exclusive(self) -> Iterator["RecruitmentTransaction"]:
        """Lock the arrivals for all processes while the context lasts; yield their journal and current state."""
        with self._journal.hold() as journal:
            yield RecruitmentTransaction(journal, self._state.after(journal.lines))

    def hash_platform_id(self, platform: str, person: str) -> str:
        """Return the key under which a person's arrival is recorded: the platform's name and an HMAC of the id there.

        The HMAC uses the study's own secret.

        Args:
            platform: the name of the recruiting platform, such as "prolific".
            person: the person's id on that platform.
        """
        digest = hmac.new(self._read_secret(), f"{platform}:{person}".encode(), hashlib.sha256).hexdigest()
        return f"{platform}:{digest}"

    def remember(self, platform_id: PlatformId) -> None:
        """Store a platform id where only the owner can read it; a repeated id is written once."""
        with self._ids.hold() as journal:
            if platform_id not in self._known_ids.after(journal.lines):
                journal.append(platform_id)

    def ids(self) -> dict[str, PlatformId]:
        """Return the participants' latest platform ids, by code; participants who arrived by a link are absent."""
        return {platform_id.participant: platform_id for platform_id in self._ids.read()}

    def forget(self, participant: str) -> None:
        """Erase permanently the record of how a participant arrived, and their platform id."""
        for journal in (self._journal, self._ids):
            journal.keep(lambda line: not _has_field_value(line, "participant", participant))

    def _read_secret(self) -> bytes:
        """Return the study's secret, after creating it if there is none."""
        if not self._in_database:
            return _read_secret_file(self._secret_path)
        stored = self._secrets.read()
        if not stored:
            with self._secrets.hold() as journal:
                if not journal.lines:
                    journal.append(PlatformSecret(secrets.token_hex(32)))
                stored = journal.lines
        return bytes.fromhex(stored[0].secret)


@dataclass(frozen=True, slots=True)
class RecruitmentTransaction:
    """The arrivals while they are locked against other processes."""

    journal: LockedJournal[RecruitmentEntry]
    standing: RecruitmentState


def hash_link_token(token: str) -> str:
    """Return the hashed key that represents a link's token in the journal."""
    return f"link:{hashlib.sha256(token.encode()).hexdigest()}"


def _decode_entry(line: bytes, number: int) -> RecruitmentEntry | None:
    """Decode a line; return None for a truncated line, which was never acknowledged, and for unknown kinds."""
    try:
        fields = msgspec.json.decode(line, type=dict[str, Any])
        kind = next((kind for field, kind in _ENTRY_TYPES.items() if field in fields), None)
        if kind is None:
            return None
        return msgspec.convert(fields, kind)
    except msgspec.DecodeError:
        return None


def _has_field_value(line: bytes, field: str, value: str) -> bool:
    """Return whether a JSON line has ``field`` with this value; False for a line that is not JSON."""
    try:
        return bool(msgspec.json.decode(line, type=dict[str, Any]).get(field) == value)
    except msgspec.DecodeError:
        return False


def _decode_platform_id(line: bytes, number: int) -> PlatformId | None:
    with suppress(msgspec.DecodeError):  # a line that a crash cut off
        return msgspec.json.decode(line, type=PlatformId)
    return None


def _read_secret_file(path: Path) -> bytes:
    """Read the secret in a file, after creating it if there is none; all processes get the same one."""
    while not path.exists():
        temporary_path = path.with_name(f"{SECRET_FILE_NAME}.{secrets.token_hex(4)}")
        disk = current_system().disk
        disk.make_folder(path.parent)
        with write_durably(temporary_path, _OWNER_ONLY, new=True) as file:
            file.write(secrets.token_bytes(32))
        with suppress(FileExistsError):  # another process was first
            disk.link(temporary_path, path)
        disk.unlink(temporary_path)
        sync_folder(path.parent)
    return path.read_bytes()


def _decode_secret(line: bytes, number: int) -> PlatformSecret | None:
    """Decode a line with a secret; return None for any other line."""
    with suppress(msgspec.DecodeError):
        return msgspec.json.decode(line, type=PlatformSecret)
    return None
