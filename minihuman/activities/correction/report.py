"""The report's table of corrections: their number and their length."""

from minihuman.reporting.activity_sections import CaptionedTable, ReportSection, SectionSource
from minihuman.reporting.template import Table

_HEADS = ("session", "corrections", "steps")
_CAPTION = "Corrections after the fact: their number, and their steps in total."


def build_section(source: SectionSource) -> ReportSection | None:
    """Build the section on corrections, or return None if there were none."""
    rows = []
    for name, log in source.read_logs(source.table("corrections")).items():
        if log.corrections:
            n_steps = sum(len(correction.actions) for correction in log.corrections)
            rows.append((name, str(len(log.corrections)), str(n_steps)))
    if rows:
        return ReportSection("Teaching", [CaptionedTable(Table(_HEADS, rows), _CAPTION)], rank=1)
    return None
