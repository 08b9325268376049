"""The description of a study's sample: age, handedness and whatever else a laboratory states of its participants.

Free texts are not described, because they may say who somebody is.
"""

import statistics
from collections import Counter
from collections.abc import Collection

from minihuman.dataset.person_table import PersonTable
from minihuman.dataset.table_columns import TableColumn


def describe_sample(people: PersonTable | None, included: Collection[str]) -> list[str]:
    """Describe the included participants in a paragraph, with a sentence for each column of numbers or levels.

    Args:
        people: the person table; None if the study has none.
        included: the codes of the included participants.
    """
    if people is None:
        return []
    codes = people.rows.column("participant").to_pylist()
    sentences = []
    for column in people.columns:
        cells = people.rows.column(column.name).to_pylist()
        stated = [cell for code, cell in zip(codes, cells, strict=True) if code in included and cell is not None]
        if not stated:
            continue
        if column.kind in ("integer", "number"):
            sentences.append(_describe_numbers(column, stated, len(included)))
        elif column.kind == "boolean":
            sentences.append(_describe_levels(column, ["yes" if cell else "no" for cell in stated], len(included)))
        elif column.levels:
            meanings = dict(column.levels)
            sentences.append(_describe_levels(column, [meanings[cell] for cell in stated], len(included)))
    if not sentences:
        return []
    return [" ".join(sentences)]


def _describe_numbers(column: TableColumn, numbers: list[float], n_people: int) -> str:
    text = f"M = {statistics.fmean(numbers):.1f}"
    if len(numbers) > 1:
        text += f", SD = {statistics.stdev(numbers):.1f}, range {min(numbers):g} to {max(numbers):g}"
    if column.unit:
        text += f" ({column.unit})"
    return f"{_name_column(column)}: {text}{_describe_missing(len(numbers), n_people)}."


def _describe_levels(column: TableColumn, levels: list[str], n_people: int) -> str:
    counts = ", ".join(f"{count} {level}" for level, count in Counter(levels).most_common())
    return f"{_name_column(column)}: {counts}{_describe_missing(len(levels), n_people)}."


def _name_column(column: TableColumn) -> str:
    return column.meaning.rstrip(".")


def _describe_missing(n_stated: int, n_people: int) -> str:
    if n_stated == n_people:
        return ""
    return f"; {n_people - n_stated} not stated"
