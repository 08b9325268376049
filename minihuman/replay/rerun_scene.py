"""The content of a replay and its times: timelines, facts, map, path, heading, keys, numbers and log lines.

Sending whole columns makes creating a session's recording tens of times faster than logging it step by step.
"""

import io
import math
import operator
from collections import defaultdict
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain, pairwise

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from minihuman.dataset.measures import response_ms
from minihuman.display.video import VideoWriter
from minihuman.experiment.machine.events import KeyPressed, Paused, Resumed
from minihuman.log.model.session_log import EpisodeLog, SessionLog, list_partner_seats
from minihuman.log.model.teaching_events import NO_ADVICE
from minihuman.replay.frames import SIZE_PX, fit_picture, render_frames, render_partner_frames

SESSION_TIME = "session_time"  # since the session's first segment began
PLAY_TIME = "play_time"  # since the session's first episode began, 0 before it; the timeline that a replay opens with
STEP = "step"  # counts all steps of the session, including each episode's first picture
EPISODE = "episode"  # 1 for the session's first, 0 before it
ALIGNED = "aligned_time"  # for several sessions, whose n-th episodes begin together


@dataclass(frozen=True, slots=True, eq=False)
class ReplayTimeline:
    """The times of one session's rows and episodes, in nanoseconds since the session began."""

    row_t_ns: NDArray[np.int64]  # of every pose of every episode
    start_t_ns: NDArray[np.int64]  # (episodes,) of each episode's first pose
    numbers: NDArray[np.int64]  # (episodes,) 1 for the session's first
    aligned_ns: NDArray[np.int64] | None  # (episodes,) their starts on the timeline of several sessions, if any

    @classmethod
    def of(cls, log: SessionLog, *, aligned_ns: dict[int, int] | None = None) -> "ReplayTimeline":
        """Return a session's timeline; ``aligned_ns`` is from `align_episode_starts`, or None for a single session."""
        numbers = [episode.number for episode in log.episodes]
        rows = np.concatenate([np.zeros(0, np.int64), *(episode.t_ns for episode in log.episodes)])
        starts = np.array([episode.t_ns[0] for episode in log.episodes], np.int64)
        aligned = None
        if aligned_ns is not None:
            aligned = np.array([aligned_ns[number] for number in numbers], np.int64)
        return cls(rows, starts, np.array(numbers, np.int64), aligned)

    @property
    def _first_ns(self) -> int:
        if len(self.start_t_ns):
            return int(self.start_t_ns[0])
        return 0

    def columns(self, t_ns: ArrayLike) -> list[rr.TimeColumn]:
        """Return a column for each of rerun's timelines with its values at ``t_ns``, ns since the session began."""
        times = np.asarray(t_ns, np.int64)
        indices = np.searchsorted(self.start_t_ns, times, side="right") - 1  # of episodes; -1 before the first
        steps = np.searchsorted(self.row_t_ns, times, side="right") - 1
        if len(self.numbers):
            episodes = np.where(indices < 0, 0, self.numbers[indices])
        else:
            episodes = np.zeros(len(times), np.int64)
        columns = [
            rr.TimeColumn(SESSION_TIME, duration=times.astype("timedelta64[ns]")),
            rr.TimeColumn(PLAY_TIME, duration=np.maximum(times - self._first_ns, 0).astype("timedelta64[ns]")),
            rr.TimeColumn(STEP, sequence=np.maximum(steps, 0)),
            rr.TimeColumn(EPISODE, sequence=episodes),
        ]
        if self.aligned_ns is not None and len(self.numbers):
            nearest = np.maximum(indices, 0)  # times before the first episode count from its start
            aligned_times = times - self.start_t_ns[nearest] + self.aligned_ns[nearest]
            columns.append(rr.TimeColumn(ALIGNED, duration=aligned_times.astype("timedelta64[ns]")))
        return columns


def align_episode_starts(logs: Sequence[SessionLog]) -> dict[int, int]:
    """Return, by episode number, the start in nanoseconds on a timeline that several sessions share.

    Each number starts a second after the longest episode of the number before it.
    """
    longest_ns: dict[int, int] = {}
    for log in logs:
        for episode in log.episodes:
            number = episode.number
            longest_ns[number] = max(longest_ns.get(number, 0), int(episode.t_ns[-1] - episode.t_ns[0]))
    starts_ns = {}
    now_ns = 0
    for number in sorted(longest_ns):
        starts_ns[number] = now_ns
        now_ns += longest_ns[number] + 1_000_000_000
    return starts_ns


def build_facts_page(log: SessionLog) -> str:
    """Return the session's facts as a page of Markdown, with a table that has a row for each episode."""
    plan = log.plan
    participant = log.plan.participant
    log_state = "finished" if log.clean else "cut off"
    lines = [
        f"# {participant.id}, session {plan.session}",
        "",
        f"**{plan.study}** {plan.study_version}, group *{participant.group}*, played by *{log.player}*.",
        (
            f"Started {log.started_at} ({_describe_segments(log)}); the log is {log_state}, "
            f"the session ended: {log.end_reason}."
        ),
        "",
        "| episode | attempt | block | world | keys | outcome | steps | return |",
        "|--:|--:|---|---|---|---|--:|--:|",
        *(_format_episode_row(episode) for episode in log.episodes),
        "",
        "| fact | value |",
        "|---|---|",
        f"| protocol SHA-256 | `{plan.protocol_sha256}` |",
        f"| study seed | {plan.study_seed} |",
        *(f"| {name} | {value} |" for name, value in sorted(log.facts.items())),
    ]
    return "\n".join(lines) + "\n"


def _describe_segments(log: SessionLog) -> str:
    """Return a phrase with the number of segments and, if there are several, the session time at which each begins."""
    if len(log.segments) == 1:
        return "one segment"
    begins = ", ".join(f"{segment.start_ns / 1e9:.1f} s" for segment in log.segments)
    return f"{len(log.segments)} segments, beginning at session time {begins}"


def _format_episode_row(episode: EpisodeLog) -> str:
    """Return an episode as a row, in Markdown, of the table of episodes on the facts page."""
    plan = episode.plan
    keys = ", ".join(f"{key}: {action}" for key, action in sorted(plan.key_map.keys.items()))
    return (
        f"| {episode.number} | {episode.attempt} | {plan.block_name} | {plan.world} (seed {plan.seed}) | {keys} "
        f"| {episode.outcome_word} | {len(episode.actions)} | {episode.return_:.3f} |"
    )


WALL = 0xC8C8C8FF
PATH = 0x0072B2FF
TRAIL = 0xE69F00FF
AGENT = 0xD55E00FF
PARTNER = 0xCC79A7FF
_POINT = pa.list_(pa.field("item", pa.float32(), nullable=False), 2)
_STRIP = pa.list_(pa.field("item", _POINT, nullable=False))
_TRAIL_MOVES = 12
_FIRST_LINE_ORDER = 20  # draw order of the path; the trail lies on it
_VIDEO_FPS = 10  # nominal, since each row refers to its picture in the video
_PATH_ROWS = 400  # a longer path is redrawn only every few moves, which avoids quadratic size
_ARROW_LENGTHS = {"cell": 0.8, "m": 0.7}  # of the arrow that shows the heading, by the map's unit and in that unit
_KEY_STATES = {  # colours by a press's verdict
    "accepted": 0x009E73FF,
    "queued": 0x56B4E9FF,
    "spare": 0xE69F00FF,
    "unmapped": 0xD55E00FF,
    "repeat": 0x8A8A8AFF,
    "not_playing": 0xCC79A7FF,
    "typing": 0xF0E442FF,
    "held_before_focus": 0x5A5A5AFF,
    "shortcut": 0x5A5A5AFF,
}

_ACTION_COLOURS = (0x0072B2FF, 0xE69F00FF, 0x009E73FF, 0xCC79A7FF, 0x56B4E9FF, 0xD55E00FF, 0xF0E442FF)


def session_root(log: SessionLog) -> str:
    """Return the root path of a session's entities in the recording, such as "sub-07_ses-01"."""
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def send_session(recording: rr.RecordingStream, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send everything about a session except the participant's view to the recording."""
    root = session_root(log)
    recording.log(
        f"{root}/facts", rr.TextDocument(build_facts_page(log), media_type=rr.MediaType.MARKDOWN), static=True
    )
    _send_maps(recording, root, log, timeline)
    _send_motion(recording, root, log, timeline)
    _send_partners(recording, root, log, timeline)
    _send_series(recording, root, log, timeline)
    _send_keys(recording, root, log, timeline)
    _send_steering(recording, root, log, timeline)
    _send_events(recording, root, log, timeline)


def send_views(recording: rr.RecordingStream, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the view of every episode, redrawn and checked against the log or as stored, and the views of partners.

    Raises:
        LogError: if a world no longer shows what the participant saw, and the log has no pictures.
        WorldError: if a world cannot be run here, and the log has no pictures.
    """
    root = session_root(log)
    files: dict[str, io.BytesIO] = {}
    videos: dict[str, VideoWriter] = {}
    times: dict[str, list[NDArray[np.int64]]] = defaultdict(list)
    with ExitStack() as stack:
        for episode in log.episodes:
            views = {"view": render_frames(episode)}
            views |= {f"view-seat-{seat}": render_partner_frames(episode, seat) for seat in list_partner_seats(episode)}
            for name, pictures in views.items():
                if name not in videos:
                    files[name] = io.BytesIO()
                    videos[name] = stack.enter_context(VideoWriter(files[name], "replay", fps=_VIDEO_FPS))
                videos[name].write(fit_picture(picture, SIZE_PX) for picture in pictures)
                times[name].append(episode.t_ns)
    for name, video in videos.items():
        asset = rr.AssetVideo(contents=files[name].getvalue(), media_type="video/mp4")
        recording.log(f"{root}/{name}", asset, static=True)
        columns = rr.VideoFrameReference.columns_nanos(np.arange(video.frames) * (1_000_000_000 // _VIDEO_FPS))
        recording.send_columns(f"{root}/{name}", timeline.columns(np.concatenate(times[name])), columns)


def _send_maps(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the walls and things of each episode's map, which appear at the episode's reset."""
    starts_ns = []
    floors = []
    for episode in log.episodes:
        if episode.start.map is not None:
            starts_ns.append(episode.t_ns[0])
            floors.append(episode.start.map)
    if not floors:
        return
    times = timeline.columns(starts_ns)
    walls = list(chain.from_iterable(floor.walls for floor in floors))
    strips = np.asarray(walls, np.float32).reshape(-1, 2, 2)
    columns = rr.LineStrips2D.columns(strips=strips, colors=[WALL] * len(strips))
    recording.send_columns(f"{root}/map/walls", times, columns.partition([len(floor.walls) for floor in floors]))
    things = list(chain.from_iterable(floor.things for floor in floors))
    points = rr.Points2D.columns(
        positions=np.array([(thing.x, thing.z) for thing in things], np.float32).reshape(-1, 2),
        radii=[thing.radius for thing in things],
        colors=np.array([int(thing.colour.lstrip("#") + "ff", 16) for thing in things], np.uint32),
        labels=[thing.name for thing in things],
    )
    recording.send_columns(f"{root}/map/things", times, points.partition([len(floor.things) for floor in floors]))


def _send_motion(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the agent's position and heading at every step, and its path and trail whenever it moved."""
    masks = [(episode, ~np.isnan(episode.poses[:, 0])) for episode in log.episodes]
    masks = [(episode, has_pose) for episode, has_pose in masks if has_pose.any()]
    if not masks:
        return
    times = np.concatenate([episode.t_ns[has_pose] for episode, has_pose in masks])
    poses = np.concatenate([episode.poses[has_pose] for episode, has_pose in masks])
    places = poses[:, [0, 2]].astype(np.float32)  # x and z
    lengths = [np.full(has_pose.sum(), _find_arrow_length(episode), np.float32) for episode, has_pose in masks]
    length = np.concatenate(lengths)
    heading = np.stack([np.cos(poses[:, 3]), -np.sin(poses[:, 3])], axis=1)  # in x and z, from the yaw
    arrows = rr.Arrows2D.columns(
        origins=places,
        vectors=(length[:, None] * heading).astype(np.float32),
        colors=np.full(len(places), AGENT, np.uint32),
        radii=length / 8,
    )
    recording.send_columns(f"{root}/map/agent", timeline.columns(times), arrows)
    ends = np.cumsum([has_pose.sum() for _, has_pose in masks])
    moves = [start + _find_moves(places[start:end]) for start, end in pairwise([0, *ends])]
    _send_lines(recording, root, timeline, times[np.concatenate(moves)], places[np.concatenate(moves)], moves)


def _send_partners(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the position, heading and path of a team's other bodies at every step."""
    for episode in log.episodes:
        for seat in list_partner_seats(episode):
            assert episode.team is not None
            poses = episode.team.poses[:, seat]
            has_pose = ~np.isnan(poses[:, 0])
            places = poses[has_pose][:, [0, 2]].astype(np.float32)  # x and z
            heading = np.stack([np.cos(poses[has_pose, 3]), -np.sin(poses[has_pose, 3])], axis=1)
            arrows = rr.Arrows2D.columns(
                origins=places,
                vectors=(_find_arrow_length(episode) * heading).astype(np.float32),
                colors=np.full(len(places), PARTNER, np.uint32),
                radii=np.full(len(places), _find_arrow_length(episode) / 8, np.float32),
            )
            times = timeline.columns(episode.t_ns[has_pose])
            recording.send_columns(f"{root}/map/seat-{seat}", times, arrows)
            strips = _build_strips(places, [(0, row + 1) for row in range(len(places))])
            lines = rr.LineStrips2D.columns(strips=strips, colors=np.full(len(places), PARTNER, np.uint32))
            recording.send_columns(f"{root}/map/path-seat-{seat}", times, lines)


def _send_lines(
    recording: rr.RecordingStream,
    root: str,
    timeline: ReplayTimeline,
    times: NDArray[np.int64],
    places: NDArray[np.float32],
    moves: Sequence[NDArray[np.int64]],
) -> None:
    """Send the agent's path since the episode began, and the trail of its latest moves.

    Args:
        recording: the recording.
        root: the root path of the session's entities.
        timeline: the session's timeline.
        times: the time of each move of all episodes, in nanoseconds.
        places: the position after each of these moves, float32[n, 2].
        moves: an array for each episode, with an element for each of its moves; only their number is used.
    """
    path: list[tuple[int, int]] = []
    trail: list[tuple[int, int]] = []
    for begin, end in pairwise(np.cumsum([0, *map(len, moves)]).tolist()):
        stride = math.ceil((end - begin) / _PATH_ROWS)
        trail_rows = max(_TRAIL_MOVES, stride)
        path += [(begin, row + 1) for row in range(begin, end, stride)]
        trail += [(max(begin, row - trail_rows), row + 1) for row in range(begin, end)]
    lines = (("path", path, PATH), ("trail", trail, TRAIL))
    for order, (name, windows, colour) in enumerate(lines, _FIRST_LINE_ORDER):
        columns = rr.LineStrips2D.columns(
            strips=_build_strips(places, windows),
            colors=np.full(len(windows), colour, np.uint32),
            draw_order=np.full(len(windows), order, np.float32),  # the trail lies on the path
        )
        rows = timeline.columns(times[[end - 1 for _, end in windows]])
        recording.send_columns(f"{root}/map/{name}", rows, columns)


def _find_moves(places: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the index of the first of an episode's positions (n, 2), and of each that differs from the one before."""
    return np.concatenate([[0], 1 + np.flatnonzero((np.diff(places, axis=0) != 0).any(axis=1))])


def _find_arrow_length(episode: EpisodeLog) -> float:
    """Return the length of the arrow of the agent's heading, in the map's unit; without a map, in metres."""
    if episode.start.map is None:
        return _ARROW_LENGTHS["m"]
    return _ARROW_LENGTHS[episode.start.map.unit]


def _build_strips(places: NDArray[np.float32], windows: Sequence[tuple[int, int]]) -> pa.Array:
    """Return, as an Arrow array, a line strip for each window [begin, end) through these rows of positions (n, 2)."""
    lengths = np.array([end - begin for begin, end in windows])
    rows = np.concatenate([np.arange(begin, end) for begin, end in windows])
    points = pa.FixedSizeListArray.from_arrays(pa.array(places[rows].ravel()), type=_POINT)
    return pa.ListArray.from_arrays(np.cumsum([0, *lengths]).astype(np.int32), points, type=_STRIP)


def _send_series(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the reward and return at each step, and the reaction times."""
    _send_rewards(recording, f"{root}/reward", log, timeline)
    _send_returns(recording, f"{root}/return", log, timeline)
    _send_reaction_times(recording, f"{root}/reaction_ms", log, timeline)


def _send_rewards(recording: rr.RecordingStream, path: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    style = rr.SeriesPoints(names="reward", colors=TRAIL, markers="circle", marker_sizes=3)
    times_ns = [episode.t_ns[1:] for episode in log.episodes]
    rewards = [episode.rewards for episode in log.episodes]
    _send_scalars(recording, path, style, timeline, times_ns, rewards)


def _send_returns(recording: rr.RecordingStream, path: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send the return at each step as a staircase: level until the step, then a jump."""
    style = rr.SeriesLines(names="return", colors=PATH, widths=2)
    times_ns = []
    pairs = []
    last_return = 0.0
    for episode in log.episodes:
        returns = np.concatenate([[0.0], np.cumsum(episode.rewards)])
        returns_before = np.concatenate([[last_return], returns[:-1]])
        times_ns.append(np.repeat(episode.t_ns, 2))
        pairs.append(np.column_stack([returns_before, returns]).ravel())
        last_return = float(returns[-1])
    _send_scalars(recording, path, style, timeline, times_ns, pairs)


def _send_reaction_times(recording: rr.RecordingStream, path: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    style = rr.SeriesPoints(names="reaction time from onset (ms)", colors=AGENT, markers="circle", marker_sizes=3)
    times_ns = []
    reactions_ms = []
    for episode in log.episodes:
        all_ms = response_ms(episode)
        is_answered = ~np.isnan(all_ms)
        times_ns.append(episode.t_ns[1:][is_answered])
        reactions_ms.append(all_ms[is_answered])
    _send_scalars(recording, path, style, timeline, times_ns, reactions_ms)


def _send_scalars(
    recording: rr.RecordingStream,
    path: str,
    style: rr.SeriesPoints | rr.SeriesLines,
    timeline: ReplayTimeline,
    times_ns: Sequence[NDArray[np.int64]],
    scalars: Sequence[NDArray[np.float64]],
) -> None:
    """Send a series of numbers with its style; ``times_ns`` and ``scalars`` have an array for each episode."""
    if not times_ns:
        return
    recording.log(path, style, static=True)
    rows = timeline.columns(np.concatenate(times_ns))
    recording.send_columns(path, rows, rr.Scalars.columns(scalars=np.concatenate(scalars)))


def _send_keys(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send a lane for each physical key, which shows the verdict on a press from the press until the release."""
    lanes: dict[str, list[KeyPressed]] = defaultdict(list)
    for press in log.keys:
        if press.verdict != "repeat":
            lanes[press.key].append(press)
    actions: dict[str, dict[str, None]] = defaultdict(dict)  # of each key, in the order of assignment
    for episode in log.episodes:
        for key, action in episode.plan.key_map.keys.items():
            actions[key].setdefault(action)
    states = list(_KEY_STATES)
    for key, presses in sorted(lanes.items()):
        lane_name = "-".join((key, *actions.get(key, ())))
        lane = f"{root}/keys/{lane_name}"
        style = rr.StateConfiguration(values=states, labels=states, colors=list(_KEY_STATES.values()))
        recording.log(lane, style, static=True)
        columns = rr.StateChange.columns(state=[_find_key_state(press) for press in presses])
        recording.send_columns(lane, timeline.columns([press.t_ns for press in presses]), columns)


def _find_key_state(press: KeyPressed) -> str:
    """Return the state that a key event gives the key's lane: the verdict on a press, "" for a release."""
    if press.down:
        return press.verdict
    return ""


def _send_steering(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send two lanes: the policy's advice after each picture, and the person's actions while in control."""
    lanes: dict[str, list[tuple[int, str]]] = {"policy": [], "person": []}
    names: dict[str, None] = {}
    for episode in log.episodes:
        taught = episode.taught
        if taught is None:
            continue
        action_names = episode.start.action_names
        for step, t_ns in enumerate(episode.t_ns[:-1].tolist()):
            advice = int(taught.policy_actions[step])
            advised_action = ""
            if advice != NO_ADVICE:
                advised_action = action_names[advice]
            person_action = ""
            if taught.by_person[step]:
                person_action = action_names[int(episode.actions[step])]
            lanes["policy"].append((t_ns, advised_action))
            lanes["person"].append((t_ns, person_action))
        for lane in lanes.values():
            lane.append((int(episode.t_ns[-1]), ""))  # the lanes are empty until the next episode
        names |= dict.fromkeys(action_names)
    for name, changes in lanes.items():
        if changes:
            states = list(names)
            colours = [_ACTION_COLOURS[number % len(_ACTION_COLOURS)] for number in range(len(names))]
            style = rr.StateConfiguration(values=states, labels=states, colors=colours)
            recording.log(f"{root}/steering/{name}", style, static=True)
            columns = rr.StateChange.columns(state=[action for _, action in changes])
            recording.send_columns(f"{root}/steering/{name}", timeline.columns([t for t, _ in changes]), columns)


def _send_events(recording: rr.RecordingStream, root: str, log: SessionLog, timeline: ReplayTimeline) -> None:
    """Send readable lines about episodes, key presses, pauses and notes, in order of time."""
    lines = list(chain.from_iterable(map(_list_episode_lines, log.episodes)))
    lines += [_describe_press(press) for press in log.keys if press.down and press.verdict != "repeat"]
    for note in log.notes:
        match note:
            case Paused():
                lines.append((note.t_ns, "WARN", f"paused: {note.reason}"))
            case Resumed():
                lines.append((note.t_ns, "INFO", "resumed"))
            case _ if "error" in note.kind:
                lines.append((note.t_ns, "ERROR", f"{note.kind}: {note.text}"))
            case _:
                lines.append((note.t_ns, "INFO", f"{note.kind}: {note.text}"))
    lines.sort(key=operator.itemgetter(0))
    if lines:
        times_ns, levels, texts = zip(*lines, strict=True)
        columns = rr.TextLog.columns(text=list(texts), level=list(levels))
        recording.send_columns(f"{root}/events", timeline.columns(list(times_ns)), columns)


def _describe_press(press: KeyPressed) -> tuple[int, str, str]:
    """Return the time in ns, the log level and the text of the line about a key press."""
    level = "WARN"
    if press.verdict in ("accepted", "queued"):
        level = "INFO"
    return press.t_ns, level, f"key {press.key}: {press.verdict.replace('_', ' ')} ({press.phase})"


def _list_episode_lines(episode: EpisodeLog) -> list[tuple[int, str, str]]:
    """Return the time in ns, the log level and the text of the lines about an episode's start and end."""
    plan = episode.plan
    n_steps = len(episode.actions)
    start = f"{episode.name} begins: {plan.world}, seed {plan.seed}; {episode.start.mission}"
    end = f"{episode.name} ends: {episode.outcome_word}, {n_steps} steps, return {episode.return_:.3f}"
    return [(int(episode.t_ns[0]), "INFO", start), (int(episode.t_ns[-1]), "INFO", end)]
