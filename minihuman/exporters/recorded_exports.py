"""Write an export of a study, erasing withdrawn participants' data before, and recording its folder afterwards."""

from collections.abc import Callable
from pathlib import Path

from minihuman.admin.local_copies import obey_withdrawals
from minihuman.admin.recorded_outputs import record_output
from minihuman.dataset.selection import Selection
from minihuman.errors import name_output_when_full
from minihuman.exporters.exporter import ExportCard, ExportResult

Writer = Callable[..., tuple[ExportResult, ExportCard]]  # ``export_study`` for a format, with its options


def write_recorded_export(
    write: Writer, kind: str, study: Path, out: Path, selection: Selection, *, progress: Callable[[Path], None]
) -> tuple[ExportResult, tuple[str, ...]]:
    """Erase withdrawn participants' data, write an export, and record its folder for later withdrawals.

    Args:
        write: the function that writes it.
        kind: what it is, as a later withdrawal names it: "export csv", "publish osf".
        study: the study's folder, or a log.
        out: the export's folder.
        selection: the rule for which sessions and episodes are included.
        progress: called with the path of each log.

    Returns:
        The export, and the lines that report its contents and what was excluded or erased.
    """
    erasures: list[str] = []
    obey_withdrawals(study, say=erasures.append)
    with name_output_when_full(out):
        export, card = write(study, out, selection, progress=progress)
    record_problem = record_output(study, kind, out)
    excluded = (f"excluded: {line}" for line in export.left_out)
    notes = (*erasures, *card.account.lines(), *excluded, *export.notes, *card.account.notes)
    return export, (*notes, *filter(None, [record_problem]))
