"""A log read back: as events, in the order they happened, or as a session of episodes."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log.episode import Episode, SessionLog, pose_row
from minihuman.log.paths import PART_SUFFIX, sessions_in
from minihuman.log.reading import CUT_OFF, Reading, all_clean
from minihuman.study import events as ev


def read_events(path: Path) -> Iterator[ev.Event]:
    """Yield a log's events in the order they were recorded.

    A live or cut-off log (``.mcap.part``) yields what is whole; a finished one must be whole.

    Raises:
        LogError: if the file cannot be opened, is no session log, of another schema version, or damaged.
    """
    return Reading(path).events()


def open_log(path: Path) -> SessionLog:
    """Read a session: a finished log, a live or cut-off ``.mcap.part``, or a session's folder with every segment in it.

    Raises:
        LogError: if there is no session log, it is of another schema version, damaged, or holds no plan.
    """
    files = _files(path)
    readings = [Reading(file) for file in files]
    segments = _split([event for reading in readings for event in reading.events()])
    if not segments:
        raise LogError(f"{path} holds no session plan; it was cut off before the session started")
    try:
        return _session(path, segments, readings)
    except LogError as error:
        raise LogError(f"{path}: {error}") from error


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    sessions = sessions_in(path)
    if len(sessions) != 1:
        raise LogError(f"{path} holds {len(sessions)} session logs (*.mcap or *{PART_SUFFIX}), not one; name a file")
    (files,) = sessions.values()
    return files


def _split(events: Iterable[ev.Event]) -> list[list[ev.Event]]:
    """Cut at each SessionStarted."""
    segments: list[list[ev.Event]] = []
    for event in events:
        if isinstance(event, ev.SessionStarted):
            segments.append([])
        if segments:
            segments[-1].append(event)
    return segments


def _session(path: Path, segments: list[list[ev.Event]], readings: list[Reading]) -> SessionLog:
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
        clean=all_clean(starts, ends),
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
                gathering.add(event)
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

    def add(self, step: ev.Stepped) -> None:
        expected = (self.start.plan.episode, len(self.steps) + 1)
        if (step.episode, step.step) != expected:
            raise LogError(
                f"episode {step.episode} step {step.step} follows episode {expected[0]} step {expected[1] - 1}; "
                "something between them is missing"
            )
        self.steps.append(step)

    def episode(self, end: ev.EpisodeEnded | None, segment: int) -> Episode:
        start, steps = self.start, self.steps
        moments: list[ev.EpisodeStarted | ev.Stepped] = [start, *steps]
        return Episode(
            start=start,
            poses=np.array([pose_row(event.pose) for event in moments], dtype=np.float64),
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


def _column(values: list[Any], dtype: Any) -> NDArray[Any]:
    return np.array(values, dtype=dtype)
