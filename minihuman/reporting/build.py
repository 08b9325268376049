"""Build a study's report from its tables: a folder of table files, figures, pages, and scripts of mixed models.

The scripts are for R (lme4, brms) and Python (statsmodels, Bambi).
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.recording_quality import PlanOutline
from minihuman.dataset.selection import ANSWER_RULES
from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLES
from minihuman.dataset.tables import Tables, select
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign, derive_design
from minihuman.reporting.activity_sections import (
    ReportSection,
    SectionSource,
    build_activity_sections,
    join_sections,
)
from minihuman.reporting.analysed_rows import (
    blank_goal_measures,
    find_practice,
    is_practice,
    leave_out_discovery,
    leave_out_navigation,
)
from minihuman.reporting.answers import state_answers
from minihuman.reporting.block_results import BlockResults
from minihuman.reporting.exclusions import count_excluded, exclude_practice_alone, list_exclusions
from minihuman.reporting.instruction_clauses import ATTEMPT_COLUMNS, count_clauses
from minihuman.reporting.interactions import InteractionResults, choose_first_block, compute_interaction
from minihuman.reporting.known_keys import find_blocks_without_discovery, find_known_keys
from minihuman.reporting.methods import build_methods, name_worlds
from minihuman.reporting.page import PageContent, build_page, build_participants_page, is_published_study
from minihuman.reporting.participant_flow import FlowSection, flow_section
from minihuman.reporting.questionnaire_scores import add_last_blocks, list_task_load, task_load_table
from minihuman.reporting.results import Results, compute_results
from minihuman.reporting.sample_description import describe_sample
from minihuman.reporting.scorecard import (
    PlayerRows,
    compose_scorecard,
    draw_scorecard,
    find_models_folder,
    read_player_rows,
    write_score_table,
)
from minihuman.reporting.scripts import write_scripts
from minihuman.reporting.study_figures import (
    CURVES,
    REACTION_TIME_QUERY,
    draw_conditions,
    draw_estimates,
    draw_interaction,
    draw_learning_curves,
    draw_paths,
    draw_reaction_times,
    draw_sessions,
    draw_waiting_times,
)
from minihuman.reporting.study_measures import add_measures
from minihuman.reporting.template import ReportFigure, Table
from minihuman.reporting.within_results import measure_levels, select_measures, unite_teams
from minihuman.statistics.mixed_model import MixedModel, fit_mixed_model

_EPISODE_COLUMNS = [  # all that the results and the curves need; a big study has many episodes
    "participant", "group", "session", "segment", "block", "episode", "attempt", "episode_in_block",
    "exclusion_reason", "world", "steps", "labels", "info_at_end", "max_steps", "outcome",
    "spl", "log_steps_ratio", "excess_steps", "path_efficiency", "response_median_ms", "reaction_median_ms",
    *(measure for measure, _, _ in CURVES),
]  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _ReportInput:
    """The data from which a report is computed: a study's tables as data frames, and the contents of its protocols."""

    study: str
    episodes: pd.DataFrame
    blocks: pd.DataFrame  # with a column for each measure of a plug-in
    participants: pd.DataFrame
    answers: pd.DataFrame
    clauses: pd.DataFrame
    starts: pd.DataFrame
    teams: pd.DataFrame
    reaction_times: pd.DataFrame  # counts by bin
    protocols: list[Protocol]
    analysis: AnalysisSpec
    design: ExperimentDesign
    sections: list[ReportSection]
    plays: list[PlayerRows]  # the study's and its models'; empty without models


def build_report(
    tables: Tables, out: Path, templates: Path | None = None, *, scripts: Sequence[str] = ()
) -> tuple[Path, ...]:
    """Write tables, figures and ``report.html`` of a study; return the paths of the files, the page first.

    ``participants.html`` beside the report shows every participant in every measure. The tables of every step, key and
    picture are left to exports.

    Args:
        tables: the study's tables.
        out: the folder of the report.
        templates: a folder with a custom template or style; see ``build_page``.
        scripts: ``r`` and ``python``, for scripts of mixed models beside the tables.

    Raises:
        LogError: if the study's folder does not exist.
        ReportError: if no log in the study's folder can be read, or the logs are of different studies.
    """
    names = [name for name in TABLES if name not in EVERY_MOMENT]  # the others are too long to be read in a report
    tables.require((*names, "steps"), shortest_paths=True)
    study = _find_study(tables)
    table_files = tables.write(out / "tables", names=[*names, PERSON_TABLE])
    report_input = _read_input(tables, study, names, out / "figures")
    tables.release()  # drawing takes seconds
    practice = find_practice(report_input.protocols, report_input.participants["group"].unique())
    episodes, blocks = _leave_out_practice(tables, report_input, practice)
    results = _compute_results(report_input, episodes, blocks)
    content = _gather_content(tables, report_input, results, practice)
    content = _add_interaction(content, tables, report_input, (episodes, blocks), results)
    content = _add_figures(content, tables, report_input, (episodes, blocks), results, out / "figures")
    models, score_files = _score_models(report_input.plays, out)
    content = replace(
        content,
        models=models,
        tables=[*table_files, *score_files],
        mixed={block.block: _fit_mixed(episodes, block) for block in results.blocks},
    )
    page = out / "report.html"
    page.write_text(build_page(content, results, templates), encoding="utf-8", newline="\n")
    participants_page = out / "participants.html"
    participants_page.write_text(build_participants_page(study, blocks, results), encoding="utf-8", newline="\n")
    script_files: tuple[Path, ...] = ()
    if scripts:
        script_files = write_scripts(out, study, results, episodes, scripts, content.interaction)
    figures = [figure.path for figure in (*content.figures, *models, *content.first_figures)]
    return (page, participants_page, *table_files, *score_files, *script_files, *figures)


def _leave_out_practice(
    tables: Tables, report_input: _ReportInput, practice: Collection[tuple[str, str]]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the episodes and blocks without practice, and without the measures that say nothing about a block."""
    episodes = report_input.episodes[~is_practice(report_input.episodes, practice)]
    blocks = report_input.blocks[~is_practice(report_input.blocks, practice)]
    blocks = leave_out_discovery(blocks, find_blocks_without_discovery(_list_outlines(tables), report_input.protocols))
    blocks = blank_goal_measures(blocks, episodes, report_input.analysis)
    trial_blocks = frozenset(block for section in report_input.sections for block in section.blocks)
    return leave_out_navigation(episodes, blocks, trial_blocks)


def _list_outlines(tables: Tables) -> list[PlanOutline]:
    """Return the outlines of the plans of all selected sessions that could be read."""
    return [session.outline for session in tables.sessions if session.outline is not None]


def _compute_results(report_input: _ReportInput, episodes: pd.DataFrame, blocks: pd.DataFrame) -> Results:
    """Compute the results from episodes and blocks without practice."""
    return compute_results(
        episodes,
        blocks,
        report_input.participants,
        report_input.analysis,
        report_input.teams,
        _find_trial_levels(report_input),
        report_input.design,
    )


def _add_interaction(
    content: PageContent,
    tables: Tables,
    report_input: _ReportInput,
    analysed: tuple[pd.DataFrame, pd.DataFrame],
    results: Results,
) -> PageContent:
    """Add the interaction, the block whose comparison answers the question, and the answers without exclusion rules.

    ``analysed`` holds the episodes and the blocks without practice.
    """
    interaction, first_block = _compute_interaction(report_input, analysed, results)
    without_rules = _answer_without_rules(tables, report_input)
    return replace(content, interaction=interaction, first_block=first_block, answers_without_rules=without_rules)


def _compute_interaction(
    report_input: _ReportInput, analysed: tuple[pd.DataFrame, pd.DataFrame], results: Results
) -> tuple[InteractionResults | None, str]:
    """Return the interaction of groups and conditions, and the block whose comparison answers the question.

    The interaction is None unless the design is mixed, and the block is "" for none. ``analysed`` holds the episodes
    and the blocks without practice.
    """
    episodes, blocks = (rows[rows["exclusion_reason"].isna()] for rows in analysed)
    analysis = report_input.analysis
    design = report_input.design
    included = unite_teams(blocks, report_input.teams)
    if design.condition_label:
        included = measure_levels(episodes, design.condition_label, _find_trial_levels(report_input))
        design = design.add_levels(sorted(included["block"].unique()))
        analysis = select_measures(analysis, included)
    interaction = compute_interaction(included, design, analysis, results.order)
    return interaction, choose_first_block(design, analysis, results, interaction)


def _find_trial_levels(report_input: _ReportInput) -> pd.DataFrame | None:
    """Return the measures of trials by level of their labels; None if the study has no trials."""
    levels = [section.measure_tables.get("trial_levels") for section in report_input.sections]
    return next((rows for rows in levels if rows is not None), None)


def _answer_without_rules(tables: Tables, report_input: _ReportInput) -> list[str]:
    """State the study's answers without exclusion rules on answers; return [] if no such rule excludes anyone."""
    reasons = {rule.reason for protocol in report_input.protocols for rule in protocol.exclusions if rule.question}
    if not reasons.intersection(report_input.participants["exclusion_reason"].dropna()):
        return []
    selection = replace(tables.selection, with_=(*tables.selection.with_, ANSWER_RULES))
    names = [name for name in TABLES if name not in EVERY_MOMENT]
    with TemporaryDirectory() as figures, select(tables.source, selection) as all_tables:
        all_tables.require((*names, "steps"), shortest_paths=True)
        all_input = _read_input(all_tables, report_input.study, names, Path(figures))
    practice = find_practice(all_input.protocols, all_input.participants["group"].unique())
    episodes, blocks = _leave_out_practice(all_tables, all_input, practice)
    results = _compute_results(all_input, episodes, blocks)
    interaction, first_block = _compute_interaction(all_input, (episodes, blocks), results)
    return state_answers(results, interaction, all_input.design, first_block)


def _add_figures(
    content: PageContent,
    tables: Tables,
    report_input: _ReportInput,
    analysed: tuple[pd.DataFrame, pd.DataFrame],
    results: Results,
    out: Path,
) -> PageContent:
    """Return the contents with the figures, divided into those that answer the study's question and the others.

    ``analysed`` holds the episodes and the blocks without practice.
    """
    first_figures: list[ReportFigure] = []
    if content.interaction is not None:
        first_figures.append(draw_interaction(content.interaction, out, content.design.condition_label))
    elif results.within is not None and results.within.comparisons:
        first_figures.append(draw_conditions(results.within, out))
    figures: list[ReportFigure] = []
    _, blocks = analysed
    block_figures = (
        *draw_sessions(blocks, results, out),
        *draw_estimates(blocks, results, out, report_input.teams),
    )
    for figure in block_figures:
        if figure.block == content.first_block:
            first_figures.append(figure)
        else:
            figures.append(figure)
    figures += _draw_figures(tables, report_input, analysed, results, out)
    return replace(content, figures=figures, first_figures=first_figures)


def _read_input(tables: Tables, study: str, names: Sequence[str], figures: Path) -> _ReportInput:
    """Read the data from which the report is computed.

    Args:
        tables: the study's tables.
        study: the study's name.
        names: the tables that the measures of plug-ins can use.
        figures: the folder of the figures.
    """
    protocols = tables.read_protocols()
    analysis = read_planned_analysis(protocols)
    blocks = tables.frame("blocks")
    practice = find_practice(protocols, tables.frame("participants", ["group"])["group"].unique())
    sections = build_activity_sections(SectionSource(tables, figures, practice))
    measures = analysis.find_plugin_measures()
    if measures:
        tables_by_name = {name: tables.frame(name) for name in names}
        for section in sections:
            tables_by_name |= section.measure_tables
        blocks = add_measures(blocks, tables_by_name, measures)
    return _ReportInput(
        study=study,
        episodes=tables.frame("episodes", _EPISODE_COLUMNS),
        blocks=blocks,
        participants=exclude_practice_alone(tables.frame("participants")),
        answers=add_last_blocks(tables.frame("answers"), tables.frame("parts"), blocks["block"].unique()),
        clauses=tables.frame("clauses"),
        starts=tables.frame("starts", [*ATTEMPT_COLUMNS, "mission"]),  # their maps are long
        teams=tables.frame("teams"),
        reaction_times=tables.query(REACTION_TIME_QUERY).to_pandas(),
        protocols=protocols,
        analysis=analysis,
        design=read_planned_design(protocols),
        sections=sections,
        plays=_read_plays(tables),
    )


def _read_plays(tables: Tables) -> list[PlayerRows]:
    """Read the rows of people and models; return an empty list if the study has no models."""
    folder = find_models_folder(tables.source)
    if not folder.is_dir():
        return []
    with select(folder, tables.selection) as models:
        return [read_player_rows(tables), read_player_rows(models)]


def _draw_figures(
    tables: Tables,
    report_input: _ReportInput,
    analysed: tuple[pd.DataFrame, pd.DataFrame],
    results: Results,
    out: Path,
) -> list[ReportFigure]:
    """Draw all figures except those of estimates and sessions; ``analysed`` is episodes and blocks without practice."""
    episodes, _ = analysed
    paths = draw_paths(tables, out, has_practice=len(episodes) < len(report_input.episodes))
    sections = sorted(report_input.sections, key=lambda section: not section.is_leading)
    figures = [(section.is_leading, figure) for section in sections for figure in section.figures]
    return [
        *(figure for is_leading, figure in figures if is_leading),
        *draw_reaction_times(report_input.reaction_times, results, out),
        *draw_learning_curves(episodes, results, out, report_input.teams),
        *draw_waiting_times(results, out),
        *(figure for is_leading, figure in figures if not is_leading),
        *paths,
    ]


def _gather_content(
    tables: Tables, report_input: _ReportInput, results: Results, practice: Collection[tuple[str, str]]
) -> PageContent:
    """Gather the page's contents besides the results; figures, tables and mixed models are added later."""
    participants = report_input.participants
    episodes = report_input.episodes
    outlines = _list_outlines(tables)
    simulated = int((participants["player"] != "human").sum())
    is_of_practice = is_practice(episodes, practice)
    flow = flow_section(tables.source, participants)
    return PageContent(
        study=report_input.study,
        sessions=len(participants),
        players=sorted(participants["player"].unique()),
        windows=dict(participants["window"].fillna("a window that did not say").value_counts()),
        simulated=simulated,
        imported=int((participants["evidence"] == "consistent").sum()),
        flow=flow,
        methods=_compose_methods(tables, report_input, results, simulated, flow),
        worlds=name_worlds(outlines, report_input.protocols),
        known_keys=find_known_keys(outlines, report_input.protocols),
        figures=(),
        first_figures=(),
        models=(),
        tables=(),
        qualities=[session.quality for session in tables.sessions if session.quality is not None],
        answers=report_input.answers,
        task_load=_tabulate_task_load(report_input, results),
        clauses=count_clauses(episodes[~is_of_practice], report_input.starts, report_input.clauses),
        activities=join_sections(report_input.sections),
        practice=_count_by_block(episodes[is_of_practice & episodes["exclusion_reason"].isna()]),
        exclusions=list_exclusions(episodes, participants),
        account=tables.account,
        analysis=report_input.analysis,
        design=report_input.design,
        interaction=None,
        first_block=results.target,
        papers=is_published_study([outline.protocol_sha256 for outline in outlines]),
        mixed={},
    )


def _compose_methods(
    tables: Tables, report_input: _ReportInput, results: Results, simulated: int, flow: FlowSection | None
) -> list[str]:
    """Return the paragraphs of the methods section; the description of the sample follows the first paragraph.

    ``simulated`` is the number of sessions that no person played.
    """
    participants_paragraph, *further_paragraphs = build_methods(
        _list_outlines(tables),
        [session.quality for session in tables.sessions if session.quality is not None],
        simulated,
        protocols=report_input.protocols,
        flow=flow.counts if flow else None,
        block_order=[block.block for block in results.blocks],
        measures=results.shown_measures,
        n_excluded=count_excluded(report_input.participants),
    )
    people = report_input.participants
    included = people[people["exclusion_reason"].isna()]
    groups = dict(zip(included["participant"], included["group"], strict=True))
    return [participants_paragraph, *describe_sample(tables.people, groups), *further_paragraphs]


def _tabulate_task_load(report_input: _ReportInput, results: Results) -> Table | None:
    """Tabulate the NASA Task Load Index of included participants by condition; None for fewer than two conditions."""
    people = report_input.participants
    people = people[people["exclusion_reason"].isna()][["participant", "group"]].drop_duplicates("participant")
    return task_load_table(
        report_input.answers.drop(columns="group", errors="ignore").merge(people, on="participant"),
        list_task_load(report_input.protocols),
        dict(report_input.design.condition_of_block),
        results.order,
    )


def _count_by_block(episodes: pd.DataFrame) -> dict[str, int]:
    """Count episodes by block; blocks are in the order of their first episodes."""
    return {str(name): len(rows) for name, rows in episodes.groupby("block", sort=False)}


def _fit_mixed(episodes: pd.DataFrame, block: BlockResults) -> MixedModel | None:
    """Fit the mixed model of a block's growth; None without growth or enough people, or for teams (shared episodes)."""
    if block.growth is None or block.teams:
        return None
    rows = episodes[(episodes["block"] == block.block) & episodes["exclusion_reason"].isna()]
    omitted_groups = {text.rpartition(": ")[0] for text in block.growth.left_out}  # of texts "GROUP: REASON"
    groups = [group for group in block.groups["group"] if group not in omitted_groups]
    measure = block.growth.measure
    if measure != "reward":
        rows = rows.rename(columns={"log_excess_steps": measure})
    return fit_mixed_model(rows, measure, groups)


def _score_models(plays: Sequence[PlayerRows], out: Path) -> tuple[list[ReportFigure], list[Path]]:
    """Draw the scores of a study's models and people and write their table; return the figure and the table's path.

    Both lists are empty if the study has no models.
    """
    if not plays:
        return [], []
    card = compose_scorecard(plays)
    png, _ = draw_scorecard(card, out / "figures" / "scores")
    caption = "Scores on the same levels, 95 % intervals over players' runs and levels (pigeonhole bootstrap). "
    figure = ReportFigure("", png, f"{caption}{'; '.join(card.notes)}.".replace("reference:", "Reference:"))
    return [figure], [write_score_table(card, out / "tables" / "scores.csv")]


def find_stale_figures(out: Path, report_files: Collection[Path]) -> tuple[str, ...]:
    """Return a warning if a report's folder has figures that the report did not write; an empty tuple if it has none.

    Such figures are of another study or of excluded participants.
    """
    stems = {path.stem for path in report_files}
    figures = (out / "figures").glob("*.p[nd][gf]")  # PNG and PDF
    stale = sorted(path.name for path in figures if path.stem not in stems)
    if not stale:
        return ()
    files = f"{len(stale)} files that are not this report's: {stale[0]} to {stale[-1]}"
    return (f"{out / 'figures'} holds {files}; remove them",)


def read_planned_analysis(protocols: Sequence[Protocol]) -> AnalysisSpec:
    """Return the analysis that the protocol planned; an empty one without protocols or if its versions differ in it."""
    analyses = {protocol.analysis for protocol in protocols}
    if len(analyses) == 1:
        return analyses.pop()
    return AnalysisSpec()


def read_planned_design(protocols: Sequence[Protocol]) -> ExperimentDesign:
    """Return the experimental design that the protocol states; an empty one without protocols or if versions differ."""
    designs = {derive_design(protocol) for protocol in protocols}
    if len(designs) == 1:
        return designs.pop()
    return ExperimentDesign()


def _find_study(tables: Tables) -> str:
    """Return the name of the single study to which all sessions belong.

    Raises:
        ReportError: if no log can be read, no session is selected, or the logs are of different studies.
    """
    readable = [session for session in tables.sessions if session.study]
    if not readable:
        skipped = len(tables.account.skipped)
        problem = f"{tables.source} contains no readable session log ({skipped} were skipped)"
        raise ReportError(f"{problem}; name a study's folder")
    for session in readable:
        if session.study != readable[0].study:
            raise ReportError(
                f"{session.path} is from study {session.study!r}, but earlier logs are from {readable[0].study!r}; "
                "name the folder of a single study"
            )
    if not any(session.outline for session in readable):
        raise ReportError(f"{tables.source} has no session that matches {tables.selection}; select others")
    return readable[0].study
