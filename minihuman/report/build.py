"""The report of a study, from its logs to a folder: tables, figures and one page."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import pandas as pd

from minihuman.data.columns import TABLES
from minihuman.data.selection import Selection
from minihuman.data.store import Kept, Store
from minihuman.data.study import Sessions
from minihuman.data.writing import write_tables
from minihuman.errors import ReportError
from minihuman.figures import drawings
from minihuman.figures.drawn_from import learning_curves, session_blocks
from minihuman.figures.kept import KeptFigures
from minihuman.log.read.open_log import open_log
from minihuman.report.clauses import clauses_done
from minihuman.report.flow import flow_section
from minihuman.report.methods import knew_the_keys, methods
from minihuman.report.page import Page, page
from minihuman.report.published import is_papers
from minihuman.report.results import Results, results
from minihuman.report.teaching import taught_logs, teaching_figures, teaching_section
from minihuman.study.analysis import Analysis
from minihuman.study.protocol import decode_logged

T = TypeVar("T")
_CURVES = (
    ("log_excess_steps", "log of the steps over the best way", (0.0, math.inf)),
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "segment", "block", "episode", "attempt", "episode_in_block",
    "left_out", "world", "steps", "max_steps", "outcome",
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
        tables = write_tables(store.tables, out / "tables", names=names, kept=store.files)
        episodes = store.tables.table("episodes", _EPISODE_COLUMNS).to_pandas()
        blocks, participants = (store.tables.table(name).to_pandas() for name in ("blocks", "participants"))
        answers, starts, done = (store.tables.table(name).to_pandas() for name in ("answers", "starts", "clauses"))
        controls = store.tables.table("controls").to_pandas()
    found = results(episodes, blocks, participants, named_before(store.kept))
    qualities = [kept.quality for kept in store.kept if kept.quality is not None]
    outlines = [kept.outline for kept in store.kept if kept.outline is not None]
    drawn, where = KeptFigures(sessions.source), out / "figures"
    paths = _paths(store.kept, sessions.selection, drawn, where)
    taught = taught_logs(store.kept, controls, sessions.selection)
    steering = teaching_figures(taught, drawn, where)
    figures = [*_curves(episodes, found, drawn, where), *_waiting(found, drawn, where), *steering, *paths]
    simulated = int((participants["player"] != "human").sum())
    facts = Page(
        study=study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        windows=dict(participants["window"].fillna("a window that did not say").value_counts()),
        simulated=simulated,
        flow=flow_section(sessions.source, participants),
        methods=methods(outlines, qualities, simulated),
        knew=knew_the_keys(outlines),
        figures=figures,
        tables=tables,
        qualities=qualities,
        answers=answers,
        clauses=clauses_done(episodes, starts, done),
        teaching=teaching_section(taught),
        account=sessions.account,
        papers=is_papers(study, frozenset(episodes["world"])),
    )
    whole = out / "report.html"
    whole.write_text(page(facts, found), encoding="utf-8")
    return (whole, *tables, *(path for _, path, _ in figures))


def of_another_report(out: Path, written: Collection[Path]) -> tuple[str, ...]:
    """Name the figures in a report's folder that it did not write: another study's, or of people left out now."""
    ours = {path.stem for path in written}
    left = sorted(path.name for path in (out / "figures").glob("*.p[nd][gf]") if path.stem not in ours)
    if not left:
        return ()
    return (
        f"{out / 'figures'} holds {len(left)} files that are not this report's: {left[0]} to {left[-1]}; remove them",
    )


def named_before(kept: Sequence[Kept]) -> Analysis:
    """What the protocol named before the study; nothing where its versions name different things."""
    one_of_each = {one.outline.protocol_sha256: one.path for one in kept if one.outline is not None}
    protocols = [(open_log(Path(path)).plan.protocol_toml, path) for path in one_of_each.values()]
    named = {decode_logged(toml, path).analysis for toml, path in protocols if toml}
    return named.pop() if len(named) == 1 else Analysis()


def _study(store: Store, sessions: Sessions) -> str:
    """The name of the one study that the sessions are of."""
    read = [kept for kept in store.kept if kept.study]
    if not read:
        skipped = len(sessions.account.skipped)
        found = f"{sessions.source} holds no session log that can be read; {skipped} were skipped"
        raise ReportError(f"{found}: name the folder of a study that somebody has played")
    for one in read:
        if one.study != read[0].study:
            raise ReportError(
                f"{one.path} is of study {one.study!r}, the ones before of {read[0].study!r}; "
                "a report is of one study: name its folder"
            )
    if not any(one.outline for one in read):
        raise ReportError(f"{sessions.source}: {sessions.selection} asks for none of its sessions; ask for others")
    return read[0].study


def _curves(episodes: pd.DataFrame, found: Results, drawn: KeptFigures, out: Path) -> Iterator[tuple[str, Path, str]]:
    """Learning curves of every block, by group."""
    counted = episodes[episodes["left_out"].isna()]
    for block in (one.block for one in found.blocks):
        rows = counted[counted["block"] == block]
        for measure, label, limits in _CURVES:
            curves = _in_order(learning_curves(rows, measure), found.order)
            if curves and rows["episode_in_block"].nunique() > 1 and rows[measure].notna().any():
                cannot_leave = limits if rows[measure].dropna().between(*limits).all() else None
                stem = out / f"{block}_{measure}"
                png, _ = drawn.save(stem, drawings.learning, curves, measure=label, limits=cannot_leave)
                yield (
                    block,
                    png,
                    f"{label[0].upper()}{label[1:]} over the episodes of block {block}: mean, 95 % interval.",
                )


def _in_order(curves: Mapping[str, T], order: Sequence[str]) -> dict[str, T]:
    """Groups in the order of the comparisons, so that each has one colour in all figures of a page."""
    return {group: curves[group] for group in order if group in curves}


def _waiting(found: Results, drawn: KeptFigures, out: Path) -> Iterator[tuple[str, Path, str]]:
    """Of every block, how long the goal and the keys were waited for."""
    for one in found.blocks:
        told = (
            ("goal", one.waits.goal, "steps of an episode", "episodes whose goal was not reached yet"),
            ("keys", one.waits.keys, "playing time (s)", "participants who had not found every key yet"),
        )
        for name, groups, label, what in told:
            if groups:
                png, _ = drawn.save(out / f"{one.block}_waiting_{name}", drawings.waiting, groups, label=label)
                tick = "a tick: over without it" if name == "goal" else "a tick: watched no longer"
                yield one.block, png, f"Share of {what} (Kaplan and Meier); {tick}. Below: how many they are."


def _paths(
    kept: Sequence[Kept], selection: Selection, drawn: KeptFigures, out: Path
) -> Iterator[tuple[str, Path, str]]:
    """The path figure of one session of each group, the one with the most blocks, of the episodes that count."""
    examples: dict[str, Kept] = {}
    for one in sorted(kept, key=lambda one: -one.blocks):
        if one.blocks and one.outline is not None:
            examples.setdefault(one.outline.group, one)
    for group, one in sorted(examples.items()):
        session = selection.judge(open_log(Path(one.path))).session
        png, _ = drawn.save(out / f"paths_{group}", drawings.paths, session_blocks(session))
        yield "", png, f"Paths of {session.plan.participant.id} (group {group}), the first to have played most blocks."
