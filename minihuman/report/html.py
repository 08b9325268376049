"""Pieces of a self-contained HTML page: tables, figures inside, numbers as they are read."""

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

_MOST_ROWS = 60  # that stand open on the page
STYLE = """
:root { color-scheme: light; }
body { font: 15px/1.5 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; color: #1c1c1c; max-width: 60rem;
  margin: 2.5rem auto; padding: 0 1.5rem; }
h1 { font-size: 1.7rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2.4rem; border-bottom: 1px solid #ddd; }
p.lead { color: #555; margin-top: .3rem; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .22rem .8rem; text-align: right; border-bottom: 1px solid #eee; vertical-align: top; }
th { border-bottom: 1px solid #999; font-weight: 600; }
th:first-child, td:first-child { text-align: left; padding-left: 0; }
td:not(.word) { white-space: nowrap; } td, th { padding-right: .5rem; }
td.word, th.word { text-align: left; }
caption { text-align: left; color: #555; padding-bottom: .3rem; }
.wide { overflow-x: auto; } .wide table { font-size: .87em; } .wide td, .wide th { padding-left: .3rem; }
.wide td.word:first-child { min-width: 11rem; }
.beside { display: flex; flex-wrap: wrap; gap: 3rem; align-items: flex-start; }
figure { margin: 1rem 0; display: inline-block; vertical-align: top; } figure img { width: 24rem; max-width: 100%; }
figcaption { color: #555; max-width: 24rem; }
h3 { font-size: 1rem; margin: 1.4rem 0 .2rem; } .few { color: #777; }
a { color: #0072b2; }
summary { cursor: pointer; color: #0072b2; }
.key { background: #f3f7fa; border-left: 4px solid #0072b2; padding: .7rem 1rem; }
@media print {
  @page { margin: 1.6cm; }
  body { font-size: 10pt; max-width: none; margin: 0; padding: 0; }
  h2, h3, caption { break-after: avoid; } tr, figure, .key { break-inside: avoid; }
  thead { display: table-header-group; }
  .beside { display: block; } figure img { width: 8cm; } .key { background: none; }
  a { color: inherit; text-decoration: none; }
}
"""


def figure(path: Path, caption: str) -> str:
    """A PNG, inside the page, with its caption."""
    data = base64.b64encode(path.read_bytes()).decode()
    alt = escape(caption, quote=True)
    return f'<figure><img alt="{alt}" src="data:image/png;base64,{data}"><figcaption>{alt}</figcaption></figure>'


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[str]], *, words: int = 1) -> str:
    """A table whose first ``words`` columns hold words."""

    def line(cells: Sequence[str], tag: str) -> str:
        kinds = [' class="word"' if place < words else "" for place in range(len(cells))]
        return "<tr>" + "".join(f"<{tag}{k}>{escape(c)}</{tag}>" for k, c in zip(kinds, cells, strict=True)) + "</tr>"

    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    body = "".join(line(row, "td") for row in rows)
    return f"<table>{title}<thead>{line(heads, 'th')}</thead><tbody>{body}</tbody></table>"


def long_table(caption: str, heads: Sequence[str], rows: Sequence[Sequence[str]], *, words: int = 1) -> str:
    """A table; one of more rows than anybody reads through is folded up, with their number."""
    whole = table(caption, heads, rows, words=words)
    if not is_long(rows):
        return whole
    return f"<details><summary>{len(rows)} rows: {escape(', '.join(heads))}</summary>{whole}</details>"


def is_long(rows: Sequence[object]) -> bool:
    """Whether a table of these is folded up."""
    return len(rows) > _MOST_ROWS


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """A table's rows, by name of column."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def spread(mean: float, sd: float) -> str:
    """A mean, and the standard deviation where there is one."""
    if math.isnan(sd):
        return number(mean)
    return f"{number(mean)} ({number(sd)})"


def number(value: float, digits: int = 3, *, sign: str = "-") -> str:
    """Three decimals, fewer for a number with digits before the point; ``sign`` "+" shows that of a gain too."""
    if math.isnan(value):
        return "n/a"
    before = len(f"{abs(value):.0f}") if abs(value) >= 1 else 0
    return f"{value:{sign}.{max(digits - before, 0)}f}".replace("-", "\N{MINUS SIGN}")


def interval(bounds: tuple[float, float], digits: int = 3, *, sign: str = "-") -> str:
    """From one bound to the other."""
    low, high = (number(bound, digits, sign=sign) for bound in bounds)
    return "n/a" if math.isnan(bounds[0]) else f"{low} to {high}"


def p_value(value: float) -> str:
    """Three decimals, or that it is less."""
    if math.isnan(value):
        return "n/a"
    return "< 0.001" if value < 0.001 else f"{value:.3f}"
