"""The CONSORT flow of participants, and the interim looks at a sequential study."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from minihuman.admin.enrolment_entries import LookTaken, open_enrolment_log, read_enrolment_log
from minihuman.admin.enrolment_flow import GroupCounts, ParticipantFlow, list_analysis_stages, list_stages
from minihuman.admin.status import count_all_interventions, count_participant_flow
from minihuman.errors import AllocationError, LogError
from minihuman.reporting.exclusions import list_exclusion_reasons
from minihuman.reporting.template import Table


class FlowSection(NamedTuple):
    """The section that counts participants by stage; the table is None if the enrolment log cannot be read."""

    table: Table | None
    interventions: str = ""  # what was done by hand, in counts
    looks: Table | None = None  # of a sequential study
    counts: ParticipantFlow | None = None  # what the table shows


def flow_section(source: Path, participants: pd.DataFrame) -> FlowSection | None:
    """Build the section on participant flow: who came, who left and who is included.

    Return None unless the report covers a study's whole folder with its enrolment log. If the enrolment log cannot be
    read, the section has no table.

    Args:
        source: the folder or log that the report covers.
        participants: the table of participants; those without a reason in ``exclusion_reason`` are included.
    """
    try:
        if not source.is_dir() or not open_enrolment_log(source).begun:
            return None
        flow = count_participant_flow(source, list_exclusion_reasons(participants))
        interventions = count_all_interventions(source)
    except (AllocationError, LogError):  # not shown, as its text names folders, and no other number depends on it
        return FlowSection(None)
    looks = [record for record in read_enrolment_log(source) if isinstance(record, LookTaken)]
    by_hand = ", ".join(f"{count} {label}" for label, count in interventions.items())
    return FlowSection(flow_table(flow), by_hand, looks_table(looks), flow)


def looks_table(looks: Sequence[LookTaken]) -> Table | None:
    """Tabulate the interim looks at a sequential study, one row each; None if there are none."""
    if not looks:
        return None
    estimate_names = dict.fromkeys(name for look in looks for name in look.estimates)
    shown_names = [name for name in estimate_names if name not in ("look", "crossed")]
    labels = {"p": "p, adjusted for the looks", "boundary": "stops at |z|"}
    group_headings = [f"n, {group}" for group in _find_group_statistics(looks[0])]
    estimate_headings = [labels.get(name, name) for name in shown_names]
    rows = []
    for look in looks:
        group_sizes = [str(int(statistic[0])) for statistic in _find_group_statistics(look).values()]
        estimates = [_format_estimate(look, name) for name in shown_names]
        decision = "stopped" if look.stop else "went on"
        rows.append((str(look.look), *group_sizes, *estimates, decision))
    return Table(("look", *group_headings, *estimate_headings, "study"), rows)


def _format_estimate(look: LookTaken, name: str) -> str:
    """Format an estimate of a look with three significant digits; a dash if the look has no such estimate."""
    if name not in look.estimates:
        return "\N{EN DASH}"
    return f"{look.estimates[name]:.3g}"


def _find_group_statistics(look: LookTaken) -> dict[str, Sequence[float]]:
    """Return the statistics that are lists, one per group; the first number in each is the group's n."""
    return {name: statistic for name, statistic in look.statistics.items() if isinstance(statistic, list) and statistic}


def flow_table(flow: ParticipantFlow) -> Table:
    """Tabulate the flow: a row per stage and per loss before the next stage, and a column per group.

    The stages of a report's analysis follow the last stage. If participants were lost after they had begun the first
    session, the analysis starts again from those who began.
    """
    stages = list(list_stages(flow))
    n_included_besides = 0
    if flow.analysis is not None:
        analysis_stages = list(list_analysis_stages(flow.analysis))
        if stages[-1].counts == analysis_stages[0].counts:
            first, *analysis_stages = analysis_stages
            stages[-1] = stages[-1]._replace(losses=first.losses)
        stages += analysis_stages
        n_included_besides = flow.analysis.unregistered
    groups = sorted({group for stage in stages[1:] for group in stage.counts})
    rows = []
    for stage in stages:
        for label, counts in ((stage.label, stage.counts), *stage.losses.items()):
            rows.append((label, str(sum(counts.values())), *_list_group_cells(counts, groups)))
    if n_included_besides:
        rows.append(("included, but not in the enrolment log", str(n_included_besides), *_make_empty_cells(groups)))
    if flow.teams:
        rows.append(("teams of people", str(sum(flow.teams.values())), *_list_group_cells(flow.teams, groups)))
    return Table(("participants", "all", *groups), rows)


def _list_group_cells(counts: GroupCounts, groups: Sequence[str]) -> tuple[str, ...]:
    """Return the cells of a row, one per group; dashes for a stage whose people have no group yet."""
    if "" in counts:
        return _make_empty_cells(groups)
    return tuple(str(counts.get(group, 0)) for group in groups)


def _make_empty_cells(groups: Sequence[str]) -> tuple[str, ...]:
    return tuple("\N{EN DASH}" for _ in groups)
