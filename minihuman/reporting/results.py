"""Results of a study, block by block, with exclusions. From the tables, not the logs.

Group comparisons, survival times until all keys were found and until the goal, the two-part comparison of rewards
that are 0 after a timeout, growth, equivalence and power.
"""

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, get_args

import msgspec
import numpy as np
import pandas as pd

from minihuman.activities.trials.trial_measures import MEASURES as TRIAL_MEASURES
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.reporting.study_measures import find_measure
from minihuman.statistics.comparison import (
    Equivalence,
    GroupComparison,
    PowerAnalysis,
    adjust_groups,
    check_equivalence,
    compare_groups,
    compare_pair,
    compute_power,
    correct_comparisons,
    find_units,
    name_units,
)
from minihuman.statistics.paired import (
    CrossoverTerm,
    GrowthComparison,
    PairedComparison,
    compare_conditions,
    compare_growth,
    fit_crossover,
    paired_test,
)
from minihuman.statistics.reliability import Reliability, estimate_reliability
from minihuman.statistics.survival import SurvivalComparison, SurvivalTimes, compare_survival
from minihuman.statistics.two_part_model import TwoPartComparison, compare_two_parts, has_mass_at_zero


@dataclass(frozen=True, slots=True, eq=False)
class BlockSurvival:
    """The survival times of one block by group; empty where there was nothing to wait for."""

    keys: Mapping[str, SurvivalTimes]  # playing seconds until every key was found, one per participant
    goal: Mapping[str, SurvivalTimes]  # steps until the goal, one per episode: a participant's are not independent
    compared: tuple[tuple[str, str, SurvivalComparison], ...]  # of keys: which groups, and how

    @property
    def without_goal(self) -> list[str]:
        """By group, how many episodes did not reach the goal; nothing where all did."""
        missed = {group: int((~times.observed).sum()) for group, times in self.goal.items()}
        return [
            f"{group} {missed[group]} of {len(times.observed)}"
            for group, times in self.goal.items()
            if any(missed.values())
        ]


def collect_survival_times(rows: pd.DataFrame, all_episodes: pd.DataFrame, order: Sequence[str]) -> BlockSurvival:
    """Collect them from a block's rows of the block table and all of its episodes; the goal's from those included.

    A participant who never found every key was watched for all of the block's playing time. An episode that failed will
    not reach the goal any more: it waits to its step limit, as one that timed out; it is not censored before.
    """
    episodes = all_episodes[all_episodes["exclusion_reason"].isna()]
    played = all_episodes.groupby(["participant", "session"])["playing_s"].sum()
    keys: dict[str, SurvivalTimes] = {}
    goal: dict[str, SurvivalTimes] = {}
    for group in order:
        group_rows = rows[(rows["group"] == group) & (rows["keys_total"] > 0)]
        first = group_rows.sort_values("session").drop_duplicates("participant")
        first_sessions = pd.MultiIndex.from_frame(first[["participant", "session"]])
        watched = played.reindex(first_sessions).fillna(0.0).to_numpy(float)
        discovered_s = first["all_keys_discovered_s"].to_numpy(float)
        if len(first):
            keys[group] = SurvivalTimes(
                np.where(np.isnan(discovered_s), watched, discovered_s), ~np.isnan(discovered_s)
            )
        known = episodes["success"].notna()
        part = episodes[(episodes["group"] == group) & (episodes["steps"] > 0) & known]
        if len(part):
            waiting_steps = part["steps"].where(part["outcome"] != "failure", part["max_steps"])
            goal[group] = SurvivalTimes(waiting_steps.to_numpy(float), part["success"].to_numpy(bool))
    pairs = ((a, b, compare_survival(keys[a], keys[b])) for a, b in combinations(keys, 2))
    return BlockSurvival(keys, goal, tuple((a, b, comparison) for a, b, comparison in pairs if comparison is not None))


def compare_reward_parts(episodes: pd.DataFrame, order: Sequence[str]) -> tuple[TwoPartComparison, ...]:
    """Every two groups compared in both parts of the reward; none where it has no mass at 0."""
    if episodes["success"].isna().all() or not has_mass_at_zero(episodes["reward"].to_numpy(np.float64)):
        return ()
    return tuple(compare_two_parts(episodes, "reward", pair) for pair in combinations(order, 2))


MEASURES = {  # columns of the block table that groups are compared on, and what they are called
    "log_excess_steps_mean": "log of the excess steps over the shortest path (without the goal: at the limit)",
    "spl_mean": "SPL: success weighted by path length",
    "success": "success (share of episodes)",
    "reward_mean": "reward",
    "steps_at_limit_mean": "steps (without the goal: at the limit)",
    "reward_first": "reward of the first episode",
    "reward_slope": "learning: change of reward from one episode to the next, over the first five",
    "excess_steps_mean": "excess steps over the shortest path (successes only)",
    "playing_s_mean": "playing time per episode (s)",
    "response_median_ms": "reaction time, median (ms)",
    "path_efficiency_mean": "path efficiency (straight distance over ground covered)",
    "ineffective_share": "share of ineffective steps",
    "all_keys_discovered_s": "time until all keys were discovered (s)",
    "log_steps_ratio_mean": "log of steps / shortest path (without the goal: at the limit)",
    "reaction_median_ms": "key press after the latest picture, median (ms)",
}
# Times are compared on their logarithms: what slows people down multiplies them, and a mean of raw seconds of a skewed
# group against a less skewed one rejects a true null in 16 % of studies.
LOG_MEASURES = ("playing_s_mean", "response_median_ms", "all_keys_discovered_s", "reaction_median_ms")
# Compared only where the protocol names them: they repeat another measure, at a cost in Holm's correction.
ONLY_IF_NAMED = frozenset({"log_steps_ratio_mean", "reaction_median_ms"})
TRIAL_BLOCK_MEASURES = ("reward_mean", "response_median_ms")  # of MEASURES, those that a block of trials has
FORMULAS = {  # of one episode, where a measure's name does not tell it
    "log_excess_steps_mean": "ln(1 + steps - shortest), shortest: steps of the shortest known path",
    "log_steps_ratio_mean": "ln(steps / shortest)",
    "spl_mean": "shortest / steps with the goal, 0 without",
    "reward_mean": "the world's own, summed over the episode",
    "reward_slope": "slope of a straight line",
    "excess_steps_mean": "steps - shortest",
    "response_median_ms": "key press minus stimulus onset: the flip of the latest picture; in real time, of the "
    "onset that the world or the block names",
    "reaction_median_ms": "key press minus the flip of the latest picture, in real time of a tick's",
    "ineffective_share": "steps without a visible effect",
}


def label_measure(name: str) -> str:
    """What a measure is called on the page."""
    return MEASURES.get(name) or find_measure(name).label


_LOG_EXCESS = "log of the excess steps over the shortest path"

Role = Literal["primary", "secondary", "exploratory"]  # named in the protocol or not


@dataclass(frozen=True, slots=True)
class EquivalenceResult:
    """The equivalence test of two groups."""

    first: str
    second: str
    test: Equivalence


@dataclass(frozen=True, slots=True)
class SessionChange:
    """A group's change of a measure from one session to another, over the participants who have it in both."""

    measure: str
    group: str
    sessions: tuple[int, int]
    n: int
    estimate: float  # the later session's mean minus the first's
    interval: tuple[float, float]  # 95 %, of the same sign flips as p; NaN where too few participants have both
    p: float  # paired permutation test
    is_log: bool = False  # the change is one of natural logarithms


@dataclass(frozen=True, slots=True, eq=False)
class BlockResults:
    """The results of one block, for the groups that played it."""

    block: str
    worlds: tuple[str, ...]
    episodes: int  # included
    subjects: pd.DataFrame  # group, participant, session, episodes, reward_mean, reward_sd
    groups: pd.DataFrame  # group, participants, then mean and standard deviation of the subjects' means
    measures: pd.DataFrame  # measure, group, n, mean, sd; of measures that have a value in this block
    by_session: pd.DataFrame  # measure, group, session, n, mean, sd; the same, each session by itself
    changes: tuple[SessionChange, ...]  # from the block's first session to each later one
    changes_compared: tuple[tuple[tuple[int, int], GroupComparison], ...]  # which sessions, and groups on their change
    comparisons: tuple[GroupComparison, ...]  # the primary measure first, then the secondary ones
    roles: Mapping[str, Role]  # of each measure that is compared
    adjusted: tuple[GroupComparison, ...]  # of the primary measure, for the covariates that the protocol names
    set_aside: Mapping[str, str]  # measures that are not compared since they omit those who failed, and why
    alike: tuple[EquivalenceResult, ...]  # of the primary measure, where the protocol gives a margin
    waits: BlockSurvival  # until every key was found, and until the goal
    parts: tuple[TwoPartComparison, ...]  # of the reward, where it has mass at 0
    growth: GrowthComparison | None  # of the excess steps, or of the reward, over the block's episodes
    reliabilities: tuple[Reliability, ...]  # of the measures that an episode has a value of; none of teams
    powers: tuple[PowerAnalysis, ...]  # one for each pair of groups, in the order of the headline
    teams: int = 0  # of several people, each of which is one unit of the statistics; 0: participants are

    @property
    def headline(self) -> tuple[GroupComparison, ...]:
        """The comparisons on the primary measure, or on the first of ``MEASURES`` that has values."""
        measure = next(
            (comparison.measure for comparison in self.comparisons if self.roles[comparison.measure] == "primary"), None
        )
        chosen = measure or next((name for name in self.roles), None)
        return tuple(comparison for comparison in self.comparisons if comparison.measure == chosen)


@dataclass(frozen=True, slots=True, eq=False)
class WithinResults:
    """Blocks compared with each other within participants, a value per participant and block."""

    conditions: tuple[str, ...]
    comparisons: tuple[PairedComparison, ...]
    effects: tuple[CrossoverTerm, ...]  # of order, where it differs between participants
    roles: Mapping[str, Role]
    label: str = ""  # of trials, whose levels the conditions are; "" where they are blocks


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A study's results, block by block in the order of play."""

    blocks: tuple[BlockResults, ...]
    target: str  # the last block that all groups played; "" without any
    order: tuple[str, ...]  # of the groups, in every comparison and figure
    within: "WithinResults | None"  # the conditions that the protocol compares within participants
    included: tuple[int, int]  # participants and episodes included

    @property
    def target_block(self) -> BlockResults | None:
        """The block that all groups are compared on."""
        return next((block for block in self.blocks if block.block == self.target), None)


def compute_results(
    episodes: pd.DataFrame,
    blocks: pd.DataFrame,
    participants: pd.DataFrame,
    analysis: AnalysisSpec | None = None,
    teams: pd.DataFrame | None = None,
    trial_levels: pd.DataFrame | None = None,
    design: ExperimentDesign | None = None,
) -> Results:
    """Compute the results from three tables; ``analysis`` is what the protocol names, ``teams`` the table of teams.

    ``trial_levels`` are the measures of trials by the levels of their labels. ``design`` says which blocks are one
    condition; without it each block is its own.
    """
    if teams is None:
        units = {}
    else:
        units = {str(name): find_units(rows) for name, rows in teams.groupby("block")}
    analysis = analysis or AnalysisSpec()
    included_people = participants[participants["exclusion_reason"].isna()]
    included_episodes = episodes[episodes["exclusion_reason"].isna()]
    included_blocks = blocks[blocks["exclusion_reason"].isna()]
    counts = blocks.groupby("group")["block"].nunique()  # more blocks first: a transfer effect is of what came before
    order = sorted((str(group) for group in counts.index), key=lambda group: (-int(counts[group]), group))
    target = analysis.block or find_target_block(included_blocks)
    return Results(
        blocks=tuple(
            compute_block_results(
                name,
                included_blocks[included_blocks["block"] == name],
                episodes[episodes["block"] == name],
                order,
                analysis if name == target else AnalysisSpec(),
                units.get(name, {}),
            )
            for name in sort_blocks_by_play(included_blocks)
        ),
        target=target,
        order=tuple(order),
        within=compare_labels(included_episodes, analysis, trial_levels)
        if analysis.condition_label
        else compare_within(
            *name_conditions(unite_teams(included_blocks, teams), analysis, design or ExperimentDesign())
        ),
        included=(included_people["participant"].nunique(), len(included_episodes)),
    )


def unite_teams(rows: pd.DataFrame, teams: pd.DataFrame | None) -> pd.DataFrame:
    """The rows, of blocks that people played together with the team in the place of its members."""
    if teams is None or teams.empty:
        return rows
    parts = [
        name_units(part, find_units(teams[teams["block"] == block]))
        for block, part in rows.groupby("block", sort=False)
    ]
    return pd.concat(parts).loc[rows.index]


def name_conditions(
    rows: pd.DataFrame, analysis: AnalysisSpec, design: ExperimentDesign
) -> tuple[pd.DataFrame, AnalysisSpec]:
    """Put each block's condition in the place of the block, in the rows and in the analysis."""
    if not design.conditions:
        return rows, analysis
    named = rows.assign(block=rows["block"].replace(dict(design.condition_of_block)))
    return named, msgspec.structs.replace(analysis, conditions=design.conditions)


def compare_within(rows: pd.DataFrame, analysis: AnalysisSpec) -> WithinResults | None:
    """Compare the protocol's conditions within participants; None where it names none.

    Measures are the primary and the secondary ones, each role corrected by itself (Holm), or else all that have values.
    A participant's value of a condition is the mean over sessions. Effects of position and carry-over are tested in the
    order of the first session.
    """
    if not analysis.conditions:
        return None
    rows = rows.reset_index(drop=True)
    place = rows.groupby(["participant", "session"], sort=False).cumcount()
    condition_rows = rows.assign(place=place)[rows["block"].isin(analysis.conditions)]
    named = [name for name in (analysis.primary_measure, *analysis.secondary_measures) if name]
    measured = [name for name in named or list_default_measures(condition_rows) if condition_rows[name].notna().any()]
    scaled, logs = take_logarithms(condition_rows, measured)
    roles = assign_roles(measured, analysis)
    tables = {
        name: scaled.pivot_table(name, "participant", "block").reindex(columns=list(analysis.conditions))
        for name in measured
    }
    comparisons = tuple(
        comparison
        for role in get_args(Role)
        for comparison in compare_conditions(
            {name: tables[name] for name in roles if roles[name] == role}, log_measures=logs
        )
    )
    first = scaled.sort_values(["session", "place"]).drop_duplicates(["participant", "block"]).sort_values("place")
    order = first.groupby("participant", sort=False)
    first = first.assign(position=order.cumcount() + 1, before=order["block"].shift().fillna(""))
    effects: tuple[CrossoverTerm, ...] = ()
    if first.groupby("block")["position"].nunique().max() > 1:
        effects = tuple(
            term
            for name in measured
            for term in fit_crossover(name, first.rename(columns={"block": "condition", name: "value"}))
        )
    return WithinResults(analysis.conditions, comparisons, effects, roles)


def leave_out_navigation(
    episodes: pd.DataFrame, blocks: pd.DataFrame, trial_blocks: Collection[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Take from blocks of trials what describes ways to a goal; the section on trials has their accuracy and times."""
    if not trial_blocks:
        return episodes, blocks
    is_trial = episodes["block"].isin(trial_blocks)
    empty = [name for name in ("success", "playing_s", "log_excess_steps", "spl") if name in episodes]
    episodes = episodes.astype(dict.fromkeys(empty, object))
    episodes.loc[is_trial, empty] = None
    is_trial = blocks["block"].isin(trial_blocks)
    dropped = [name for name in MEASURES if name not in TRIAL_BLOCK_MEASURES]
    blocks = blocks.astype(dict.fromkeys(dropped, np.float64))
    blocks.loc[is_trial, dropped] = np.nan
    blocks.loc[is_trial, "keys_total"] = 0
    return episodes, blocks


def compare_labels(
    episodes: pd.DataFrame, analysis: AnalysisSpec, trial_levels: pd.DataFrame | None = None
) -> WithinResults | None:
    """Compare the levels of a label of trials within participants, over the included trials that have it.

    A participant's value of a level is the mean over its trials; of response times the median over trials; of a
    measure of trials what the section on trials has, the mean over blocks.

    Args:
        episodes: the included ones.
        analysis: names the label, and the measures.
        trial_levels: a row per participant, session, block, label and level, with the measures of trials.
    """
    label = analysis.condition_label
    levels = read_label(episodes, label)
    rows = episodes.assign(block=levels)[levels != ""]
    if rows.empty:
        return None
    keys = ["participant", "session", "block"]
    rows = rows.assign(success=pd.to_numeric(rows["success"]))
    values = rows.groupby(keys, sort=False).agg(
        success=("success", "mean"), reward_mean=("reward", "mean"), response_median_ms=("response_median_ms", "median")
    )
    measured = values.reindex(columns=list(MEASURES)).reset_index()
    if trial_levels is not None:
        of_label = trial_levels[trial_levels["label"].eq(label)].drop(columns=["block"])
        named = {name: f"trials:{name}" for name in TRIAL_MEASURES}
        means = of_label.rename(columns={"level": "block", **named}).groupby(keys)[list(named.values())].mean()
        measured = measured.merge(means.reset_index(), on=keys, how="left")
    conditions = tuple(sorted(measured["block"].unique()))
    of_levels = AnalysisSpec(
        primary_measure=analysis.primary_measure if analysis.primary_measure in measured else "",
        secondary_measures=tuple(name for name in analysis.secondary_measures if name in measured),
        conditions=conditions,
    )
    within = compare_within(measured, of_levels) if len(conditions) > 1 else None
    # levels alternate: they have no position
    if within:
        return replace(within, effects=(), label=label)
    return None


def read_label(episodes: pd.DataFrame, label: str) -> "pd.Series[str]":
    """Read the level of a label that each episode has, as a text; "" where it has none."""
    return episodes["labels"].map(lambda text: str(json.loads(text or "{}").get(label, "")), na_action=None)


def list_default_measures(rows: pd.DataFrame) -> list[str]:
    """The measures that are compared where the protocol names none: those that have values."""
    return [name for name in MEASURES if name not in ONLY_IF_NAMED and rows[name].notna().any()]


def compute_block_results(
    block: str,
    rows: pd.DataFrame,
    all_episodes: pd.DataFrame,
    order: list[str],
    analysis: AnalysisSpec,
    units: Mapping[str, str] | None = None,
) -> BlockResults:
    """Compute one block's results from its included rows of the block table and all of its episodes.

    Where people played together, ``units`` names each one's team, which is then the unit of every statistic.
    """
    units = units or {}
    waits = collect_survival_times(rows, all_episodes, [group for group in order if (rows["group"] == group).any()])
    people = rows.sort_values(["participant", "session"])
    rows, all_episodes = (name_units(part, units) for part in (rows, all_episodes)) if units else (rows, all_episodes)
    episodes = all_episodes[all_episodes["exclusion_reason"].isna()]
    order = [group for group in order if (rows["group"] == group).any()]
    rows = _groups_in(order, rows.sort_values(["participant", "session"]))
    aside = {
        name: why
        for name, why in set_measures_aside(rows, late=int(episodes["success"].eq(False).sum())).items()
        if name not in (analysis.primary_measure, *analysis.secondary_measures)
    }
    unasked = ONLY_IF_NAMED - {analysis.primary_measure, *analysis.secondary_measures}
    named = (analysis.primary_measure, *analysis.secondary_measures)
    columns = list(dict.fromkeys([*MEASURES, *filter(None, named), *analysis.covariates]))
    measured = [
        name
        for name in columns
        if rows[name].notna().any()
        and name not in aside
        and name not in unasked
        and (name in MEASURES or name in named)
    ]
    participant_means = (
        rows.groupby(["group", "participant"])[columns].mean().reset_index()
    )  # several sessions: their mean
    roles = assign_roles(measured, analysis)
    scaled, logs = take_logarithms(rows, measured)
    scaled_means = scaled.groupby(["group", "participant"])[columns].mean().reset_index()
    comparisons = compare_measures(scaled_means, roles, order, logs)
    changed = list_changes(scaled, measured)
    has_excess = "log_excess_steps" in episodes and episodes["log_excess_steps"].notna().any()
    if has_excess:
        lines = episodes.rename(columns={"log_excess_steps": _LOG_EXCESS})
    else:
        lines = episodes
    results = BlockResults(
        block=block,
        worlds=tuple(dict.fromkeys(episodes["world"])),
        episodes=len(episodes),
        subjects=_groups_in(order, people)[
            ["group", "participant", "session", "episodes", "reward_mean", "reward_sd"]
        ].reset_index(drop=True),
        groups=_groups_in(order, summarise_group_rewards(participant_means)),
        measures=_measures(_groups_in(order, participant_means), measured, ["group"]),
        by_session=_measures(_groups_in(order, rows), measured, ["group", "session"]),
        changes=tuple(
            session_change
            for sessions, change in changed.items()
            for session_change in _estimate(change, measured, sessions, order, logs)
        ),
        changes_compared=tuple(
            (sessions, comparison)
            for sessions, change in changed.items()
            for comparison in compare_measures(change, roles, order, logs)
        ),
        comparisons=comparisons,
        roles=roles,
        adjusted=compare_adjusted(scaled_means, analysis, order, logs),
        alike=_alike(participant_means, analysis, order),
        waits=replace(waits, compared=()) if units else waits,
        parts=compare_reward_parts(episodes, order),
        set_aside=aside,
        growth=compare_growth(lines, _LOG_EXCESS if has_excess else "reward", order=order),
        reliabilities=() if units else tuple(estimate_reliabilities(episodes, measured)),
        powers=(),
        teams=len({*units.values()} & {*rows["participant"]}),
    )
    return replace(results, powers=tuple(compute_power(comparison.n) for comparison in results.headline))


def estimate_reliabilities(episodes: pd.DataFrame, measures: Sequence[str]) -> Iterator[Reliability]:
    """The reliability of each measure that an episode has a value of; of times, of their logarithms."""
    episodes = episodes.sort_values("session", kind="stable")  # rows of a session are in the order of play
    for name in measures:
        if (column := name.removesuffix("_mean")) in episodes:
            values = episodes[column].astype(float)
            with_values = episodes.assign(value=np.log(values.where(values > 0)) if name in LOG_MEASURES else values)
            reliability = estimate_reliability(name, with_values[["group", "participant", "value"]])
            if reliability is not None:
                yield reliability


def compare_adjusted(
    participant_means: pd.DataFrame, analysis: AnalysisSpec, order: Sequence[str], logs: Collection[str] = ()
) -> tuple[GroupComparison, ...]:
    """Groups compared on the primary measure at equal covariates (analysis of covariance), each pair by itself.

    Participants without a covariate are left out. None where the protocol names no covariates; a pair with too few
    participants for the slopes has its reason.
    """
    primary = analysis.primary_measure
    covariates = list(analysis.covariates)
    if not covariates or primary not in participant_means:
        return ()
    known = participant_means.dropna(subset=[primary, *covariates])
    parts = {
        group: (rows[primary].to_numpy(float), rows[covariates].to_numpy(float))
        for group, rows in known.groupby(known["group"].astype(str))
    }
    comparisons = []
    for first, second in combinations([group for group in order if group in parts], 2):
        a, b, test = adjust_groups(parts[first], parts[second]) or (parts[first][0], parts[second][0], None)
        comparison = compare_pair(primary, (first, a), (second, b), test, is_log=primary in logs)
        reason = f"{len(a)} and {len(b)} are too few, or too much alike, for the slopes of {len(covariates)} covariates"
        comparisons.append(comparison if test else replace(comparison, reason=reason))
    return correct_comparisons(comparisons)


def take_logarithms(rows: pd.DataFrame, measures: Sequence[str]) -> tuple[pd.DataFrame, frozenset[str]]:
    """The rows with the logarithms of ``LOG_MEASURES``, and which those are: one with a value of 0 stays as it is."""
    times = [name for name in measures if name in LOG_MEASURES or (":" in name and find_measure(name).is_log)]
    logs = [name for name in times if not (rows[name] <= 0).any()]
    return rows.assign(**{name: np.log(rows[name].astype(float)) for name in logs}), frozenset(logs)


def compare_measures(
    participant_means: pd.DataFrame,
    roles: Mapping[str, Role],
    order: Sequence[str],
    logs: Collection[str] = (),
    *,
    intervals: bool = True,
) -> tuple[GroupComparison, ...]:
    """Every two groups on every measure, each role corrected by itself; ``each`` has a row per participant."""
    return tuple(
        comparison
        for role in get_args(Role)
        for comparison in compare_groups(
            participant_means,
            [name for name in roles if roles[name] == role],
            order=order,
            log_measures=logs,
            intervals=intervals,
        )
    )


def list_changes(rows: pd.DataFrame, measures: Sequence[str]) -> dict[tuple[int, int], pd.DataFrame]:
    """By pair of sessions, the block's first and each later one, every participant's change; NaN who has only one.

    A pair of sessions that no participant has both of is left out.
    """
    values = {
        int(str(session)): part.groupby(["group", "participant"])[list(measures)].mean().astype(float)
        for session, part in rows.groupby("session")
    }
    first, *later = sorted(values) or [0]
    changed = {(first, session): (values[session] - values[first]).reset_index() for session in later}
    return {sessions: change for sessions, change in changed.items() if change[list(measures)].notna().any(axis=None)}


def _estimate(
    changes: pd.DataFrame,
    measures: Sequence[str],
    sessions: tuple[int, int],
    order: Sequence[str],
    logs: Collection[str],
) -> Iterator[SessionChange]:
    for measure in measures:
        for group in order:
            values = changes.loc[changes["group"] == group, measure].dropna().to_numpy(np.float64)
            if len(values):
                test = paired_test(values)
                interval, p = (
                    (test.interval(), test.p()) if test and test.error > 0 else ((math.nan, math.nan), math.nan)
                )
                yield SessionChange(
                    measure, group, sessions, len(values), float(values.mean()), interval, p, measure in logs
                )


def set_measures_aside(rows: pd.DataFrame, *, late: int) -> dict[str, str]:
    """Find the measures that omit those who failed, where some did; ``late`` episodes ended without success."""
    undiscovered = int((rows["all_keys_discovered_s"].isna() & (rows["keys_total"] > 0)).sum())
    reasons = {
        "excess_steps_mean": f"omits {late} episodes without success" if late else "",
        "all_keys_discovered_s": f"omits {undiscovered} who never discovered them all; compared below with these censored"
        if undiscovered
        else "",
    }
    return {name: reason for name, reason in reasons.items() if reason and rows[name].notna().any()}


def assign_roles(names: Sequence[str], analysis: AnalysisSpec) -> dict[str, Role]:
    """What the protocol says of each measure."""
    roles: dict[str, Role] = dict.fromkeys(names, "exploratory")
    roles |= {name: "secondary" for name in analysis.secondary_measures if name in roles}
    roles |= {name: "primary" for name in (analysis.primary_measure,) if name in roles}
    return roles


def _alike(
    participant_means: pd.DataFrame, analysis: AnalysisSpec, order: Sequence[str]
) -> tuple[EquivalenceResult, ...]:
    if analysis.equivalence_margin is None:
        return ()
    bounds = -analysis.equivalence_margin, analysis.equivalence_margin
    values = {
        group: participant_means.loc[participant_means["group"] == group, analysis.primary_measure]
        .dropna()
        .to_numpy(np.float64)
        for group in order
    }
    tested = ((a, b, check_equivalence(values[a], values[b], bounds)) for a, b in combinations(order, 2))
    return tuple(EquivalenceResult(a, b, test) for a, b, test in tested if test is not None)


def sort_blocks_by_play(blocks: pd.DataFrame) -> list[str]:
    """Sort the blocks by their mean position in the sessions that contain them."""
    place = blocks.groupby(["participant", "session"], sort=False).cumcount()
    means = place.groupby(blocks["block"], sort=False).mean()
    return [str(name) for name in means.sort_values(kind="stable").index]


def find_target_block(blocks: pd.DataFrame) -> str:
    """The last block that every group played; "" without any. Rows are in the order of play."""
    played = [list(dict.fromkeys(part["block"])) for _, part in blocks.groupby("group")]
    common = [block for block in (played[0] if played else []) if all(block in group_blocks for group_blocks in played)]
    return str(common[-1]) if common else ""


def summarise_group_rewards(participant_means: pd.DataFrame) -> pd.DataFrame:
    """Mean and standard deviation, by group, of the subjects' mean rewards."""
    grouped = participant_means.groupby("group")["reward_mean"]
    return grouped.agg(participants="count", reward_mean="mean", reward_sd="std").reset_index()


PRACTICE_ALONE = "only practice was played"


def exclude_practice_alone(participants: pd.DataFrame) -> pd.DataFrame:
    """Exclude the participants of whom nothing but practice is included; who had nothing to play stays."""
    counts = participants["exclusion_reason"].isna()
    played = (participants["episodes"] > 0) | participants["completed_share"].isna()
    practice_only = counts & ~participants["participant"].isin(participants.loc[counts & played, "participant"])
    return participants.assign(exclusion_reason=participants["exclusion_reason"].mask(practice_only, PRACTICE_ALONE))


def list_exclusions(episodes: pd.DataFrame, participants: pd.DataFrame) -> pd.DataFrame:
    """List every row that is excluded, with its reason: participants first, then episodes of the others.

    The level of a session is "participant" if no other one of the participant is included, else "session".
    """
    people = participants.loc[participants["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session"]]
    included = participants.loc[participants["exclusion_reason"].isna(), "participant"]
    people = people.assign(level=np.where(people["participant"].isin(included), "session", "participant"))
    excluded_sessions = set(zip(people["exclusion_reason"], people["participant"], people["session"], strict=True))
    single = episodes.loc[
        episodes["exclusion_reason"].notna(), ["exclusion_reason", "participant", "session", "episode", "attempt"]
    ]
    session_keys = zip(single["exclusion_reason"], single["participant"], single["session"], strict=True)
    single = single[np.array([key not in excluded_sessions for key in session_keys], bool)].assign(level="episode")
    exclusions = pd.concat([people.astype(object), single.astype(object)], ignore_index=True)
    return exclusions.reindex(columns=["exclusion_reason", "level", "participant", "session", "episode", "attempt"])


def _groups_in(order: Sequence[str], rows: pd.DataFrame) -> pd.DataFrame:
    """The same rows, group after group."""
    places = {group: place for place, group in enumerate(order)}
    return rows.sort_values("group", key=lambda groups: groups.map(places), kind="stable").reset_index(drop=True)


def _measures(rows: pd.DataFrame, names: list[str], by: list[str]) -> pd.DataFrame:
    long = rows.melt(by, names, var_name="measure")
    table = long.groupby(["measure", *by], sort=False)["value"].agg(n="count", mean="mean", sd="std").reset_index()
    order = {name: place for place, name in enumerate(dict.fromkeys([*MEASURES, *names]))}
    return table.sort_values("measure", key=lambda names: names.map(order), kind="stable").reset_index(drop=True)
