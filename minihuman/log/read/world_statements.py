"""Reads what a world reported at an episode's steps: success, and the keys of ``info`` that were kept."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.read.protobuf_columns import FieldColumn
from minihuman.worlds.outcomes import parse_outcome_rule

StepColumn = Callable[[str], FieldColumn]  # a field of all steps of a log, by its name


def read_successes(plan: EpisodePlan, column: StepColumn, steps: slice) -> NDArray[np.float64] | None:
    """Return the success that the world reported at each step of an episode, if the outcome rule asks for it.

    Args:
        plan: the episode's plan.
        column: returns a field of all steps of the log, given its name.
        steps: the rows of the episode's steps.

    Returns:
        float64[steps]: 1 or 0, or NaN if none was reported; None if the outcome rule does not ask the world.
    """
    if not parse_outcome_rule(plan.outcome_rule).asks_world:
        return None
    field = column("success")
    return np.where(field.is_present[steps], field.values[steps], np.nan)


def read_infos(plan: EpisodePlan, column: StepColumn, steps: slice) -> Sequence[Mapping[str, Any]] | None:
    """Return the recorded keys of each step's ``info``; None if the plan records none.

    The arguments are those of ``read_successes``.
    """
    if not plan.record_info:
        return None
    return [msgspec.json.decode(text) for text in column("info_json").values[steps]]
