"""Imports a site's records: runs each through the session host and the recorder, and reports every difference.

The real session machine writes the log from the messages that the page recorded. The digests of the screens that the
page showed, and of the steps that it computed, are compared with the session machine's.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from minihuman.admin.enrolment_entries import SlotTaken, open_enrolment_log
from minihuman.admin.manifest import record_log_end
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import Stop
from minihuman.experiment.machine.running_episode import NS_PER_MS
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.evidence import COLLECTED, PAGE
from minihuman.log.paths import SegmentPath
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import DeferredRecorder, Recorder
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.web import messages
from minihuman.web.computed import PageWorld
from minihuman.web.eligibility import collect_browser_facts
from minihuman.web.message_streams import IncomingStream
from minihuman.web.page_data.imported_slots import build_imported_slot, require_only_imported
from minihuman.web.session_host import SessionHost
from minihuman.web.site.site_error import SiteError
from minihuman.web.site.site_folder import digest_build, get_page_settings, plan_site_session
from minihuman.web.site.site_records import SiteRecord, read_records
from minihuman.worlds.source_digest import kernels_digest

_IMPORTED = "imported from a site, record "  # the reason for which a slot was taken, followed by the record's digest


@dataclass(frozen=True, slots=True)
class ImportedRecord:
    """The outcome of importing one record.

    Attributes:
        id: the record's name.
        log: the session's log; None if the record was refused or imported before, or the participant declined.
        screens: the number of screens that the page reported to have shown.
        differences: a sentence for each screen or step that differs from the session machine's.
        notes: further remarks on the import, such as that the slot was taken before.
        error: the error for which the record was refused; None if it was not.
    """

    id: str
    log: Path | None
    screens: int = 0
    differences: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    error: MinihumanError | None = None

    @property
    def text(self) -> str:
        """Return a description of the outcome in one line."""
        if self.error is not None:
            return f"{self.id}: {self.error}"
        outcome = "nothing was written"
        if self.log is not None:
            outcome = f"{self.screens} screens, {len(self.differences)} differ, consistent, not witnessed: {self.log}"
        return "; ".join([f"{self.id}: {outcome}", *self.notes, *self.differences])


def import_records(paths: Iterable[Path], study: Path, protocol: Protocol) -> Iterator[ImportedRecord]:
    """Import records into a study's folder as one session per record, and yield each outcome, in order of time.

    Args:
        paths: the files of the records.
        study: the study's folder, which must have the study's name.
        protocol: the protocol from which the site was made.

    Raises:
        SiteError: if a file is no record, or the folder has another name.
    """
    if study.absolute().name != protocol.study.name:
        raise SiteError(f"the study's folder is {study.name!r}, the protocol is of study {protocol.study.name!r}")
    for record in sorted(read_records(paths), key=lambda record: (record.started_unix_ms, record.id)):
        try:
            yield _import_record(record, study.absolute(), protocol)
        except MinihumanError as error:
            yield ImportedRecord(record.id, None, error=error)


def _import_record(record: SiteRecord, study: Path, protocol: Protocol) -> ImportedRecord:
    """Enrol a record's participant, unless that was done before, and write the session's log.

    Raises:
        MinihumanError: if the record is refused.
    """
    _require_build(record, protocol)
    study.mkdir(parents=True, exist_ok=True)
    notes = []
    with open_enrolment_log(study).hold() as register:
        taken_slots = [line for line in register.lines if isinstance(line, SlotTaken)]
        require_only_imported(taken_slots, study, _IMPORTED)
        imported_slot = next((line for line in taken_slots if line.reason == _IMPORTED + record.digest), None)
        n_taken_before = sum(line.index == record.slot for line in taken_slots)
        code = format_participant_code(record.slot, n_taken_before)
        if imported_slot is not None:
            code = imported_slot.participant
        plan = plan_site_session(protocol, record.slot, code)
        if SegmentPath.of_plan(study.parent, plan).log.exists():
            return ImportedRecord(record.id, None, notes=("imported before",))
        if imported_slot is None:
            reason = _IMPORTED + record.digest
            list_length = protocol.study.participants
            register.append(build_imported_slot(plan, record.slot, reason, list_length=list_length))
    if n_taken_before and imported_slot is None:
        notes.append(f"slot {record.slot + 1} was taken {n_taken_before} times before, so that groups may be uneven")
    if record.missing:
        notes.append(f"lacks {record.missing}")
    return SiteSessionRun(record, plan, study.parent, protocol).write(notes)


def _require_build(record: SiteRecord, protocol: Protocol) -> None:
    """Raise SiteError if a record is of another protocol or other rules, or its slot is none of the study's."""
    build = digest_build(protocol)
    if record.build != build:
        raise SiteError(
            f"recorded by build {record.build!r}, but this protocol and these rules make {build!r}; import it with the "
            "protocol and the version of minihuman that made the site"
        )
    if record.slot >= protocol.study.participants:
        raise SiteError(f"slot {record.slot + 1} is none of the study's {protocol.study.participants}")


class SiteSessionRun:
    """Runs a record's session again, with the messages of the record.

    Args:
        record: the record.
        plan: the plan of its participant's session.
        folder: the data folder.
        protocol: the study.
    """

    def __init__(self, record: SiteRecord, plan: SessionPlan, folder: Path, protocol: Protocol) -> None:
        self._record = record
        self._folder = folder
        self._files: list[McapRecorder] = []
        self._screens = 0
        self._differences: list[str] = []
        self._recent: list[int] = []  # the names of the session's screens since the last one that the page reported
        settings = get_page_settings(protocol)
        self._session = build_session(
            plan, PageWorld, self._collect_facts(plan), picture_px=settings.picture_px, renders_steps=False
        )
        self._recorder = DeferredRecorder(plan, self._open_recorder)  # opened at once if no consent is asked for
        self._host = SessionHost(self._session, self._recorder, PageWorld, settings)
        self._host.restart(computes=True)

    def _collect_facts(self, plan: SessionPlan) -> dict[str, str]:
        return {
            "player": "human",
            **collect_browser_facts(self._record.facts),
            **collect_machine_facts(),
            **collect_world_facts(list_world_ids(plan)),
            COLLECTED: PAGE,
            "page_data": self._record.digest,
            "page_rules": self._record.build,
            "page_kernels": kernels_digest(),
        }

    def _open_recorder(self) -> Recorder:
        started_ns = self._record.started_unix_ms * NS_PER_MS
        self._files.append(McapRecorder(self._folder, self._session.plan, started_ns=started_ns))
        return self._files[0]

    def write(self, notes: Sequence[str]) -> ImportedRecord:
        """Run the session, write its log, and return the outcome with ``notes``.

        Raises:
            SiteError: if a message is out of order, or its time is not later than that of the previous one.
            LogError: if the log cannot be written.
        """
        try:
            self._receive_all()
            if not self._host.over:
                last_ns = self._host.last_at_ns + 1
                self._host.stop(Stop(last_ns, "window_closed", "the page has no more of this session"))
        except messages.MessageError as error:
            raise SiteError(f"record {self._record.id}: {error}") from error
        finally:
            log = self._recorder.close()
            self._host.close()
        if log is not None:
            record_log_end(log)
            self._differences += _list_page_notes(log)
        return ImportedRecord(self._record.id, log, self._screens, tuple(self._differences), tuple(notes))

    def _receive_all(self) -> None:
        incoming = IncomingStream()
        for message in self._record.messages:
            if not incoming.take(message.n) or self._host.over:
                continue
            self._compare_screen(message)
            self._host.receive(message.n, message.at, message.what)
            name = self._host.outbox.screen_name
            if self._recent[-1:] != [name]:
                self._recent.append(name)

    def _compare_screen(self, message: messages.NumberedMessage) -> None:
        """Compare a screen that the page reported to have shown with the session's screens since the last report.

        The session may have gone on to another screen before the reported one was on the display.
        """
        display = message.what
        if not isinstance(display, messages.DisplayedMessage) or display.step >= 0:
            return
        self._screens += 1
        if display.name in self._recent:
            self._recent = self._recent[self._recent.index(display.name) :]
        else:
            present = self._host.outbox.screen_name
            self._differences.append(
                f"message {message.n}: the page showed screen {display.name}, the session {present}"
            )


def _list_page_notes(log: Path) -> list[str]:
    """Return the session host's notes on the page, such as on steps that differ and keys that a script pressed."""
    notes = read_log(log).notes
    return [note.text for note in notes if isinstance(note, Noted) and note.kind == BROWSER_NOTE]
