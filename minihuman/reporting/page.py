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


def build_page(facts: PageContent, found: Results, templates: Path | None = None) -> str:
    """Render the page.

    Args:
        facts: what the page shows besides the results.
        found: the results.
        templates: a folder with a ``report.html.j2`` or a ``report.css`` that is taken instead of the package's. Its
            template may extend ``minihuman/report.html.j2``.

    Raises:
        ReportError: if there is no such file in the folder, or the template in it cannot be rendered.
    """
    target = found.target_block
    shown = {
        "study": facts.study,
        "versions": _versions(facts.account),
        "sessions": facts.sessions,
        "included": found.kept,
        "players": facts.players,
        "simulated": facts.simulated,
        "imported": facts.imported,
        "windows": ", ".join(f"{window} in {count} sessions" for window, count in facts.windows.items()),
        "flow": facts.flow,
        "practice": facts.practice,
        "published": _published(target) if facts.papers and target else None,
        "question": ask_question(facts.analysis, found, facts.design, facts.interaction),
        "answers_first": _answer(target if facts.first_block else None, found, facts),
        "excluded": _count_excluded(facts.exclusions),
        "within": _within(found.within),
        "interaction": _interaction(facts.interaction),
        "blocks": [_block(one, found, facts) for one in found.blocks],
        "min_growth_episodes": MIN_EPISODES,
        "clauses": clauses_table(facts.clauses),
        "activities": facts.activities,
        "answers": answers_table(facts.answers),
        "figures": facts.figures,
        "first_figures": facts.first_figures,
        "models": facts.models,
        "quality": quality_section(facts.qualities),
        "exclusions": exclusions_section(facts.exclusions),
        "skipped": skipped_table(facts.account.skipped),
        "methods": facts.methods,
        "tables": facts.tables,
    }
    return render_template(REPORT, shown, templates)


def ask_question(
    analysis: AnalysisSpec,
    found: Results,
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
    groups = found.target_block.groups["group"].tolist() if found.target_block else []
    conditions = found.within.conditions if found.within else ()
    parts = []
    if len(groups) > 1:
        parts.append(f"groups {_join(groups)} in block {found.target}")
    if found.within and found.within.label:
        parts.append(f"levels {_join(conditions)} of {found.within.label} within participants")
    elif conditions:
        parts.append(f"blocks {_join(conditions)} within participants")
    if not parts:
        return f"{stated}One group: nothing is compared between groups."
    return f"{stated}Asked: how {', and '.join(parts)} differ in {measure}."


def _join(names: Sequence[str]) -> str:
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]}"
    return names[0]


def _answer(target: BlockResults | None, found: Results, facts: PageContent) -> list[str]:
    """The statements that answer it: the primary's, adjusted ones, equivalence, and conditions.

    Where the question is about the interaction, its answer comes first, and conditions pooled over groups are left to
    their table.
    """
    is_about_interaction = facts.interaction is not None and facts.design.primary_effect == "interaction"
    said = []
    if target is not None and len(target.groups) > 1:
        said += [difference_statement(each, target.block) for each in target.headline]
        said += [f"Adjusted for the covariates. {difference_statement(each, target.block)}" for each in target.adjusted]
        said += [equivalence_statement(each, target.roles) for each in target.alike]
    if found.within and not is_about_interaction:
        primary = [one for one in found.within.comparisons if found.within.roles[one.measure] == "primary"]
        said += [paired_statement(one) for one in primary]
    if facts.interaction:
        interaction = list(state_interaction(facts.interaction))
    else:
        interaction = []
    if is_about_interaction:
        return [*interaction, *said]
    return [*said, *interaction]


def _count_excluded(exclusions: pd.DataFrame) -> str:
    """Who was left out, by reason."""
    people = exclusions[exclusions["level"] == "participant"].drop_duplicates(["exclusion_reason", "participant"])
    counts = people["exclusion_reason"].value_counts(sort=False)
    return ", ".join(f"{count} ({reason})" for reason, count in counts.items()) or "none"


def _within(found: WithinResults | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "label": found.label,
        "conditions": _join(found.conditions),
        "table": conditions_table(found),
        "effects": crossover_table(found),
    }


def _interaction(found: InteractionResults | None) -> dict[str, Table] | None:
    if found is None:
        return None
    return {"cells": cells_table(found), "table": interaction_table(found)}


def build_participants_page(study: str, blocks: pd.DataFrame, found: Results) -> str:
    """Render the page on which every included participant can be found in every measure; it works from disk alone.

    Args:
        study: the study's name.
        blocks: rows of the table "blocks".
        found: the results; their measures, groups and target block are shown.
    """
    included = blocks[blocks["exclusion_reason"].isna()]
    measures = [one for one in dict.fromkeys(name for block in found.blocks for name in block.roles) if one in included]
    rows = [
        {
            **{name: row[name] for name in ("participant", "group", "session", "block")},
            "values": {name: None if pd.isna(row[name]) else float(row[name]) for name in measures},
        }
        for row in to_records(included)
    ]
    data = {
        "rows": rows,
        "groups": list(found.order),
        "blocks": [one.block for one in found.blocks],
        "target": found.target,
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


def _block(one: BlockResults, found: Results, facts: PageContent) -> dict[str, Any]:
    """A block as the template shows it."""
    alone = len(one.groups) == 1 and len(found.order) > 1
    pairs = {(each.first, each.second) for each in one.comparisons}
    return {
        "name": one.block,
        "worlds": one.worlds,
        "episodes": one.episodes,
        "teams": one.teams,
        "is_target": one.block == found.target and len(one.groups) > 1,
        "only_group": str(one.groups["group"].iloc[0]) if alone else "",
        "differences": []
        if one.block == facts.first_block and len(one.groups) > 1
        else [difference_statement(each, one.block) for each in one.headline],
        "has_no_primary": bool(one.comparisons) and "primary" not in one.roles.values(),
        "has_roles": _has_roles(one),
        "measures": _measures(one),
        **_subjects(one),
        "comparisons": _comparisons(one) if one.comparisons else None,
        "only_pair": f" ({_unbroken(*pairs.pop())})" if len(pairs) == 1 else "",
        "not_compared": [
            {"measure": label_measure(each.measure), "why": f"{format_pair(each.first, each.second)} ({each.reason})"}
            for each in one.comparisons
            if each.reason
        ],
        "groups_with_keys": facts.known_keys.get(one.block, ()) if one.comparisons else (),
        "set_aside": [f"{label_measure(name)} ({reason})" for name, reason in one.set_aside.items()],
        "without_goal": one.waits.without_goal,
        "several_sessions": one.by_session["session"].nunique() > 1,
        "sessions": session_table(one),
        "session_changes": session_changes_table(one),
        "survival": survival_table(one.waits),
        "parts": parts_table(one.parts),
        "parts_missing": list_missing_parts(one.parts),
        **_growth(one, facts.mixed.get(one.block)),
        "reliability": reliability_table(one.reliabilities),
        "powers": [power_statement(each) for each in one.powers],
    }


def _published(one: BlockResults) -> dict[str, Any]:
    """Set the published study's subjects beside this one's."""
    frame = read_published_subjects()
    rows = [(row["group"], str(row["subject"]), f"{row['reward_mean']:.2f}") for row in to_records(frame)]
    means = summarise_group_rewards(frame)
    rows += [(row["group"], "all", format_mean_sd(row["reward_mean"], row["reward_sd"])) for row in to_records(means)]
    return {
        "source": PUBLISHED_SOURCE,
        "table": Table(("group", "subject", "reward"), rows, words=2),
        "statements": [difference_statement(e, one.block) for e in one.comparisons if e.measure == "reward_mean"],
        "block": {"name": one.block, **_subjects(one)},
    }


def _subjects(one: BlockResults) -> dict[str, Table]:
    """Each subject's reward, by session where there are several, and the groups' over subjects' means."""
    several = one.subjects["session"].nunique() > 1
    heads = ("group", "subject", *(("session",) if several else ()), "n", "reward")

    def table(frame: pd.DataFrame, n: str) -> Table:
        rows = [
            (
                row["group"], row.get("participant", "all"), *((str(row.get("session", "all")),) if several else ()),
                str(row[n]), format_mean_sd(row["reward_mean"], row["reward_sd"]),
            )
            for row in to_records(frame)
        ]  # fmt: skip
        return Table(heads, rows, words=len(heads) - 2)

    return {"subjects": table(one.subjects, "episodes"), "subject_means": table(one.groups, "participants")}


def _has_roles(one: BlockResults) -> bool:
    return set(one.roles.values()) != {"exploratory"}


def _unbroken(first: str, second: str) -> str:
    """A difference of two groups that no line break divides."""
    return f"{first}\N{NO-BREAK SPACE}\N{MINUS SIGN}\N{NO-BREAK SPACE}{second}"


def _comparisons(one: BlockResults) -> Table:
    """A row per comparison; of several pairs of groups a column says which."""
    pairs = dict.fromkeys((each.first, each.second) for each in one.comparisons)
    several = len(pairs) > 1
    named = _has_roles(one)

    def row(each: GroupComparison) -> tuple[str, ...]:
        return (
            label_measure(each.measure), *((one.roles[each.measure],) if named else ()),
            *((_unbroken(each.first, each.second),) if several else ()), f"{each.n[0]}, {each.n[1]}",
            *((", ".join(map(format_number, each.means[:2])),) if several else map(format_number, each.means)),
            format_difference(each.difference, each.interval, is_log=each.is_log),
            format_p_value(each.p), format_p_value(each.p_holm), format_p_value(each.smallest_p),
            format_with_interval(each.g, each.g_interval, 2),
        )  # fmt: skip

    heads = (
        *("measure", *(("named before",) if named else ()), *(("groups",) if several else ()), "n"),
        *(("means",) if several else (f"mean, {group}" for pair in pairs for group in pair)),
        *("difference", "p", "p (Holm)", "smallest p", "g"),
    )
    return Table(heads, [row(each) for each in one.comparisons], words=1 + named + several)


def _growth(one: BlockResults, mixed: MixedModel | None) -> dict[str, Any]:
    found = one.growth
    if found is None:
        return {"growth": None}
    return {
        "growth": _terms(found.terms),
        "growth_measure": found.measure.capitalize(),
        "growth_reference": found.reference,
        "growth_left_out": found.left_out,
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


def _measures(one: BlockResults) -> Table:
    rows = [
        (label_measure(row["measure"]), row["group"], str(row["n"]), format_mean_sd(row["mean"], row["sd"]))
        for row in to_records(one.measures)
    ]
    return Table(("measure", "group", "n", "mean"), rows, words=2)
