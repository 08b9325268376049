"""Measures: numbers computed from one episode or one session by pure functions, without files, clocks or drawing.

The measures are time without pauses, reaction times, path length and straightness, steps relative to the shortest path
(SPL: Anderson et al., 2018), the slope over a block's first episodes, and the time at which each key's action is
discovered. A step has a visible effect if the observation after it differs from the one before it.
"""

import json
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import UNPRESSED_VERDICTS
from minihuman.experiment.plan.session_plan import EpisodePlan, KeyMap
from minihuman.log.model.event_columns import CategoricalTexts
from minihuman.log.model.session_log import EpisodeLog
from minihuman.worlds.contract import PathLengthBounds

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


def played_ns(episode: EpisodeLog, until_ns: int | None = None) -> int:
    """Return the playing time in nanoseconds, without pauses, from the reset to the session time ``until_ns``.

    If ``until_ns`` is None, the time runs to the last step.
    """
    first_ns = int(episode.t_ns[0])
    last_ns = int(episode.t_ns[-1]) if until_ns is None else until_ns
    paused_ns = 0
    for begin_ns, end_ns in episode.pauses:
        overlap_ns = min(last_ns, end_ns) - max(first_ns, begin_ns)
        paused_ns += max(0, overlap_ns)
    return last_ns - first_ns - paused_ns


def playing_s(episode: EpisodeLog) -> float:
    """Return the playing time in seconds from the reset to the last step, without pauses."""
    return played_ns(episode) / 1e9


def response_ms(episode: EpisodeLog) -> NDArray[np.float64]:
    """Return the reaction time of each step in milliseconds, an array of shape (n,); NaN for a step without one.

    In a turn-based block every picture is an onset: the time runs from the flip of the latest picture to the key press.
    In real time a tick's picture requires no response, so the time runs from a stimulus onset that the world or the
    block declares to the first later key that a tick processed. It is NaN if no onset is declared or a pause lies in
    between.
    """
    if episode.plan.pace != "real_time":
        return episode.rt_ms
    times_ms = np.full(len(episode.actions), math.nan)
    shown_steps, first_frames = np.unique(episode.frames.column("step"), return_index=True)
    if episode.onsets is None:
        is_onset = np.zeros(len(episode.poses), bool)
    else:
        is_onset = episode.onsets
    onsets_ns = np.sort(np.asarray(episode.frames.column("flip_ns"))[first_frames[is_onset[shown_steps]]])
    key_steps = np.flatnonzero([key != "" for key in episode.step_keys])
    latest_onsets = np.searchsorted(onsets_ns, episode.key_t_ns[key_steps], side="right") - 1
    onsets, first_keys = np.unique(latest_onsets, return_index=True)  # only the first key after an onset answers it
    for onset, step in zip(onsets.tolist(), key_steps[first_keys].tolist(), strict=True):
        if onset < 0:  # a key before the first onset
            continue
        begin_ns = onsets_ns[onset]
        end_ns = episode.key_t_ns[step]
        if not any(begin_ns < pause_end_ns and pause_ns < end_ns for pause_ns, pause_end_ns in episode.pauses):
            times_ms[step] = (end_ns - begin_ns) / 1e6
    return times_ms


def mean_and_median(times_ms: NDArray[np.float64]) -> tuple[float | None, float | None]:
    """Return the mean and the median of the times that are not NaN; None for both if there are none."""
    present_ms = times_ms[~np.isnan(times_ms)]
    n = present_ms.size
    if not n:
        return (None, None)
    middle_ms = np.sort(present_ms)[(n - 1) // 2 : n // 2 + 1]  # two times if their number is even
    return (float(present_ms.mean()), float(middle_ms.mean()))


TURN_DTYPE = np.dtype([("row", np.int64), ("turned_rad", np.float64), ("steps", np.int64)])
_STILL = 1e-9  # floating-point noise, in the map's unit
_APART = np.full((1, 4), math.nan)  # separates the poses of two episodes, so that no movement joins them

PoseArray = NDArray[np.float64]  # (n + 1, 4) for one episode; several are separated by a row of NaN


class PathMeasures(NamedTuple):
    """The measures of an episode's path."""

    length: float  # distance travelled in cells or metres; NaN if the world has no pose
    efficiency: float  # straight distance / distance travelled; 1 for a straight line, NaN without movement
    turns: int  # runs of turning in place


def measure_paths(episodes: Sequence[EpisodeLog]) -> list[PathMeasures]:
    """Measure the paths of several episodes at once, which takes hardly longer than measuring one."""
    parts = [_APART]
    for episode in episodes:
        parts += [episode.poses, _APART]
    poses = np.concatenate(parts)
    begins = np.cumsum([1, *(len(episode.poses) + 1 for episode in episodes)])  # row 0 is the first separator
    strides = _measure_strides(poses)
    _, turn_ends, _ = _find_turns(poses)
    turn_episodes = np.searchsorted(begins, turn_ends, side="right") - 1
    n_turns = np.bincount(turn_episodes, minlength=len(episodes))
    measures = []
    for episode, begin, turns in zip(episodes, begins[:-1].tolist(), n_turns.tolist(), strict=True):
        n_strides = len(episode.poses) - 1
        length = float(strides[begin : begin + n_strides].sum())
        if math.isnan(episode.poses[0, 0]):  # an episode without steps has no stride that is NaN
            length = math.nan
        if length > _STILL:
            efficiency = net_displacement(episode) / length
        else:
            efficiency = math.nan
        measures.append(PathMeasures(length, efficiency, turns))
    return measures


def net_displacement(episode: EpisodeLog) -> float:
    """Return the straight-line distance from the first position to the last, in cells or metres."""
    x0, _, z0, _ = episode.poses[0]
    x1, _, z1, _ = episode.poses[-1]
    return float(np.hypot(x1 - x0, z1 - z0))


def turned_rad(episode: EpisodeLog) -> NDArray[np.float64]:
    """Return the angle turned at each step, shape (n,), in [-pi, pi]; counter-clockwise is positive seen from above."""
    return _turned_rad(episode.poses)


def turns_in_place(episode: EpisodeLog) -> NDArray[np.void]:
    """Find the runs of turning in place.

    Each record has the ``row`` of the run's last pose, the total unsigned angle ``turned_rad``, and the number of
    ``steps`` that turned. A run lasts while the position stays the same; runs without any change of heading are
    excluded.
    """
    angles_rad = np.abs(turned_rad(episode))
    begins, ends, n_steps = _find_turns(episode.poses)
    records = [
        (end, angles_rad[begin:end].sum(), steps)
        for begin, end, steps in zip(begins.tolist(), ends.tolist(), n_steps.tolist(), strict=True)
    ]
    return np.array(records, dtype=TURN_DTYPE)


def _measure_strides(poses: PoseArray) -> NDArray[np.float64]:
    """Return the distance from each position to the next, shape (n,)."""
    displacements = poses[1:] - poses[:-1]
    return np.asarray(np.hypot(displacements[:, 0], displacements[:, 2]))


def _turned_rad(poses: PoseArray) -> NDArray[np.float64]:
    yaw_rad = poses[:, 3]
    change: NDArray[np.float64] = yaw_rad[1:] - yaw_rad[:-1]
    return (change + math.pi) % (2 * math.pi) - math.pi


def _find_turns(poses: PoseArray) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Find the runs of turning in place: each run's first and last row in ``poses``, and how many steps turned.

    Each of the three arrays has one number per run.
    """
    still = _measure_strides(poses) < _STILL
    bounded = np.concatenate([[False], still, [False]])
    edges = np.flatnonzero(bounded[1:] != bounded[:-1]).reshape(-1, 2)  # first and last row of each run
    turned = still & (np.abs(_turned_rad(poses)) > _STILL)
    turns_until_row = np.concatenate([[0], np.cumsum(turned)])
    steps = turns_until_row[edges[:, 1]] - turns_until_row[edges[:, 0]]
    has_turn = steps > 0
    return edges[has_turn, 0], edges[has_turn, 1], steps[has_turn]


def excess_steps(steps: int, best: int | None, *, success: bool) -> float | None:
    """Return ``steps`` minus ``best``, the steps of the best known path to the goal.

    Return None if the goal was missed, which ``success`` says, or if ``best`` is None because no path is known.
    """
    if success and best is not None:
        return float(steps - best)
    return None


def log_excess_steps(steps: int, best: int | None, limit: int, outcome: str) -> float | None:
    """Return ln(1 + excess steps); an episode that missed the goal counts with its step limit.

    The logarithm is compared because slower people need a multiple of the steps, not a fixed number more. Failures
    count because otherwise a group that fails more often would look better. None for an episode that was broken off, or
    if ``best``, the steps of the best known path to the goal, is None.
    """
    if best is None or outcome not in ("goal", "timeout", "failure"):
        return None
    return math.log1p(max(_steps_at_limit(steps, limit, outcome) - best, 0))


def log_steps_ratio(steps: int, best: int | None, limit: int, outcome: str) -> float | None:
    """Return ln(steps / steps of the best known path); an episode that missed the goal counts with its step limit.

    Differences of this measure are ratios of steps: -0.36 is 30 % fewer. Here a step is weighed by the length of the
    path. ``log_excess_steps`` weighs the first superfluous steps most, so that one layout on which all participants are
    nearly perfect can weigh as much as all other layouts together. None for an episode that was broken off, or if
    ``best``, the steps of the best known path to the goal, is None or 0.
    """
    if best is None or best < 1 or outcome not in ("goal", "timeout", "failure"):
        return None
    return math.log(max(_steps_at_limit(steps, limit, outcome), best) / best)


def _steps_at_limit(steps: int, limit: int, outcome: str) -> int:
    """Return an episode's steps, or its step limit if it did not reach the goal."""
    if outcome == "goal":
        return steps
    return limit


def spl(steps: int, best: int | None, outcome: str) -> float | None:
    """Return success weighted by path length, in steps (Anderson et al., 2018).

    The value is best / steps if the goal was reached, else 0; ``best`` is the steps of the best known path. It is None
    for an episode that was broken off, or if no path is known.
    """
    if best is None or outcome not in ("goal", "timeout", "failure"):
        return None
    if outcome == "goal" and steps:
        return best / max(steps, best)
    return 0.0


FIRST_EPISODES = 5  # the number of episodes regarded as the first


def slope_per_episode(values: Sequence[float], *, first: int = FIRST_EPISODES) -> float:
    """Return the least-squares slope of a measure per episode over the first episodes; NaN with fewer than two values.

    ``values`` holds the measure of each episode in order, of which the ``first`` are used. NaN values, which mark
    excluded episodes, are ignored.
    """
    early = np.asarray(values[:first], float)
    is_known = ~np.isnan(early)
    if is_known.sum() < 2:
        return math.nan
    centred = np.flatnonzero(is_known) - np.flatnonzero(is_known).mean()
    values_there = early[is_known]
    rises = values_there - values_there[0]  # exactly 0 for equal values, so that rounding makes no slope
    return float((centred * rises).sum() / (centred**2).sum())


_TAKEN = ("accepted", "queued")  # verdicts of presses that caused a step


@dataclass(frozen=True, slots=True)
class KeyUse:
    """The use of one key under one key map, and when its action was discovered.

    ``discovered_s`` is the playing time, and ``discovered_steps`` the number of steps, from the first use of the key
    map up to and including the press that discovered the action. Both are None if the action never had a visible
    effect.
    """

    key: str
    action: str | None  # None: no action
    first_episode: int  # number of the first episode under the key map
    presses: int  # presses during episodes, without auto-repeats
    steps: int  # steps that the key caused
    ineffective_steps: int  # steps without a visible effect
    refused: int  # presses with no action, or while no action was taken
    discovered_s: float | None
    discovered_steps: int | None


def visible_effect(episode: EpisodeLog) -> NDArray[np.bool_]:
    """Return whether each step changed the observation, an array of shape (n,)."""
    return np.not_equal(episode.observation_hashes[1:], episode.observation_hashes[:-1])


@dataclass(frozen=True, slots=True)
class KeyTally:
    """The presses and steps of one episode by key, without auto-repeats, and when each key's action first showed."""

    episode: EpisodeLog
    presses: Counter[str]
    refused: Counter[str]
    steps: Counter[str]
    ineffective_steps: Counter[str]
    first_shown: dict[str, int]  # the first step with a visible effect, from 0

    @classmethod
    def of(cls, episode: EpisodeLog) -> "KeyTally":
        """Count the presses and steps of an episode."""
        keys = episode.keys
        key = keys.column("key")
        verdict = keys.column("verdict")
        pressed = keys.column("down") & ~verdict.equals_any(UNPRESSED_VERDICTS)
        causes = CategoricalTexts.of(episode.step_keys)
        shows = visible_effect(episode)
        return cls(
            episode,
            presses=key.count_values(pressed),
            refused=key.count_values(pressed & ~verdict.equals_any(_TAKEN)),
            steps=causes.count_values(),
            ineffective_steps=causes.count_values(~shows),
            first_shown=causes.first_index(shows),
        )


_Discovery = tuple[float | None, int | None]  # when a key's action first showed: playing time in s, and steps
_UNDISCOVERED: _Discovery = (None, None)


def summarize_key_use(tallies: Sequence[KeyTally]) -> tuple[KeyUse, ...]:
    """Summarize the use of every key of each key map, and of every other key that was tried.

    ``tallies`` are those of a session's episodes, in order.
    """
    rows: list[KeyUse] = []
    for key_map, group in _group_by_key_map(tallies):
        rows += _summarize_key_map(key_map, group)
    return tuple(rows)


def _summarize_key_map(key_map: KeyMap, group: Sequence[KeyTally]) -> Iterator[KeyUse]:
    """Yield the use of each key in the episodes that were played with one key map."""
    presses = _sum_counts(tally.presses for tally in group)
    refused = _sum_counts(tally.refused for tally in group)
    steps = _sum_counts(tally.steps for tally in group)
    ineffective_steps = _sum_counts(tally.ineffective_steps for tally in group)
    discoveries = _find_discoveries(group)
    used_keys = {*+presses, *+steps}  # the unary plus drops keys with a count of 0
    further_keys = used_keys.union(key_map.spare_keys) - {*key_map.keys, ""}  # "" caused a tick's no-op
    for key in (*sorted(key_map.keys), *sorted(further_keys)):
        action = key_map.keys.get(key)
        discovered_s, discovered_steps = _UNDISCOVERED
        if action is not None:
            discovered_s, discovered_steps = discoveries.get(key, _UNDISCOVERED)
        yield KeyUse(
            key=key,
            action=action,
            first_episode=group[0].episode.number,
            presses=presses[key],
            steps=steps[key],
            ineffective_steps=ineffective_steps[key],
            refused=refused[key],
            discovered_s=discovered_s,
            discovered_steps=discovered_steps,
        )


def key_discovery_times(tallies: Sequence[KeyTally]) -> list[float | None]:
    """Return the ``KeyUse.discovered_s`` of every key with an action, for each key map; None if not discovered."""
    times_s: list[float | None] = []
    for key_map, group in _group_by_key_map(tallies):
        discoveries = _find_discoveries(group)
        for key in key_map.keys:
            discovered_s, _ = discoveries.get(key, _UNDISCOVERED)
            times_s.append(discovered_s)
    return times_s


def _group_by_key_map(tallies: Iterable[KeyTally]) -> Iterator[tuple[KeyMap, list[KeyTally]]]:
    """Yield each key map with the consecutive episodes that were played under it."""
    for key_map, run in groupby(tallies, key=lambda tally: tally.episode.plan.key_map):
        yield key_map, list(run)


def _sum_counts(counts: Iterable[Counter[str]]) -> Counter[str]:
    """Return the sum of several counters."""
    total: Counter[str] = Counter()
    for count in counts:
        total.update(count)
    return total


def _find_discoveries(group: Sequence[KeyTally]) -> dict[str, _Discovery]:
    """Return, by key, when its action first showed: the playing time in seconds and the steps under its key map.

    ``group`` holds the tallies of consecutive episodes under one key map. Keys whose action never showed are absent.
    """
    discoveries: dict[str, _Discovery] = {}
    steps_before = 0
    played_before_ns = 0
    for tally in group:
        episode = tally.episode
        for key, step in tally.first_shown.items():
            if key not in discoveries:
                discovered_ns = played_before_ns + played_ns(episode, int(episode.key_t_ns[step]))
                discoveries[key] = (discovered_ns / 1e9, steps_before + step + 1)
        steps_before += len(episode.actions)
        played_before_ns += played_ns(episode)
    return discoveries


def world_options_json(plan: EpisodePlan) -> str:
    """Encode a world's options as JSON in the form used by the table "plan"."""
    return json.dumps(plan.options, sort_keys=True, default=str)


@lru_cache(maxsize=100_000)
def layout_path_bounds(world_id: str, options: str, seed: int) -> PathLengthBounds:
    """Return bounds on the fewest steps to the goal in the world made from a seed.

    ``options`` holds the world's options as JSON with sorted keys, as ``world_options_json`` writes them.

    Raises:
        WorldError: if the world cannot be created here.
    """
    world = _make_world(world_id, options)
    world.reset(seed)
    return world.path_length_bounds()


@lru_cache(maxsize=16)
def _make_world(world_id: str, options: str) -> "World":
    """Make a world from its id and its options as JSON."""
    from minihuman.worlds.adapters.world import World

    return World(world_id, json.loads(options))
