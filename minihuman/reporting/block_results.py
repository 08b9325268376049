"""The results of one block, computed from the tables.

They are group comparisons, changes between sessions, survival times until all keys were discovered and until the goal,
the two-part comparison of rewards that are 0 after a timeout, growth, equivalence, reliability and power.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import get_args

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.reporting.block_measures import (
    LOG_MEASURES,
    MEASURES,
    ONLY_IF_NAMED,
    Role,
    assign_roles,
    set_measures_aside,
    take_logarithms,
)
from minihuman.statistics.comparison import (
    ALL_ALIKE,
    GroupComparison,
    compare_groups,
    compare_pair,
    correct_comparisons,
)
from minihuman.statistics.equivalence import Equivalence, check_equivalence
from minihuman.statistics.paired import GrowthComparison, compare_growth, paired_test
from minihuman.statistics.permutation import adjust_groups
from minihuman.statistics.reliability import Reliability, estimate_reliability
from minihuman.statistics.survival import SurvivalComparison, SurvivalTimes, compare_survival
from minihuman.statistics.t_tests import PowerAnalysis, Values, compute_power
from minihuman.statistics.two_part_model import TwoPartComparison, compare_two_parts, has_mass_at_zero
from minihuman.statistics.units import name_units


@dataclass(frozen=True, slots=True, eq=False)
class BlockSurvival:
    """The survival times of one block by group; empty if no event could occur."""

    keys: Mapping[str, SurvivalTimes]  # playing seconds until every key was found, one per participant
    # Steps until the goal, one per episode, so that a participant's are not independent. Empty if no episode ended at a
    # goal although rewards were earned, because such a world has none.
    goal: Mapping[str, SurvivalTimes]
    compared: tuple[tuple[str, str, SurvivalComparison], ...]  # two groups and the comparison of their ``keys``

    @property
    def without_goal(self) -> list[str]:
        """Return, as text per group, how many episodes did not reach the goal; an empty list if all did."""
        missed = {group: int((~times.observed).sum()) for group, times in self.goal.items()}
        if not any(missed.values()):
            return []
        counts = {group: f"{missed[group]} of {len(times.observed)}" for group, times in self.goal.items()}
        if len(counts) == 1:
            return list(counts.values())
        return [f"{group} {count}" for group, count in counts.items()]


def collect_survival_times(rows: pd.DataFrame, all_episodes: pd.DataFrame, order: Sequence[str]) -> BlockSurvival:
    """Collect survival times by group, in ``order``, from a block's rows of the block table and its episodes.

    Times to the goal are collected from included episodes only.

    A participant who never discovered every key is censored at the end of the block's playing time. An episode that
    failed can no longer reach the goal, so it is censored at its step limit like one that timed out, not earlier.
    """
    episodes = all_episodes[all_episodes["exclusion_reason"].isna()]
    playing_s = all_episodes.groupby(["participant", "session"])["playing_s"].sum()
    keys: dict[str, SurvivalTimes] = {}
    for group in order:
        group_rows = rows[(rows["group"] == group) & (rows["keys_total"] > 0)]
        first = group_rows.sort_values("session").drop_duplicates("participant")
        if len(first):
            keys[group] = _collect_key_times(first, playing_s)
    if not any(times.observed.any() for times in keys.values()):
        keys = {}  # nobody discovered them all: there may be one that does nothing here
    compared = []
    for first_group, second_group in combinations(keys, 2):
        comparison = compare_survival(keys[first_group], keys[second_group])
        if comparison is not None:
            compared.append((first_group, second_group, comparison))
    return BlockSurvival(keys, _collect_goal_times(episodes, order), tuple(compared))


def _collect_goal_times(episodes: pd.DataFrame, order: Sequence[str]) -> dict[str, SurvivalTimes]:
    """Return the steps until the goal by group, one per episode; {} if the block has no goal to reach."""
    if lacks_goal(episodes):
        return {}
    goal: dict[str, SurvivalTimes] = {}
    ended = episodes[(episodes["steps"] > 0) & episodes["success"].notna()]
    for group in order:
        group_episodes = ended[ended["group"] == group]
        if len(group_episodes):
            failed = group_episodes["outcome"] == "failure"
            # after a failure the goal cannot be reached any more: censored at the limit, not at the step of the failure
            steps = group_episodes["steps"].where(~failed, group_episodes["max_steps"])
            goal[group] = SurvivalTimes(steps.to_numpy(float), group_episodes["success"].to_numpy(bool))
    return goal


def lacks_goal(episodes: pd.DataFrame) -> bool:
    """Return whether no episode ended at a goal though rewards were earned, as where points are collected."""
    return not episodes["success"].eq(True).any() and bool((episodes["reward"] > 0).any())


_JOINT_EPISODE = ["group", "participant", "session", "block", "episode_in_block", "attempt", "seed", "exclusion_reason"]


def _unite_waits(waits: BlockSurvival, episodes: pd.DataFrame, order: Sequence[str]) -> BlockSurvival:
    """Return survival times in which an episode that a team played together counts once.

    The times until all keys were discovered are not compared, because those of a team's members are not independent.
    ``participant`` in ``episodes`` is the team, or the participant without a team.
    """
    included = episodes[episodes["exclusion_reason"].isna()]
    return replace(waits, compared=(), goal=_collect_goal_times(_drop_joint_duplicates(included), order))


def _drop_joint_duplicates(episodes: pd.DataFrame) -> pd.DataFrame:
    """Keep one row of each episode that the members of a team played together; ``participant`` is the team."""
    return episodes.drop_duplicates([column for column in _JOINT_EPISODE if column in episodes])


def _collect_key_times(first: pd.DataFrame, playing_s: "pd.Series[float]") -> SurvivalTimes:
    """Return the seconds until all keys were discovered, from each participant's first session of the block."""
    sessions = pd.MultiIndex.from_frame(first[["participant", "session"]])
    watched_s = playing_s.reindex(sessions).fillna(0.0).to_numpy(float)
    discovered_s = first["all_keys_discovered_s"].to_numpy(float)
    never_all = np.isnan(discovered_s)
    return SurvivalTimes(np.where(never_all, watched_s, discovered_s), ~never_all)


def compare_reward_parts(
    episodes: pd.DataFrame, order: Sequence[str], unit_names: Mapping[str, str]
) -> tuple[TwoPartComparison, ...]:
    """Compare each pair of groups on both parts of the reward; () unless some rewards are 0, some above, none below.

    Return () also if no success is known. ``unit_names`` has, by group, the noun for units other than participants.
    """
    if episodes["success"].isna().all() or not has_mass_at_zero(episodes["reward"].to_numpy(np.float64)):
        return ()
    return tuple(compare_two_parts(episodes, "reward", pair, unit_names) for pair in combinations(order, 2))


_LOG_EXCESS = "log of the excess steps over the shortest path"


@dataclass(frozen=True, slots=True)
class EquivalenceResult:
    """The equivalence test of two groups."""

    first: str
    second: str
    test: Equivalence


@dataclass(frozen=True, slots=True)
class SessionChange:
    """A group's change of a measure from one session to another, over the participants with values in both."""

    measure: str
    group: str
    sessions: tuple[int, int]
    n: int
    estimate: float  # the later session's mean minus the first's
    interval: tuple[float, float]  # 95 %, of the same sign flips as p; NaN where too few participants have both
    p: float  # paired permutation test
    is_log: bool = False  # the change is one of natural logarithms


_SUBJECT_COLUMNS = ["group", "participant", "session", "episodes", "reward_mean", "reward_sd"]


@dataclass(frozen=True, slots=True, eq=False)
class BlockResults:
    """The results of one block, for the groups that played it."""

    block: str
    episodes: int  # included; those that a team played together count once
    subjects: pd.DataFrame  # group, participant, session, episodes, reward_mean, reward_sd
    groups: pd.DataFrame  # group, participants, then mean and standard deviation of the subjects' means
    measures: pd.DataFrame  # measure, group, n, mean, sd; of measures that have a value in this block
    by_session: pd.DataFrame  # measure, group, session, n, mean, sd; the same, each session by itself
    changes: tuple[SessionChange, ...]  # from the block's first session to each later one
    changes_compared: tuple[tuple[tuple[int, int], GroupComparison], ...]  # which sessions, and groups on their change
    comparisons: tuple[GroupComparison, ...]  # the primary measure first, then the secondary ones
    roles: Mapping[str, Role]  # of each measure that is compared
    adjusted: tuple[GroupComparison, ...]  # of the primary measure, for the covariates that the protocol names
    set_aside: Mapping[str, str]  # why a measure is not compared, by measure: it omits participants who failed
    alike: tuple[EquivalenceResult, ...]  # of the primary measure, where the protocol gives a margin
    waits: BlockSurvival  # until every key was found, and until the goal
    parts: tuple[TwoPartComparison, ...]  # of the reward, where it has mass at 0
    growth: GrowthComparison | None  # of the excess steps, or of the reward, over the block's episodes
    reliabilities: tuple[Reliability, ...]  # of measures that single episodes have; empty for blocks of teams
    powers: tuple[PowerAnalysis, ...]  # one for each pair of groups, in the order of the headline
    teams: int = 0  # of several people, each of which is one unit of the statistics; 0: participants are
    team_units: Mapping[str, str] = field(default_factory=dict)  # by group: "teams", or "teams and participants"

    @property
    def unit_name(self) -> str:
        """Name the unit of the block's statistics, in the plural."""
        names = {self.team_units.get(str(group), "participants") for group in self.groups["group"]}
        if len(names) == 1:
            return names.pop()
        return "teams and participants"

    @property
    def headline(self) -> tuple[GroupComparison, ...]:
        """Return the comparisons on the primary measure or, without one, on the first measure whose values differ."""
        return _select_headline(self.comparisons, self.roles)


def _name_team_units(rows: pd.DataFrame, teams: Collection[str]) -> dict[str, str]:
    """Return the plural noun for the units of each group that has teams; groups without teams are omitted."""
    names: dict[str, str] = {}
    for group, codes in rows.groupby("group")["participant"]:
        is_team = codes.isin(teams)
        if is_team.all():
            names[str(group)] = "teams"
        elif is_team.any():
            names[str(group)] = "teams and participants"
    return names


def _select_headline(comparisons: Sequence[GroupComparison], roles: Mapping[str, Role]) -> tuple[GroupComparison, ...]:
    """Return the comparisons on the primary measure or, without one, on the first measure whose values differ.

    If no values differ, return the comparisons on the first measure.
    """
    primary = [comparison.measure for comparison in comparisons if roles[comparison.measure] == "primary"]
    varying = {comparison.measure for comparison in comparisons if comparison.reason != ALL_ALIKE}
    candidates = [*primary, *(measure for measure in roles if measure in varying), *roles]
    return tuple(comparison for comparison in comparisons if comparison.measure == candidates[0])


def compute_block_results(
    block: str,
    rows: pd.DataFrame,
    all_episodes: pd.DataFrame,
    order: list[str],
    analysis: AnalysisSpec,
    units: Mapping[str, str] | None = None,
) -> BlockResults:
    """Compute one block's results from its included rows of the block table and all of its episodes.

    If people played together, ``units`` maps each participant to their team, which is then the unit of every statistic.
    """
    units = units or {}
    order = [group for group in order if (rows["group"] == group).any()]
    waits = collect_survival_times(rows, all_episodes, order)
    people = rows.sort_values(["participant", "session"])
    if units:
        rows = name_units(rows, units)
        all_episodes = name_units(all_episodes, units)
        waits = _unite_waits(waits, all_episodes, order)
    episodes = all_episodes[all_episodes["exclusion_reason"].isna()]
    rows = _order_by_group(rows.sort_values(["participant", "session"]), order)
    set_aside = _list_set_aside(rows, episodes, analysis)
    columns = list(dict.fromkeys([*MEASURES, *list_named_measures(analysis), *analysis.covariates]))
    measured = _select_measures(rows, columns, analysis, set_aside)
    roles = assign_roles(measured, analysis)
    means = _average_sessions(rows, columns)
    scaled, logs = take_logarithms(rows, measured)
    scaled_means = _average_sessions(scaled, columns)
    comparisons = compare_measures(scaled_means, roles, order, logs)
    changed = list_changes(scaled, measured)
    return BlockResults(
        block=block,
        episodes=len(_drop_joint_duplicates(episodes) if units else episodes),
        subjects=_order_by_group(people, order)[_SUBJECT_COLUMNS].reset_index(drop=True),
        groups=_order_by_group(summarise_group_rewards(means), order),
        measures=_describe_measures(_order_by_group(means, order), measured, ["group"]),
        by_session=_describe_measures(_order_by_group(rows, order), measured, ["group", "session"]),
        changes=tuple(_estimate_changes(changed, measured, order, logs)),
        changes_compared=tuple(_compare_changes(changed, roles, order, logs)),
        comparisons=comparisons,
        roles=roles,
        adjusted=compare_adjusted(scaled_means, analysis, order, logs),
        alike=_check_equivalences(means, analysis, order),
        waits=waits,
        parts=compare_reward_parts(episodes, order, _name_team_units(rows, set(units.values()))),
        set_aside=set_aside,
        growth=_compare_growth(episodes, order),
        reliabilities=() if units else tuple(estimate_reliabilities(episodes, measured)),
        powers=tuple(compute_power(comparison.n) for comparison in _select_headline(comparisons, roles)),
        teams=len({*units.values()} & {*rows["participant"]}),
        team_units=_name_team_units(rows, set(units.values())),
    )


def list_named_measures(analysis: AnalysisSpec) -> list[str]:
    """Return the measures that the protocol names, the primary one first."""
    return [name for name in (analysis.primary_measure, *analysis.secondary_measures) if name]


def _list_set_aside(rows: pd.DataFrame, episodes: pd.DataFrame, analysis: AnalysisSpec) -> dict[str, str]:
    """Return the measures that are not compared because they omit failures, with the reason; none that is named."""
    late = int(episodes["success"].eq(False).sum())
    named_measures = list_named_measures(analysis)
    return {name: reason for name, reason in set_measures_aside(rows, late=late).items() if name not in named_measures}


def _select_measures(
    rows: pd.DataFrame, columns: Sequence[str], analysis: AnalysisSpec, set_aside: Collection[str]
) -> list[str]:
    """Return the measures on which groups are compared: the named and the default ones, if they have values."""
    named = list_named_measures(analysis)
    default = [name for name in MEASURES if name not in ONLY_IF_NAMED and name not in set_aside]
    return [name for name in columns if (name in named or name in default) and rows[name].notna().any()]


def _average_sessions(rows: pd.DataFrame, columns: Sequence[str]) -> pd.DataFrame:
    """Average the sessions of each participant; return a row per group and participant."""
    return rows.groupby(["group", "participant"])[list(columns)].mean().reset_index()


def _compare_growth(episodes: pd.DataFrame, order: Sequence[str]) -> GrowthComparison | None:
    """Compare the groups' growth over the block's episodes, in excess steps or, if there are none, in reward."""
    if "log_excess_steps" in episodes and episodes["log_excess_steps"].notna().any():
        return compare_growth(episodes.rename(columns={"log_excess_steps": _LOG_EXCESS}), _LOG_EXCESS, order=order)
    return compare_growth(episodes, "reward", order=order)


def estimate_reliabilities(episodes: pd.DataFrame, measures: Sequence[str]) -> Iterator[Reliability]:
    """Yield the reliability of each measure that episodes have; times are analysed on a log scale."""
    episodes = episodes.sort_values("session", kind="stable")  # rows of a session are in the order of play
    for name in measures:
        column = name.removesuffix("_mean")
        if column not in episodes:
            continue
        values = episodes[column].astype(float)
        if name in LOG_MEASURES:
            with_values = episodes.assign(value=np.log(values.where(values > 0)))
        else:
            with_values = episodes.assign(value=values)
        reliability = estimate_reliability(name, with_values[["group", "participant", "value"]])
        if reliability is not None:
            yield reliability


def compare_adjusted(
    participant_means: pd.DataFrame, analysis: AnalysisSpec, order: Sequence[str], logs: Collection[str] = ()
) -> tuple[GroupComparison, ...]:
    """Compare each pair of groups on the primary measure at equal covariates (analysis of covariance).

    Participants without a covariate are omitted. There is no comparison if the protocol names no covariates; a pair
    with too few participants for the slopes has a reason instead.
    """
    primary = analysis.primary_measure
    covariates = list(analysis.covariates)
    if not covariates or primary not in participant_means:
        return ()
    complete = participant_means.dropna(subset=[primary, *covariates])
    parts = {
        group: (rows[primary].to_numpy(float), rows[covariates].to_numpy(float))
        for group, rows in complete.groupby(complete["group"].astype(str))
    }
    comparisons = []
    for first, second in combinations([group for group in order if group in parts], 2):
        adjusted = adjust_groups(parts[first], parts[second])
        pair = (first, parts[first][0]), (second, parts[second][0])
        test = None
        if adjusted is not None:
            first_adjusted, second_adjusted, test = adjusted
            pair = (first, first_adjusted), (second, second_adjusted)
        comparison = compare_pair(primary, *pair, test, is_log=primary in logs)
        if test is None:
            sizes = f"{len(pair[0][1])} and {len(pair[1][1])} are too few, or too much alike"
            comparison = replace(comparison, reason=f"{sizes}, for the slopes of {len(covariates)} covariates")
        comparisons.append(comparison)
    return correct_comparisons(comparisons)


def compare_measures(
    participant_means: pd.DataFrame,
    roles: Mapping[str, Role],
    order: Sequence[str],
    logs: Collection[str] = (),
    *,
    intervals: bool = True,
) -> tuple[GroupComparison, ...]:
    """Compare each pair of groups on every measure; p values are corrected within each role.

    Args:
        participant_means: a table with a row per participant.
        roles: the role of each measure.
        order: the groups, in order.
        logs: the measures that are logarithms.
        intervals: whether to compute intervals, which take most of the time.
    """
    comparisons: list[GroupComparison] = []
    for role in get_args(Role):
        measures = [name for name in roles if roles[name] == role]
        comparisons += compare_groups(participant_means, measures, order=order, log_measures=logs, intervals=intervals)
    return tuple(comparisons)


def list_changes(rows: pd.DataFrame, measures: Sequence[str]) -> dict[tuple[int, int], pd.DataFrame]:
    """Return every participant's change from the block's first session to each later one, by pair of sessions.

    A participant who has only one of the two sessions has NaN. A pair of sessions that no participant has both of is
    omitted.
    """
    means_by_session = {
        int(str(session)): part.groupby(["group", "participant"])[list(measures)].mean().astype(float)
        for session, part in rows.groupby("session")
    }
    if not means_by_session:
        return {}
    first, *later = sorted(means_by_session)
    changes = {}
    for session in later:
        change = (means_by_session[session] - means_by_session[first]).reset_index()
        if change[list(measures)].notna().any(axis=None):
            changes[first, session] = change
    return changes


def _estimate_changes(
    changed: Mapping[tuple[int, int], pd.DataFrame],
    measures: Sequence[str],
    order: Sequence[str],
    logs: Collection[str],
) -> Iterator[SessionChange]:
    """Estimate each group's mean change of each measure, by pair of sessions, from the result of ``list_changes``."""
    for sessions, rows in changed.items():
        for measure in measures:
            for group in order:
                changes = rows.loc[rows["group"] == group, measure].dropna().to_numpy(np.float64)
                if len(changes):
                    yield _estimate_change(changes, measure, group, sessions, is_log=measure in logs)


def _estimate_change(
    changes: Values, measure: str, group: str, sessions: tuple[int, int], *, is_log: bool
) -> SessionChange:
    """Estimate a group's mean change; the interval and p are NaN if the changes are too few or do not vary."""
    test = paired_test(changes)
    interval = (math.nan, math.nan)
    p = math.nan
    if test is not None and test.error > 0:
        interval = test.interval()
        p = test.p()
    return SessionChange(measure, group, sessions, len(changes), float(changes.mean()), interval, p, is_log)


def _compare_changes(
    changed: Mapping[tuple[int, int], pd.DataFrame],
    roles: Mapping[str, Role],
    order: Sequence[str],
    logs: Collection[str],
) -> Iterator[tuple[tuple[int, int], GroupComparison]]:
    """Compare groups on their changes, by pair of sessions, from the result of ``list_changes``."""
    for sessions, rows in changed.items():
        for comparison in compare_measures(rows, roles, order, logs):
            yield sessions, comparison


def _check_equivalences(
    participant_means: pd.DataFrame, analysis: AnalysisSpec, order: Sequence[str]
) -> tuple[EquivalenceResult, ...]:
    """Test each pair of groups for equivalence on the primary measure, if the protocol gives a margin."""
    if analysis.equivalence_margin is None:
        return ()
    bounds = (-analysis.equivalence_margin, analysis.equivalence_margin)
    values = {
        group: participant_means.loc[participant_means["group"] == group, analysis.primary_measure]
        .dropna()
        .to_numpy(np.float64)
        for group in order
    }
    return tuple(
        EquivalenceResult(a, b, check_equivalence(values[a], values[b], bounds)) for a, b in combinations(order, 2)
    )


def summarise_group_rewards(participant_means: pd.DataFrame) -> pd.DataFrame:
    """Compute the mean and standard deviation of the participants' mean rewards, by group."""
    grouped = participant_means.groupby("group")["reward_mean"]
    return grouped.agg(participants="count", reward_mean="mean", reward_sd="std").reset_index()


def _order_by_group(rows: pd.DataFrame, order: Sequence[str]) -> pd.DataFrame:
    """Return rows sorted by group as in ``order``, keeping the order of rows within each group."""
    ranks = {group: rank for rank, group in enumerate(order)}
    return rows.sort_values("group", key=lambda groups: groups.map(ranks), kind="stable").reset_index(drop=True)


def _describe_measures(rows: pd.DataFrame, names: list[str], by: list[str]) -> pd.DataFrame:
    """Return the columns measure, those in ``by``, n, mean and sd: a row per measure and group of rows."""
    long = rows.melt(by, names, var_name="measure")
    table = long.groupby(["measure", *by], sort=False)["value"].agg(n="count", mean="mean", sd="std").reset_index()
    ranks = {name: rank for rank, name in enumerate(dict.fromkeys([*MEASURES, *names]))}
    return table.sort_values("measure", key=lambda column: column.map(ranks), kind="stable").reset_index(drop=True)
