"""What the report's template shows: tables and figures as values, and how numbers are written. No HTML."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import pandas as pd

_MOST_ROWS = 60  # that stand open on the page


class AnswerCounts(NamedTuple):
    """A table's cell: the commonest answers, each with its count, and how many other ones there are."""

    most: tuple[tuple[str, int], ...]
    others: int = 0


Cell = str | AnswerCounts


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first ``words`` columns hold words, the others numbers."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    words: int = 1

    def __add__(self, other: "Table") -> "Table":
        """Append the other's rows, of the same heads."""
        return replace(self, rows=(*self.rows, *other.rows))

    @property
    def is_long(self) -> bool:
        """Whether it has more rows than are read through, so that the page folds it up."""
        return len(self.rows) > _MOST_ROWS


class ReportFigure(NamedTuple):
    """A PNG with its caption; ``block`` is "" where it is of all blocks."""

    block: str
    path: Path
    caption: str


def to_records(frame: "pd.DataFrame") -> list[dict[str, Any]]:
    """A table's rows, by name of column."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def format_mean_sd(mean: float, sd: float) -> str:
    """A mean, and the standard deviation where there is one."""
    if math.isnan(sd):
        return format_number(mean)
    return f"{format_number(mean)} ({format_number(sd)})"


def format_number(value: float, digits: int = 3, *, sign: str = "-") -> str:
    """Three decimals, fewer for a number with digits before the point; ``sign`` "+" shows that of a gain too."""
    if math.isnan(value):
        return "n/a"
    before = len(f"{abs(value):.0f}") if abs(value) >= 1 else 0
    return f"{value:{sign}.{max(digits - before, 0)}f}".replace("-", "\N{MINUS SIGN}")


def format_interval(bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    """From one bound to the other."""
    low, high = (format_number(bound, digits, sign=sign) for bound in bounds)
    return "n/a" if math.isnan(bounds[0]) else f"{low} to {high}"


def format_with_interval(value: float, bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    """A number, and its interval in brackets where it has one."""
    number = format_number(value, digits, sign=sign)
    return number if math.isnan(bounds[0]) else f"{number} ({format_interval(bounds, digits, sign=sign)})"


def format_difference(
    value: float, bounds: tuple[float, float], *, is_log: bool, sign: str = "-", digits: int = 3
) -> str:
    """A difference with its interval; one of logarithms as the ratio that it is."""
    if not is_log:
        return format_with_interval(value, bounds, digits, sign=sign)
    ratio = format_with_interval(math.exp(value), (math.exp(bounds[0]), math.exp(bounds[1])), digits)
    return f"\N{MULTIPLICATION SIGN}{ratio}"


def format_p_value(value: float) -> str:
    """Three decimals, or that it is less."""
    if math.isnan(value):
        return "n/a"
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def format_pair(first: str, second: str) -> str:
    """A difference of two groups."""
    return f"{first} \N{MINUS SIGN} {second}"
