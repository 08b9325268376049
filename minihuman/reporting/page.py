"""The report as one self-contained HTML page, by a Jinja template that a lab can replace or extend.

The published study's subject means stand beside a replication of it: Chevalier-Boisvert et al. (2023), "Minigrid &
Miniworld", mean reward of each subject in Miniworld's four rooms.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Any

import pandas as pd

from minihuman.dataset.recording_quality import RecordingQuality
from minihuman.dataset.selection import SelectionSummary
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.reporting.activity_sections import ReportSection
from minihuman.reporting.interactions import InteractionResults, cells_table, interaction_table, state_interaction
from minihuman.reporting.results import BlockResults, Results, WithinResults, label_measure, summarise_group_rewards
from minihuman.reporting.sections import (
    FlowSection,
    answers_table,
    clauses_table,
    conditions_table,
    crossover_table,
    difference_statement,
    equivalence_statement,
    exclusions_section,
    list_missing_parts,
    paired_statement,
    parts_table,
    power_statement,
    quality_section,
    reliability_table,
    session_changes_table,
    session_table,
    skipped_table,
    survival_table,
)
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
from minihuman.statistics.comparison import GroupComparison
from minihuman.statistics.paired import MIN_EPISODES, GrowthTerm, MixedModel

_PUBLISHED_PROTOCOLS = frozenset(  # SHA-256 of the shipped file, by its fields' present and earlier names
    {
        "d834748978b9d35e1c6da9437a14a607b53b613941fa1c5e2d2cb2cf0a1667f1",
        "9716c6e0934a0bd93fbb2bab1a313816346017f237df1c31c718421c4ee536e2",
    }
)
PUBLISHED_SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld"


def read_published_subjects() -> pd.DataFrame:
    """One row per subject: group, subject, reward_mean."""
    with (files("minihuman.reporting") / "data" / "published.csv").open(encoding="utf-8") as file:
        return pd.read_csv(file)


def is_published_study(protocols: Collection[str]) -> bool:
    """Whether all sessions were played by the published study's own protocol; ``protocols`` are SHA-256 of files."""
    return bool(protocols) and _PUBLISHED_PROTOCOLS.issuperset(protocols)


@dataclass(frozen=True, slots=True)
class PageContent:
    """What the page is made of, besides the results."""

    study: str
    sessions: int
    players: Sequence[str]
    simulated: int  # sessions that no person played
    imported: int  # sessions that a page recorded and nobody witnessed
    windows: Mapping[str, int]  # what they sat at, and how many sessions there
    flow: FlowSection | None  # how many came, left, were screened out and are included
    methods: Sequence[str]
    known_keys: Mapping[str, Sequence[str]]  # block: the groups who came to it with the keys of the one before
    figures: Sequence[ReportFigure]
    first_figures: Sequence[ReportFigure]  # of the result
    models: Sequence[ReportFigure]
    tables: Sequence[Path]
    qualities: Sequence[RecordingQuality]
    answers: pd.DataFrame
    clauses: pd.DataFrame  # asked for and done, by block, verb and group
    activities: Sequence[ReportSection]  # what kinds of activity add
    practice: Mapping[str, int]  # block that is not analysed: episodes that would be included
    exclusions: pd.DataFrame
    account: SelectionSummary
    analysis: AnalysisSpec  # what the protocol named
    design: ExperimentDesign
    interaction: InteractionResults | None  # of groups and conditions, in a mixed design
    first_block: str  # whose comparison of groups is among the answers; "": none's
    papers: bool  # the protocol is the published study's
    mixed: Mapping[str, MixedModel | None]  # of each block whose change over episodes is compared


def build_page(content: PageContent, results: Results, templates: Path | None = None) -> str:
    """Render the page.

    Args:
        facts: what the page shows besides the results.
        found: the results.
        templates: a folder with a ``report.html.j2`` or a ``report.css`` that is taken instead of the package's. Its
            template may extend ``minihuman/report.html.j2``.

    Raises:
        ReportError: if there is no such file in the folder, or the template in it cannot be rendered.
    """
    target = results.target_block
    context = {
        "study": content.study,
        "versions": _versions(content.account),
        "sessions": content.sessions,
        "included": results.included,
        "players": content.players,
        "simulated": content.simulated,
        "imported": content.imported,
        "windows": ", ".join(f"{window} in {count} sessions" for window, count in content.windows.items()),
        "flow": content.flow,
        "practice": content.practice,
        "published": _published(target) if content.papers and target else None,
        "question": ask_question(content.analysis, results, content.design, content.interaction),
        "answers_first": _answer(target if content.first_block else None, results, content),
        "excluded": _count_excluded(content.exclusions),
        "within": _within(results.within),
        "interaction": _interaction(content.interaction),
        "blocks": [_block(block, results, content) for block in results.blocks],
        "min_growth_episodes": MIN_EPISODES,
        "clauses": clauses_table(content.clauses),
        "activities": content.activities,
        "answers": answers_table(content.answers),
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


def ask_question(
    analysis: AnalysisSpec,
    results: Results,
    design: ExperimentDesign | None = None,
    interaction: InteractionResults | None = None,
) -> str:
    """What the study compares, in one sentence, after the protocol's own question."""
    stated = f"{design.question} " if design and design.question else ""
    if analysis.primary_measure:
        measure = label_measure(analysis.primary_measure)
    else:
        measure = "every measure"
    if design and interaction and design.primary_effect == "interaction":
        return (
            f"{stated}Asked: whether differences between conditions {_join(interaction.conditions)} in {measure} "
            f"depend on the group ({_join(interaction.groups)})."
        )
    groups = results.target_block.groups["group"].tolist() if results.target_block else []
    conditions = results.within.conditions if results.within else ()
    parts = []
    if len(groups) > 1:
        parts.append(f"groups {_join(groups)} in block {results.target}")
    if results.within and results.within.label:
        parts.append(f"levels {_join(conditions)} of {results.within.label} within participants")
    elif conditions:
        parts.append(f"blocks {_join(conditions)} within participants")
    if not parts:
        return f"{stated}One group: nothing is compared between groups."
    return f"{stated}Asked: how {', and '.join(parts)} differ in {measure}."


def _join(names: Sequence[str]) -> str:
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]}"
    return names[0]


def _answer(target: BlockResults | None, results: Results, content: PageContent) -> list[str]:
    """The statements that answer it: the primary's, adjusted ones, equivalence, and conditions.

    Where the question is about the interaction, its answer comes first, and conditions pooled over groups are left to
    their table.
    """
    is_about_interaction = content.interaction is not None and content.design.primary_effect == "interaction"
    statements = []
    if target is not None and len(target.groups) > 1:
        statements += [difference_statement(comparison, target.block) for comparison in target.headline]
        statements += [
            f"Adjusted for the covariates. {difference_statement(comparison, target.block)}"
            for comparison in target.adjusted
        ]
        statements += [equivalence_statement(equivalence, target.roles) for equivalence in target.alike]
    if results.within and not is_about_interaction:
        primary = [
            comparison
            for comparison in results.within.comparisons
            if results.within.roles[comparison.measure] == "primary"
        ]
        statements += [paired_statement(comparison) for comparison in primary]
    if content.interaction:
        interaction = list(state_interaction(content.interaction))
    else:
        interaction = []
    if is_about_interaction:
        return [*interaction, *statements]
    return [*statements, *interaction]


def _count_excluded(exclusions: pd.DataFrame) -> str:
    """Who was left out, by reason."""
    people = exclusions[exclusions["level"] == "participant"].drop_duplicates(["exclusion_reason", "participant"])
    counts = people["exclusion_reason"].value_counts(sort=False)
    return ", ".join(f"{count} ({reason})" for reason, count in counts.items()) or "none"


def _within(within: WithinResults | None) -> dict[str, Any] | None:
    if within is None:
        return None
    return {
        "label": within.label,
        "conditions": _join(within.conditions),
        "table": conditions_table(within),
        "effects": crossover_table(within),
    }


def _interaction(interaction: InteractionResults | None) -> dict[str, Table] | None:
    if interaction is None:
        return None
    return {"cells": cells_table(interaction), "table": interaction_table(interaction)}


def build_participants_page(study: str, blocks: pd.DataFrame, results: Results) -> str:
    """Render the page on which every included participant can be found in every measure; it works from disk alone.

    Args:
        study: the study's name.
        blocks: rows of the table "blocks".
        found: the results; their measures, groups and target block are shown.
    """
    included = blocks[blocks["exclusion_reason"].isna()]
    measures = [
        measure
        for measure in dict.fromkeys(name for block in results.blocks for name in block.roles)
        if measure in included
    ]
    rows = [
        {
            **{name: row[name] for name in ("participant", "group", "session", "block")},
            "values": {name: None if pd.isna(row[name]) else float(row[name]) for name in measures},
        }
        for row in to_records(included)
    ]
    data = {
        "rows": rows,
        "groups": list(results.order),
        "blocks": [block.block for block in results.blocks],
        "target": results.target,
        "measures": {name: label_measure(name) for name in measures},
        "short": {name: label_measure(name).partition(" (")[0].partition(":")[0] for name in measures},
    }
    return render_template(PARTICIPANTS, {"study": study, "data": data})


def _versions(account: SelectionSummary) -> str:
    """By which versions of the protocol the sessions were played."""
    versions = [f"{version} in {count} sessions" for (_, version), count in sorted(account.versions.items())]
    if len(versions) == 1:
        return f"Protocol version {versions[0]}"
    return f"{len(versions)} versions of the protocol are pooled here ({'; '.join(versions)}), --version takes one"


def _block(block: BlockResults, results: Results, content: PageContent) -> dict[str, Any]:
    """A block as the template shows it."""
    is_only_group = len(block.groups) == 1 and len(results.order) > 1
    pairs = {(comparison.first, comparison.second) for comparison in block.comparisons}
    return {
        "name": block.block,
        "worlds": block.worlds,
        "episodes": block.episodes,
        "teams": block.teams,
        "is_target": block.block == results.target and len(block.groups) > 1,
        "only_group": str(block.groups["group"].iloc[0]) if is_only_group else "",
        "differences": []
        if block.block == content.first_block and len(block.groups) > 1
        else [difference_statement(comparison, block.block) for comparison in block.headline],
        "has_no_primary": bool(block.comparisons) and "primary" not in block.roles.values(),
        "has_roles": _has_roles(block),
        "measures": _measures(block),
        **_subjects(block),
        "comparisons": _comparisons(block) if block.comparisons else None,
        "only_pair": f" ({_unbroken(*pairs.pop())})" if len(pairs) == 1 else "",
        "not_compared": [
            {
                "measure": label_measure(comparison.measure),
                "why": f"{format_pair(comparison.first, comparison.second)} ({comparison.reason})",
            }
            for comparison in block.comparisons
            if comparison.reason
        ],
        "groups_with_keys": content.known_keys.get(block.block, ()) if block.comparisons else (),
        "set_aside": [f"{label_measure(name)} ({reason})" for name, reason in block.set_aside.items()],
        "without_goal": block.waits.without_goal,
        "several_sessions": block.by_session["session"].nunique() > 1,
        "sessions": session_table(block),
        "session_changes": session_changes_table(block),
        "survival": survival_table(block.waits),
        "parts": parts_table(block.parts),
        "parts_missing": list_missing_parts(block.parts),
        **_growth(block, content.mixed.get(block.block)),
        "reliability": reliability_table(block.reliabilities),
        "powers": [power_statement(power) for power in block.powers],
    }


def _published(block: BlockResults) -> dict[str, Any]:
    """Set the published study's subjects beside this one's."""
    frame = read_published_subjects()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in to_records(frame)]
    means = summarise_group_rewards(frame)
    rows += [(row["group"], "all", format_mean_sd(row["reward_mean"], row["reward_sd"])) for row in to_records(means)]
    return {
        "source": PUBLISHED_SOURCE,
        "table": Table(("group", "subject", "reward"), rows, words=2),
        "statements": [difference_statement(e, block.block) for e in block.comparisons if e.measure == "reward_mean"],
        "block": {"name": block.block, **_subjects(block)},
    }


def _subjects(block: BlockResults) -> dict[str, Table]:
    """Each subject's reward, by session where there are several, and the groups' over subjects' means."""
    has_several_sessions = block.subjects["session"].nunique() > 1
    heads = ("group", "subject", *(("session",) if has_several_sessions else ()), "n", "reward")

    def table(frame: pd.DataFrame, n: str) -> Table:
        rows = [
            (
                row["group"], row.get("participant", "all"), *((str(row.get("session", "all")),) if has_several_sessions else ()),
                str(row[n]), format_mean_sd(row["reward_mean"], row["reward_sd"]),
            )
            for row in to_records(frame)
        ]  # fmt: skip
        return Table(heads, rows, words=len(heads) - 2)

    return {"subjects": table(block.subjects, "episodes"), "subject_means": table(block.groups, "participants")}


def _has_roles(block: BlockResults) -> bool:
    return set(block.roles.values()) != {"exploratory"}


def _unbroken(first: str, second: str) -> str:
    """A difference of two groups that no line break divides."""
    return f"{first}\N{NO-BREAK SPACE}\N{MINUS SIGN}\N{NO-BREAK SPACE}{second}"


def _comparisons(block: BlockResults) -> Table:
    """A row per comparison; of several pairs of groups a column says which."""
    pairs = dict.fromkeys((comparison.first, comparison.second) for comparison in block.comparisons)
    has_several_pairs = len(pairs) > 1
    has_roles = _has_roles(block)

    def row(comparison: GroupComparison) -> tuple[str, ...]:
        return (
            label_measure(comparison.measure), *((block.roles[comparison.measure],) if has_roles else ()),
            *((_unbroken(comparison.first, comparison.second),) if has_several_pairs else ()), f"{comparison.n[0]}, {comparison.n[1]}",
            *((", ".join(map(format_number, comparison.means[:2])),) if has_several_pairs else map(format_number, comparison.means)),
            format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log),
            format_p_value(comparison.p), format_p_value(comparison.p_holm), format_p_value(comparison.smallest_p),
            format_with_interval(comparison.g, comparison.g_interval, 2),
        )  # fmt: skip

    heads = (
        *("measure", *(("named before",) if has_roles else ()), *(("groups",) if has_several_pairs else ()), "n"),
        *(("means",) if has_several_pairs else (f"mean, {group}" for pair in pairs for group in pair)),
        *("difference", "p", "p (Holm)", "smallest p", "g"),
    )
    return Table(heads, [row(comparison) for comparison in block.comparisons], words=1 + has_roles + has_several_pairs)


def _growth(block: BlockResults, mixed: MixedModel | None) -> dict[str, Any]:
    growth = block.growth
    if growth is None:
        return {"growth": None}
    return {
        "growth": _terms(growth.terms),
        "growth_measure": growth.measure.capitalize(),
        "growth_reference": growth.reference,
        "growth_left_out": growth.left_out,
        "mixed": _estimates(mixed.terms) if mixed and mixed.terms else None,
        "mixed_model": mixed,
    }


def _estimates(terms: Sequence[GrowthTerm]) -> Table:
    """The terms of a mixed model, without its Wald intervals and p.

    Of 2 and 18 people with SDs 3 to 1 they reject a true null in a third of studies.
    """
    return Table(("term", "estimate"), [(term.name, format_number(term.estimate)) for term in terms])


def _terms(terms: Sequence[GrowthTerm]) -> Table:
    rows = [
        (
            term.name, str(term.people), format_number(term.estimate), format_interval(term.interval),
            format_p_value(term.p),
        )
        for term in terms
    ]  # fmt: skip
    return Table(("term", "participants", "estimate", "95 % interval", "p"), rows)


def _measures(block: BlockResults) -> Table:
    rows = [
        (label_measure(row["measure"]), row["group"], str(row["n"]), format_mean_sd(row["mean"], row["sd"]))
        for row in to_records(block.measures)
    ]
    return Table(("measure", "group", "n", "mean"), rows, words=2)
