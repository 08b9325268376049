"""The results of a study, block by block and within participants, computed from the tables instead of the logs."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign
from minihuman.moved import forward_names
from minihuman.reporting.block_results import BlockResults, compute_block_results
from minihuman.reporting.within_results import (
    WithinResults,
    compare_labels,
    compare_within,
    name_conditions,
    unite_teams,
)
from minihuman.statistics.units import find_units


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """A study's results, block by block in the order of play."""

    blocks: tuple[BlockResults, ...]
    target: str  # the block that the protocol names, else the last one that all groups played; "" without any
    order: tuple[str, ...]  # of the groups, in every comparison and figure
    within: WithinResults | None  # the conditions that the protocol compares within participants
    included: tuple[int, int]  # participants and episodes included

    @property
    def target_block(self) -> BlockResults | None:
        """Return the results of the block on which all groups are compared; None if there is no such block."""
        return next((block for block in self.blocks if block.block == self.target), None)

    @property
    def are_trials(self) -> bool:
        """Return whether all blocks consist of trials; these have no playing time."""
        return bool(self.blocks) and "playing_s_mean" not in self.shown_measures

    @property
    def shown_measures(self) -> set[str]:
        """Return the names of the measures that have values in a block or are compared within participants."""
        names = {str(name) for block in self.blocks for name in block.measures["measure"].unique()}
        return names | set(self.within.roles if self.within else ())


def compute_results(
    episodes: pd.DataFrame,
    blocks: pd.DataFrame,
    participants: pd.DataFrame,
    analysis: AnalysisSpec | None = None,
    teams: pd.DataFrame | None = None,
    trial_levels: pd.DataFrame | None = None,
    design: ExperimentDesign | None = None,
) -> Results:
    """Compute a study's results from its tables of episodes, blocks and participants.

    ``analysis`` is the protocol's planned analysis, ``teams`` the table of teams, and ``trial_levels`` the measures of
    trials by level of their labels. ``design`` assigns blocks to conditions; without it each block is a condition.
    """
    units: dict[str, dict[str, str]] = {}
    if teams is not None:
        units = {str(name): find_units(rows) for name, rows in teams.groupby("block")}
    analysis = analysis or AnalysisSpec()
    people = participants[participants["exclusion_reason"].isna()]
    included_episodes = episodes[episodes["exclusion_reason"].isna()]
    included_blocks = blocks[blocks["exclusion_reason"].isna()]
    order = _order_groups(blocks)
    target = analysis.block or find_target_block(included_blocks)
    results_in_order = [
        compute_block_results(
            name,
            included_blocks[included_blocks["block"] == name],
            episodes[episodes["block"] == name],
            order,
            analysis if name == target else AnalysisSpec(),
            units.get(name, {}),
        )
        for name in sort_blocks_by_play(included_blocks, analysis.conditions)
    ]
    if analysis.condition_label:
        within = compare_labels(included_episodes, analysis, trial_levels, design.contrasts if design else ())
    else:
        within = _compare_blocks(unite_teams(included_blocks, teams), analysis, design or ExperimentDesign())
    return Results(
        blocks=tuple(results_in_order),
        target=target,
        order=tuple(order),
        within=within,
        included=(people["participant"].nunique(), len(included_episodes)),
    )


def _compare_blocks(blocks: pd.DataFrame, analysis: AnalysisSpec, design: ExperimentDesign) -> WithinResults | None:
    """Compare conditions that are blocks, or the contrasts between them that the design states; None without any."""
    return compare_within(*name_conditions(blocks, analysis, design), design.contrasts)


def _order_groups(blocks: pd.DataFrame) -> list[str]:
    """Return the groups by their number of blocks, most first, because a transfer effect depends on earlier blocks.

    Groups with as many blocks are in alphabetical order.
    """
    counts = blocks.groupby("group")["block"].nunique()
    return sorted((str(group) for group in counts.index), key=lambda group: (-int(counts[group]), group))


def sort_blocks_by_play(blocks: pd.DataFrame, conditions: Sequence[str] = ()) -> list[str]:
    """Return the names of the blocks, sorted by their mean position in the sessions that contain them.

    If sessions had the ``conditions`` in different orders, these blocks share one position and follow each other in the
    order of ``conditions``.
    """
    position = blocks.groupby(["participant", "session"], sort=False).cumcount()
    means = {str(name): float(mean) for name, mean in position.groupby(blocks["block"], sort=False).mean().items()}
    is_condition = blocks["block"].isin(conditions)
    compared = blocks[is_condition]
    orders = compared.groupby(["participant", "session"], sort=False)["block"].agg(tuple)
    if orders.nunique() > 1:
        shared_mean = float(position[is_condition].mean())
        means |= dict.fromkeys(compared["block"].unique(), shared_mean)
    ranks = {name: rank for rank, name in enumerate(conditions)}
    # rounded, so that means that are equal but for rounding errors do not override the order of conditions
    return sorted(means, key=lambda name: (round(means[name], 9), ranks.get(name, len(ranks))))


def find_target_block(blocks: pd.DataFrame) -> str:
    """Return the last block that every group played; "" if there is none. Rows are in the order of play."""
    blocks_by_group = [list(dict.fromkeys(rows["block"])) for _, rows in blocks.groupby("group")]
    if not blocks_by_group:
        return ""
    common = [block for block in blocks_by_group[0] if all(block in group_blocks for group_blocks in blocks_by_group)]
    if not common:
        return ""
    return str(common[-1])


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
