"""Pairs of stretches that were compared, as imitation's preference learning takes them: two fragments and a number."""

from collections.abc import Iterator
from typing import Any

import datasets

from minihuman.data.chosen import Chosen
from minihuman.recorded.episode import SessionLog
from minihuman.study.activities.pair_events import Stretch, Verdict

# How much the left fragment is preferred; "cannot tell" says nothing.
PREFERENCES: dict[Verdict, float] = {"left": 1.0, "equal": 0.5, "right": 0.0}
SIDES = ("left", "right")

_Key = tuple[int, int, int, int]  # episode, attempt, first step and last


class Fragments:
    """Gathers the stretches of one session after the other as its episodes come by."""

    def __init__(self) -> None:
        self._log: SessionLog | None = None
        self._wanted: set[_Key] = set()
        self._found: dict[_Key, dict[str, Any]] = {}
        self._worlds: dict[_Key, str] = {}

    def take(self, item: Chosen, dataset: str, trajectory: dict[str, Any]) -> Iterator[tuple[str, dict[str, Any]]]:
        """Look at an episode's trajectory; gives the pairs of the session before, if this is of the next one."""
        if self._log is None or self._log.path != item.log.path:
            yield from self.close()
            self._log = item.log
            self._wanted = {_key(side) for each in item.log.comparisons for side in (each.left, each.right)}
        plan = item.episode.plan
        for key in self._wanted:
            if key[:2] == (plan.episode, item.episode.attempt):
                self._found[key] = _fragment(trajectory, *key[2:])
                self._worlds[key] = dataset

    def close(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """The pairs of the last session: the dataset's name, and a row."""
        for each in self._log.comparisons if self._log else ():
            keys = [_key(side) for side in (each.left, each.right)]
            if each.said.answer in PREFERENCES and all(key in self._found for key in keys):
                row: dict[str, Any] = {"preference": PREFERENCES[each.said.answer], "t_ns": each.said.t_ns}
                for side, key in zip(SIDES, keys, strict=True):
                    row |= {f"{side}_{name}": part for name, part in self._found[key].items()}
                yield self._worlds[keys[0]], row
        self._found, self._worlds = {}, {}


def pair_features(trajectory: datasets.Features) -> datasets.Features:
    """The columns of a pair, both of whose fragments have those of a trajectory."""
    each = {f"{side}_{name}": kind for side in SIDES for name, kind in trajectory.items()}
    return datasets.Features({"preference": datasets.Value("float64"), "t_ns": datasets.Value("int64")} | each)


def _key(side: Stretch) -> _Key:
    return side.episode, side.attempt, side.first, side.last


def _fragment(trajectory: dict[str, Any], first: int, last: int) -> dict[str, Any]:
    """Steps of a trajectory: ``last`` is the step whose observation is the last one."""
    steps = slice(first, last)
    whole = last == len(trajectory["acts"])
    return {
        "obs": trajectory["obs"][first : last + 1],
        "acts": trajectory["acts"][steps],
        "infos": trajectory["infos"][steps],
        "terminal": trajectory["terminal"] and whole,
        "rews": trajectory["rews"][steps],
    }
