"""The report as one self-contained HTML page, rendered from a Jinja template that a lab can replace or extend.

A replication of the published study is shown beside its subject means: Chevalier-Boisvert et al. (2023), "Minigrid &
Miniworld", mean reward of each subject in Miniworld's four rooms.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from minihuman.dataset.recording_quality import RecordingQuality
from minihuman.dataset.selection import SelectionSummary
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.reporting.activity_sections import ReportSection
from minihuman.reporting.answers import state_answers
from minihuman.reporting.block_measures import label_measure, phrase_measure
from minihuman.reporting.block_results import BlockResults, summarise_group_rewards
from minihuman.reporting.instruction_clauses import clauses_table
from minihuman.reporting.interactions import InteractionResults, cells_table, interaction_table
from minihuman.reporting.participant_flow import FlowSection
from minihuman.reporting.result_tables import (
    conditions_table,
    crossover_table,
    list_missing_parts,
    list_reliability_notes,
    parts_table,
    reliability_table,
    session_changes_table,
    session_table,
    survival_table,
)
from minihuman.reporting.results import Results
from minihuman.reporting.sections import answers_table, exclusions_section, quality_section, skipped_table
from minihuman.reporting.statements import difference_statement, power_statement
from minihuman.reporting.study_question import ask_question, join_names
from minihuman.reporting.template import (
    PARTICIPANTS,
    REPORT,
    ReportFigure,
    Table,
    format_difference,
    format_interval,
    format_mean_sd,
    format_number,
    format_p_value,
    format_pair,
    format_with_interval,
    render_template,
    to_records,
)
from minihuman.reporting.within_results import WithinResults
from minihuman.statistics.comparison import GroupComparison
from minihuman.statistics.mixed_model import MixedModel
from minihuman.statistics.paired import MIN_EPISODES, GrowthTerm

_PUBLISHED_PROTOCOLS = frozenset(  # SHA-256 of the shipped file, by its fields' present and earlier names
    {
        "d834748978b9d35e1c6da9437a14a607b53b613941fa1c5e2d2cb2cf0a1667f1",
        "9716c6e0934a0bd93fbb2bab1a313816346017f237df1c31c718421c4ee536e2",
    }
)
PUBLISHED_SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld"


def read_published_subjects() -> pd.DataFrame:
    """Return the published study's subjects, one row each with the columns group, subject and reward_mean."""
    with (files("minihuman.reporting") / "data" / "published.csv").open(encoding="utf-8") as file:
        return pd.read_csv(file)


def is_published_study(protocols: Collection[str]) -> bool:
    """Return whether all sessions used the published study's protocol.

    ``protocols`` are the SHA-256 of the sessions' protocol files; without any, return False.
    """
    return bool(protocols) and _PUBLISHED_PROTOCOLS.issuperset(protocols)


@dataclass(frozen=True, slots=True)
class PageContent:
    """The contents of the page besides the results."""

    study: str
    sessions: int
    players: Sequence[str]
    simulated: int  # sessions that no person played
    imported: int  # sessions that a page recorded without a server
    windows: Mapping[str, int]  # the number of sessions by kind of window
    flow: FlowSection | None  # counts of participants who came, left, were screened out and are included
    methods: Sequence[str]
    worlds: Mapping[str, Sequence[str]]  # by block, with their options
    known_keys: Mapping[str, Sequence[str]]  # by block, the groups that already knew its keys
    figures: Sequence[ReportFigure]
    first_figures: Sequence[ReportFigure]  # those that answer the study's question
    models: Sequence[ReportFigure]
    tables: Sequence[Path]
    qualities: Sequence[RecordingQuality]
    answers: pd.DataFrame
    task_load: Table | None  # the NASA Task Load Index by condition
    clauses: pd.DataFrame  # assigned and completed, by block, verb and group
    activities: Sequence[ReportSection]  # the sections of activity kinds
    practice: Mapping[str, int]  # by practice block, the episodes that would be included
    exclusions: pd.DataFrame
    account: SelectionSummary
    analysis: AnalysisSpec  # as the protocol plans it
    design: ExperimentDesign
    interaction: InteractionResults | None  # of groups and conditions, in a mixed design
    first_block: str  # the block whose group comparison answers the question; "" for none
    papers: bool  # whether the protocol is the published study's
    mixed: Mapping[str, MixedModel | None]  # by block, if its change over episodes is compared
    answers_without_rules: Sequence[str] = ()  # the study's answers if rules on questionnaire answers exclude nobody


def build_page(content: PageContent, results: Results, templates: Path | None = None) -> str:
    """Render the page as HTML.

    Args:
        content: the contents of the page besides the results.
        results: the study's results.
        templates: a folder with a ``report.html.j2`` or a ``report.css`` that replaces the package's own. Its template
            can extend ``minihuman/report.html.j2``.

    Raises:
        ReportError: if the folder has neither file, or its template cannot be rendered.
    """
    context = {
        "study": content.study,
        "versions": _describe_versions(content.account),
        "sessions": content.sessions,
        **_build_size_context(results),
        "players": content.players,
        "simulated": content.simulated,
        "imported": content.imported,
        "windows": _count_windows(content.windows),
        "flow": content.flow,
        "practice": content.practice,
        "published": _compare_with_published(results) if content.papers else None,
        **_build_question_context(results, content),
        "within": _build_within_context(results.within),
        "interaction": _build_interaction_context(content.interaction, are_trials=results.are_trials),
        "blocks": [_build_block_context(block, results, content) for block in results.blocks],
        "min_growth_episodes": MIN_EPISODES,
        "clauses": clauses_table(content.clauses),
        "activities": content.activities,
        "answers": answers_table(content.answers, results.order),
        "task_load": content.task_load,
        "figures": content.figures,
        "first_figures": content.first_figures,
        "models": content.models,
        "quality": quality_section(content.qualities),
        "exclusions": exclusions_section(content.exclusions),
        "skipped": skipped_table(content.account.skipped),
        "methods": content.methods,
        "tables": content.tables,
    }
    return render_template(REPORT, context, templates)


def _build_question_context(results: Results, content: PageContent) -> dict[str, Any]:
    """Return the template's variables on the study's question, its answers, and what limits the answers."""
    return {
        "question": ask_question(content.analysis, results, content.design, content.interaction),
        "answers_first": state_answers(results, content.interaction, content.design, content.first_block),
        "answers_without_rules": content.answers_without_rules,
        "excluded": _count_excluded(content.exclusions),
        "absent_measures": _list_absent_measures(results, content),
    }


def _build_size_context(results: Results) -> dict[str, Any]:
    """Return the template's variables on how much is included, and on whether episodes are trials."""
    return {
        "included": results.included,
        "are_trials": results.are_trials,
    }


def _count_windows(windows: Mapping[str, int]) -> str:
    """State in how many sessions each kind of window was used."""
    return ", ".join(f"{window} in {count} sessions" for window, count in windows.items())


def _count_excluded(exclusions: pd.DataFrame) -> str:
    """Return the number of excluded participants by reason, as text."""
    people = exclusions[exclusions["level"] == "participant"].drop_duplicates(["exclusion_reason", "participant"])
    counts = people["exclusion_reason"].value_counts(sort=False)
    return ", ".join(f"{count} ({reason})" for reason, count in counts.items()) or "none"


def _list_absent_measures(results: Results, content: PageContent) -> list[str]:
    """Return the names of the measures that the protocol names but the results lack, because they have no values."""
    shown_measures = results.shown_measures | set(content.interaction.roles if content.interaction else ())
    named_measures = (content.analysis.primary_measure, *content.analysis.secondary_measures)
    return [phrase_measure(name) for name in named_measures if name and name not in shown_measures]


def _build_within_context(within: WithinResults | None) -> dict[str, Any] | None:
    """Return the template's variables on conditions compared within participants; None if none are."""
    if within is None:
        return None
    return {
        "label": within.label,
        "conditions": join_names(within.conditions),
        "has_response_times": bool(within.label) and "response_median_ms" in within.roles,
        "table": conditions_table(within),
        "effects": crossover_table(within),
    }


def _build_interaction_context(interaction: InteractionResults | None, *, are_trials: bool) -> dict[str, Any] | None:
    """Return the template's variables on the interaction of groups and conditions; None if there is none."""
    if interaction is None:
        return None
    label = label_measure(interaction.measure)
    return {
        "measure": f"{label[:1].upper()}{label[1:]}",
        "cells": cells_table(interaction),
        "table": interaction_table(interaction),
        "has_response_times": are_trials and interaction.measure == "response_median_ms",
        "has_overall_test": bool(interaction.omnibus),
    }


def build_participants_page(study: str, blocks: pd.DataFrame, results: Results) -> str:
    """Render the page that shows every included participant in every measure as HTML, which needs no server.

    Args:
        study: the study's name.
        blocks: the rows of the table "blocks".
        results: the results that determine the measures, groups and target block shown.
    """
    included = blocks[blocks["exclusion_reason"].isna()]
    compared = dict.fromkeys(name for block in results.blocks for name in block.roles)
    measures = [measure for measure in compared if measure in included]
    labels = {name: label_measure(name) for name in measures}
    rows = []
    for row in to_records(included):
        row_key = {name: row[name] for name in ("participant", "group", "session", "block")}
        values = {name: None if pd.isna(row[name]) else float(row[name]) for name in measures}
        rows.append({**row_key, "values": values})
    contents = {
        "rows": rows,
        "groups": list(results.order),
        "blocks": [block.block for block in results.blocks],
        "target": results.target,
        "measures": labels,
        "short": {name: label.partition(" (")[0].partition(":")[0] for name, label in labels.items()},
    }
    return render_template(PARTICIPANTS, {"study": study, "data": contents})


def _describe_versions(account: SelectionSummary) -> str:
    """State under which versions of the protocol the sessions were played."""
    versions = [f"{version} in {count} sessions" for (_, version), count in sorted(account.versions.items())]
    if len(versions) == 1:
        return f"Protocol version {versions[0]}"
    return f"{len(versions)} versions of the protocol are pooled here ({'; '.join(versions)}), --version takes one"


def _build_block_context(block: BlockResults, results: Results, content: PageContent) -> dict[str, Any]:
    """Return the template's variables on one block's results."""
    has_comparisons = bool(block.comparisons)
    differences = _list_differences(block, content.first_block)
    return {
        "name": block.block,
        "worlds": content.worlds.get(block.block, ()) if block.episodes else (),
        "episodes": block.episodes,
        "teams": block.teams,
        "is_target": block.block == content.first_block and len(block.groups) > 1,
        "is_beside_interaction": has_comparisons and content.interaction is not None and not content.first_block,
        "only_group": _find_only_group(block, results),
        "differences": differences,
        "folds_differences": len(differences) > 2 and len(results.blocks) > 1,
        "has_response_times": results.are_trials and "response_median_ms" in set(block.measures["measure"]),
        "has_no_primary": has_comparisons and "primary" not in block.roles.values(),
        "has_roles": _has_roles(block),
        "measures": _measures_table(block),
        **_tabulate_subjects(block),
        "comparisons": _comparisons_table(block) if has_comparisons else None,
        "only_pair": _name_only_pair(block),
        "not_compared": _list_notes(block, "reason"),
        "cautions": _list_notes(block, "caution"),
        "groups_with_keys": _list_groups_with_keys(block, content),
        "set_aside": [f"{label_measure(name)} ({reason})" for name, reason in block.set_aside.items()],
        "without_goal": block.waits.without_goal,
        "several_sessions": block.by_session["session"].nunique() > 1,
        "sessions": session_table(block),
        "session_changes": session_changes_table(block),
        "survival": survival_table(block.waits),
        "parts": parts_table(block.parts),
        "parts_missing": list_missing_parts(block.parts),
        **_build_growth_context(block, content.mixed.get(block.block), are_trials=results.are_trials),
        "reliability": reliability_table(block.reliabilities, are_trials=results.are_trials),
        "reliability_notes": list_reliability_notes(block.reliabilities),
        "powers": [power_statement(power, block.unit_name) for power in block.powers],
    }


def _list_groups_with_keys(block: BlockResults, content: PageContent) -> Sequence[str]:
    """Return the groups that knew a block's keys from before; none if the page shows no discovery of keys in it."""
    if not block.comparisons or not block.waits.keys:
        return ()
    return content.known_keys.get(block.block, ())


def _find_only_group(block: BlockResults, results: Results) -> str:
    """Return the only group that played a block in a study with several groups; "" for any other block."""
    if len(block.groups) == 1 and len(results.order) > 1:
        return str(block.groups["group"].iloc[0])
    return ""


def _list_differences(block: BlockResults, first_block: str) -> list[str]:
    """State the group differences in a block; [] if they are among the answers at the top of the page."""
    if block.block == first_block and len(block.groups) > 1:
        return []
    return [difference_statement(comparison, block.block, block.team_units) for comparison in block.headline]


def _name_only_pair(block: BlockResults) -> str:
    """Return the two groups that are compared, in parentheses; "" unless there is exactly one pair."""
    pairs = {(comparison.first, comparison.second) for comparison in block.comparisons}
    if len(pairs) != 1:
        return ""
    return f" ({_format_unbroken_pair(*pairs.pop())})"


def _list_notes(block: BlockResults, field: Literal["reason", "caution"]) -> list[dict[str, str]]:
    """Return, for each comparison with a note of the given kind, its ``measure`` and, as ``why``, groups and note."""
    return [
        {
            "measure": label_measure(comparison.measure),
            "why": f"{format_pair(comparison.first, comparison.second)} ({getattr(comparison, field)})",
        }
        for comparison in block.comparisons
        if getattr(comparison, field)
    ]


def _compare_with_published(results: Results) -> dict[str, Any] | None:
    """Return the template's variables that compare the published subjects with this study's; None without a target."""
    block = results.target_block
    if block is None:
        return None
    frame = read_published_subjects()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in to_records(frame)]
    means = summarise_group_rewards(frame)
    rows += [(row["group"], "all", format_mean_sd(row["reward_mean"], row["reward_sd"])) for row in to_records(means)]
    rewards = [comparison for comparison in block.comparisons if comparison.measure == "reward_mean"]
    return {
        "source": PUBLISHED_SOURCE,
        "table": Table(("group", "subject", "reward"), rows, words=2),
        "statements": [difference_statement(comparison, block.block) for comparison in rewards],
        "block": {"name": block.block, "teams": block.teams, **_tabulate_subjects(block)},
    }


def _tabulate_subjects(block: BlockResults) -> dict[str, Table]:
    """Return a table of each participant's reward, by session if there are several, and a table of group means."""
    has_several_sessions = block.subjects["session"].nunique() > 1
    heads = ["group", "subject", "n", "reward"]
    if has_several_sessions:
        heads.insert(2, "session")

    def tabulate(frame: pd.DataFrame, n_column: str) -> Table:
        rows = []
        for row in to_records(frame):
            cells = [row["group"], row.get("participant", "all")]
            if has_several_sessions:
                cells.append(str(row.get("session", "all")))
            rows.append((*cells, str(row[n_column]), format_mean_sd(row["reward_mean"], row["reward_sd"])))
        return Table(tuple(heads), rows, words=len(heads) - 2)

    return {"subjects": tabulate(block.subjects, "episodes"), "subject_means": tabulate(block.groups, "participants")}


def _has_roles(block: BlockResults) -> bool:
    """Return whether the protocol names a measure of the block, so that not all are exploratory."""
    return set(block.roles.values()) != {"exploratory"}


def _format_unbroken_pair(first: str, second: str, *, is_log: bool = False) -> str:
    """Format a difference of two groups, or their ratio, without line breaks."""
    sign = "/" if is_log else "\N{MINUS SIGN}"
    return f"{first}\N{NO-BREAK SPACE}{sign}\N{NO-BREAK SPACE}{second}"


def _comparisons_table(block: BlockResults) -> Table:
    """Tabulate the comparisons, one row each; a column names the groups if there are several pairs."""
    pairs = list(dict.fromkeys((comparison.first, comparison.second) for comparison in block.comparisons))
    has_roles = _has_roles(block)
    words = ["measure"]
    if has_roles:
        words.append("named before")
    if len(pairs) > 1:
        words.append("groups")
        means = ["means"]
    else:
        means = [f"mean, {group}" for pair in pairs for group in pair]
    rows = [
        _list_comparison_cells(
            comparison,
            role=block.roles[comparison.measure] if has_roles else "",
            has_several_pairs=len(pairs) > 1,
        )
        for comparison in block.comparisons
    ]
    heads = (*words, "n", *means, "difference", "p", "p (Holm)", "smallest p", "g")
    return Table(heads, rows, words=len(words))


def _list_comparison_cells(comparison: GroupComparison, *, role: str, has_several_pairs: bool) -> tuple[str, ...]:
    """Return the cells of a comparison; ``role`` is "" if the table has no column of roles."""
    words = [label_measure(comparison.measure)]
    if role:
        words.append(role)
    means = [format_number(mean) for mean in comparison.means]
    if has_several_pairs:
        words.append(_format_unbroken_pair(comparison.first, comparison.second, is_log=comparison.is_log))
        means = [", ".join(means)]
    return (
        *words,
        f"{comparison.n[0]}, {comparison.n[1]}",
        *means,
        format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log),
        format_p_value(comparison.p),
        format_p_value(comparison.p_holm),
        format_p_value(comparison.smallest_p),
        format_with_interval(comparison.g, comparison.g_interval, 2),
    )


def _build_growth_context(block: BlockResults, mixed: MixedModel | None, *, are_trials: bool) -> dict[str, Any]:
    """Return the template's variables on the growth over a block's episodes or trials."""
    growth = block.growth
    if growth is None:
        return {"growth": None}
    estimates = None
    if mixed is not None and mixed.terms:
        estimates = _mixed_model_table(mixed.terms, are_trials=are_trials)
    return {
        "growth": _growth_table(growth.terms, are_trials=are_trials),
        "growth_measure": growth.measure.capitalize(),
        "growth_reference": growth.reference,
        "growth_left_out": growth.left_out,
        "mixed": estimates,
        "mixed_model": mixed,
    }


def _mixed_model_table(terms: Sequence[GrowthTerm], *, are_trials: bool) -> Table:
    """Tabulate the terms of a mixed model, without Wald intervals and p values.

    In simulations with groups of 2 and 18 people and SDs in a ratio of 3 to 1, these reject a true null hypothesis in a
    third of studies.
    """
    return Table(
        ("term", "estimate"),
        [(_name_growth(term, are_trials=are_trials), format_number(term.estimate)) for term in terms],
    )


def _name_growth(term: GrowthTerm, *, are_trials: bool) -> str:
    """Return the name of a growth term, with trials instead of episodes in a study of trials."""
    return term.name.replace("change an episode", "change a trial") if are_trials else term.name


def _growth_table(terms: Sequence[GrowthTerm], *, are_trials: bool) -> Table:
    """Tabulate the terms of a comparison of growth over episodes or trials."""
    rows = [
        (
            _name_growth(term, are_trials=are_trials),
            str(term.people),
            format_number(term.estimate),
            format_interval(term.interval),
            format_p_value(term.p),
        )
        for term in terms
    ]
    return Table(("term", "participants", "estimate", "95 % interval", "p"), rows)


def _measures_table(block: BlockResults) -> Table:
    """Tabulate the mean and SD of each measure in each group of a block."""
    rows = [
        (label_measure(row["measure"]), row["group"], str(row["n"]), format_mean_sd(row["mean"], row["sd"]))
        for row in to_records(block.measures)
    ]
    return Table(("measure", "group", "n", "mean"), rows, words=2)
