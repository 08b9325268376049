"""Write an export of a study, obeying withdrawals before it and recording after it where it lies."""

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
    """Obey withdrawals, write an export, and record where it lies; return it with the lines that say what it holds.

    Args:
        write: the function that writes it.
        kind: what it is, as a later withdrawal names it: "export csv", "publish osf".
        study: the study's folder, or a log.
        out: the export's folder.
        selection: the rule for which sessions and episodes are included.
        progress: called with the path of each log.
    """
    obeyed: list[str] = []
    obey_withdrawals(study, say=obeyed.append)
    with name_output_when_full(out):
        export, card = write(study, out, selection, progress=progress)
    forgotten = record_output(study, kind, out)
    excluded = (f"excluded: {line}" for line in export.left_out)
    notes = (*obeyed, *card.account.lines(), *excluded, *export.notes, *card.account.notes)
    return export, (*notes, *filter(None, [forgotten]))
