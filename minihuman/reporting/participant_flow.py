"""The CONSORT flow of participants, and the interim looks at a sequential study."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from minihuman.admin.enrolment_entries import LookTaken, open_enrolment_log, read_enrolment_log
from minihuman.admin.status import (
    GroupCounts,
    ParticipantFlow,
    SessionFlow,
    count_all_interventions,
    count_participant_flow,
)
from minihuman.errors import AllocationError, LogError
from minihuman.reporting.template import (
    Table,
)


class FlowSection(NamedTuple):
    """The participants by stage; the table is None if the enrolment log cannot be read."""

    table: Table | None
    interventions: str = ""  # what was done by hand, in counts
    looks: Table | None = None  # of a sequential study


def flow_section(source: Path, participants: pd.DataFrame) -> FlowSection | None:
    """Build the section on participant flow: who came, who left and who is included.

    The section is None unless the report covers a study's whole folder with its enrolment log.

    Args:
        source: the folder or log that the report covers.
        participants: the table of participants; those without a reason in ``exclusion_reason`` are included.
    """
    try:
        if not source.is_dir() or not open_enrolment_log(source).begun:
            return None
        flow = count_participant_flow(source)
        interventions = count_all_interventions(source)
    except (AllocationError, LogError):  # no other number depends on it; the error names folders: it is not given here
        return FlowSection(None)
    included = participants[participants["exclusion_reason"].isna()].groupby("group")["participant"].nunique()
    included_by_group = {str(group): int(n) for group, n in included.items()}
    table = flow_table(flow, included_by_group, _count_excluded(participants))
    looks = [line for line in read_enrolment_log(source) if isinstance(line, LookTaken)]
    by_hand = ", ".join(f"{count} {label}" for label, count in interventions.items())
    return FlowSection(table, by_hand, looks_table(looks))


def looks_table(looks: Sequence[LookTaken]) -> Table | None:
    """Tabulate the looks at a sequential study, one row each; None if there are none."""
    if not looks:
        return None
    named = dict.fromkeys(name for look in looks for name in look.estimates)
    estimates = [name for name in named if name not in ("look", "crossed")]
    rows = [
        (
            str(look.look),
            *(str(int(statistic[0])) for statistic in _find_group_statistics(look).values()),
            *(_format_estimate(look, name) for name in estimates),
            "stopped" if look.stop else "went on",
        )
        for look in looks
    ]
    groups = [f"n, {group}" for group in _find_group_statistics(looks[0])]
    labels = {"p": "p, adjusted for the looks", "boundary": "stops at |z|"}
    return Table(("look", *groups, *(labels.get(name, name) for name in estimates), "study"), rows)


def _format_estimate(look: LookTaken, name: str) -> str:
    if name not in look.estimates:
        return "\N{EN DASH}"
    return f"{look.estimates[name]:.3g}"


def _find_group_statistics(look: LookTaken) -> dict[str, Sequence[float]]:
    """Return the statistics that are lists, one per group; the first number in each is the group's n."""
    return {name: statistic for name, statistic in look.statistics.items() if isinstance(statistic, list) and statistic}


def _count_excluded(participants: pd.DataFrame) -> dict[str, dict[str, int]]:
    """Count the participants excluded from every session, by reason (of their first session) and group."""
    included = set(participants.loc[participants["exclusion_reason"].isna(), "participant"])
    excluded = participants[~participants["participant"].isin(included)].drop_duplicates("participant")
    counts: dict[str, dict[str, int]] = {}
    for (reason, group), rows in excluded.groupby(["exclusion_reason", "group"]):
        counts.setdefault(str(reason), {})[str(group)] = len(rows)
    return counts


def flow_table(
    flow: ParticipantFlow, included: Mapping[str, int], excluded: Mapping[str, Mapping[str, int]] | None = None
) -> Table:
    """Tabulate the flow: a row per stage, a column per group.

    Args:
        flow: of the enrolment log.
        included: how many participants of each group the report includes.
        excluded: how many are excluded from every session, by reason and group.
    """
    groups = sorted({*flow.allocated, *included})
    stages: list[tuple[str, GroupCounts]] = [("allocated to a group", flow.allocated)]
    losses = (
        ("withdrew afterwards", flow.withdrew),
        ("did not return, slot reallocated", flow.replaced),
        ("no data recorded so far", flow.without_data),
    )
    stages += [(label, counts) for label, counts in losses if counts]
    for number, course in flow.courses.items():
        session = f"session {number}: " if len(flow.courses) > 1 else ""
        stages += [(f"{session}{label}", counts) for label, counts in _list_course_stages(course)]
    stages += [(f"excluded: {reason}", counts) for reason, counts in (excluded or {}).items()]
    stages.append(("included in this report", included))
    before_groups = [("came", flow.came), *flow.before.items()]
    rows = [(label, str(count), *("\N{EN DASH}" for _ in groups)) for label, count in before_groups]
    rows += [
        (label, str(sum(counts.values())), *(str(counts.get(group, 0)) for group in groups)) for label, counts in stages
    ]
    return Table(("participants", "all", *groups), rows)


def _list_course_stages(course: SessionFlow) -> Iterator[tuple[str, GroupCounts]]:
    """Yield the stages of one session: an early end only where a participant had it."""
    yield "began", course.began
    early_ends = (
        ("screened out", course.screened_out),
        ("simulated participant failed", course.failed),
        ("not finished", course.unfinished),
    )
    for label, counts in early_ends:
        if counts:
            yield label, counts
    yield "finished", course.complete
