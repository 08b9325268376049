"""The description of a study's sample: age, handedness and whatever else a laboratory states of its participants.

Free texts are not described, because they may say who somebody is.
"""

import statistics
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TypeVar

from minihuman.dataset.person_table import PersonTable
from minihuman.dataset.table_columns import TableColumn

T = TypeVar("T")


def describe_sample(people: PersonTable | None, groups: Mapping[str, str]) -> list[str]:
    """Describe the included participants in a paragraph, with a sentence for each column of numbers or levels.

    If there are several groups, each sentence also describes every group. The list is empty if there is nothing to
    describe.

    Args:
        people: the person table; None if the study has none.
        groups: the groups of the included participants, by code.
    """
    if people is None:
        return []
    codes = people.rows.column("participant").to_pylist()
    sentences = []
    for column in people.columns:
        cells = dict(zip(codes, people.rows.column(column.name).to_pylist(), strict=True))
        included_cells = {code: cell for code, cell in cells.items() if code in groups and cell is not None}
        if not included_cells:
            continue
        if column.kind in ("integer", "number"):
            sentences.append(_describe_numbers(column, included_cells, groups))
        elif column.kind == "boolean":
            levels = {code: "yes" if cell else "no" for code, cell in included_cells.items()}
            sentences.append(_describe_levels(column, levels, groups))
        elif column.levels:
            meanings = dict(column.levels)
            levels = {code: meanings[cell] for code, cell in included_cells.items()}
            sentences.append(_describe_levels(column, levels, groups))
    if not sentences:
        return []
    return [" ".join(sentences)]


def _describe_numbers(column: TableColumn, numbers: Mapping[str, float], groups: Mapping[str, str]) -> str:
    """Return a sentence with mean, standard deviation and range, and the mean and standard deviation of each group.

    ``numbers`` has the column's numbers, and ``groups`` the groups of all included participants, by code.
    """
    text = _format_mean_sd(list(numbers.values()))
    if len(numbers) > 1:
        text += f", range {min(numbers.values()):g} to {max(numbers.values()):g}"
    if column.unit:
        text += f" ({column.unit})"
    by_group = "".join(f"; {group}: {_format_mean_sd(part)}" for group, part in _divide_by_group(numbers, groups))
    return f"{_name_column(column)}: {text}{_describe_missing(len(numbers), len(groups))}{by_group}."


def _describe_levels(column: TableColumn, levels: Mapping[str, str], groups: Mapping[str, str]) -> str:
    """Return a sentence with the number of participants of each level, and of each level in each group.

    ``levels`` has the participants' levels in words, and ``groups`` the groups of all included participants, by code.
    """
    by_group = "".join(f"; {group}: {_format_counts(part)}" for group, part in _divide_by_group(levels, groups))
    counts = _format_counts(list(levels.values()))
    return f"{_name_column(column)}: {counts}{_describe_missing(len(levels), len(groups))}{by_group}."


def _divide_by_group(values: Mapping[str, T], groups: Mapping[str, str]) -> Iterator[tuple[str, list[T]]]:
    """Yield each group with its participants' values; nothing if all participants are of one group."""
    names = sorted(set(groups.values()))
    if len(names) == 1:
        return
    for name in names:
        group_values = [value for code, value in values.items() if groups[code] == name]
        if group_values:
            yield name, group_values


def _format_mean_sd(numbers: list[float]) -> str:
    text = f"M = {statistics.fmean(numbers):.1f}"
    if len(numbers) > 1:
        text += f", SD = {statistics.stdev(numbers):.1f}"
    return text


def _format_counts(levels: list[str]) -> str:
    return ", ".join(f"{count} {level}" for level, count in Counter(levels).most_common())


def _name_column(column: TableColumn) -> str:
    return column.meaning.rstrip(".")


def _describe_missing(n_stated: int, n_people: int) -> str:
    """State for how many participants there is no value; "" if there is one for each."""
    if n_stated == n_people:
        return ""
    return f"; {n_people - n_stated} not stated"
