"""An episode's columns, made from the columns of its messages."""

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log.plan_messages import one_of
from minihuman.log.read.wire import Column
from minihuman.recorded.columns import NO_ACTION, EventColumns
from minihuman.recorded.episode import pose_row
from minihuman.study import events as ev

_AXES = ("x", "y", "z", "yaw_rad")
_VERDICTS = get_args(ev.Verdict)


def check_steps(episode: int, episodes: NDArray[np.int64], steps: NDArray[np.int64]) -> None:
    """Refuse an episode in which a step is missing, or another's is."""
    wrong = np.flatnonzero((episodes != episode) | (steps != np.arange(1, len(steps) + 1)))
    if wrong.size:
        first = wrong[0]
        raise LogError(
            f"episode {episodes[first] + 1} step {steps[first]} follows episode {episode + 1} step {first}; "
            "something between them is missing"
        )


def by_step(column: Callable[[str], Column]) -> dict[str, NDArray[Any]]:
    """The columns of ``Episode`` that have a row for each step."""
    rt_ms = column("rt_ms")
    return {
        "actions": column("action").values,
        "key_t_ns": column("key_t_ns").values,
        "rewards": column("reward").values,
        "terminated": column("terminated").values,
        "truncated": column("truncated").values,
        "rt_ms": np.where(rt_ms.there, rt_ms.values, np.nan),
    }


def moments_of(
    starts: Sequence[ev.EpisodeStarted], resets: Sequence[int], column: Callable[[str], Column]
) -> dict[str, NDArray[Any]]:
    """The columns of ``Episode`` that have a row for its reset and one for each step, put before its first."""
    pose = column("pose")
    after = np.stack([np.where(pose.there, pose.values[axis].values, np.nan) for axis in _AXES], axis=1)
    first = np.array([pose_row(start.pose) for start in starts], np.float64).reshape(-1, len(_AXES))
    moments: dict[str, NDArray[Any]] = {"poses": np.insert(after, resets, first, axis=0)}
    for of_episode, name, dtype in (
        ("t_ns", "t_ns", np.int64),
        ("state_hashes", "state_hash", np.uint64),
        ("observation_hashes", "observation_hash", np.uint64),
    ):
        first = np.array([getattr(start, name) for start in starts], dtype)
        moments[of_episode] = np.insert(column(name).values, resets, first)
    return moments


def presses_of(column: Callable[[str], Column], count: int) -> EventColumns[ev.KeyPressed]:
    """Key presses and releases from the columns of their messages.

    Raises:
        LogError: if a verdict is outside its vocabulary.
    """
    for word in column("verdict").values.words:
        one_of(_VERDICTS, word)

    def values(name: str) -> Any:
        found = column(name)
        return np.where(found.there, found.values, NO_ACTION) if name == "action" else found.values

    return EventColumns(ev.KeyPressed, cache(values), range(count))


def frames_of(column: Callable[[str], Column], count: int) -> EventColumns[ev.FrameShown]:
    """Pictures shown from the columns of their messages."""
    return EventColumns(ev.FrameShown, lambda name: column(name).values, range(count))
