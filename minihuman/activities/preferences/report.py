"""The report's table of comparisons: the answers and the response times."""

from collections.abc import Mapping

import numpy as np

from minihuman.log.model.session_log import SessionLog
from minihuman.reporting.activity_sections import CaptionedTable, ReportSection, SectionSource
from minihuman.reporting.template import Table, format_number

_HEADS = ("session", "pairs", "left", "right", "equal", "cannot tell", "s", "replays")
_CAPTION = "Comparisons: the answers, the median response time, and how often pairs were replayed."
_MS_PER_S = 1e3


def build_section(source: SectionSource) -> ReportSection | None:
    """Build the section on comparisons, or return None if there were none."""
    rows = _build_rows(source.read_logs(source.table("preferences")))
    if rows:
        return ReportSection("Teaching", [CaptionedTable(Table(_HEADS, rows), _CAPTION)], rank=2)
    return None


def _build_rows(logs: Mapping[str, SessionLog]) -> list[tuple[str, ...]]:
    """Return the cells of the table's row of each session with answers; ``logs`` are by the session's name."""
    rows = []
    for name, log in logs.items():
        answers = [comparison.preference.answer for comparison in log.comparisons]
        if answers:
            times_ms = [comparison.answer_ms for comparison in log.comparisons if not np.isnan(comparison.answer_ms)]
            counts = [str(answers.count(answer)) for answer in ("left", "right", "equal", "cannot_tell")]
            n_replays = str(sum(comparison.preference.replays for comparison in log.comparisons))
            median_s = format_number(float(np.median(times_ms)) / _MS_PER_S, 2)
            rows.append((name, str(len(answers)), *counts, median_s, n_replays))
    return rows
