"""The clauses of instructions: how many were assigned and completed, by block, verb and group."""

from typing import Any

import pandas as pd

from minihuman.reporting.template import (
    Table,
    format_number,
    format_with_interval,
    to_records,
)
from minihuman.statistics.scores import wilson_interval

VERBS = {"GoTo": "go to", "Open": "open", "Pickup": "pick up", "PutNext": "put next to"}  # by a clause's type
ATTEMPT_COLUMNS = ["participant", "session", "segment", "episode"]  # a segment has at most one attempt at an episode


def count_clauses(episodes: pd.DataFrame, starts: pd.DataFrame, completed: pd.DataFrame) -> pd.DataFrame:
    """Count the clauses that were assigned and completed, by block, verb and group.

    Args:
        episodes: the table of episodes; only included episodes are counted.
        starts: the table of episode starts, which has the missions.
        completed: the table of completed clauses.

    Returns:
        A table with the columns block, verb, group, asked, done and median_step (of completed clauses); blocks in which
        no clause was ever completed are absent.
    """
    included = episodes.loc[episodes["exclusion_reason"].isna(), [*ATTEMPT_COLUMNS, "block", "group"]]
    included = included.merge(starts[[*ATTEMPT_COLUMNS, "mission"]], on=ATTEMPT_COLUMNS)
    attempts = completed[ATTEMPT_COLUMNS].drop_duplicates()
    blocks = included.merge(attempts, on=ATTEMPT_COLUMNS)["block"]  # blocks in which a clause was completed
    included = included[included["block"].isin(blocks)]
    if included.empty:
        return pd.DataFrame(columns=["block", "verb", "group", "asked", "done", "median_step"])
    steps = completed[[*ATTEMPT_COLUMNS, "clause", "step"]]
    clause_rows = pd.DataFrame(_list_clauses(included)).merge(steps, on=[*ATTEMPT_COLUMNS, "clause"], how="left")
    grouped = clause_rows.groupby(["block", "verb", "group"], sort=False)["step"]
    return grouped.agg(asked="size", done="count", median_step="median").reset_index()


def _list_clauses(episodes: pd.DataFrame) -> list[dict[str, Any]]:
    """Return a row per clause of each episode's mission, with the clause's number (from 1) and its verb."""
    from minihuman.worlds.grid.babyai.language import clauses, parse  # brings Numba, which few reports need

    rows: list[dict[str, Any]] = []
    for episode in episodes.itertuples(index=False):
        columns = dict(zip([*ATTEMPT_COLUMNS, "block", "group"], episode[:-1], strict=True))  # all but the mission
        for number, clause in enumerate(clauses(parse(str(episode.mission))), start=1):
            rows.append({**columns, "clause": number, "verb": VERBS[type(clause).__name__]})
    return rows


def clauses_table(rows: pd.DataFrame) -> Table | None:
    """Tabulate how many clauses of instructions were completed, from ``count_clauses``; None if that has no rows."""
    cells = [_list_clause_cells(row) for row in to_records(rows)]
    if not cells:
        return None
    return Table(("block", "clause", "group", "asked", "done", "step"), cells, words=3)


def _list_clause_cells(row: dict[str, Any]) -> tuple[str, ...]:
    n = row["asked"]
    successes = row["done"]
    step = "\N{EN DASH}"
    if successes:
        step = format_number(float(row["median_step"]))
    share = format_with_interval(successes / n, wilson_interval(successes, n), 2)
    return (row["block"], row["verb"], row["group"], str(n), share, step)
