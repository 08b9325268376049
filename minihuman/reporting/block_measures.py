"""The measures on which groups are compared: columns of the block table, with their labels, formulas and roles."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.reporting.study_measures import find_measure

MEASURES = {  # columns of the block table that groups are compared on, and what they are called
    "log_excess_steps_mean": "log of the excess steps over the shortest path (without the goal: at the limit)",
    "spl_mean": "SPL: success weighted by path length",
    "success": "success (share of episodes)",
    "reward_mean": "reward",
    "steps_at_limit_mean": "steps (without the goal: at the limit)",
    "reward_first": "reward of the first episode",
    "reward_slope": "learning: change of reward from one episode to the next, over at most the first five",
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
GOAL_MEASURES = (  # that say nothing in a block without a goal to reach
    "log_excess_steps_mean",
    "spl_mean",
    "success",
    "steps_at_limit_mean",
    "excess_steps_mean",
    "log_steps_ratio_mean",
)
FORMULAS = {  # of one episode, where a measure's name does not tell it
    "log_excess_steps_mean": "ln(1 + steps \N{MINUS SIGN} shortest), shortest: steps of the shortest known path",
    "log_steps_ratio_mean": "ln(steps / shortest)",
    "spl_mean": "shortest / steps with the goal, 0 without",
    "success": "episodes that ended at the goal / all",
    "reward_mean": "the rewards of the world, summed over the episode",
    "steps_at_limit_mean": "steps with the goal, the step limit without",
    "reward_first": "the rewards of the first included episode",
    "reward_slope": "slope of a straight line",
    "excess_steps_mean": "steps \N{MINUS SIGN} shortest",
    "playing_s_mean": "from the reset to the last step, without pauses",
    "response_median_ms": "key press minus stimulus onset, of all responses, right or wrong: the flip of the latest "
    "picture; in real time, of the picture from which the world or the block counts",
    "reaction_median_ms": "key press minus the flip of the latest picture, in real time of a tick's",
    "path_efficiency_mean": "straight distance from start to end / distance covered",
    "ineffective_share": "steps after which the participant's view was as before / steps",
    "all_keys_discovered_s": "playing time until the action of every key had shown",
}
TRIAL_FORMULAS = {  # of one trial, in place of those of an episode
    "reward_mean": "the rewards of the world, summed over the trial",
    "response_median_ms": "key press minus the onset that the block's response times count from, of all responses, "
    "right or wrong",
}

NAMES_IN_SENTENCES = {  # of MEASURES whose labels say how they are computed, which the methods say, too
    "log_excess_steps_mean": "excess steps over the shortest path (log scale)",
    "log_steps_ratio_mean": "steps relative to the shortest path (log scale)",
    "spl_mean": "SPL (success weighted by path length)",
    "success": "success rate",
    "steps_at_limit_mean": "steps to the goal",
    "reward_slope": "change of reward over at most the first five episodes",
    "excess_steps_mean": "excess steps of successful episodes",
    "response_median_ms": "median reaction time (ms)",
}


def label_measure(name: str) -> str:
    """Return the label of a measure for tables and figures, which says how the measure is computed.

    Raises:
        ReportError: if the name is neither one of `MEASURES` nor that of a study measure, ``KIND:ARGUMENT``.
    """
    return MEASURES.get(name) or find_measure(name).label


def phrase_measure(name: str) -> str:
    """Return the name of a measure for sentences, which is shorter than its label for some measures."""
    return NAMES_IN_SENTENCES.get(name) or label_measure(name)


Role = Literal["primary", "secondary", "exploratory"]  # named in the protocol or not


def list_default_measures(rows: pd.DataFrame) -> list[str]:
    """Return the measures that are compared if the protocol names none: those of `MEASURES` that have values.

    The measures in `ONLY_IF_NAMED` are omitted.
    """
    return [name for name in MEASURES if name not in ONLY_IF_NAMED and rows[name].notna().any()]


def take_logarithms(rows: pd.DataFrame, measures: Sequence[str]) -> tuple[pd.DataFrame, frozenset[str]]:
    """Replace measures that are compared on a log scale by their natural logarithms.

    Return the rows and the names of the replaced measures. A measure with a value of 0 or less is left unchanged.
    """
    log_measures = [name for name in measures if name in LOG_MEASURES or _is_log_study_measure(name)]
    positive = [name for name in log_measures if not (rows[name] <= 0).any()]
    return rows.assign(**{name: np.log(rows[name].astype(float)) for name in positive}), frozenset(positive)


def _is_log_study_measure(name: str) -> bool:
    """Return whether a name, such as "design:threshold", is of a study measure that is compared on its logarithm."""
    return ":" in name and find_measure(name).is_log


def set_measures_aside(rows: pd.DataFrame, *, late: int) -> dict[str, str]:
    """Return the measures that are not to be compared because they omit failures, each with the reason.

    Args:
        rows: a block's rows of the table of blocks.
        late: the number of the block's episodes without success.
    """
    undiscovered = int((rows["all_keys_discovered_s"].isna() & (rows["keys_total"] > 0)).sum())
    reasons: dict[str, str] = {}
    if late:
        reasons["excess_steps_mean"] = f"omits {late} episodes without success"
    if undiscovered:
        reasons["all_keys_discovered_s"] = (
            f"omits {undiscovered} who never discovered them all; compared below with these censored"
        )
    return {name: reason for name, reason in reasons.items() if rows[name].notna().any()}


def assign_roles(names: Sequence[str], analysis: AnalysisSpec) -> dict[str, Role]:
    """Return the role of each measure: as the protocol names it, else exploratory."""
    roles: dict[str, Role] = dict.fromkeys(names, "exploratory")
    roles |= {name: "secondary" for name in analysis.secondary_measures if name in roles}
    if analysis.primary_measure in roles:
        roles[analysis.primary_measure] = "primary"
    return roles
