"""What exports say of steps that an agent and a person shared: who steered, and what the policy would have done."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.recorded.episode import Episode
from minihuman.recorded.taught import NO_ADVICE


def taught_columns(episode: Episode, *, with_reset: bool = False) -> dict[str, NDArray[Any]]:
    """A row for each step: whether the person steered, and the world's action that the policy would have done.

    Nothing where no agent had a part in the episode; -1 where the policy said nothing. ``with_reset`` puts a row before
    the first, of nobody and nothing.
    """
    taught = episode.taught
    if taught is None:
        return {}
    rows = {"intervention": taught.by_person, "policy_action": taught.policy_actions}
    if with_reset:
        blank = {"intervention": False, "policy_action": NO_ADVICE}
        rows = {name: np.insert(values, 0, blank[name]) for name, values in rows.items()}
    return rows


def taught_at(episode: Episode, index: int) -> dict[str, Any]:
    """The same of one step, 0 for the first, as plain values, with the policy's probabilities by action number."""
    taught = episode.taught
    if taught is None:
        return {}
    return {
        "intervention": bool(taught.by_person[index]),
        "policy_action": int(taught.policy_actions[index]),
        "policy_probabilities": np.round(taught.probabilities[index].astype(np.float64), 9).tolist(),
        "policy": taught.policy,
    }
