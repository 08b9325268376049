"""Build a study's report, from its logs to a folder of tables, figures, one page, and scripts of mixed models in R
(lme4, brms) and Python (statsmodels, Bambi).
"""

import json
import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

import minihuman
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import CachedSession, StudyStore
from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLES
from minihuman.dataset.table_files import write_tables
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec, apply_overrides
from minihuman.figures.figure_data import (
    Difference,
    collect_learning_curves,
    draw_figure_files,
    group_by_block,
    name_measure,
)
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.activity_sections import SectionSource, build_activity_sections, join_sections
from minihuman.reporting.methods import build_methods, find_known_keys
from minihuman.reporting.page import PageContent, build_page, build_participants_page, is_published_study
from minihuman.reporting.results import (
    BlockResults,
    Results,
    compute_results,
    exclude_practice_alone,
    label_measure,
    list_exclusions,
)
from minihuman.reporting.scorecard import build_scorecard, draw_scorecard, find_models_folder, write_score_table
from minihuman.reporting.sections import ATTEMPT_COLUMNS, count_clauses, flow_section
from minihuman.reporting.study_measures import add_measures
from minihuman.reporting.template import ReportFigure
from minihuman.statistics.paired import MixedModel, fit_mixed_model

LANGUAGES = ("r", "python")
_FILES = {"r": "analysis.R", "python": "analysis.py"}


class _Expression(NamedTuple):
    """A measure of one episode, from the columns of the table of episodes."""

    r: str
    python: str


def _column(name: str) -> _Expression:
    return _Expression(f"as.numeric(d${name})", f'd["{name}"].astype(float)')


def _logarithm(name: str) -> _Expression:
    return _Expression(f"log(as.numeric(d${name}))", f'np.log(d["{name}"].astype(float))')


_OF_EPISODE = {  # measures of a block that are the mean of an episode's; times on their logarithms, as in the report
    "log_excess_steps_mean": _column("log_excess_steps"),
    "log_steps_ratio_mean": _column("log_steps_ratio"),
    "spl_mean": _column("spl"),
    "reward_mean": _column("reward"),
    "success": _column("success"),
    "steps_at_limit_mean": _Expression(
        "ifelse(d$success, d$steps, d$max_steps)", 'd["steps"].where(d["success"], d["max_steps"]).astype(float)'
    ),
    "playing_s_mean": _logarithm("playing_s"),
    "response_median_ms": _logarithm("response_median_ms"),
    "reaction_median_ms": _logarithm("reaction_median_ms"),
    "path_efficiency_mean": _column("path_efficiency"),
}


def write_scripts(
    out: Path, study: str, found: Results, episodes: pd.DataFrame, languages: Sequence[str]
) -> tuple[Path, ...]:
    """Write ``analysis.R`` and ``analysis.py`` into a report's folder, for the block that groups are compared on.

    The measure is the primary one if it is a mean over episodes, else the first that is.

    Raises:
        ReportError: if no block is played by two groups, or no such measure has values.
    """
    block = found.target_block
    if block is None or len(block.groups) < 2:
        raise ReportError(
            "--r and --python compare groups, but no block is played by two groups; leave these options out"
        )
    wanted = sorted(block.roles, key=lambda name: block.roles[name] != "primary")
    measure = next((name for name in wanted if name in _OF_EPISODE), None)
    if measure is None or episodes[episodes["block"] == block.block].empty:
        raise ReportError(
            f"--r and --python need a measure for each episode, which block {block.block} lacks; remove them"
        )
    groups = [str(group) for group in block.groups["group"]]
    environment = Environment(
        loader=PackageLoader("minihuman.reporting", "templates"), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["tojson"] = json.dumps
    shown = {
        "study": study,
        "block": block.block,
        "version": minihuman.__version__,
        "groups": groups,
        "reference": groups[-1],
        "label": label_measure(measure),
        "expression": _OF_EPISODE[measure],
    }
    written = []
    for language in languages:
        path = out / _FILES[language]
        path.write_text(environment.get_template(f"{path.name}.j2").render(shown), encoding="utf-8", newline="\n")
        written.append(path)
    return tuple(written)


_CURVES = (
    ("log_excess_steps", "log of the excess steps over the shortest path", (0.0, math.inf)),
    ("reward", "reward", (0.0, 1.0)),
    ("success", "success (share)", (0.0, 1.0)),
    ("playing_s", "playing time (s)", (0.0, math.inf)),
)
_AXIS = {
    "log_excess_steps": "log of excess steps",
    "reward": "reward",
    "success": "share of episodes",
    "playing_s": "playing time (s)",
}
_BOUNDED_MEASURES = frozenset(
    {"success", "spl_mean", "reward_mean", "reward_first", "path_efficiency_mean", "ineffective_share"}
)
_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "segment", "block", "episode", "attempt", "episode_in_block",
    "exclusion_reason", "world", "steps", "max_steps", "outcome",
    "spl", "log_steps_ratio", "excess_steps", "path_efficiency", "response_median_ms", "reaction_median_ms",
    *(measure for measure, _, _ in _CURVES),
]  # fmt: skip


def build_report(
    sessions: StudySessions, out: Path, templates: Path | None = None, *, scripts: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Write tables, figures and ``report.html`` of a study's sessions; give the files, the page first.

    ``participants.html`` beside it shows every participant in every measure.

    The tables of every step, key and picture are left to an export.

    Args:
        sessions: the study's.
        out: the folder of the report.
        templates: a folder with a template or a style of one's own; see ``build_page``.
        scripts: ``r`` and ``python``, for scripts of mixed models beside the tables.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no log in it can be read, or they are of different studies.
    """
    names = [name for name in TABLES if name not in EVERY_MOMENT]  # the others are too long to be read in a report
    with StudyStore(sessions, with_shortest=True, tables=(*names, "steps")) as store:
        study = _study(store, sessions)
        tables = write_tables(store.tables, out / "tables", names=names)
        episodes = store.tables.table("episodes", _EPISODE_COLUMNS).to_pandas()
        blocks, participants = (store.tables.table(name).to_pandas() for name in ("blocks", "participants"))
        answers, done = (store.tables.table(name).to_pandas() for name in ("answers", "clauses"))
        starts = store.tables.table("starts", [*ATTEMPT_COLUMNS, "mission"]).to_pandas()  # their maps are long
        teams = store.tables.table("teams").to_pandas()
        protocols = read_protocols(store.kept)
        analysis = read_planned_analysis(protocols)
        source = SectionSource(
            store.kept, lambda name: store.tables.table(name).to_pandas(), sessions.selection, out / "figures"
        )
        sections = build_activity_sections(source)
        if named := analysis.find_plugin_measures():
            known = {name: store.tables.table(name).to_pandas() for name in names}
            for section in sections:
                known |= section.measure_tables
            blocks = add_measures(blocks, known, named)
        times = store.tables.query(_REACTION_TIMES).to_pandas()
    participants = exclude_practice_alone(participants)
    practice = find_practice(protocols, participants["group"].unique())
    practised = episodes[_is_practice(episodes, practice) & episodes["exclusion_reason"].isna()]
    exclusions = list_exclusions(episodes, participants)
    episodes, blocks = (rows[~_is_practice(rows, practice)] for rows in (episodes, blocks))
    found = compute_results(episodes, blocks, participants, analysis, teams)
    qualities = [kept.quality for kept in store.kept if kept.quality is not None]
    outlines = [kept.outline for kept in store.kept if kept.outline is not None]
    where = out / "figures"
    paths = _paths(store.kept, sessions.selection, where)
    estimates = [*_estimates(blocks, found, where)]
    figures = [
        *(one for one in estimates if one.block != found.target),
        *_reaction_times(times, found, where),
        *_curves(episodes, found, where),
        *_session_figures(blocks, found, where),
        *_waiting(found, where),
        *(figure for section in sections for figure in section.figures),
        *paths,
    ]
    simulated = int((participants["player"] != "human").sum())
    models, scored = _models(sessions, out)
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
        first_figures=[one for one in estimates if one.block == found.target],
        models=models,
        tables=[*tables, *scored],
        qualities=qualities,
        answers=answers,
        clauses=count_clauses(episodes, starts, done),
        activities=join_sections(sections),
        practice={str(name): len(rows) for name, rows in practised.groupby("block", sort=False)},
        exclusions=exclusions,
        account=sessions.account,
        analysis=analysis,
        papers=is_published_study([one.protocol_sha256 for one in outlines]),
        mixed={one.block: _fit_mixed(episodes, one) for one in found.blocks},
    )
    whole = out / "report.html"
    whole.write_text(build_page(facts, found, templates), encoding="utf-8", newline="\n")
    explored = out / "participants.html"
    explored.write_text(build_participants_page(study, blocks, found), encoding="utf-8", newline="\n")
    written = write_scripts(out, study, found, episodes, scripts) if scripts else ()
    return (
        whole,
        explored,
        *tables,
        *scored,
        *written,
        *(figure.path for figure in (*figures, *models, *facts.first_figures)),
    )


def _fit_mixed(episodes: pd.DataFrame, one: BlockResults) -> MixedModel | None:
    """The mixed model of what a block's growth is of; None of teams, whose members' episodes are the same ones."""
    if one.growth is None or one.teams:
        return None
    rows = episodes[(episodes["block"] == one.block) & episodes["exclusion_reason"].isna()]
    left_out = {text.rpartition(": ")[0] for text in one.growth.left_out}
    groups = [group for group in one.groups["group"] if group not in left_out]
    column = "reward" if one.growth.measure == "reward" else "log_excess_steps"
    return fit_mixed_model(rows.rename(columns={column: one.growth.measure}), one.growth.measure, groups)


def _models(sessions: StudySessions, out: Path) -> tuple[list[ReportFigure], list[Path]]:
    """The figure and the table of the study's models beside people; nothing where it has no models."""
    if not find_models_folder(sessions.source).is_dir():
        return [], []
    card = build_scorecard([sessions.source], selection=sessions.selection)
    png, _ = draw_scorecard(card, out / "figures" / "scores")
    caption = "Scores on the same levels, 95 % intervals over players' runs and levels (pigeonhole bootstrap). "
    figure = ReportFigure("", png, f"{caption}{'; '.join(card.notes)}.".replace("reference:", "Reference:"))
    return [figure], [write_score_table(card, out / "tables" / "scores.csv")]


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
            f"the protocol's versions analyse different blocks ({', '.join(blocks)}); choose one version with --version"
        )
    return found[0] if found else frozenset()


def _is_practice(rows: pd.DataFrame, practice: Collection[tuple[str, str]]) -> "pd.Series[bool]":
    pairs = pd.MultiIndex.from_frame(rows[["group", "block"]])
    return pd.Series(pairs.isin(sorted(practice)) if practice else False, rows.index, bool)


def _study(store: StudyStore, sessions: StudySessions) -> str:
    """Find the name of the one study that the sessions are of."""
    read = [kept for kept in store.kept if kept.study]
    if not read:
        skipped = len(sessions.account.skipped)
        found = f"{sessions.source} contains no readable session log ({skipped} were skipped)"
        raise ReportError(f"{found}; name a study's folder")
    for one in read:
        if one.study != read[0].study:
            raise ReportError(
                f"{one.path} is from study {one.study!r}, but earlier logs are from {read[0].study!r}; "
                "name the folder of a single study"
            )
    if not any(one.outline for one in read):
        raise ReportError(f"{sessions.source} has no session that matches {sessions.selection}; select others")
    return read[0].study


def _find_limits(measure: str, values: "pd.Series[float]") -> tuple[float, float] | None:
    """The bounds that a measure cannot leave, where none of its values does; None where there are none."""
    return (0.0, 1.0) if measure in _BOUNDED_MEASURES and values.dropna().between(0, 1).all() else None


def _estimates(blocks: pd.DataFrame, found: Results, out: Path) -> Iterator[ReportFigure]:
    """Draw every participant and the groups' differences on the measure that each block is compared on first."""
    included = blocks[blocks["exclusion_reason"].isna()]
    for one in found.blocks:
        measure = one.headline[0].measure if one.headline else ""
        rows = included[included["block"] == one.block]
        if not measure or one.teams or not rows[measure].notna().any():
            continue
        means = rows.groupby(["group", "participant"])[measure].mean()  # over sessions, as the groups are compared
        groups = {group: means.loc[group].to_numpy(float) for group in found.order if group in means.index}
        differences = [Difference(each.first, each.second, each.difference, each.interval) for each in one.headline]
        name = label_measure(measure)
        short, title = name.partition(" (")[0].partition(":")[0], name_measure(name, one.block, width=110)
        stem, limits = out / f"{one.block}_result", _find_limits(measure, rows[measure])
        png, _ = draw_figure_files(
            stem, "estimation.estimation_figure", groups, differences, measure=short, title=title, limits=limits
        )
        caption = (
            f"{name[0].upper()}{name[1:]} in block {one.block}. A: a dot per participant, beside them the group's mean "
            "with its 95 % interval. B: differences of the means, with the intervals of the comparison."
        )
        yield ReportFigure(one.block, png, caption)


_BINS_PER_OCTAVE = 4
_REACTION_TIMES = f"""
    SELECT block, "group", participant, floor({_BINS_PER_OCTAVE} * log2(response_ms))::INTEGER AS bin, count(*) AS n
    FROM steps
    WHERE (study, participant, session, episode, attempt) IN (
        SELECT (study, participant, session, episode, attempt) FROM episodes WHERE exclusion_reason IS NULL
    ) AND response_ms > 0 GROUP BY ALL ORDER BY ALL
"""


def _reaction_times(times: pd.DataFrame, found: Results, out: Path) -> Iterator[ReportFigure]:
    """Draw the distribution of each participant's reaction times, block by block."""
    for one in found.blocks:
        rows = times[times["block"] == one.block]
        if rows.empty:
            continue
        bins = range(int(rows["bin"].min()), int(rows["bin"].max()) + 1)
        counts = rows.pivot_table(
            index=["group", "participant"], columns="bin", values="n", aggfunc="sum", fill_value=0
        )
        shares = counts.reindex(columns=bins, fill_value=0)
        shares = shares.div(shares.sum(axis=1), axis=0)
        groups = {group: shares.loc[group].to_numpy(float) for group in found.order if group in shares.index}
        edges_ms = 2.0 ** (np.arange(bins.start, bins.stop + 1) / _BINS_PER_OCTAVE)
        stem, title = out / f"{one.block}_reaction_times", name_measure("reaction times", one.block)
        png, _ = draw_figure_files(stem, "estimation.reaction_time_figure", groups, edges_ms, title=title)
        caption = (
            f"Reaction times in block {one.block}, {_BINS_PER_OCTAVE} bins per doubling: a thin line per participant, "
            "or above 12 a band from their 10th to their 90th percentile; thick the mean of the group's participants."
        )
        yield ReportFigure(one.block, png, caption)


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
                title = name_measure(label, block)
                axis = {"measure": _AXIS[measure], "limits": cannot_leave, "title": title}
                png, _ = draw_figure_files(stem, "learning_curves.learning_figure", curves, **axis)
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
        name = label_measure(measure)
        limits = _find_limits(measure, rows[measure])
        title, short = name_measure(name, one.block), name.partition(" (")[0].partition(":")[0]
        axis = {"measure": short, "limits": limits, "xlabel": "session", "numbers": sessions, "title": title}
        png, _ = draw_figure_files(out / f"{one.block}_sessions", "learning_curves.learning_figure", curves, **axis)
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
                alone = name == "keys"  # a time per participant; episodes of one are not independent
                title = name_measure(f"share of {what}", one.block)
                stem, axis = out / f"{one.block}_waiting_{name}", {"label": label, "title": title}
                png, _ = draw_figure_files(stem, "survival_curves.survival_figure", groups, independent=alone, **axis)
                band = "95 % intervals (Greenwood, log-log); " if alone else ""
                caption = f"Share of {what} (Kaplan and Meier); {band}ticks: censored. Below: the number at risk."
                yield ReportFigure(one.block, png, caption)


def _paths(kept: Sequence[CachedSession], selection: Selection, out: Path) -> Iterator[ReportFigure]:
    """The path figure of one session of each group, the one with the most blocks, over the included episodes."""
    examples: dict[str, CachedSession] = {}
    for one in sorted(kept, key=lambda one: -one.blocks):
        if one.blocks and one.outline is not None:
            examples.setdefault(one.outline.group, one)
    for group, one in sorted(examples.items()):
        session = selection.judge(read_log(Path(one.path))).session
        png, _ = draw_figure_files(out / f"paths_{group}", "path_figures.blocks_figure", group_by_block(session))
        caption = f"Paths of {session.plan.participant.id} (group {group}), the first participant with the most blocks."
        yield ReportFigure("", png, caption)
