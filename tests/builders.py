"""Episodes and sessions made by hand: real values for tests of the read side, with no log file behind them."""

import hashlib
import math
from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

import numpy as np

from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyPressed,
    Outcome,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.plan.session_plan import BlockText, EpisodePlan, KeyMap, Participant, SessionPlan
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.session_log import EpisodeLog, Segment, SegmentNote, SessionLog
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.worlds.contract import PICTURES_VERSION
from minihuman.worlds.pose import Map, Pose, Thing

Kind = Literal["grid", "room"]
GRID_ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle", "done")
ROOM_ACTIONS = ("turn_left", "turn_right", "move_forward", "move_back", "pickup", "drop", "toggle", "done")
WORLDS = {"grid": "minihuman/MiniGrid-FourRooms-v0", "room": "minihuman/MiniWorld-FourRooms-v0"}
KEYS = {
    "grid": KeyMap(keys={"1": "forward", "2": "right", "3": "left"}, spare_keys=("4", "5"), spare="ignore", seed=11),
    "room": KeyMap(
        keys={"4": "move_forward", "2": "turn_left", "1": "turn_right"}, spare_keys=("3", "5"), spare="ignore", seed=12
    ),
}
_DOORS = ((9, 4), (9, 13), (5, 9), (14, 9))
_STEP_NS = 400_000_000
STARTED_NS = 1_767_603_600_000_000_000  # 2026-01-05T09:00:00Z


def free_cells() -> np.ndarray:
    """Four rooms of a 19 x 19 grid: bool[column, row], True where one can stand."""
    free = np.ones((19, 19), bool)
    free[[0, 9, 18], :] = False
    free[:, [0, 9, 18]] = False
    for column, row in _DOORS:
        free[column, row] = True
    return free


def grid_map(goal: tuple[int, int]) -> Map:
    """The four rooms in cells: every face between a wall and a free cell."""
    free = free_cells()
    walls = []
    for column, row in np.argwhere(free):
        for dx, dz in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            if not free[column + dx, row + dz]:
                x, z = column + dx / 2, row + dz / 2
                walls.append((x - abs(dz) / 2, z - abs(dx) / 2, x + abs(dz) / 2, z + abs(dx) / 2))
    things = (Thing("green goal", float(goal[0]), float(goal[1]), 0.5, "#00ff00"),)
    return Map(
        "cell",
        (-0.5, -0.5, 18.5, 18.5),
        tuple((float(a), float(b), float(c), float(d)) for a, b, c, d in walls),
        things,
    )


def room_map(goal: tuple[float, float]) -> Map:
    """Four rooms in metres, 14 m across, joined by four passages 2 m wide and long."""
    walls: list[tuple[float, float, float, float]] = []
    for sign in (-1.0, 1.0):
        for other in (-1.0, 1.0):
            x0, x1, z0, z1 = sign * 7, sign * 1, other * 7, other * 1
            walls += [(x0, z0, x0, z1), (x0, z0, x1, z0)]
            walls += [(x1, z0, x1, other * 5), (x1, other * 3, x1, z1), (x0, z1, sign * 5, z1), (sign * 3, z1, x1, z1)]
        walls += [(-1.0, sign * 5, 1.0, sign * 5), (-1.0, sign * 3, 1.0, sign * 3)]
        walls += [(sign * 5, -1.0, sign * 5, 1.0), (sign * 3, -1.0, sign * 3, 1.0)]
    return Map("m", (-7.0, -7.0, 7.0, 7.0), tuple(walls), (Thing("red box", goal[0], goal[1], 0.57, "#ff0000"),))


def cells_between(start: tuple[int, int], goal: tuple[int, int]) -> list[tuple[int, int]]:
    """A shortest walk through free cells, both ends included."""
    free = free_cells()
    came: dict[tuple[int, int], tuple[int, int] | None] = {start: None}
    queue = deque([start])
    while queue:
        cell = queue.popleft()
        if cell == goal:
            break
        for dx, dz in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            near = (cell[0] + dx, cell[1] + dz)
            if free[near] and near not in came:
                came[near] = cell
                queue.append(near)
    walk: list[tuple[int, int]] = []
    step: tuple[int, int] | None = goal
    while step is not None:
        walk.append(step)
        step = came[step]
    return walk[::-1]


def points_between(start: tuple[float, float], goal: tuple[float, float]) -> list[tuple[float, float]]:
    """Way points from one room to another, through the passages, first along x, then along z."""
    points = [start]
    side = math.copysign(1.0, start[1])
    if start[0] * goal[0] < 0:
        direction = math.copysign(1.0, goal[0])
        points += [(-direction * 1.5, side * 4), (direction * 1.5, side * 4)]
    if side * goal[1] < 0:
        across = math.copysign(4.0, goal[0])
        points += [(across, side * 1.5), (across, -side * 1.5)]
    return [*points, goal]


def pursue(
    points: Sequence[tuple[float, float]], yaw_rad: float, *, stride: float, turn_rad: float, reach: float
) -> tuple[list[tuple[float, float, float, float]], list[int]]:
    """Turn and walk from point to point: poses (n + 1) and actions (0 left, 1 right, 2 forward) (n)."""
    x, z = points[0]
    poses, actions = [(x, 0.0, z, yaw_rad)], []
    for target_x, target_z in points[1:]:
        while math.hypot(target_x - x, target_z - z) > reach:
            bearing = math.atan2(-(target_z - z), target_x - x)
            error = math.remainder(bearing - yaw_rad, math.tau)
            if abs(error) > turn_rad / 2 + 1e-9:
                actions.append(0 if error > 0 else 1)
                yaw_rad = math.remainder(yaw_rad + math.copysign(turn_rad, error), math.tau)
            else:
                actions.append(2)
                x, z = x + stride * math.cos(yaw_rad), z - stride * math.sin(yaw_rad)
            poses.append((x, 0.0, z, yaw_rad))
    return poses, actions


def plan(
    number: int = 0,
    *,
    kind: Kind = "grid",
    block: int = 0,
    in_block: int = 0,
    of: int = 10,
    key_map: KeyMap | None = None,
) -> EpisodePlan:
    """An episode's plan in the four rooms of that kind."""
    actions = GRID_ACTIONS if kind == "grid" else ROOM_ACTIONS
    return EpisodePlan(
        episode=number, block=block, block_name=kind, episode_in_block=in_block, episodes_in_block=of,
        world=WORLDS[kind], options={}, seed=100 + number, actions=actions[:3],
        key_map=key_map or KEYS[kind], show_keys=False, pace="on_key", step_period_ms=0.0, noop=None,
        auto_repeat=False, max_steps=100 if kind == "grid" else 250, view="partial", palette="classic",
    )  # fmt: skip


def made(
    episode_plan: EpisodePlan,
    poses: Sequence[tuple[float, float, float, float]],
    actions: Sequence[int],
    floor: Map | None,
    *,
    outcome: Outcome | None = "goal",
    start_ns: int = 0,
    rt_ms: Sequence[float] | None = None,
    seen: Sequence[int] | None = None,
    extra_keys: Iterable[KeyPressed] = (),
    reward: float | None = None,
) -> EpisodeLog:
    """An episode from its poses and actions; every step has its key press, frame and reaction time.

    ``seen`` are the observation hashes (n + 1); by default they change with the pose only.
    """
    n = len(actions)
    names = GRID_ACTIONS if len(episode_plan.actions) and episode_plan.actions[0] in GRID_ACTIONS else ROOM_ACTIONS
    key_of = {name: key for key, name in episode_plan.key_map.keys.items()}
    step_keys = tuple(key_of.get(names[action], "") for action in actions)
    rt = np.full(n, 350.0) if rt_ms is None else np.asarray(rt_ms, float)
    t_ns = start_ns + np.concatenate([[0], np.cumsum((np.nan_to_num(rt, nan=400.0) + 50.0) * 1e6)]).astype(np.int64)
    flip_ns = t_ns + 16_000_000
    rewards = np.zeros(n)
    if n and outcome == "goal":
        rewards[-1] = 1 - 0.2 * n / episode_plan.max_steps if reward is None else reward
    rows = np.asarray(poses, np.float64).reshape(n + 1, 4)
    if seen is None:
        seen = [int.from_bytes(hashlib.blake2b(row.tobytes(), digest_size=8).digest(), "little") for row in rows]
    states = np.arange(n + 1, dtype=np.uint64) * np.uint64(7919) + np.uint64(episode_plan.seed)
    presses = tuple(
        KeyPressed(
            int(t_ns[i + 1]) - 1_000_000, step_keys[i], step_keys[i], True, int(actions[i]), "accepted", "playing"
        )
        for i in range(n)
        if step_keys[i]
    )
    start = EpisodeStarted(
        start_ns, episode_plan, names, "get to the goal", floor, Pose(*rows[0]), int(states[0]), int(seen[0])
    )
    return EpisodeLog(
        start=start, poses=rows, t_ns=t_ns, actions=np.asarray(actions, np.int64), step_keys=step_keys,
        key_t_ns=t_ns[1:] - 1_000_000, rewards=rewards,
        terminated=np.arange(1, n + 1) == (n if outcome == "goal" else -1),
        truncated=np.arange(1, n + 1) == (n if outcome == "timeout" else -1),
        rt_ms=rt, state_hashes=states, observation_hashes=np.asarray(seen, np.uint64),
        keys=EventColumns.of(KeyPressed, sorted((*presses, *extra_keys), key=lambda press: press.t_ns)),
        frames=EventColumns.of(FrameShown, (
            FrameShown(int(t), episode_plan.episode, i, int(t) - 14_000_000, int(t)) for i, t in enumerate(flip_ns)
        )),
        outcome=outcome,
    )  # fmt: skip


def episode(
    number: int = 0, *, kind: Kind = "grid", seed: int = 0, detours: int = 0, outcome: Outcome | None = "goal",
    start_ns: int = 0, block: int = 0, in_block: int | None = None, of: int = 10,
) -> EpisodeLog:  # fmt: skip
    """A walk from a random start to a random goal in another room, with ``detours`` on the way."""
    rng = np.random.default_rng([seed, number, kind == "room"])
    its_plan = plan(number, kind=kind, block=block, in_block=number if in_block is None else in_block, of=of)
    rt_ms = None
    if kind == "grid":
        room = (slice(1, 9), slice(10, 18))
        spots = [
            (
                int(rng.integers(room[i % 2].start, room[i % 2].stop)),
                int(rng.integers(1, 9) if i % 3 else rng.integers(10, 18)),
            )
            for i in range(detours + 2)
        ]
        points: list[tuple[float, float]] = [spots[0]]
        for start, goal in pairwise(spots):
            points += cells_between(start, goal)[1:]
        poses, actions = pursue(points, 0.0, stride=1.0, turn_rad=math.pi / 2, reach=0.01)
        floor = grid_map(spots[-1])
    else:
        corners = [
            (float(sx * rng.uniform(2, 6)), float(sz * rng.uniform(2, 6)))
            for sx, sz in rng.choice([-1, 1], (detours + 2, 2))
        ]
        points = [corners[0]]
        for start_m, goal_m in pairwise(corners):
            points += points_between(start_m, goal_m)[1:]
        poses, actions = pursue(points, rng.uniform(-3, 3), stride=0.15, turn_rad=math.radians(15), reach=0.25)
        floor = room_map(corners[-1])
    if outcome != "goal":
        keep = max(1, len(actions) * 2 // 3)
        poses, actions = poses[: keep + 1], actions[:keep]
    rt_ms = np.exp(rng.normal(5.8, 0.4, len(actions)))
    return made(its_plan, poses, actions, floor, outcome=outcome, start_ns=start_ns, rt_ms=rt_ms)


def session_of(
    episodes: Sequence[EpisodeLog], *, participant: str = "sub-01", index: int = 0, group: str = "grid_first",
    study: str = "transfer", clean: bool = True, notes: tuple[SegmentNote, ...] = (),
    keys: Sequence[KeyPressed] | None = None, path: Path | None = None,
) -> SessionLog:  # fmt: skip
    """A session log holding these episodes."""
    text = BlockText("", "", "", 0.0)
    end_reason, facts = (
        "complete" if clean else "cut_off",
        {"version_minihuman": "0.1.0", "python": "3.12", "pictures": str(PICTURES_VERSION)},
    )
    blocks = max((played.plan.block for played in episodes), default=0) + 1
    session_plan = SessionPlan(
        study=study, study_version="1", protocol_toml=b"", protocol_sha256="0" * 64,
        participant=Participant(participant, index, group), session=1, study_seed=7, allocation_sha256=None,
        overridden=False, consent_text="", consent_sha256="", key_pool=("1", "2", "3", "4", "5"),
        keyboard_check=False, texts=(text,) * blocks, closing_text="",
        episodes=tuple(played.plan for played in episodes), first_episode=0, segment=1,
    )  # fmt: skip
    pressed = EventColumns.of(KeyPressed, [press for played in episodes for press in played.keys])
    ends = np.cumsum([0, *(len(played.keys) for played in episodes)]).tolist()
    spans = zip(episodes, pairwise(ends), strict=True)
    episodes = [replace(played, keys=pressed[begin:end]) for played, (begin, end) in spans]
    return SessionLog(
        path=path or Path(f"sessions/{study}/{participant}/ses-01/{participant}_ses-01.mcap"),
        plan=session_plan, player="human-like", started_at="2026-01-05T09:00:00Z", clean=clean,
        end_reason=end_reason, facts=facts, episodes=tuple(episodes),
        segments=(
            Segment(
                number=1, started_at="2026-01-05T09:00:00Z", started_unix_ns=STARTED_NS, started_monotonic_ns=None,
                monotonic_clock="", start_ns=0, end_ns=max((int(one.t_ns[-1]) for one in episodes), default=0),
                end_reason=end_reason, clean=clean, facts=facts, notes=notes,
                keys=pressed if keys is None else EventColumns.of(KeyPressed, keys),
            ),
        ),
    )  # fmt: skip


def session(
    *, participant: str = "sub-01", index: int = 0, group: str = "grid_first", seed: int = 0,
    blocks: Sequence[Kind] = ("grid", "room"), episodes: int = 5, path: Path | None = None,
) -> SessionLog:  # fmt: skip
    """A session with ``episodes`` in each block; the first ones take detours, as people do."""
    played: list[EpisodeLog] = []
    t_ns = 2_000_000_000
    for block, kind in enumerate(blocks):
        for in_block in range(episodes):
            outcome: Outcome = "timeout" if (in_block, block) == (1, 0) else "goal"
            walked = episode(
                len(played), kind=kind, seed=seed, detours=max(0, 2 - in_block), outcome=outcome, start_ns=t_ns,
                block=block, in_block=in_block, of=episodes,
            )  # fmt: skip
            played.append(walked)
            t_ns = int(walked.t_ns[-1]) + 2_000_000_000
    return session_of(played, participant=participant, index=index, group=group, path=path)


def events_of(log: SessionLog) -> list[Event]:
    """The events a recorder would have seen of this session."""
    events: list[Event] = [SessionStarted(0, log.plan, log.facts | {"player": log.player})]
    for played in log.episodes:
        returns = np.cumsum(played.rewards)
        steps = [
            Stepped(
                t_ns=int(played.t_ns[i + 1]), episode=played.plan.episode, step=i + 1, action=int(played.actions[i]),
                key=played.step_keys[i], key_t_ns=int(played.key_t_ns[i]), reward=float(played.rewards[i]),
                return_=float(returns[i]), terminated=bool(played.terminated[i]), truncated=bool(played.truncated[i]),
                pose=None if np.isnan(played.poses[i + 1, 0]) else Pose(*(float(v) for v in played.poses[i + 1])),
                rt_ms=None if np.isnan(played.rt_ms[i]) else float(played.rt_ms[i]),
                state_hash=int(played.state_hashes[i + 1]), observation_hash=int(played.observation_hashes[i + 1]),
            )
            for i in range(len(played.actions))
        ]  # fmt: skip
        inside = [*played.keys, *steps, *played.frames]
        events += [played.start, *sorted(inside, key=lambda event: event.t_ns)]
        if played.outcome is not None:
            end_ns = max(int(event.t_ns) for event in inside) if inside else int(played.t_ns[-1])
            last = int(played.state_hashes[-1])
            events.append(EpisodeEnded(end_ns, played.plan.episode, played.outcome, len(steps), played.return_, last))
    last_ns = max(event.t_ns for event in events)
    return [*events, SessionEnded(last_ns, "complete", "", len(log.episodes))]


def write_log(log: SessionLog, data: Path) -> Path:
    """Record a session as it would have been played, and give its finished log. Nothing is fsynced."""
    recorder = McapRecorder(data, log.plan, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda fd: None))
    recorder.write(events_of(log))
    path = recorder.close()
    assert path is not None
    return path
