"""Build a study's report, from its logs to a folder of tables, figures and one page."""

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path

import pandas as pd

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import CachedSession, StudyStore
from minihuman.dataset.table_columns import TABLES
from minihuman.dataset.table_files import write_tables
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec, apply_overrides
from minihuman.figures.figure_data import collect_learning_curves, group_by_block
from minihuman.figures.learning_curves import learning_figure
from minihuman.figures.path_figures import blocks_figure
from minihuman.figures.style import save_figure
from minihuman.figures.survival_curves import survival_figure
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.elements import ReportFigure
from minihuman.reporting.methods import build_methods, find_known_keys
from minihuman.reporting.page import PageContent, build_page, is_published_study
from minihuman.reporting.results import MEASURES, Results, compute_results, exclude_practice_alone, list_exclusions
from minihuman.reporting.sections import count_clauses, flow_section
from minihuman.reporting.teaching_section import read_taught_logs, teaching_figures, teaching_section

_CURVES = (
    ("log_excess_steps", "log of the excess steps over the shortest path", (0.0, math.inf)),
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_BOUNDED_MEASURES = frozenset(
    {"success", "spl_mean", "reward_mean", "reward_first", "path_efficiency_mean", "ineffective_share"}
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "segment", "block", "episode", "attempt", "episode_in_block",
    "exclusion_reason", "world", "steps", "max_steps", "outcome",
    *(measure for measure, _, _ in _CURVES),
]  # fmt: skip
_EVERY_MOMENT = frozenset({"steps", "presses", "other_presses", "frames", "samples"})  # too long to be read in a report


def build_report(sessions: StudySessions, out: Path, templates: Path | None = None) -> tuple[Path, ...]:
    """Write tables, figures and ``report.html`` of a study's sessions; give the files, the page first.

    The tables of every step, key and picture are left to an export.

    Args:
        sessions: the study's.
        out: the folder of the report.
        templates: a folder with a template or a style of one's own; see ``build_page``.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no log in it can be read, or they are of different studies.
    """
    names = [name for name in TABLES if name not in _EVERY_MOMENT]
    with StudyStore(sessions, with_shortest=True, tables=names) as store:
        study = _study(store, sessions)
        tables = write_tables(store.tables, out / "tables", names=names)
        episodes = store.tables.table("episodes", _EPISODE_COLUMNS).to_pandas()
        blocks, participants = (store.tables.table(name).to_pandas() for name in ("blocks", "participants"))
        answers, starts, done = (store.tables.table(name).to_pandas() for name in ("answers", "starts", "clauses"))
        controls = store.tables.table("controls").to_pandas()
    participants = exclude_practice_alone(participants)
    protocols = read_protocols(store.kept)
    practice = find_practice(protocols, participants["group"].unique())
    practised = episodes[_is_practice(episodes, practice) & episodes["exclusion_reason"].isna()]
    exclusions = list_exclusions(episodes, participants)
    episodes, blocks = (rows[~_is_practice(rows, practice)] for rows in (episodes, blocks))
    found = compute_results(episodes, blocks, participants, read_planned_analysis(protocols))
    qualities = [kept.quality for kept in store.kept if kept.quality is not None]
    outlines = [kept.outline for kept in store.kept if kept.outline is not None]
    where = out / "figures"
    paths = _paths(store.kept, sessions.selection, where)
    taught = read_taught_logs(store.kept, controls, sessions.selection)
    steering = teaching_figures(taught, where)
    figures = [
        *_curves(episodes, found, where),
        *_session_figures(blocks, found, where),
        *_waiting(found, where),
        *steering,
        *paths,
    ]
    simulated = int((participants["player"] != "human").sum())
    facts = PageContent(
        study=study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        windows=dict(participants["window"].fillna("a window that did not say").value_counts()),
        simulated=simulated,
        flow=flow_section(sessions.source, participants),
        methods=build_methods(outlines, qualities, simulated, protocols=protocols),
        known_keys=find_known_keys(outlines, protocols),
        figures=figures,
        tables=tables,
        qualities=qualities,
        answers=answers,
        clauses=count_clauses(episodes, starts, done),
        teaching=teaching_section(taught),
        practice={str(name): len(rows) for name, rows in practised.groupby("block", sort=False)},
        exclusions=exclusions,
        account=sessions.account,
        papers=is_published_study([one.protocol_sha256 for one in outlines]),
    )
    whole = out / "report.html"
    whole.write_text(build_page(facts, found, templates), encoding="utf-8", newline="\n")
    return (whole, *tables, *(figure.path for figure in figures))


def find_stale_figures(out: Path, written: Collection[Path]) -> tuple[str, ...]:
    """Name the figures in a report's folder that it did not write: another study's, or of excluded participants."""
    ours = {path.stem for path in written}
    left = sorted(path.name for path in (out / "figures").glob("*.p[nd][gf]") if path.stem not in ours)
    if not left:
        return ()
    return (
        f"{out / 'figures'} holds {len(left)} files that are not this report's: {left[0]} to {left[-1]}; remove them",
    )


def read_protocols(kept: Sequence[CachedSession]) -> list[Protocol]:
    """The protocols that the sessions were played by, each once."""
    one_of_each = {one.outline.protocol_sha256: one.path for one in kept if one.outline is not None}
    found = [(read_log(Path(path)).plan.protocol_toml, path) for path in one_of_each.values()]
    return [decode_logged_protocol(toml, path) for toml, path in found if toml]


def read_planned_analysis(protocols: Sequence[Protocol]) -> AnalysisSpec:
    """Read what the protocol named before the study; nothing where its versions name different things."""
    named = {protocol.analysis for protocol in protocols}
    return named.pop() if len(named) == 1 else AnalysisSpec()


def find_practice(protocols: Sequence[Protocol], groups: Iterable[str]) -> frozenset[tuple[str, str]]:
    """Find group and block of all practice.

    Raises:
        ReportError: if one version of the protocol analyses a block, and another does not.
    """
    found = [
        frozenset(
            (group, block.name)
            for group in groups
            for block in (apply_overrides(each, group) for each in protocol.blocks)
            if not block.analysed
        )
        for protocol in protocols
    ]
    if len(set(found)) > 1:
        blocks = sorted({block for each in found for _, block in each})
        raise ReportError(
            f"versions of the protocol disagree on the analysed blocks ({', '.join(blocks)}); choose one with --version"
        )
    return found[0] if found else frozenset()


def _is_practice(rows: pd.DataFrame, practice: Collection[tuple[str, str]]) -> "pd.Series[bool]":
    return pd.Series([pair in practice for pair in zip(rows["group"], rows["block"], strict=True)], rows.index, bool)


def _study(store: StudyStore, sessions: StudySessions) -> str:
    """Find the name of the one study that the sessions are of."""
    read = [kept for kept in store.kept if kept.study]
    if not read:
        skipped = len(sessions.account.skipped)
        found = f"{sessions.source} holds no session log that can be read; {skipped} were skipped"
        raise ReportError(f"{found}: not a study with sessions; name a study folder")
    for one in read:
        if one.study != read[0].study:
            raise ReportError(
                f"{one.path} is of study {one.study!r}, the earlier logs of {read[0].study!r}; "
                "a report is of one study: name its folder"
            )
    if not any(one.outline for one in read):
        raise ReportError(f"{sessions.source}: {sessions.selection} selects none of its sessions; select others")
    return read[0].study


def _curves(episodes: pd.DataFrame, found: Results, out: Path) -> Iterator[ReportFigure]:
    """Draw the learning curves of every block, by group."""
    counted = episodes[episodes["exclusion_reason"].isna()]
    for block in (one.block for one in found.blocks):
        rows = counted[counted["block"] == block]
        for measure, label, limits in _CURVES:
            curves = collect_learning_curves(rows, measure, order=found.order)
            if curves and rows["episode_in_block"].nunique() > 1 and rows[measure].notna().any():
                cannot_leave = limits if rows[measure].dropna().between(*limits).all() else None
                stem = out / f"{block}_{measure}"
                png, _ = save_figure(learning_figure(curves, measure=label, limits=cannot_leave), stem)
                caption = f"{label[0].upper()}{label[1:]} over the episodes of block {block}: mean, 95 % interval."
                yield ReportFigure(block, png, caption)


def _session_figures(blocks: pd.DataFrame, found: Results, out: Path) -> Iterator[ReportFigure]:
    """Of every block of several sessions, the measure that groups are compared on first, session by session."""
    included = blocks[blocks["exclusion_reason"].isna()]
    for one in found.blocks:
        rows = included[included["block"] == one.block]
        measures = one.by_session["measure"].tolist()
        measure = one.headline[0].measure if one.headline else next(iter(measures), None)
        if measure is None or rows["session"].nunique() < 2:
            continue
        of_group = {group: rows[rows["group"] == group] for group in found.order}
        sessions = sorted(rows["session"].unique())
        curves = {
            group: theirs.pivot(index="participant", columns="session", values=measure)
            .reindex(columns=sessions)
            .to_numpy(float)
            for group, theirs in of_group.items()
            if len(theirs)
        }
        name = MEASURES[measure]
        bounded = measure in _BOUNDED_MEASURES and rows[measure].dropna().between(0, 1).all()
        limits = (0.0, 1.0) if bounded else None
        figure = learning_figure(curves, measure=name, limits=limits, xlabel="session", numbers=sessions)
        png, _ = save_figure(figure, out / f"{one.block}_sessions")
        caption = f"{name[0].upper()}{name[1:]} in block {one.block}, session by session: mean, 95 % interval."
        yield ReportFigure(one.block, png, caption)


def _waiting(found: Results, out: Path) -> Iterator[ReportFigure]:
    """Draw how long participants took to the goal and to their keys, block by block."""
    for one in found.blocks:
        kinds = (
            ("goal", one.waits.goal, "steps of an episode", "episodes that have not reached the goal"),
            ("keys", one.waits.keys, "playing time (s)", "participants who have not discovered all keys"),
        )
        for name, groups, label, what in kinds:
            if groups:
                png, _ = save_figure(survival_figure(groups, label=label), out / f"{one.block}_waiting_{name}")
                caption = f"Share of {what} (Kaplan and Meier); ticks: censored. Below: the number at risk."
                yield ReportFigure(one.block, png, caption)


def _paths(kept: Sequence[CachedSession], selection: Selection, out: Path) -> Iterator[ReportFigure]:
    """The path figure of one session of each group, the one with the most blocks, over the included episodes."""
    examples: dict[str, CachedSession] = {}
    for one in sorted(kept, key=lambda one: -one.blocks):
        if one.blocks and one.outline is not None:
            examples.setdefault(one.outline.group, one)
    for group, one in sorted(examples.items()):
        session = selection.judge(read_log(Path(one.path))).session
        png, _ = save_figure(blocks_figure(group_by_block(session)), out / f"paths_{group}")
        caption = f"Paths of {session.plan.participant.id} (group {group}), the first participant with the most blocks."
        yield ReportFigure("", png, caption)
