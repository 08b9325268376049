"""The report of a study, from its logs to a folder: tables, figures and one page."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import pandas as pd

from minihuman.data.rows import Rows
from minihuman.data.selection import Selection
from minihuman.data.study import SessionRows, Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import ReportError
from minihuman.figures.files import save
from minihuman.figures.learning import learning_curves, learning_figure
from minihuman.figures.paths import session_paths
from minihuman.log.read.open_log import open_log
from minihuman.report.page import Page, page
from minihuman.report.results import Results, results
from minihuman.study.plan import SessionPlan

_CURVES = (
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "block", "episode", "attempt", "episode_in_block", "left_out",
    *(measure for measure, _, _ in _CURVES),
]  # fmt: skip


class _Study:
    """What is learnt of a study while its sessions stream by."""

    def __init__(self) -> None:
        self.plan: SessionPlan | None = None
        self.example: Path | None = None  # the session with the most blocks that count, for the path figure
        self._blocks = 0

    def rows(self, found: Iterable[SessionRows]) -> Iterator[Rows]:
        """Pass the rows on.

        Raises:
            ReportError: if the folder holds more than one study.
        """
        for one in found:
            if self.plan is None:
                self.plan = one.plan
            elif self.plan.study != one.plan.study:
                raise ReportError(
                    f"{one.path} is of study {one.plan.study!r}, the ones before of {self.plan.study!r}; "
                    "a report is of one study: name its folder"
                )
            blocks = len({facts["block"] for facts in one.facts})
            if blocks > self._blocks:
                self.example, self._blocks = one.path, blocks
            yield one.rows


def build(sessions: Sessions, out: Path) -> tuple[Path, ...]:
    """Write tables, figures and ``report.html`` of a study's sessions; give the files, the page first.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no log in it can be read, or they are of different studies.
    """
    study = _Study()
    tables = write_tables(study.rows(sessions.rows(with_shortest=True)), out / "tables")
    account = sessions.account
    if study.plan is None:
        raise ReportError(
            f"{sessions.source} holds no session log that can be read; {len(account.skipped)} were skipped"
        )
    episodes = pd.read_parquet(out / "tables" / "episodes.parquet", columns=_EPISODE_COLUMNS)
    blocks, participants = (pd.read_parquet(out / "tables" / f"{name}.parquet") for name in ("blocks", "participants"))
    found = results(episodes, blocks, participants)
    figures = [*_curves(episodes, found, out / "figures"), *_paths(study.example, sessions.selection, out / "figures")]
    facts = Page(
        study=study.plan.study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        figures=figures,
        tables=tables,
        account=account,
    )
    where = out / "report.html"
    where.write_text(page(facts, found), encoding="utf-8")
    return (where, *tables, *(path for path, _ in figures))


def _curves(episodes: pd.DataFrame, found: Results, out: Path) -> Iterator[tuple[Path, str]]:
    """Learning curves of the compared block, by group."""
    counted = episodes[episodes["left_out"].isna() & (episodes["block"] == found.block)]
    for measure, label, limits in _CURVES:
        curves = learning_curves(counted, measure)
        if curves:
            png, _ = save(learning_figure(curves, measure=label, limits=limits), out / f"learning_{measure}")
            yield png, f"{label} over the episodes of block {found.block}: mean and its 95 % interval."


def _paths(log: Path | None, selection: Selection, out: Path) -> Iterator[tuple[Path, str]]:
    """The path figure of one session, of the episodes that count."""
    if log is not None:
        session = selection.judge(open_log(log)).session
        png, _ = save(session_paths(session), out / "paths")
        yield png, f"Paths of {session.plan.participant.id} ({session.plan.participant.group})."
