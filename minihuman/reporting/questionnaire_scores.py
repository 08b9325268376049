"""Questionnaires by the condition after which they were asked, and the raw score of the NASA Task Load Index."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import pandas as pd

from minihuman.experiment.protocol.protocol import Protocol
from minihuman.reporting.template import Table, format_number

TASK_LOAD_FORM = "nasa-tlx"
SCORE = "raw TLX: mean of the six"
_LAST_ANSWER = ["participant", "session", "part", "questions", "item"]


def name_last_blocks(occasions: pd.DataFrame, parts: pd.DataFrame, blocks: Collection[str]) -> pd.DataFrame:
    """Return the occasions on which questions were asked, with the block that was played last before each.

    Args:
        occasions: rows with ``participant``, ``session`` and ``part``, the place of the questions in the session
        parts: the table of parts
        blocks: the names of the blocks

    Returns:
        The rows that follow a block, with its name in the column ``block``.
    """
    played = parts[(parts["what"] == "started") & parts["name"].isin(blocks)]
    started = played[["participant", "session", "part", "name"]].rename(columns={"part": "block_part", "name": "block"})
    candidates = occasions.merge(started, on=["participant", "session"])
    candidates = candidates[candidates["block_part"] < candidates["part"]].sort_values("block_part")
    keys = [name for name in occasions.columns if name in _LAST_ANSWER]
    return candidates.drop_duplicates(keys, keep="last").drop(columns="block_part")


def add_last_blocks(answers: pd.DataFrame, parts: pd.DataFrame, blocks: Collection[str]) -> pd.DataFrame:
    """Add the column ``after`` to answers: the name of the block that was played last before the questions.

    It is "" for questionnaires that no session asks after several blocks, because these are about the whole session.

    Args:
        answers: rows of the table of answers.
        parts: the table of parts.
        blocks: the names of the blocks.
    """
    if answers.empty:
        return answers.assign(after="")
    keys = ["participant", "session", "questions", "part"]
    located = name_last_blocks(answers[keys].drop_duplicates(), parts, blocks).rename(columns={"block": "after"})
    n_blocks = located.groupby(["participant", "session", "questions"])["after"].nunique()
    largest_n_blocks = n_blocks.groupby("questions").max()
    repeated = [questions for questions, n in largest_n_blocks.items() if n > 1]
    located = located[located["questions"].isin(repeated)]
    return answers.merge(located, on=keys, how="left").fillna({"after": ""})


def list_task_load(protocols: Iterable[Protocol]) -> frozenset[str]:
    """Return the names of the questionnaires that are the shipped NASA Task Load Index."""
    return frozenset(
        questionnaire.name
        for protocol in protocols
        for questionnaire in protocol.questions
        if questionnaire.form == TASK_LOAD_FORM
    )


def task_load_table(
    answers: pd.DataFrame, questionnaires: Collection[str], condition_of_block: Mapping[str, str], groups: Sequence[str]
) -> Table | None:
    """Tabulate the Task Load Index by condition: mean and SD over participants of each scale and of the raw score.

    The raw score is the mean of a participant's six scales, and is missing if one of them is. A participant's value in
    a condition is the mean over sessions.

    Args:
        answers: included answers, with ``group``, and ``after`` as from ``add_last_blocks``
        questionnaires: the names of the questionnaires that are the index
        condition_of_block: the condition of each block that is compared; another block stands for itself
        groups: the groups, in order

    Returns:
        The table; None if the index was not asked after several conditions.
    """
    ratings = answers[answers["questions"].isin(questionnaires) & answers["after"].ne("")]
    ratings = ratings.drop_duplicates(_LAST_ANSWER, keep="last")
    ratings = ratings.assign(condition=ratings["after"].replace(dict(condition_of_block)))
    if ratings["condition"].nunique() < 2:
        return None
    rated_conditions = list(dict.fromkeys(ratings["condition"]))
    planned = [name for name in dict.fromkeys(condition_of_block.values()) if name in rated_conditions]
    conditions = [*planned, *(name for name in rated_conditions if name not in planned)]
    occasion = ["group", "participant", "session", "part", "condition"]
    scales = ratings.pivot_table(index=occasion, columns="item", values="number", sort=False)
    scales = scales.reindex(columns=list(dict.fromkeys(ratings["item"])))
    scales = scales.assign(**{SCORE: scales.mean(axis=1, skipna=False)})
    people = scales.groupby(["group", "participant", "condition"]).mean()
    rows = []
    for group in groups:
        if group not in people.index.get_level_values("group"):
            continue
        cells = people.loc[group]
        for scale in people.columns:
            by_condition = cells[scale].unstack("condition").reindex(columns=conditions)
            rows.append((group, str(scale), *(_format_cell(by_condition[name].dropna()) for name in conditions)))
    return Table(("group", "scale", *conditions), rows, words=2)


def _format_cell(values: "pd.Series[float]") -> str:
    """Format the mean, SD and number of the participants' values; "n/a" if there are none."""
    if values.empty:
        return "n/a"
    return f"{format_number(float(values.mean()))} ({format_number(float(values.std()))}), n {len(values)}"
