"""Studies that are open for editing. The file on disk is the truth: it is read for each request and replaced whole.

A version of the file is the SHA-256 of its bytes. An edit names the version to which it applies, so that two tabs, or
the builder and an editor, never overwrite each other's work.
"""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock

from minihuman.admin.protocol_file import MAX_PROTOCOL_BYTES
from minihuman.builder import description
from minihuman.builder.check_report import check_study
from minihuman.builder.differences import list_differences
from minihuman.builder.document import NotEditableError, TomlDocument
from minihuman.builder.durations import estimate_durations
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.history import FileHistory
from minihuman.builder.imported_studies import StudyImports, describe_trust, trust_study
from minihuman.builder.media import MediaFolder
from minihuman.builder.messages import (
    CheckReport,
    Differences,
    Document,
    Edit,
    EditRefusal,
    Mistake,
    NewStudyRequest,
    Studies,
    StudyCard,
    TrustQuestion,
)
from minihuman.builder.new_study import list_templates, make_study
from minihuman.builder.recorded_data import RecordedStudy
from minihuman.builder.references import rename
from minihuman.builder.restrictions import WAY_OUT, count_enrolled, find_restrictions, find_violation
from minihuman.builder.toml_spans import Steps
from minihuman.errors import MinihumanError
from minihuman.storage.durable_files import replace_durably
from minihuman.web.server.desk import StudyEntry, find_studies


@dataclass(slots=True)
class _FileState:
    """What this process keeps about a file between requests."""

    history: FileHistory
    lock: Lock = field(default_factory=Lock)
    literals: dict[tuple[Steps, str], str] = field(default_factory=dict)  # how a value was written, by path and value


class StudyFolder:
    """The studies of a folder.

    Args:
        folder: the folder of the protocols.
        data_folder: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data_folder: Path) -> None:
        self.folder = folder
        self.data = data_folder
        self.imports = StudyImports(folder)
        self._states: dict[Path, _FileState] = {}

    def list_studies(self) -> Studies:
        """Describe every study of the folder, and the templates."""
        cards = [self._describe(study_entry) for study_entry in find_studies(self.folder, self.data)]
        return Studies(self.folder.resolve().name, cards, list(list_templates()))

    def open(self, key: str) -> "OpenStudy":
        """Open the study with a key, which is the path of its protocol in the folder.

        Raises:
            EditRefusedError: if there is no such file.
        """
        for study_entry in find_studies(self.folder, self.data):
            if study_entry.key == key and study_entry.protocol is not None:
                return self._open(study_entry, study_entry.protocol)
        raise EditRefusedError(EditRefusal("not_there", f"there is no study {key!r} in this folder; reload the page"))

    def open_data(self, key: str) -> RecordedStudy:
        """Open the recorded sessions of a study.

        Raises:
            EditRefusedError: if there is no such study.
        """
        return RecordedStudy(self.open(key).study_entry)

    def compare(self, key: str, earlier_key: str) -> Differences:
        """Return the differences of a study from another one of the folder, such as its earlier version.

        Args:
            key: the key of the study.
            earlier_key: the key of the study from which it differs.

        Raises:
            EditRefusedError: if there is no such file.
            OSError: if a file cannot be read.
        """
        _, after = description.read_values(self.open(key).path.read_bytes())
        _, before = description.read_values(self.open(earlier_key).path.read_bytes())
        return Differences(key, earlier_key, list(list_differences(before, after)))

    def make(self, request: NewStudyRequest) -> Document:
        """Write a new study from a template, or as a new version of a study of the folder; describe the new file.

        Raises:
            EditRefusedError: if there is a study of that name already, or no such template or study.
            OSError: if it cannot be written.
        """
        if request.source_key:
            source = self.open(request.source_key).path
            folder = self.folder.resolve()  # as the path of the source is resolved
            key = make_study(request, self.folder, source).relative_to(folder)
        else:
            key = make_study(request, self.folder, None).relative_to(self.folder)
        return self.open(str(key)).read()

    def _open(self, study_entry: StudyEntry, protocol: Path) -> "OpenStudy":
        path = protocol.resolve()
        state = self._states.setdefault(path, _FileState(FileHistory(path)))
        return OpenStudy(study_entry, path, state)

    def _describe(self, study_entry: StudyEntry) -> StudyCard:
        """Return the card of a study; a study without a protocol has empty values where the protocol would say more."""
        document = None
        if study_entry.protocol is not None:
            document = self._open(study_entry, study_entry.protocol).read()
        tree = document.tree if document else {}
        study = tree.get("study", {})
        about = tree.get("about", {})
        minutes = [(duration.least_min, duration.most_min) for duration in (document.durations if document else ())]
        return StudyCard(
            key=study_entry.key,
            name=study_entry.name,
            title=str(about.get("title", "")) or study_entry.name,
            language=str(study.get("language", "en")),
            groups=list(dict.fromkeys(lane.group for lane in (document.lanes if document else ()))),
            parts=document.parts if document else [],
            lanes=document.lanes if document else [],
            minutes=max(minutes, key=lambda pair: pair[1], default=None),
            participants=study.get("participants", 100),
            enrolled=_count_enrolled(study_entry),
            sessions=_count_sessions(study_entry),
            mistakes=len(document.mistakes) if document else 0,
            problem=study_entry.problem,
            has_protocol=study_entry.protocol is not None,
        )


class OpenStudy:
    """A protocol file that is open in the builder.

    Args:
        study_entry: the study.
        path: its file, after following links.
        state: what is kept of the file between requests.
    """

    def __init__(self, study_entry: StudyEntry, path: Path, state: _FileState) -> None:
        self.study_entry = study_entry
        self.path = path
        self._state = state

    def version(self) -> str:
        """Return the version of the file as it is now, the SHA-256 of its bytes.

        Raises:
            OSError: if the file cannot be read.
        """
        return hashlib.sha256(self.path.read_bytes()).hexdigest()

    def check(self) -> CheckReport:
        """Check the file as `minihuman check` does, which takes seconds.

        Raises:
            OSError: if the file cannot be read.
        """
        return check_study(self.path)

    def ask_trust(self) -> TrustQuestion:
        """Return what the file would run or read if it were trusted.

        Raises:
            OSError: if a file cannot be read.
        """
        return describe_trust(self.path, description.read_values(self.path.read_bytes())[1])

    def trust(self, seen_sha256: str) -> Document:
        """Trust what the file runs and reads, if the code is the one that the user has seen; describe the file then.

        Raises:
            EditRefusedError: if the code has changed since.
            OSError: if the record of trust cannot be written.
        """
        trust_study(self.path, description.read_values(self.path.read_bytes())[1], seen_sha256)
        return self.read()

    def media(self) -> MediaFolder:
        """Return the folder of the files beside the protocol.

        Raises:
            OSError: if the file cannot be read.
        """
        _, tree = description.read_values(self.path.read_bytes())
        return MediaFolder(self.path.parent, tree)

    def read(self) -> Document:
        """Read the file and describe it.

        Raises:
            OSError: if the file cannot be read.
        """
        return self._describe(self.path.read_bytes())

    def edit(self, version: str, edits: Sequence[Edit]) -> Document:
        """Make edits together, write the file, and describe it, if it is still the version to which they apply.

        Args:
            version: the SHA-256 of the file that the caller saw last.
            edits: the edits, in order; all are made, or none.

        Raises:
            EditRefusedError: if the file has changed, an edit is not possible, or enrolment has fixed what it changes.
            OSError: if the file cannot be written.
        """

        def change(old: bytes) -> bytes:
            new = self._apply(old, edits)
            self._require_allowed(old, new)
            if new != old:
                self._state.history.record(old, new)
            return new

        return self._replace(version, change)

    def undo(self, version: str) -> Document:
        """Write the version before the present one, and return the document.

        Args:
            version: the SHA-256 of the file that the caller saw last.

        Raises:
            EditRefusedError: if the file is another version now, there is no earlier one, or enrolment has fixed it.
        """
        return self._replace(version, lambda old: self._step(old, -1))

    def redo(self, version: str) -> Document:
        """Write the version that was undone last, and return the document.

        Args:
            version: the SHA-256 of the file that the caller saw last.

        Raises:
            EditRefusedError: if the file is another version now, there is no later one, or enrolment has fixed it.
        """
        return self._replace(version, lambda old: self._step(old, 1))

    def _replace(self, version: str, change: Callable[[bytes], bytes]) -> Document:
        """Write what ``change`` returns for the file's present bytes, and describe the new file.

        Raises:
            EditRefusedError: if the file is another version now, or ``change`` refuses.
            OSError: if the file cannot be read or written.
        """
        with self._state.lock:
            old = self.path.read_bytes()
            if hashlib.sha256(old).hexdigest() != version:
                message = "the file was changed elsewhere in the meantime; look at it as it is now, and edit it again"
                raise EditRefusedError(EditRefusal("conflict", message, document=self._describe(old)))
            new = change(old)
            if new != old:
                with replace_durably(self.path, mode=self.path.stat().st_mode & 0o777) as file:
                    file.write(new)
            return self._describe(new)

    def _step(self, old: bytes, by: int) -> bytes:
        """Return the version before (-1) or after (+1) the present bytes, and move to it in the history.

        Raises:
            EditRefusedError: if there is no such version, or enrolment has fixed what it changes.
        """
        history = self._state.history
        if not history.can_step(old, by):
            which = "an earlier" if by < 0 else "a later"
            raise EditRefusedError(EditRefusal("not_there", f"there is not {which} version of this file"))
        new = history.peek(old, by)
        self._require_allowed(old, new)
        return history.step(old, by)

    def _apply(self, old: bytes, edits: Sequence[Edit]) -> bytes:
        """Return the file's new bytes, with edits applied to the bytes ``old`` in order.

        Raises:
            EditRefusedError: if an edit is not possible, or the file would be too large.
        """
        text = _decode(old)
        try:
            for edit in edits:
                text = self._apply_edit(text, edit)
        except NotEditableError as error:
            raise EditRefusedError(EditRefusal("not_editable", str(error), list(error.path), error.line)) from error
        new = text.encode()
        if len(new) > MAX_PROTOCOL_BYTES:
            message = f"the file would have {len(new)} bytes; a protocol has {MAX_PROTOCOL_BYTES} at most"
            raise EditRefusedError(EditRefusal("not_valid", message))
        return new

    def _apply_edit(self, text: str, edit: Edit) -> str:
        """Return a protocol's text after one edit.

        Raises:
            NotEditableError: if the edit is not possible.
        """
        path: Steps = tuple(edit.path)
        if edit.op == "replace_text":
            if not isinstance(edit.value, str):
                raise NotEditableError("replace_text takes a text")
            return edit.value
        document = TomlDocument.parse(text)
        if not path:
            raise NotEditableError(f"{edit.op} takes the path of a field")
        match edit.op:
            case "set":
                return self._set(document, path, edit.value).text
            case "remove":
                return document.remove(path).text
            case "insert":
                return document.insert(path, edit.value).text
            case "move":
                return document.move(path, edit.to).text
            case "rename":
                return rename(document, path, str(edit.value)).text
            case "duplicate":
                copy: Steps = (*path[:-1], int(path[-1]) + 1)
                document = document.duplicate(path)
                for name, content in (edit.value or {}).items():
                    document = document.set((*copy, name), content)
                return document.text

    def _set(self, document: TomlDocument, path: Steps, content: object) -> TomlDocument:
        """Return the document with a field set to a value.

        A value that the field had before is written with the same text as then: a reversed edit leaves no trace.
        """
        literals = self._state.literals
        if literal := document.literal(path):
            literals[path, _make_comparable(document.find(path))] = literal
        return document.set(path, content, literals.get((path, _make_comparable(content)), ""))

    def _require_allowed(self, old: bytes, new: bytes) -> None:
        """Check that the new bytes of a file change nothing that enrolment has fixed.

        If the old bytes have no values, as they are not valid TOML, nothing is checked.

        Raises:
            EditRefusedError: if they change something that is fixed.
        """
        _, before = description.read_values(old)
        _, after = description.read_values(new)
        if not before:
            return
        violation = find_violation(self.study_entry.folder, before, after, new)
        if violation is not None:
            path, problem = violation
            raise EditRefusedError(EditRefusal("restricted", f"{problem}; {WAY_OUT}", list(path)))

    def _describe(self, content: bytes) -> Document:
        text, tree = description.read_values(content)
        lines: dict[str, int] = {}
        document = None
        try:
            document = TomlDocument.parse(_decode(content))
            lines = description.list_lines(document)
        except (NotEditableError, EditRefusedError) as error:
            read_only = [Mistake([], getattr(error, "line", 1), str(error))]
        else:
            read_only = description.list_old_names(tree, document)
        protocol, mistakes = description.check_file(self.path, content)
        return Document(
            key=self.study_entry.key,
            name=self.study_entry.name,
            version=hashlib.sha256(content).hexdigest(),
            text=text,
            tree=tree,
            lines=lines,
            parts=description.list_parts(tree, document),
            lanes=description.list_lanes(tree),
            mistakes=mistakes,
            restrictions=find_restrictions(self.study_entry.folder, tree),
            durations=estimate_durations(protocol) if protocol else [],
            pay=description.describe_pay(tree),
            can_undo=self._state.history.can_step(content, -1),
            can_redo=self._state.history.can_step(content, 1),
            trusted=description.is_trusted(tree, self.path.parent),
            read_only=read_only,
        )


def _make_comparable(content: object) -> str:
    """Return a text that is equal for values that mean the same, such as 2 and 2.0."""
    if isinstance(content, int) and not isinstance(content, bool):
        content = float(content)
    return repr(content)


def _decode(content: bytes) -> str:
    """Decode a file from UTF-8, so that encoding the text gives the same bytes.

    Raises:
        EditRefusedError: if it is not UTF-8.
    """
    try:
        return content.decode()
    except UnicodeDecodeError as error:
        message = f"byte {error.start} is not valid UTF-8; save the file as UTF-8"
        raise EditRefusedError(EditRefusal("not_editable", message)) from None


def _count_enrolled(study_entry: StudyEntry) -> int:
    """Count the enrolled participants of a study; 0 if its enrolment log cannot be read."""
    try:
        return count_enrolled(study_entry.folder)
    except (MinihumanError, OSError):  # the study's own page says why
        return 0


def _count_sessions(study_entry: StudyEntry) -> dict[str, int]:
    """Count the sessions of a study by state; {} if they cannot be read."""
    try:
        return dict(study_entry.counts())
    except (MinihumanError, OSError):
        return {}
