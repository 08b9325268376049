"""The report's section on teams: the shares of the episodes that people, idle bodies and agents played."""

import json
from collections import Counter
from collections.abc import Iterable

import pandas as pd

from minihuman.activities.team.plan import PERSON
from minihuman.reporting.activity_sections import CaptionedTable, ReportSection, SectionSource
from minihuman.reporting.template import Table

_CAPTION = (
    "Who acted in the seats of people, in included episodes: steps of seats, each episode of a team counted once. "
    "Idle: nothing had come from the person's page in time, not even that no key was down, and the body stood still. "
    "Agent: a program had the seat of a person who was away. Absent: share of joint steps in which a person's seat "
    "idled or an agent had it."
)
_ABSENT_ENOUGH = 0.1  # the share of joint steps above which an episode counts in the last column


def build_section(source: SectionSource) -> ReportSection | None:
    """Build the section on who played the included episodes; None if no team played a step of them."""
    teams = source.table("teams")
    if teams.empty:
        return None
    rows = [_build_block_row(block, episodes) for block, episodes in teams.groupby("block", sort=False)]
    heads = ("block", "joint episodes", "person", "idle", "agent", "mean absent", f"absent over {_ABSENT_ENOUGH:.0%}")
    filled_rows = [row for row in rows if row is not None]
    if filled_rows:
        return ReportSection("Who played", [CaptionedTable(Table(heads, filled_rows), _CAPTION)])
    return None


def _build_block_row(block: object, episodes: pd.DataFrame) -> tuple[str, ...] | None:
    """Return a block's row of the table; None if its episodes have no steps in people's seats.

    ``episodes`` are the block's rows of the table "teams".
    """
    # each member's session has a row for the episode; keep one row per team
    team_episodes = episodes.drop_duplicates(["team", "session", "episode", "digest"])
    steps: Counter[str] = Counter()
    for kinds, played_by in zip(team_episodes["seats"], team_episodes["played_by"], strict=True):
        steps.update(_sum_steps(json.loads(kinds), json.loads(played_by)))
    if not steps:
        return None
    shares = team_episodes["absent_share"].dropna()
    n_absent = int((shares > _ABSENT_ENOUGH).sum())
    counts = [_format_count(steps[source], steps.total()) for source in ("person", "late", "agent")]
    return (str(block), str(len(team_episodes)), *counts, _format_percent(float(shares.mean())), str(n_absent))


def _sum_steps(kinds: Iterable[str], played_by: Iterable[dict[str, int]]) -> Counter[str]:
    """Sum the steps in the seats of people by who acted in them: a person, late (the idle action) or an agent.

    Args:
        kinds: by seat, "person" or the agent in the seat.
        played_by: by seat, the number of steps in which each source acted.
    """
    steps: Counter[str] = Counter()
    for kind, sources in zip(kinds, played_by, strict=True):
        if kind == PERSON:
            steps.update(sources)
    return steps


def _format_count(count: int, total: int) -> str:
    return f"{count} ({_format_percent(count / total)})"


def _format_percent(share: float) -> str:
    return f"{100 * share:.1f} %"
