"""The report's template: the tables and figures it shows, the format of numbers, and the rendering.

The template is the package's or a lab's own.
"""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from jinja2 import (
    ChoiceLoader,
    FileSystemLoader,
    PackageLoader,
    PrefixLoader,
    StrictUndefined,
    TemplateError,
    TemplateSyntaxError,
)
from jinja2.sandbox import SandboxedEnvironment

from minihuman.errors import ReportError
from minihuman.statistics.effect_size import ExplainedVariance

if TYPE_CHECKING:
    import pandas as pd


_MOST_ROWS = 60  # a longer table is collapsed
_MOST_SHOWN = 2_000  # rows on the page: browsers take seconds for more; the table files have all
_EXACT_DECIMALS = 12  # further ones are rounding errors, which depend on the order in which a mean was summed


class AnswerCounts(NamedTuple):
    """A table cell with the most frequent answers, each with its count, and the number of other distinct answers."""

    most: tuple[tuple[str, int], ...]
    others: int = 0


Cell = str | AnswerCounts


@dataclass(frozen=True, slots=True)
class Table:
    """A table whose first ``words`` columns hold text and whose other columns hold numbers."""

    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    words: int = 1

    def __add__(self, other: "Table") -> "Table":
        """Return this table with the rows of another one appended, which must have the same headings."""
        return replace(self, rows=(*self.rows, *other.rows))

    @property
    def shown(self) -> Sequence[Sequence[Cell]]:
        """Return the rows that are shown on the page: all, or the first ``_MOST_SHOWN`` of a longer table."""
        return self.rows[:_MOST_SHOWN]

    @property
    def is_long(self) -> bool:
        """Return whether the table is so long that the page collapses it."""
        return len(self.rows) > _MOST_ROWS


class ReportFigure(NamedTuple):
    """A PNG file with its caption; ``block`` is "" if the figure covers all blocks."""

    block: str
    path: Path
    caption: str


def to_records(frame: "pd.DataFrame") -> list[dict[str, Any]]:
    """Return the rows of a data frame, each as a dict by column name."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def format_mean_sd(mean: float, sd: float) -> str:
    """Format a mean, followed by the standard deviation in parentheses unless it is NaN."""
    if math.isnan(sd):
        return format_number(mean)
    return f"{format_number(mean)} ({format_number(sd)})"


def format_number(value: float, digits: int = 3, *, sign: str = "-") -> str:
    """Format a number with ``digits`` decimals, less one for each digit before the point; "n/a" for NaN.

    A 0 before the point is not counted. ``sign`` is "-" to show only minus signs, or "+" to show plus signs as well.
    """
    if math.isnan(value):
        return "n/a"
    value = round(value, _EXACT_DECIMALS)
    n_integer_digits = 0
    if abs(value) >= 1:
        n_integer_digits = len(f"{int(abs(value))}")
    return f"{value:{sign}.{max(digits - n_integer_digits, 0)}f}".replace("-", "\N{MINUS SIGN}")


def format_interval(bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    """Format an interval as "low to high"; "n/a" if its bounds are NaN."""
    low, high = (format_number(bound, digits, sign=sign) for bound in bounds)
    if math.isnan(bounds[0]):
        return "n/a"
    return f"{low} to {high}"


def format_with_interval(value: float, bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    """Format a number, followed by its interval in parentheses if it has one."""
    number = format_number(value, digits, sign=sign)
    if math.isnan(bounds[0]):
        return number
    return f"{number} ({format_interval(bounds, digits, sign=sign)})"


def format_explained_variance(variance: ExplainedVariance) -> str:
    """Format an effect's share of variance with its 90 % interval; "n/a" if it has none."""
    return format_with_interval(variance.estimate, variance.interval, 2)


def format_difference(
    value: float, bounds: tuple[float, float], *, is_log: bool, sign: str = "-", digits: int = 3
) -> str:
    """Format a difference with its interval, if it has one; a difference of logarithms is shown as a ratio.

    ``digits`` and, except for ratios, ``sign`` are those of ``format_number``.
    """
    if not is_log:
        return format_with_interval(value, bounds, digits, sign=sign)
    ratio = format_with_interval(math.exp(value), (math.exp(bounds[0]), math.exp(bounds[1])), digits)
    return f"\N{MULTIPLICATION SIGN}{ratio}"


def format_p_value(value: float) -> str:
    """Format a p value with three decimals or as "< 0.001"; "n/a" for NaN."""
    if math.isnan(value):
        return "n/a"
    if value < 0.001:
        return "< 0.001"
    return f"{value:.3f}"


def format_pair(first: str, second: str, *, is_log: bool = False) -> str:
    """Format two groups or conditions as a difference, or as a ratio if ``is_log``.

    If ``second`` is "", ``first`` is the name of a contrast, which is returned unchanged.
    """
    if not second:
        return first
    sign = "/" if is_log else "\N{MINUS SIGN}"
    return f"{first} {sign} {second}"


REPORT = "report.html.j2"
CAPTIONED_TABLE = "captioned_table.html.j2"
STYLE = "report.css"
PARTICIPANTS = "participants.html.j2"


def render_template(name: str, context: Mapping[str, Any], templates: Path | None = None) -> str:
    """Render a template in Jinja's sandbox, with all values escaped; a template cannot reach Python's internals.

    Args:
        name: the template's file name.
        context: the template's variables, by name.
        templates: a folder with a ``report.html.j2`` or a ``report.css`` that replaces the package's own.

    Raises:
        ReportError: if the folder has neither file, or a template cannot be rendered.
    """
    package = PackageLoader("minihuman.reporting", "templates")
    loaders = [package, PrefixLoader({"minihuman": package})]
    if templates is not None:
        if not any((templates / file_name).is_file() for file_name in (REPORT, STYLE)):
            raise ReportError(f"{templates} contains neither {REPORT} nor {STYLE}; name a folder with one of them")
        loaders.insert(0, FileSystemLoader(templates))
    environment = SandboxedEnvironment(
        autoescape=True, undefined=StrictUndefined, loader=ChoiceLoader(loaders), trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["data_uri"] = lambda png: f"data:image/png;base64,{base64.b64encode(png.read_bytes()).decode()}"
    try:
        return environment.get_template(name).render(context)
    except TemplateError as error:
        line = f":{error.lineno}" if isinstance(error, TemplateSyntaxError) else ""
        folder = templates or "minihuman's own template"
        raise ReportError(f"{folder}: {name}{line}: {error.message}") from error
