"""Record where exports, reports and tables of a study were written, so that a withdrawal can name them.

The list is in the data folder, for all studies there. It cannot find outputs that were moved, copied or published.
"""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import msgspec

from minihuman.dataset.table_catalogue import TablePartition
from minihuman.storage.durable_files import write_atomically
from minihuman.storage.file_journal import FileJournal
from minihuman.storage.remote_store import FolderStore
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, find_database_url

OUTPUTS_FILE_NAME = "outputs.jsonl"
NOTICE_FILE_NAME = "WITHDRAWN.md"
TABLES = "tables"  # the kind of a folder that `minihuman gather --tables` filled


class RecordedOutput(msgspec.Struct, frozen=True):
    """An export, a report or tables made from a study."""

    study: str
    kind: str  # "report", "export csv", "tables"
    path: str  # absolute


def record_output(study_dir: Path, kind: str, out: Path) -> str:
    """Record an output of a study that has an enrolment log; participants can withdraw only from such a study.

    Args:
        study_dir: the study's folder.
        kind: the kind of output, such as "report", "export csv" or "tables".
        out: the folder of the output.

    Returns:
        The reason why a later withdrawal will not find the output; "" if it will, or if the study has no enrolment log.
    """
    study_dir = study_dir.absolute()
    if not (study_dir / ENROLMENT_FILE_NAME).is_file() and not find_database_url(study_dir):
        return ""
    output = RecordedOutput(study_dir.name, kind, str(out.absolute()))
    try:
        with _open_output_list(study_dir.parent).hold() as journal:
            if output not in journal.lines:
                journal.append(output)
    except OSError as error:  # a read-only copy of the data folder
        return f"{study_dir.parent} cannot be written ({error.strerror}), so a later withdrawal will not name {out}"
    return ""


def list_outputs(study_dir: Path) -> Iterator[RecordedOutput]:
    """Yield the recorded outputs of a study, without those whose folders no longer exist where they were written."""
    study_dir = study_dir.absolute()
    for output in _open_output_list(study_dir.parent).read():
        if output.study == study_dir.name and Path(output.path).is_dir():
            yield output


def withdraw_from_outputs(study_dir: Path, code: str) -> list[str]:
    """Erase a participant from folders of tables, and add a notice of the withdrawal to every other output.

    Returns:
        A line for each output that still contains their data.

    Raises:
        OSError: if a notice cannot be written.
        RemoteStoreError: if tables cannot be removed.
    """
    lines: list[str] = []
    for output in list_outputs(study_dir):
        folder = Path(output.path)
        if output.kind == TABLES:
            _erase_tables(folder, output.study, code)
            continue
        notice_path = folder / NOTICE_FILE_NAME
        notice = notice_path.read_text(encoding="utf-8") if notice_path.is_file() else _NOTICE_HEADER
        if code not in notice:
            write_atomically(f"{notice}- {code}\n", notice_path)
        lines.append(f"{folder} ({output.kind}) was made before {code} withdrew; make it again, or delete it")
    return lines


_NOTICE_HEADER = "Since this was made, these participants withdrew from the study. Make it again, or delete it:\n\n"


def _erase_tables(folder: Path, study: str, code: str) -> None:
    """Erase the files of a participant of a study from a folder of tables that has files of several participants."""
    store = FolderStore(folder)
    partitions = map(TablePartition.parse, store.names(""))
    owner = (study, code)
    names = [
        partition.name for partition in partitions if partition and (partition.study, partition.participant) == owner
    ]
    store.erase(code, names)


def _open_output_list(data_folder: Path) -> FileJournal[RecordedOutput]:
    return FileJournal(data_folder / OUTPUTS_FILE_NAME, _decode_output, mode=0o600)


def _decode_output(line: bytes, number: int) -> RecordedOutput | None:
    """Decode a line; return None for a line that a crash cut off."""
    with suppress(msgspec.DecodeError):
        return msgspec.json.decode(line, type=RecordedOutput)
    return None
