"""A session gathered from its messages: each kind in a row, then all of a kind made into columns at once.

No object is made of a step, a key press or a picture shown: that is what makes a study quick to read.
"""

from bisect import bisect
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from operator import itemgetter
from typing import Any, get_args

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.observations import Observations
from minihuman.log.plan_messages import one_of
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.chunk import OfTopic
from minihuman.log.read.file import Reading
from minihuman.log.read.wire import Column, Columns, read_columns
from minihuman.recorded.columns import NO_ACTION, EventColumns
from minihuman.recorded.episode import Episode, pose_row
from minihuman.study import events as ev

_AXES = ("x", "y", "z", "yaw_rad")
_THOUSANDS: dict[str, type[Message]] = {topics.STEP: v1.Step, topics.KEY: v1.KeyEvent, topics.FRAME: v1.FrameShown}
_VERDICTS = get_args(ev.Verdict)
_TRUTHS = frozenset(topic.name for topic in topics.TOPICS if not topic.for_viewers) - {topics.SAMPLE}


@dataclass(slots=True)
class _Span:
    """An episode as far as it has been read: its messages are those between two places."""

    start: ev.EpisodeStarted
    segment: int  # 0 for the first that was read
    begin: int
    end: int | None = None  # None: the log broke off first
    outcome: ev.Outcome | None = None


class _Rows:
    """All of a session's messages on one topic: their places among all, and their fields, read when asked for."""

    def __init__(self, topic: str, found: Sequence[OfTopic], data: bytes) -> None:
        self._topic = topic
        self.places, self._begins, self._ends = (
            np.concatenate([np.zeros(0, np.int64), *(getattr(of_topic, name) for of_topic in found)])
            for name in ("places", "begins", "ends")
        )
        self._data = data

    @cached_property
    def _columns(self) -> Columns:
        return read_columns(_THOUSANDS[self._topic], self._data, self._begins, self._ends)

    def column(self, name: str) -> Column:
        """One field of them all.

        Raises:
            LogError: if it cannot be read.
        """
        try:
            return self._columns[name]
        except ValueError as error:
            raise LogError(f"a message on {self._topic} cannot be read: {error}") from error

    def within(self, span: _Span) -> slice:
        """Which of them belong to an episode."""
        begin = int(np.searchsorted(self.places, span.begin))
        return slice(begin, len(self.places) if span.end is None else int(np.searchsorted(self.places, span.end)))


class Gathering:
    """Takes a session's messages in the order they were recorded. What lies between episodes belongs to none."""

    def __init__(self) -> None:
        self.started: list[ev.SessionStarted] = []  # one a segment
        self.ended: ev.SessionEnded | None = None  # the last segment's, if it said so
        self.notes: list[ev.Noted | ev.Paused | ev.Resumed] = []
        self._chunks: list[bytes] = []  # that hold messages of the topics that have thousands
        self._found: dict[str, list[OfTopic]] = defaultdict(list)  # among those chunks' bytes
        self._observed: tuple[list[int], list[bytes]] = ([], [])  # places and messages, not looked at yet
        self._spans: list[_Span] = []
        self._count = 0  # of messages, so far
        self._size = 0  # of those chunks, so far

    def read(self, reading: Reading) -> None:
        """Take a file's messages.

        Raises:
            LogError: as ``Reading.events``, but for steps, keys and pictures.
        """
        for chunk in reading.chunks():
            others: list[tuple[int, str, bytes]] = []
            size = self._size
            for topic, places, begins, ends in chunk.by_topic(among=_TRUTHS):
                if topic in _THOUSANDS:
                    self._found[topic].append(OfTopic(topic, places + self._count, begins + size, ends + size))
                    self._size = size + len(chunk.data)
                else:
                    numbers = (self._count + places).tolist()
                    payloads = [
                        chunk.data[begin:end] for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)
                    ]
                    if topic == topics.OBSERVATION:
                        self._observed[0].extend(numbers)
                        self._observed[1].extend(payloads)
                    else:
                        others += ((number, topic, data) for number, data in zip(numbers, payloads, strict=True))
            if self._size > size:
                self._chunks.append(chunk.data)
            for place, topic, data in sorted(others, key=itemgetter(0)):
                self._take(place, reading.event(topic, data))
            self._count += len(chunk)

    def keys_and_episodes(self, segments: Sequence[int]) -> tuple[EventColumns[ev.KeyPressed], tuple[Episode, ...]]:
        """Every key press and release of the session, and every episode in the order played.

        ``segments`` are the numbers of those that were read.

        Raises:
            LogError: if a step or a key press cannot be read, or a step is missing. Pictures are read when looked at.
        """
        data = b"".join(self._chunks)
        steps, downs, pictures = (_Rows(topic, self._found[topic], data) for topic in _THOUSANDS)
        keys, shown = _presses(downs.column, len(downs.places)), _frames(pictures.column, len(pictures.places))
        of_steps = [steps.within(span) for span in self._spans]
        moments = _moments([span.start for span in self._spans], [its.start for its in of_steps], steps.column)
        by_step = _by_step(steps.column)
        numbers = [steps.column(name).values for name in ("episode", "step")]
        step_keys = steps.column("key").values
        episodes = []
        for number, (span, its) in enumerate(zip(self._spans, of_steps, strict=True)):
            _check(span.start.plan.episode, *(column[its] for column in numbers))
            with_reset = slice(its.start + number, its.stop + number + 1)  # every episode before has a reset too
            episodes.append(
                Episode(
                    start=span.start,
                    **{name: column[with_reset] for name, column in moments.items()},
                    **{name: column[its] for name, column in by_step.items()},
                    step_keys=step_keys[its],
                    keys=keys[downs.within(span)],
                    frames=shown[pictures.within(span)],
                    outcome=span.outcome,
                    observations=self._observations(span, its.stop - its.start),
                    segment=segments[span.segment],
                )
            )
        return keys, tuple(episodes)

    def _observations(self, span: _Span, steps: int) -> Observations | None:
        """What was observed in an episode; a log may break off between an observation and its step."""
        places, messages = self._observed
        its = messages[bisect(places, span.begin) : None if span.end is None else bisect(places, span.end)]
        return Observations(span.start.plan.episode, its[: steps + 1]) if len(its) > steps else None

    def _take(self, place: int, event: ev.Event | None) -> None:
        match event:
            case ev.SessionStarted():
                self._close(place)
                self.started.append(event)
                self.ended = None
            case ev.SessionEnded():
                self.ended = event
            case ev.EpisodeStarted():
                self._close(place)
                self._spans.append(_Span(event, len(self.started) - 1, begin=place))
            case ev.EpisodeEnded():
                self._close(place, event.outcome)
            case ev.Noted() | ev.Paused() | ev.Resumed():
                self.notes.append(event)

    def _close(self, place: int, outcome: ev.Outcome | None = None) -> None:
        """End the last episode, if it has not ended."""
        if self._spans and self._spans[-1].end is None:
            self._spans[-1].end, self._spans[-1].outcome = place, outcome


def _check(episode: int, episodes: NDArray[np.int64], steps: NDArray[np.int64]) -> None:
    """Refuse an episode in which a step is missing, or another's is."""
    wrong = np.flatnonzero((episodes != episode) | (steps != np.arange(1, len(steps) + 1)))
    if wrong.size:
        first = wrong[0]
        raise LogError(
            f"episode {episodes[first]} step {steps[first]} follows episode {episode} step {first}; "
            "something between them is missing"
        )


def _by_step(column: Callable[[str], Column]) -> dict[str, NDArray[Any]]:
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


def _moments(
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


def _presses(column: Callable[[str], Column], count: int) -> EventColumns[ev.KeyPressed]:
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


def _frames(column: Callable[[str], Column], count: int) -> EventColumns[ev.FrameShown]:
    """Pictures shown from the columns of their messages."""
    return EventColumns(ev.FrameShown, lambda name: column(name).values, range(count))
