"""The report of a study, from its logs to a folder: tables, figures and one page."""

import math
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
import pandas as pd

from minihuman.data.quality import Quality
from minihuman.data.rows import Rows
from minihuman.data.selection import Selection
from minihuman.data.study import SessionRows, Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import ReportError
from minihuman.figures.files import save
from minihuman.figures.learning import learning_curves, learning_figure
from minihuman.figures.paths import session_paths
from minihuman.log.read.open_log import open_log
from minihuman.report.methods import methods
from minihuman.report.page import Page, page
from minihuman.report.published import is_papers
from minihuman.report.results import Results, results
from minihuman.study.plan import SessionPlan

_CURVES = (
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "block", "episode", "attempt", "episode_in_block", "left_out", "world",
    *(measure for measure, _, _ in _CURVES),
]  # fmt: skip


class _Study:
    """What is learnt of a study while its sessions stream by."""

    def __init__(self) -> None:
        self.plan: SessionPlan | None = None
        self.examples: dict[str, tuple[int, Path]] = {}  # by group: the session with the most blocks that count
        self.plans: list[SessionPlan] = []
        self.qualities: list[Quality] = []

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
            group, blocks = one.plan.participant.group, len({facts["block"] for facts in one.facts})
            if blocks > self.examples.get(group, (0,))[0]:
                self.examples[group] = blocks, one.path
            self.plans.append(msgspec.structs.replace(one.plan, protocol_toml=b""))
            self.qualities.append(one.quality)
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
    figures = [*_curves(episodes, found, out / "figures"), *_paths(study, sessions.selection, out / "figures")]
    facts = Page(
        study=study.plan.study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        methods=methods(study.plans, study.qualities),
        figures=figures,
        tables=tables,
        qualities=study.qualities,
        answers=_answers(tables),
        account=account,
        papers=is_papers(study.plan.study, frozenset(episodes["world"])),
    )
    where = out / "report.html"
    where.write_text(page(facts, found), encoding="utf-8")
    return (where, *tables, *(path for _, path, _ in figures))


def _curves(episodes: pd.DataFrame, found: Results, out: Path) -> Iterator[tuple[str, Path, str]]:
    """Learning curves of every block, by group."""
    counted = episodes[episodes["left_out"].isna()]
    for block in (one.block for one in found.blocks):
        rows = counted[counted["block"] == block]
        for measure, label, limits in _CURVES:
            curves = learning_curves(rows, measure)
            if curves and rows["episode_in_block"].nunique() > 1:
                png, _ = save(learning_figure(curves, measure=label, limits=limits), out / f"{block}_{measure}")
                yield block, png, f"{label} over the episodes of block {block}: mean and its 95 % interval."


def _answers(tables: Iterable[Path]) -> pd.DataFrame | None:
    """What was answered; None where nothing was asked."""
    return next((pd.read_parquet(path) for path in tables if path.stem == "answers"), None)


def _paths(study: _Study, selection: Selection, out: Path) -> Iterator[tuple[str, Path, str]]:
    """The path figure of one session of each group, of the episodes that count."""
    for group, (_, log) in sorted(study.examples.items()):
        session = selection.judge(open_log(log)).session
        png, _ = save(session_paths(session), out / f"paths_{group}")
        yield "", png, f"Paths of {session.plan.participant.id} ({group})."
