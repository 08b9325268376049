"""Tables for a notebook: as pandas, and as the HTML that a cell shows."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.data.columns import TABLES
from minihuman.data.selection import Selection
from minihuman.data.store import Store
from minihuman.data.study import Sessions
from minihuman.errors import StoreError

if TYPE_CHECKING:
    import pandas as pd


def frame(source: Path, selection: Selection, name: str, *, everything: bool) -> "pd.DataFrame":
    """One of a study's or session's tables, of what counts or of everything.

    Raises:
        StoreError: if there is no such table.
    """
    if name not in TABLES:
        raise StoreError(f"there is no table {name!r}; there are {', '.join(TABLES)}")
    with Store(Sessions(source, selection), with_shortest=True) as store:
        found: pd.DataFrame = store.tables.table(name, counting=not everything).to_pandas()
        return found


def as_html(caption: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A small table under a line."""
    head = "".join(f"<th>{escape(one)}</th>" for one in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<p>{escape(caption)}</p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
