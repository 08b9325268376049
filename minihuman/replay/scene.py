"""What the replay shows of a session, sent column by column: map, path, heading, keys, numbers, words.

Sending whole columns makes a session's recording tens of times faster than logging it step by step.
"""

import io
from collections import defaultdict

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from PIL import Image

from minihuman.log.episode import Episode, SessionLog
from minihuman.replay.facts import facts_page
from minihuman.replay.moments import Moments
from minihuman.replay.views import redraw
from minihuman.study.events import KeyPressed, Paused, Resumed
from minihuman.worlds.adapt import World

WALL, PATH, TRAIL, AGENT = 0xC8C8C8FF, 0x0072B2FF, 0xE69F00FF, 0xD55E00FF
_TRAIL_MOVES = 12
_PATH_ROWS = 400  # a longer path is redrawn every few moves: the whole of it each time would grow with the square
_HEADING = {"cell": 0.8, "m": 0.7}
_KEY_STATES = {  # what became of a press: label, colour
    "accepted": 0x009E73FF,
    "queued": 0x56B4E9FF,
    "spare": 0xE69F00FF,
    "unmapped": 0xD55E00FF,
    "repeat": 0x8A8A8AFF,
    "not_playing": 0xCC79A7FF,
}


def session_root(log: SessionLog) -> str:
    """Where a session's things are in the recording: "sub-07_ses-01"."""
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def send_session(recording: rr.RecordingStream, log: SessionLog, moments: Moments) -> None:
    """Send everything but the participant's view."""
    root = session_root(log)
    recording.log(f"{root}/facts", rr.TextDocument(facts_page(log), media_type=rr.MediaType.MARKDOWN), static=True)
    _send_maps(recording, root, log, moments)
    for episode in log.episodes:
        _send_motion(recording, root, episode, moments)
    _send_series(recording, root, log, moments)
    _send_keys(recording, root, log, moments)
    _send_events(recording, root, log, moments)


def send_views(recording: rr.RecordingStream, log: SessionLog, moments: Moments) -> None:
    """Send the participant's view of every episode, drawn again and checked against the log.

    Raises:
        LogError: if what a world shows now is not what was seen.
        WorldError: if a world cannot be run here.
    """
    for episode in log.episodes:
        world = World(episode.plan.world, episode.plan.options)
        pictures = [_png(picture) for picture in redraw(episode, world)]
        world.close()
        columns = rr.EncodedImage.columns(blob=pictures, media_type=["image/png"] * len(pictures))
        recording.send_columns(f"{session_root(log)}/view", moments.columns(episode.t_ns), columns)


def _png(picture: NDArray[np.uint8]) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "png", compress_level=1)
    return file.getvalue()


def _send_maps(recording: rr.RecordingStream, root: str, log: SessionLog, moments: Moments) -> None:
    told = [(episode.t_ns[0], episode.start.map) for episode in log.episodes if episode.start.map is not None]
    if not told:
        return
    times = moments.columns([t_ns for t_ns, _ in told])
    walls = [wall for _, floor in told for wall in floor.walls]
    strips = np.asarray(walls, np.float32).reshape(-1, 2, 2)
    columns = rr.LineStrips2D.columns(strips=strips, colors=[WALL] * len(strips))
    recording.send_columns(f"{root}/map/walls", times, columns.partition([len(floor.walls) for _, floor in told]))
    things = [thing for _, floor in told for thing in floor.things]
    points = rr.Points2D.columns(
        positions=np.array([(thing.x, thing.z) for thing in things], np.float32).reshape(-1, 2),
        radii=[thing.radius for thing in things],
        colors=np.array([int(thing.colour.lstrip("#") + "ff", 16) for thing in things], np.uint32),
        labels=[thing.name for thing in things],
    )
    recording.send_columns(f"{root}/map/things", times, points.partition([len(floor.things) for _, floor in told]))


def _send_motion(recording: rr.RecordingStream, root: str, episode: Episode, moments: Moments) -> None:
    """The agent at every step; path and trail whenever it moved."""
    told = np.flatnonzero(~np.isnan(episode.poses[:, 0]))
    if not told.size:
        return
    places = episode.poses[told][:, [0, 2]].astype(np.float32)
    yaw = episode.poses[told, 3]
    length = _HEADING[episode.start.map.unit if episode.start.map else "m"]
    arrows = rr.Arrows2D.columns(
        origins=places,
        vectors=(length * np.stack([np.cos(yaw), -np.sin(yaw)], axis=1)).astype(np.float32),
        colors=[AGENT] * len(places),
        radii=[length / 8] * len(places),
    )
    times = episode.t_ns[told]
    recording.send_columns(f"{root}/map/agent", moments.columns(times), arrows)
    moved = np.concatenate([[0], 1 + np.flatnonzero((np.diff(places, axis=0) != 0).any(axis=1))])
    stride = -(-len(moved) // _PATH_ROWS)
    ends = np.arange(len(moved))
    for name, rows, firsts, colour in (
        ("path", ends[::stride], np.zeros(len(ends[::stride]), int), PATH),
        ("trail", ends, np.maximum(0, ends - max(_TRAIL_MOVES, stride)), TRAIL),
    ):
        strips = [places[moved[first : end + 1]] for first, end in zip(firsts, rows, strict=True)]
        columns = rr.LineStrips2D.columns(strips=strips, colors=[colour] * len(strips))
        recording.send_columns(f"{root}/map/{name}", moments.columns(times[moved[rows]]), columns)


def _send_series(recording: rr.RecordingStream, root: str, log: SessionLog, moments: Moments) -> None:
    """Reward and return a step, and reaction times where there are any."""
    series: dict[str, tuple[list[NDArray[np.int64]], list[NDArray[np.float64]]]] = defaultdict(lambda: ([], []))
    for episode in log.episodes:
        answered = ~np.isnan(episode.rt_ms)
        for name, times, values in (
            ("reward", episode.t_ns[1:], episode.rewards),
            ("return", episode.t_ns, np.concatenate([[0.0], np.cumsum(episode.rewards)])),
            ("reaction_ms", episode.t_ns[1:][answered], episode.rt_ms[answered]),
        ):
            series[name][0].append(times)
            series[name][1].append(values)
    styles = {
        "reward": rr.SeriesPoints(names="reward", colors=TRAIL, markers="circle", marker_sizes=3),
        "return": rr.SeriesLines(names="return", colors=PATH, widths=2),
        "reaction_ms": rr.SeriesPoints(names="reaction time (ms)", colors=AGENT, markers="circle", marker_sizes=3),
    }
    for name, (all_times, all_values) in series.items():
        recording.log(f"{root}/{name}", styles[name], static=True)
        rows = moments.columns(np.concatenate(all_times))
        recording.send_columns(f"{root}/{name}", rows, rr.Scalars.columns(scalars=np.concatenate(all_values)))


def _send_keys(recording: rr.RecordingStream, root: str, log: SessionLog, moments: Moments) -> None:
    """A lane a physical key: what became of each press, until it came up."""
    lanes: dict[str, list[KeyPressed]] = defaultdict(list)
    for press in log.keys:
        if press.verdict != "repeat":
            lanes[press.key].append(press)
    states = list(_KEY_STATES)
    for key, presses in sorted(lanes.items()):
        lane = f"{root}/keys/{key}"
        style = rr.StateConfiguration(values=states, labels=states, colors=list(_KEY_STATES.values()))
        recording.log(lane, style, static=True)
        columns = rr.StateChange.columns(state=[press.verdict if press.down else "" for press in presses])
        recording.send_columns(lane, moments.columns([press.t_ns for press in presses]), columns)


def _send_events(recording: rr.RecordingStream, root: str, log: SessionLog, moments: Moments) -> None:
    """Readable lines: episodes, key presses, pauses and notes, in order of time."""
    lines = [line for episode in log.episodes for line in _episode_lines(episode)]
    lines += [(press.t_ns, "INFO" if press.action is not None else "WARN", _press_line(press)) for press in _downs(log)]
    for note in log.notes:
        match note:
            case Paused():
                lines.append((note.t_ns, "WARN", f"paused: {note.reason}"))
            case Resumed():
                lines.append((note.t_ns, "INFO", "resumed"))
            case _:
                lines.append((note.t_ns, "ERROR" if "error" in note.kind else "INFO", f"{note.kind}: {note.text}"))
    lines.sort(key=lambda line: line[0])
    if lines:
        columns = rr.TextLog.columns(text=[line[2] for line in lines], level=[line[1] for line in lines])
        recording.send_columns(f"{root}/events", moments.columns([line[0] for line in lines]), columns)


def _downs(log: SessionLog) -> list[KeyPressed]:
    return [press for press in log.keys if press.down and press.verdict != "repeat"]


def _press_line(press: KeyPressed) -> str:
    return f"key {press.key}: {press.verdict.replace('_', ' ')} ({press.phase})"


def _episode_lines(episode: Episode) -> list[tuple[int, str, str]]:
    plan = episode.plan
    number, steps = plan.episode + 1, len(episode.actions)
    began = f"episode {number} begins: {plan.world}, seed {plan.seed}; {episode.start.mission}"
    ended = f"episode {number} ends: {episode.outcome or 'cut off'}, {steps} steps, return {episode.return_:.3f}"
    return [(int(episode.t_ns[0]), "INFO", began), (int(episode.t_ns[-1]), "INFO", ended)]
