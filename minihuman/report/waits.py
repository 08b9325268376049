"""Waiting in a block: until every key was found, one time a person; until the goal, one time an episode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pandas as pd

from minihuman.statistics.survival import Waited, WaitedCompared, compare_waiting


@dataclass(frozen=True, slots=True, eq=False)
class Waits:
    """What one block tells of waiting, by group; empty where nobody waited for it."""

    keys: Mapping[str, Waited]  # playing seconds until every key was found, one a participant
    goal: Mapping[str, Waited]  # steps until the goal, one an episode: a person's are not independent
    compared: tuple[tuple[str, str, WaitedCompared], ...]  # of keys: which groups, and how


def waits(rows: pd.DataFrame, begun: pd.DataFrame, order: Sequence[str]) -> Waits:
    """From a block's rows of the block table and all of its episodes, of which those that count tell of the goal.

    Who never found every key was watched for all of the block's playing time. An episode that failed will not reach
    the goal any more: it waits to its step limit, as one that timed out; it is none that was watched no longer.
    """
    episodes = begun[begun["left_out"].isna()]
    played = begun.groupby(["participant", "session"])["playing_s"].sum()
    keys: dict[str, Waited] = {}
    goal: dict[str, Waited] = {}
    for group in order:
        theirs = rows[(rows["group"] == group) & (rows["keys_to_find"] > 0)]
        first = theirs.sort_values("session").drop_duplicates("participant")
        who = zip(first["participant"], first["session"], strict=True)
        watched = np.array([float(played.get(one, 0.0)) for one in who])
        found = first["found_all_s"].to_numpy(float)
        if len(first):
            keys[group] = Waited(np.where(np.isnan(found), watched, found), ~np.isnan(found))
        part = episodes[(episodes["group"] == group) & (episodes["steps"] > 0)]
        if len(part):
            waited = part["steps"].where(part["outcome"] != "failure", part["max_steps"])
            goal[group] = Waited(waited.to_numpy(float), part["success"].to_numpy(bool))
    pairs = ((a, b, compare_waiting(keys[a], keys[b])) for a, b in combinations(keys, 2))
    return Waits(keys, goal, tuple((a, b, one) for a, b, one in pairs if one is not None))
