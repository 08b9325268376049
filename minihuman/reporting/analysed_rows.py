"""The rows of a report's tables that are analysed: without practice, and without measures that a block lacks."""

from collections.abc import Collection, Iterable, Sequence

import numpy as np
import pandas as pd

from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import AnalysisSpec, apply_overrides
from minihuman.reporting.block_measures import GOAL_MEASURES, MEASURES, TRIAL_BLOCK_MEASURES
from minihuman.reporting.block_results import lacks_goal, list_named_measures


def leave_out_navigation(
    episodes: pd.DataFrame, blocks: pd.DataFrame, trial_blocks: Collection[str]
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return episodes and blocks in which the navigation measures of trial blocks are missing.

    The accuracy and times of trials are in the report's section on trials.

    Args:
        episodes: rows of the table of episodes.
        blocks: rows of the table of blocks.
        trial_blocks: the names of the blocks of trials.
    """
    if not trial_blocks:
        return episodes, blocks
    is_trial = episodes["block"].isin(trial_blocks)
    episode_measures = [name for name in ("success", "playing_s", "log_excess_steps", "spl") if name in episodes]
    episodes = episodes.astype(dict.fromkeys(episode_measures, object))
    episodes.loc[is_trial, episode_measures] = None
    is_trial_block = blocks["block"].isin(trial_blocks)
    block_measures = [name for name in MEASURES if name not in TRIAL_BLOCK_MEASURES]
    blocks = blocks.astype(dict.fromkeys(block_measures, np.float64))
    blocks.loc[is_trial_block, block_measures] = np.nan
    blocks.loc[is_trial_block, "keys_total"] = 0  # so that no participant counts as one who missed a key
    return episodes, blocks


def leave_out_discovery(blocks: pd.DataFrame, known_blocks: Collection[str]) -> pd.DataFrame:
    """Return rows of blocks in which the measures of discovering keys are missing for the blocks ``known_blocks``.

    In these blocks the keys were shown or known before. The time until all keys were discovered is NaN there, and the
    number of keys to discover is 0.
    """
    has_known_keys = blocks["block"].isin(known_blocks)
    if not has_known_keys.any():
        return blocks
    blocks = blocks.astype({"all_keys_discovered_s": np.float64})
    blocks.loc[has_known_keys, "all_keys_discovered_s"] = np.nan
    blocks.loc[has_known_keys, "keys_total"] = 0
    return blocks


def blank_goal_measures(blocks: pd.DataFrame, episodes: pd.DataFrame, analysis: AnalysisSpec) -> pd.DataFrame:
    """Return rows of blocks in which the measures of reaching a goal are NaN in blocks that have no goal.

    Measures that the protocol names keep their values. ``episodes`` are the episodes of all blocks.
    """
    named_measures = {*list_named_measures(analysis), *analysis.covariates}
    goal_measures = [name for name in GOAL_MEASURES if name in blocks and name not in named_measures]
    included = episodes[episodes["exclusion_reason"].isna()]
    blocks_without_goal = [name for name, block_episodes in included.groupby("block") if lacks_goal(block_episodes)]
    is_goalless = blocks["block"].isin(blocks_without_goal)
    if not is_goalless.any():
        return blocks
    blocks = blocks.astype(dict.fromkeys(goal_measures, np.float64))
    blocks.loc[is_goalless, goal_measures] = np.nan
    return blocks


def find_practice(protocols: Sequence[Protocol], groups: Iterable[str]) -> frozenset[tuple[str, str]]:
    """Return the group and the block of every practice block; an empty set without protocols.

    ``protocols`` are the versions of the study's protocol, and ``groups`` the names of its groups.

    Raises:
        ReportError: if one version of the protocol analyses a block, and another does not.
    """
    group_names = list(groups)
    practice_versions = {_list_practice(protocol, group_names) for protocol in protocols}
    if len(practice_versions) > 1:
        blocks = ", ".join(sorted({block for practice in practice_versions for _, block in practice}))
        raise ReportError(
            f"the protocol's versions analyse different blocks ({blocks}); choose one version with --version"
        )
    return next(iter(practice_versions), frozenset())


def _list_practice(protocol: Protocol, groups: Sequence[str]) -> frozenset[tuple[str, str]]:
    """Return the group and the block of every practice block in one version of the protocol."""
    practice = set()
    for group in groups:
        for block_spec in protocol.blocks:
            block = apply_overrides(block_spec, group)
            if not block.analysed:
                practice.add((group, block.name))
    return frozenset(practice)


def is_practice(rows: pd.DataFrame, practice: Collection[tuple[str, str]]) -> "pd.Series[bool]":
    """Return whether each row belongs to a practice block; ``practice`` has the group and name of each such block."""
    if not practice:
        return pd.Series(False, rows.index, dtype=bool)
    pairs = pd.MultiIndex.from_frame(rows[["group", "block"]])
    return pd.Series(pairs.isin(sorted(practice)), rows.index, bool)
