"""Who took part: from coming to counting, group by group, as CONSORT asks for it."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd

from minihuman.errors import AllocationError
from minihuman.lab.flow import Counts, Flow, flow
from minihuman.lab.register_lines import register_of
from minihuman.report.html import table

_TITLE = "<h2>Who took part</h2>"


def flow_section(source: Path, participants: pd.DataFrame) -> list[str]:
    """The table, or why there is none; nothing where the report is not of a study's whole folder, with its register.

    Args:
        source: what the report is of.
        participants: the table of participants; those without a reason in ``left_out`` count.
    """
    try:
        if not source.is_dir() or not register_of(source).begun:
            return []
        found = flow(source)
    except AllocationError:  # no other number here leans on it; what is wrong names folders, so it is not said here
        return [
            _TITLE,
            '<p class="lead">Not told: the register cannot be read; <code>minihuman status</code> says why.</p>',
        ]
    counting = participants[participants["left_out"].isna()].groupby("group")["participant"].nunique()
    told = (
        "Numbers of participants, from the study's register and sessions. Whoever left before anything was recorded "
        "and came again is counted each time: nothing is kept that could tell."
    )
    counts = {str(group): int(n) for group, n in counting.items()}
    return [_TITLE, f'<p class="lead">{told}</p>', flow_table(found, counts)]


def flow_table(found: Flow, counting: Mapping[str, int]) -> str:
    """A row a stage, a column a group."""
    groups = sorted({*found.given_group, *counting})

    def row(what: str, counts: Counts) -> tuple[str, ...]:
        return (what, str(sum(counts.values())), *(str(counts.get(group, 0)) for group in groups))

    def of_all(what: str, count: int) -> tuple[str, ...]:
        return (what, str(count), *("\N{EN DASH}" for _ in groups))

    rows = [of_all("came", found.came), *(of_all(what, count) for what, count in found.before.items())]
    rows.append(row("given a group", found.given_group))
    rows += [row(what, counts) for what, counts in _parted(found) if counts]
    many = len(found.courses) > 1
    for number, course in found.courses.items():
        session = f"session {number}: " if many else ""
        rows.append(row(f"{session}began", course.began))
        rows += [
            row(f"{session}{what}", counts)
            for what, counts in (("screened out", course.screened_out), ("not finished", course.unfinished))
            if counts
        ]
        rows.append(row(f"{session}finished", course.complete))
    rows.append(row("count in this report", counting))
    return table("", ("participants", "all", *groups), rows)


def _parted(found: Flow) -> tuple[tuple[str, Counts], ...]:
    return (
        ("withdrew afterwards", found.withdrew),
        ("did not come back, slot given to another", found.replaced),
        ("nothing recorded so far", found.unrecorded),
    )
