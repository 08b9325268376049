"""What instructions asked for and what was done of it: a row a block, verb and group. From the tables."""

from typing import Any

import pandas as pd

from minihuman.report.html import interval, number, records, table
from minihuman.statistics.shares import wilson

VERBS = {"GoTo": "go to", "Open": "open", "Pickup": "pick up", "PutNext": "put next to"}  # by a clause's type
_ATTEMPT = ["participant", "session", "segment", "episode"]  # one of an episode: a segment has one at most


def clauses_done(episodes: pd.DataFrame, starts: pd.DataFrame, done: pd.DataFrame) -> pd.DataFrame:
    """How many clauses were asked for and done, by block, verb and group.

    Args:
        episodes: The table of episodes; only those that count are told of.
        starts: The table of beginnings, for the missions.
        done: The table of clauses that were done.

    Returns:
        block, verb, group, asked, done, median_step (of those done); no row of blocks in which no clause was ever done.
    """
    counted = episodes.loc[episodes["left_out"].isna(), [*_ATTEMPT, "block", "group"]]
    counted = counted.merge(starts[[*_ATTEMPT, "mission"]], on=_ATTEMPT)
    counted = counted[counted["block"].isin(_blocks(counted, done))]
    if counted.empty:
        return pd.DataFrame(columns=["block", "verb", "group", "asked", "done", "median_step"])
    steps = done[[*_ATTEMPT, "clause", "step"]]
    asked = pd.DataFrame(_asked(counted)).merge(steps, on=[*_ATTEMPT, "clause"], how="left")
    grouped = asked.groupby(["block", "verb", "group"], sort=False)["step"]
    return grouped.agg(asked="size", done="count", median_step="median").reset_index()


def _asked(counted: pd.DataFrame) -> list[dict[str, Any]]:
    """A row a clause of each episode's mission."""
    from minihuman.worlds.grid.instructions.language import clauses, parse  # brings Numba, which few reports need

    return [
        {
            **dict(zip([*_ATTEMPT, "block", "group"], row[:-1], strict=True)),
            "clause": at,
            "verb": VERBS[type(clause).__name__],
        }
        for row in counted.itertuples(index=False)
        for at, clause in enumerate(clauses(parse(str(row.mission))), start=1)
    ]


def _blocks(counted: pd.DataFrame, done: pd.DataFrame) -> Any:
    """The blocks whose worlds have instructions, as far as anything of one was done."""
    return counted.merge(done[_ATTEMPT].drop_duplicates(), on=_ATTEMPT)["block"].unique()


def clauses_section(rows: pd.DataFrame) -> list[str]:
    """The page's section; empty where no world had instructions."""
    if rows.empty:
        return []
    told = [
        (
            row["block"], row["verb"], row["group"], str(row["asked"]),
            f"{number(row['done'] / row['asked'], 2)} ({interval(wilson(row['done'], row['asked']), 2)})",
            number(float(row["median_step"])) if row["done"] else "\N{EN DASH}",
        )
        for row in records(rows)
    ]  # fmt: skip
    caption = (
        "Clauses of the instructions in the episodes that count. Done: the share that was done, with Wilson's 95 % "
        "interval as if every clause were a person's only one; step: the median step in which those were done."
    )
    heads = ("block", "clause", "group", "asked", "done", "step")
    return ["<h2>Instructions</h2>", table(caption, heads, told, words=3)]
