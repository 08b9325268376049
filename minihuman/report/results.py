"""What a study shows, block by block, and who was left out. From the tables, not the logs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal, get_args

import numpy as np
import pandas as pd

from minihuman.report.parts import reward_parts
from minihuman.report.waits import Waits, waits
from minihuman.statistics.compare import Comparison, compare_groups
from minihuman.statistics.equivalence import Equivalence, equivalence
from minihuman.statistics.growth import Growth, growth
from minihuman.statistics.power import Power, power
from minihuman.statistics.two_parts import TwoParts
from minihuman.study.analysis import Analysis

MEASURES = {  # columns of the block table that groups are compared on, and what they are called
    "log_excess_steps_mean": "log of the steps over the best way (without the goal: at the limit)",
    "spl_mean": "SPL: success weighted by path length",
    "success": "success (share of episodes)",
    "reward_mean": "reward",
    "steps_at_limit_mean": "steps (without the goal: at the limit)",
    "reward_first": "reward of the first episode",
    "reward_slope": "learning: change of reward from one episode to the next, over the first five",
    "excess_steps_mean": "steps over the best way, of successes alone",
    "playing_s_mean": "playing time of an episode (s)",
    "reaction_median_ms": "reaction time, median (ms)",
    "path_efficiency_mean": "path efficiency (straight distance over ground covered)",
    "in_vain_share": "share of steps in vain",
    "found_all_s": "time until every key was found (s)",
    "log_steps_ratio_mean": "log of steps / steps of the best way (without the goal: at the limit)",
}
# Compared where the protocol names them: another's question in other terms, which would cost all of them in Holm's
# correction.
ONLY_IF_NAMED = frozenset({"log_steps_ratio_mean"})
FORMULAS = {  # of one episode, where a measure's name does not tell it
    "log_excess_steps_mean": "ln(1 + steps - best), best being the steps of the best way that is known",
    "log_steps_ratio_mean": "ln(steps / best), best being the steps of the best way that is known",
    "spl_mean": "best / steps with the goal, 0 without",
    "reward_mean": "the world's own, summed over the episode",
    "reward_slope": "slope of a straight line",
    "excess_steps_mean": "steps - best",
    "reaction_median_ms": "from a picture to the key that it was answered with",
    "in_vain_share": "steps that left the world as it was",
}

_LOG_EXCESS = "log of the steps over the best way"

Role = Literal["primary", "secondary", "exploratory"]  # named in the protocol before anybody played, or not


@dataclass(frozen=True, slots=True)
class Alike:
    """Whether two groups are shown to be alike."""

    first: str
    second: str
    test: Equivalence


@dataclass(frozen=True, slots=True, eq=False)
class BlockResults:
    """What one block shows, of the groups that played it."""

    block: str
    worlds: tuple[str, ...]
    episodes: int  # that count
    subjects: pd.DataFrame  # group, participant, session, episodes, reward_mean, reward_sd
    groups: pd.DataFrame  # group, participants, then mean and standard deviation of the subjects' means
    measures: pd.DataFrame  # measure, group, n, mean, sd; of measures that have a value in this block
    comparisons: tuple[Comparison, ...]  # the primary measure first, then the secondary ones
    roles: Mapping[str, Role]  # of each measure that is compared
    set_aside: Mapping[str, str]  # measures that are not compared since they leave out who did not get there, and why
    alike: tuple[Alike, ...]  # of the primary measure, where the protocol says how near is alike
    waits: Waits  # until every key was found, and until the goal
    parts: tuple[TwoParts, ...]  # of the reward, where it has mass at 0
    growth: Growth | None  # of the steps over the best way, or of the reward, over the block's episodes
    powers: tuple[Power, ...]  # one for each pair of groups, in the order of the headline

    @property
    def headline(self) -> tuple[Comparison, ...]:
        """What groups are compared on first: the primary measure, or the first of ``MEASURES`` that is told."""
        measure = next((one.measure for one in self.comparisons if self.roles[one.measure] == "primary"), None)
        chosen = measure or next((name for name in MEASURES if name in self.roles), None)
        return tuple(one for one in self.comparisons if one.measure == chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A study's results, block by block in the order of play."""

    blocks: tuple[BlockResults, ...]
    target: str  # the last block that all groups played; "" without any
    order: tuple[str, ...]  # of the groups, in every comparison and figure
    exclusions: pd.DataFrame  # left_out, level, participant, session, episode, attempt
    kept: tuple[int, int]  # participants and episodes that count

    @property
    def target_block(self) -> BlockResults | None:
        """The block that all groups are compared on."""
        return next((one for one in self.blocks if one.block == self.target), None)


def results(
    episodes: pd.DataFrame, blocks: pd.DataFrame, participants: pd.DataFrame, analysis: Analysis | None = None
) -> Results:
    """Work out the results from the three tables as they were written, judged by what the protocol names."""
    analysis = analysis or Analysis()
    counted_people = participants[participants["left_out"].isna()]
    counted = episodes[episodes["left_out"].isna()]
    kept = blocks[blocks["left_out"].isna()]
    order = _most_prepared_first(blocks)
    target = analysis.block or target_block(kept)
    return Results(
        blocks=tuple(
            block_results(
                name,
                kept[kept["block"] == name],
                episodes[episodes["block"] == name],
                order,
                analysis if name == target else Analysis(),
            )
            for name in in_order_of_play(kept)
        ),
        target=target,
        order=tuple(order),
        exclusions=exclusions(episodes, participants),
        kept=(counted_people["participant"].nunique(), len(counted)),
    )


def block_results(
    block: str, rows: pd.DataFrame, begun: pd.DataFrame, order: list[str], analysis: Analysis
) -> BlockResults:
    """One block's, from its rows of the block table that count and all of its episodes."""
    episodes = begun[begun["left_out"].isna()]
    order = [group for group in order if (rows["group"] == group).any()]
    rows = _groups_in(order, rows.sort_values(["participant", "session"]))
    aside = {
        name: why
        for name, why in _set_aside(rows, episodes).items()
        if name not in (analysis.primary, *analysis.secondary)
    }
    unasked = ONLY_IF_NAMED - {analysis.primary, *analysis.secondary}
    told = [name for name in MEASURES if rows[name].notna().any() and name not in aside and name not in unasked]
    each = rows.groupby(["group", "participant"])[list(MEASURES)].mean().reset_index()  # several sessions: their mean
    roles = _roles(told, analysis)
    comparisons = tuple(
        one
        for role in get_args(Role)
        for one in compare_groups(each, [name for name in roles if roles[name] == role], order=order)
    )
    told_excess = "log_excess_steps" in episodes and episodes["log_excess_steps"].notna().any()
    lines = episodes.rename(columns={"log_excess_steps": _LOG_EXCESS}) if told_excess else episodes
    found = BlockResults(
        block=block,
        worlds=tuple(dict.fromkeys(episodes["world"])),
        episodes=len(episodes),
        subjects=rows[["group", "participant", "session", "episodes", "reward_mean", "reward_sd"]].reset_index(
            drop=True
        ),
        groups=_groups_in(order, group_rewards(each)),
        measures=_measures(_groups_in(order, each), told),
        comparisons=comparisons,
        roles=roles,
        alike=_alike(each, analysis, order),
        waits=waits(rows, begun, order),
        parts=reward_parts(episodes, order),
        set_aside=aside,
        growth=growth(lines, _LOG_EXCESS if told_excess else "reward", order=order),
        powers=(),
    )
    return replace(found, powers=tuple(power(one.n) for one in found.headline))


def _set_aside(rows: pd.DataFrame, episodes: pd.DataFrame) -> dict[str, str]:
    """Measures that know only of those who got there, where somebody did not."""
    late = int((~episodes["success"].astype(bool)).sum())
    never = int((rows["found_all_s"].isna() & (rows["keys_to_find"] > 0)).sum())
    why = {
        "excess_steps_mean": f"{late} episodes without success are not in it" if late else "",
        "found_all_s": f"{never} never found them all; compared below with them in it" if never else "",
    }
    return {name: reason for name, reason in why.items() if reason and rows[name].notna().any()}


def _roles(told: Sequence[str], analysis: Analysis) -> dict[str, Role]:
    roles: dict[str, Role] = dict.fromkeys(told, "exploratory")
    roles |= {name: "secondary" for name in analysis.secondary if name in roles}
    roles |= {name: "primary" for name in (analysis.primary,) if name in roles}
    return roles


def _alike(each: pd.DataFrame, analysis: Analysis, order: Sequence[str]) -> tuple[Alike, ...]:
    if analysis.equivalence is None:
        return ()
    bounds = -analysis.equivalence, analysis.equivalence
    told = {group: each.loc[each["group"] == group, analysis.primary].dropna().to_numpy(np.float64) for group in order}
    tested = ((a, b, equivalence(told[a], told[b], bounds)) for a, b in combinations(order, 2))
    return tuple(Alike(a, b, test) for a, b, test in tested if test is not None)


def in_order_of_play(blocks: pd.DataFrame) -> list[str]:
    """The blocks by where they come in a session, on the average of those who played them."""
    place = blocks.groupby(["participant", "session"], sort=False).cumcount()
    means = place.groupby(blocks["block"], sort=False).mean()
    return [str(name) for name in means.sort_values(kind="stable").index]


def target_block(blocks: pd.DataFrame) -> str:
    """The last block that every group played; "" without any. Rows are in the order of play."""
    played = [list(dict.fromkeys(part["block"])) for _, part in blocks.groupby("group")]
    common = [block for block in (played[0] if played else []) if all(block in theirs for theirs in played)]
    return str(common[-1]) if common else ""


def _most_prepared_first(blocks: pd.DataFrame) -> list[str]:
    """The groups, those first that played more blocks: what came before is what a transfer effect is of."""
    counts = blocks.groupby("group")["block"].nunique()
    return sorted((str(group) for group in counts.index), key=lambda group: (-int(counts[group]), group))


def group_rewards(each: pd.DataFrame) -> pd.DataFrame:
    """Mean and standard deviation, by group, of the subjects' mean rewards."""
    grouped = each.groupby("group")["reward_mean"]
    return grouped.agg(participants="count", reward_mean="mean", reward_sd="std").reset_index()


def exclusions(episodes: pd.DataFrame, participants: pd.DataFrame) -> pd.DataFrame:
    """Every row left out, with its reason: participants first, then episodes of the others."""
    people = participants.loc[participants["left_out"].notna(), ["left_out", "participant", "session"]]
    people = people.assign(level="participant")
    whole = set(zip(people["left_out"], people["participant"], people["session"], strict=True))
    theirs = zip(episodes["left_out"], episodes["participant"], episodes["session"], strict=True)
    alone = np.array([pd.notna(key[0]) and key not in whole for key in theirs], bool)
    single = episodes.loc[alone, ["left_out", "participant", "session", "episode", "attempt"]].assign(level="episode")
    both = pd.concat([people.astype(object), single.astype(object)], ignore_index=True)
    return both.reindex(columns=["left_out", "level", "participant", "session", "episode", "attempt"])


def _groups_in(order: Sequence[str], rows: pd.DataFrame) -> pd.DataFrame:
    """The same rows, group after group."""
    places = {group: place for place, group in enumerate(order)}
    return rows.sort_values("group", key=lambda groups: groups.map(places), kind="stable").reset_index(drop=True)


def _measures(rows: pd.DataFrame, told: list[str]) -> pd.DataFrame:
    long = rows.melt("group", told, var_name="measure")
    table = long.groupby(["measure", "group"], sort=False)["value"].agg(n="count", mean="mean", sd="std").reset_index()
    order = {name: place for place, name in enumerate(MEASURES)}
    return table.sort_values("measure", key=lambda names: names.map(order), kind="stable").reset_index(drop=True)
