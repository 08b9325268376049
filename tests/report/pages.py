"""The report's page with little on it, to look at one of its parts."""

from pathlib import Path
from typing import Any

from minihuman.reporting.sections import quality_section
from minihuman.reporting.template import REPORT, Table, render_template

NOTHING: dict[str, Any] = {
    "study": "little", "versions": "Protocol version 1", "sessions": 0, "included": (0, 0),
    "are_trials": False, "players": (), "answers_without_rules": [],
    "simulated": 0, "imported": 0, "windows": "", "flow": None, "practice": {}, "published": None, "blocks": [],
    "absent_measures": [], "question": "", "answers_first": [], "first_figures": [], "excluded": "none",
    "within": None, "interaction": None,
    "min_growth_episodes": 8, "clauses": None, "activities": [], "answers": None, "figures": [], "models": [],
    "task_load": None,
    "quality": quality_section([]),
    "exclusions": None, "skipped": Table((), ()), "methods": [], "tables": [],
}  # fmt: skip


def page(templates: Path | None = None, **shown: Any) -> str:
    """Render a page that shows this and nothing else."""
    return render_template(REPORT, NOTHING | shown, templates)
