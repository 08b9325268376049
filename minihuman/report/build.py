"""The report of a study, from its logs to a folder: tables, figures and one page."""

import math
from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from minihuman.data.columns import TABLES
from minihuman.data.selection import Selection
from minihuman.data.store import Store
from minihuman.data.study import Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import ReportError
from minihuman.figures.files import save
from minihuman.figures.learning import learning_curves, learning_figure
from minihuman.figures.paths import session_paths
from minihuman.log.read.open_log import open_log
from minihuman.report.page import Page, page
from minihuman.report.results import Results, results

_CURVES = (
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "block", "episode", "attempt", "episode_in_block", "left_out",
    *(measure for measure, _, _ in _CURVES),
]  # fmt: skip
_EVERY_MOMENT = frozenset({"steps", "presses", "other_presses", "frames", "samples"})  # too long to be read in a report


def build(sessions: Sessions, out: Path) -> tuple[Path, ...]:
    """Write tables, figures and ``report.html`` of a study's sessions; give the files, the page first.

    The tables of every step, key and picture are left to an export.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no log in it can be read, or they are of different studies.
    """
    with Store(sessions, with_shortest=True) as store:
        study = _study(store, sessions)
        names = [name for name in TABLES if name not in _EVERY_MOMENT]
        tables = write_tables(store.tables, out / "tables", names=names)
        episodes = store.tables.table("episodes", _EPISODE_COLUMNS).to_pandas()
        blocks, participants = (store.tables.table(name).to_pandas() for name in ("blocks", "participants"))
        example = max(store.kept, key=lambda kept: kept.blocks)  # the first with the most blocks that count
    found = results(episodes, blocks, participants)
    figures = [*_curves(episodes, found, out / "figures")]
    if example.blocks:
        figures.append(_paths(Path(example.path), sessions.selection, out / "figures"))
    facts = Page(
        study=study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        figures=figures,
        tables=tables,
        account=sessions.account,
    )
    where = out / "report.html"
    where.write_text(page(facts, found), encoding="utf-8")
    return (where, *tables, *(path for path, _ in figures))


def _study(store: Store, sessions: Sessions) -> str:
    """The name of the one study that the sessions are of."""
    read = [kept for kept in store.kept if kept.study]
    if not read:
        skipped = len(sessions.account.skipped)
        raise ReportError(f"{sessions.source} holds no session log that can be read; {skipped} were skipped")
    for one in read:
        if one.study != read[0].study:
            raise ReportError(
                f"{one.path} is of study {one.study!r}, the ones before of {read[0].study!r}; "
                "a report is of one study: name its folder"
            )
    return read[0].study


def _curves(episodes: pd.DataFrame, found: Results, out: Path) -> Iterator[tuple[Path, str]]:
    """Learning curves of the compared block, by group."""
    counted = episodes[episodes["left_out"].isna() & (episodes["block"] == found.block)]
    for measure, label, limits in _CURVES:
        curves = learning_curves(counted, measure)
        if curves:
            png, _ = save(learning_figure(curves, measure=label, limits=limits), out / f"learning_{measure}")
            yield png, f"{label} over the episodes of block {found.block}: mean and its 95 % interval."


def _paths(log: Path, selection: Selection, out: Path) -> tuple[Path, str]:
    """The path figure of one session, of the episodes that count."""
    session = selection.judge(open_log(log)).session
    png, _ = save(session_paths(session), out / "paths")
    return png, f"Paths of {session.plan.participant.id} ({session.plan.participant.group})."
