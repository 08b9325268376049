"""How somebody looked for the goal, press by press, and what of it can be counted: of logged people and simulated."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.measures.effort import log_excess_steps
from minihuman.measures.keys import visible_effect
from minihuman.recorded.episode import Episode

COUNTED = (
    *("spare keys", "steps in vain", "turns undone", "turns", "places again", "places again much later"),
    *("log excess steps", "its spread", "time-outs", "steps straight on"),
)
_UNDO = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}
_MUCH_LATER_S = 15.0
_DIRECTIONS = 8  # that a pose is told apart by


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One episode's presses of keys of the pool, (n,), and how it ended."""

    block: int
    actions: Sequence[str]  # "" of a key without one
    shown: NDArray[np.bool_]  # something was seen to come of it
    poses: NDArray[np.float64]  # (n, 3) x, z, yaw_rad after it
    t_s: NDArray[np.float64]  # since the episode began
    outcome: str
    reward: float
    steps: int
    best: int | None  # steps of the best way that is known
    limit: int

    @property
    def log_excess(self) -> float:
        """Its excess steps, time-outs at the limit; NaN where no way is known or it was broken off."""
        found = log_excess_steps(self.steps, self.best, self.limit, self.outcome)
        return math.nan if found is None else found


def trace_of(episode: Episode, best: int | None) -> Trace:
    """A logged episode's; ``best`` is the number of steps of the best way that is known."""
    keys = episode.keys
    spare = np.flatnonzero(keys.column("down") & keys.column("verdict").are(("spare",)))
    spare_ns = keys.column("t_ns")[spare]
    stepped = np.array([bool(key) for key in episode.step_keys], bool)  # a tick's no-op is no press
    poses = episode.poses[:, [0, 2, 3]]
    at_step = np.searchsorted(episode.t_ns, spare_ns, side="right") - 1
    order = np.argsort(np.concatenate([episode.key_t_ns[stepped], spare_ns]), kind="stable")
    names = [name for name, by_key in zip(episode.actions, stepped, strict=True) if by_key]
    actions = [episode.start.action_names[action] for action in names] + [""] * len(spare)
    return Trace(
        block=episode.plan.block,
        actions=tuple(actions[place] for place in order),
        shown=np.concatenate([visible_effect(episode)[stepped], np.zeros(len(spare), bool)])[order],
        poses=np.concatenate([poses[1:][stepped], poses[np.clip(at_step, 0, None)]])[order],
        t_s=(np.concatenate([episode.key_t_ns[stepped], spare_ns])[order] - episode.t_ns[0]) / 1e9,
        outcome=episode.outcome_word,
        reward=episode.return_,
        steps=len(episode.actions),
        best=best,
        limit=episode.plan.max_steps,
    )


def counts_of(traces: Sequence[Trace]) -> NDArray[np.float64]:
    """What one person's episodes come to after the keys were found, a number for each of ``COUNTED``."""
    kept = [_after(trace, start) for trace, start in zip(traces, _found(traces), strict=True)]
    actions = [action for trace in kept for action in trace.actions]
    pairs = [(one, other) for trace in kept for one, other in zip(trace.actions, trace.actions[1:], strict=False)]
    places = [_places(trace) for trace in kept]
    excess = np.array([trace.log_excess for trace in traces])
    excess = excess[~np.isnan(excess)]
    turns = sum(action in _UNDO for action in actions)
    in_vain = sum(
        bool(action) and not shown for trace in kept for action, shown in zip(trace.actions, trace.shown, strict=True)
    )
    return np.array(
        [
            _share(actions.count(""), len(actions)),
            _share(in_vain, len(actions)),
            _share(sum(_UNDO.get(one) == other for one, other in pairs), len(actions)),
            _share(turns, len(actions)),
            _share(sum(again for again, _ in places), len(actions)),
            _share(sum(later for _, later in places), len(actions)),
            excess.mean() if len(excess) else 0.0,
            excess.std() if len(excess) else 0.0,
            _share(sum(trace.outcome == "timeout" for trace in traces), len(traces)),
            _share(sum(one == other and one not in _UNDO for one, other in pairs), len(actions)),
        ]
    )


def _share(count: float, of: int) -> float:
    """The logarithm of a share, finite where nothing was counted."""
    return math.log((count + 0.5) / (of + 1))


def _found(traces: Sequence[Trace]) -> list[int]:
    """From which press of each episode on all the actions that a block's people ever used had been seen."""
    starts = []
    used = {trace.block: set[str]() for trace in traces}
    for trace in traces:
        used[trace.block] |= {action for action, shown in zip(trace.actions, trace.shown, strict=True) if shown}
    seen = {block: set[str]() for block in used}
    for trace in traces:
        start = 0 if seen[trace.block] == used[trace.block] else len(trace.actions)
        for place, (action, shown) in enumerate(zip(trace.actions, trace.shown, strict=True)):
            if shown and action not in seen[trace.block]:
                seen[trace.block].add(action)
                start = place + 1 if seen[trace.block] == used[trace.block] else start
        starts.append(start)
    return starts


def _after(trace: Trace, start: int) -> Trace:
    return Trace(
        trace.block, trace.actions[start:], trace.shown[start:], trace.poses[start:], trace.t_s[start:], trace.outcome,
        trace.reward, trace.steps, trace.best, trace.limit,
    )  # fmt: skip


def _places(trace: Trace) -> tuple[int, int]:
    """How often a pose was taken up again, and how often a place long after it was left."""
    again, later = 0, 0
    poses, left_s = set[tuple[float, ...]](), dict[tuple[float, ...], float]()
    here: tuple[float, ...] | None = None
    for (x, z, yaw_rad), at_s, shown in zip(trace.poses.tolist(), trace.t_s.tolist(), trace.shown, strict=True):
        if not shown or math.isnan(x):
            continue
        place = round(x), round(z)
        pose = (*place, round(yaw_rad / math.tau * _DIRECTIONS) % _DIRECTIONS)
        again += pose in poses
        poses.add(pose)
        if here is not None and place != here:
            left_s[here] = at_s
            later += at_s - left_s.get(place, at_s) > _MUCH_LATER_S
        here = place
    return again, later
