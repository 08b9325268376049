"""A log read back: as events, in the order they happened, or as a session of episodes."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Metadata
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log.decode import decode
from minihuman.log.episode import Episode, SessionLog
from minihuman.log.live import END_METADATA, SEGMENT_METADATA
from minihuman.log.paths import PART_SUFFIX, session_files
from minihuman.log.scan import LogMessage, Scan
from minihuman.log.topics import SCHEMA_VERSION
from minihuman.study import events as ev
from minihuman.worlds.pose import Pose

CUT_OFF = "cut_off"


def read_events(path: Path) -> Iterator[ev.Event]:
    """Yield a log's events in the order they were recorded.

    A live or cut-off log (``.mcap.part``) yields what is whole; a finished one must be whole.

    Raises:
        LogError: if the file is no session log, of another schema version, or damaged.
        OSError: if it cannot be opened.
    """
    return _Reading(path).events()


def open_log(path: Path) -> SessionLog:
    """Read a session: a finished log, a live or cut-off ``.mcap.part``, or a session's folder with all that is in it.

    Raises:
        LogError: if there is no session log, it is of another schema version, damaged, or holds no plan.
        OSError: if a file cannot be opened.
    """
    files = session_files(path) if path.is_dir() else [path]
    if not files:
        raise LogError(f"{path} holds no session log (*.mcap or *{PART_SUFFIX})")
    readings = [_Reading(file) for file in files]
    segments = _split([event for reading in readings for event in reading.events()])
    if not segments:
        raise LogError(f"{path} holds no session plan; it was cut off before the session started")
    return _session(path, segments, readings)


class _Reading:
    """One file's events; its segments' metadata are complete once the events are read."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.starts: list[dict[str, str]] = []
        self.ends: list[dict[str, str]] = []

    def events(self) -> Iterator[ev.Event]:
        scan = Scan(self.path)
        for record in scan:
            match record:
                case LogMessage():
                    if not self.starts:
                        raise LogError(f"{self.path} is not a minihuman log: nothing in it says which version it has")
                    event = self._decode(record)
                    if event is not None:
                        yield event
                case Metadata(name=str(name), metadata=dict(facts)) if name == SEGMENT_METADATA:
                    self.starts.append(_checked(facts, self.path))
                case Metadata(name=str(name), metadata=dict(facts)) if name == END_METADATA:
                    self.ends.append(facts)
        if not scan.finished and not self.path.name.endswith(PART_SUFFIX):
            reason = scan.stopped or "never finished"
            raise LogError(f"{self.path} is {reason}; rename it to *{PART_SUFFIX}, then run: minihuman recover")

    def _decode(self, message: LogMessage) -> ev.Event | None:
        try:
            return decode(message.channel.topic, message.data)
        except Exception as error:  # a foreign or newer message can make protobuf raise anything
            raise LogError(f"{self.path}: a message on {message.channel.topic} cannot be read: {error}") from error


def _checked(facts: dict[str, str], path: Path) -> dict[str, str]:
    version = facts.get("schema_version", "none")
    if version != str(SCHEMA_VERSION):
        raise LogError(
            f"{path} has log schema version {version}, this minihuman reads version {SCHEMA_VERSION}; "
            f"read it with the version that wrote it (minihuman {facts.get('minihuman', 'unknown')})"
        )
    return facts


def _split(events: Iterable[ev.Event]) -> list[list[ev.Event]]:
    """Cut at each SessionStarted."""
    segments: list[list[ev.Event]] = []
    for event in events:
        if isinstance(event, ev.SessionStarted):
            segments.append([])
        if segments:
            segments[-1].append(event)
    return segments


def _session(path: Path, segments: list[list[ev.Event]], readings: list[_Reading]) -> SessionLog:
    first, last = segments[0][0], segments[-1][-1]
    assert isinstance(first, ev.SessionStarted)
    starts = [facts for reading in readings for facts in reading.starts]
    ends = [facts for reading in readings for facts in reading.ends]
    events = [event for segment in segments for event in segment]
    return SessionLog(
        path=path,
        plan=first.plan,
        player=first.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        clean=len(ends) == len(starts) and all(end["clean"] == "true" for end in ends),
        end_reason=last.reason if isinstance(last, ev.SessionEnded) else CUT_OFF,
        facts=first.facts,
        episodes=tuple(
            episode
            for number, segment in zip(starts, segments, strict=True)
            for episode in _episodes(segment, segment=int(number["segment"]))
        ),
        notes=tuple(event for event in events if isinstance(event, ev.Noted | ev.Paused | ev.Resumed)),
        keys=tuple(event for event in events if isinstance(event, ev.KeyPressed)),
        metadata={"segments": starts, "ends": ends},
    )


def _episodes(events: Iterable[ev.Event], *, segment: int) -> Iterator[Episode]:
    """Gather each episode's events; those between episodes belong to none."""
    gathering: _Gathering | None = None
    for event in events:
        match event:
            case ev.EpisodeStarted():
                if gathering is not None:
                    yield gathering.episode(None, segment)
                gathering = _Gathering(event)
            case ev.EpisodeEnded() if gathering is not None:
                yield gathering.episode(event, segment)
                gathering = None
            case ev.Stepped() if gathering is not None:
                gathering.steps.append(event)
            case ev.KeyPressed() if gathering is not None:
                gathering.keys.append(event)
            case ev.FrameShown() if gathering is not None:
                gathering.frames.append(event)
    if gathering is not None:
        yield gathering.episode(None, segment)


class _Gathering:
    """An episode as far as it has been read."""

    def __init__(self, start: ev.EpisodeStarted) -> None:
        self.start = start
        self.steps: list[ev.Stepped] = []
        self.keys: list[ev.KeyPressed] = []
        self.frames: list[ev.FrameShown] = []

    def episode(self, end: ev.EpisodeEnded | None, segment: int) -> Episode:
        start, steps = self.start, self.steps
        moments: list[ev.EpisodeStarted | ev.Stepped] = [start, *steps]
        return Episode(
            start=start,
            poses=np.array([_row(event.pose) for event in moments], dtype=np.float64),
            t_ns=_column([event.t_ns for event in moments], np.int64),
            actions=_column([step.action for step in steps], np.int64),
            step_keys=tuple(step.key for step in steps),
            key_t_ns=_column([step.key_t_ns for step in steps], np.int64),
            rewards=_column([step.reward for step in steps], np.float64),
            terminated=_column([step.terminated for step in steps], np.bool_),
            truncated=_column([step.truncated for step in steps], np.bool_),
            rt_ms=_column([np.nan if step.rt_ms is None else step.rt_ms for step in steps], np.float64),
            state_hashes=_column([event.state_hash for event in moments], np.uint64),
            observation_hashes=_column([event.observation_hash for event in moments], np.uint64),
            keys=tuple(self.keys),
            frames=tuple(self.frames),
            outcome=None if end is None else end.outcome,
            segment=segment,
        )


def _row(pose: Pose | None) -> tuple[float, float, float, float]:
    return (np.nan,) * 4 if pose is None else (pose.x, pose.y, pose.z, pose.yaw_rad)


def _column(values: list[Any], dtype: Any) -> NDArray[Any]:
    return np.array(values, dtype=dtype)
