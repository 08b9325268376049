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
    """Clear the navigation measures of trial blocks; their accuracy and times are in the section on trials."""
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


def leave_out_discovery(blocks: pd.DataFrame, known_blocks: Collection[str]) -> pd.DataFrame:
    """Clear the time until all keys were discovered in blocks where nobody had to discover them."""
    is_known = blocks["block"].isin(known_blocks)
    if not is_known.any():
        return blocks
    blocks = blocks.astype({"all_keys_discovered_s": np.float64})
    blocks.loc[is_known, "all_keys_discovered_s"] = np.nan
    blocks.loc[is_known, "keys_total"] = 0
    return blocks


def leave_out_goals(blocks: pd.DataFrame, episodes: pd.DataFrame, analysis: AnalysisSpec) -> pd.DataFrame:
    """Clear the measures of reaching a goal in blocks that have none, unless the protocol names them."""
    named = {*list_named_measures(analysis), *analysis.covariates}
    cleared = [name for name in GOAL_MEASURES if name in blocks and name not in named]
    included = episodes[episodes["exclusion_reason"].isna()]
    goalless = [name for name, played in included.groupby("block") if lacks_goal(played)]
    is_goalless = blocks["block"].isin(goalless)
    if not is_goalless.any():
        return blocks
    blocks = blocks.astype(dict.fromkeys(cleared, np.float64))
    blocks.loc[is_goalless, cleared] = np.nan
    return blocks


def find_practice(protocols: Sequence[Protocol], groups: Iterable[str]) -> frozenset[tuple[str, str]]:
    """Return the group and the block of every practice block.

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
    """Return whether each row belongs to a practice block."""
    if not practice:
        return pd.Series(False, rows.index, dtype=bool)
    pairs = pd.MultiIndex.from_frame(rows[["group", "block"]])
    return pd.Series(pairs.isin(sorted(practice)), rows.index, bool)
