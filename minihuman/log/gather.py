"""A session gathered from its messages: each kind in a row, then all of a kind made into columns at once.

No event is made of a step, a key press or a picture shown: that is what makes a study quick to read.
"""

from bisect import bisect
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from typing import Any, Generic, TypeVar

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.columns import EventColumns, frames, presses
from minihuman.log.episode import Episode, pose_row
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.reading import Reading
from minihuman.study import events as ev

M = TypeVar("M", bound=Message)
_AXES = ("x", "y", "z", "yaw_rad")
_NOWHERE = v1.Pose(**dict.fromkeys(_AXES, np.nan))
_FOR_VIEWERS = frozenset(topic.name for topic in topics.TOPICS if topic.for_viewers)


@dataclass(slots=True)
class _Span:
    """An episode as far as it has been read: its messages are those between two places."""

    start: ev.EpisodeStarted
    segment: int  # 0 for the first that was read
    begin: int
    end: int | None = None  # None: the log broke off first
    outcome: ev.Outcome | None = None


@dataclass(slots=True)
class _Kind(Generic[M]):
    """All messages of a topic that has thousands: their places among all of the session's, and their bytes."""

    topic: str
    message: type[M]
    places: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)

    def parsed(self) -> list[M]:
        """The messages themselves.

        Raises:
            LogError: if one cannot be read.
        """
        try:
            return [self.message.FromString(data) for data in self.payloads]
        except Exception as error:  # a foreign or newer message can make protobuf raise anything
            raise LogError(f"a message on {self.topic} cannot be read: {error}") from error

    def within(self, span: _Span) -> slice:
        """Which of them belong to an episode."""
        end = len(self.places) if span.end is None else bisect(self.places, span.end)
        return slice(bisect(self.places, span.begin), end)


class Gathering:
    """Takes a session's messages in the order they were recorded. What lies between episodes belongs to none."""

    def __init__(self) -> None:
        self.started: list[ev.SessionStarted] = []  # one a segment
        self.ended: ev.SessionEnded | None = None  # the last segment's, if it said so
        self.notes: list[ev.Noted | ev.Paused | ev.Resumed] = []
        self._steps = _Kind(topics.STEP, v1.Step)
        self._keys = _Kind(topics.KEY, v1.KeyEvent)
        self._frames = _Kind(topics.FRAME, v1.FrameShown)
        self._spans: list[_Span] = []
        self._count = 0  # of messages, so far

    def read(self, reading: Reading) -> None:
        """Take a file's messages.

        Raises:
            LogError: as ``Reading.events``, but for steps, keys and pictures.
        """
        kinds: dict[str, _Kind[Any]] = {kind.topic: kind for kind in (self._steps, self._keys, self._frames)}
        for chunk in reading.chunks():
            others: list[tuple[int, str, bytes]] = []
            for topic, (places, payloads) in chunk.by_topic().items():
                if topic in kinds:
                    kinds[topic].places += [self._count + place for place in places]
                    kinds[topic].payloads += payloads
                elif topic not in _FOR_VIEWERS:
                    others += ((self._count + place, topic, data) for place, data in zip(places, payloads, strict=True))
            for place, topic, data in sorted(others, key=itemgetter(0)):
                self._take(place, reading.event(topic, data))
            self._count += len(chunk)

    def keys(self) -> EventColumns[ev.KeyPressed]:
        """Every key press and release of the session.

        Raises:
            LogError: if one cannot be read.
        """
        return presses(self._keys.parsed())

    def episodes(self, keys: EventColumns[ev.KeyPressed], segments: Sequence[int]) -> Iterator[Episode]:
        """Every episode, in the order played; ``segments`` are the numbers of those that were read.

        Raises:
            LogError: if a step or a picture cannot be read, or a step is missing.
        """
        shown, messages = frames(self._frames.parsed()), self._steps.parsed()
        of_steps = [self._steps.within(span) for span in self._spans]
        steps = _steps(messages)
        moments = _moments([span.start for span in self._spans], [its.start for its in of_steps], messages)
        step_keys = tuple(message.key for message in messages)
        for number, (span, its) in enumerate(zip(self._spans, of_steps, strict=True)):
            _check(span.start.plan.episode, messages[its])
            with_reset = slice(its.start + number, its.stop + number + 1)  # every episode before has a reset too
            yield Episode(
                start=span.start,
                **{name: column[with_reset] for name, column in moments.items()},
                **{name: column[its] for name, column in steps.items()},
                step_keys=step_keys[its],
                keys=keys[self._keys.within(span)],
                frames=shown[self._frames.within(span)],
                outcome=span.outcome,
                segment=segments[span.segment],
            )

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


def _check(episode: int, steps: Sequence[v1.Step]) -> None:
    """Refuse an episode in which a step is missing, or another's is."""
    for number, step in enumerate(steps, 1):
        if (step.episode, step.step) != (episode, number):
            raise LogError(
                f"episode {step.episode} step {step.step} follows episode {episode} step {number - 1}; "
                "something between them is missing"
            )


def _steps(messages: Sequence[v1.Step]) -> dict[str, NDArray[Any]]:
    """The columns of ``Episode`` that have a row for each step."""
    rt_ms = [message.rt_ms if message.HasField("rt_ms") else np.nan for message in messages]
    return {
        "actions": np.array([message.action for message in messages], np.int64),
        "key_t_ns": np.array([message.key_t_ns for message in messages], np.int64),
        "rewards": np.array([message.reward for message in messages], np.float64),
        "terminated": np.array([message.terminated for message in messages], np.bool_),
        "truncated": np.array([message.truncated for message in messages], np.bool_),
        "rt_ms": np.array(rt_ms, np.float64),
    }


def _moments(
    starts: Sequence[ev.EpisodeStarted], resets: Sequence[int], messages: Sequence[v1.Step]
) -> dict[str, NDArray[Any]]:
    """The columns of ``Episode`` that have a row for its reset and one for each step, put before its first."""
    poses = [message.pose if message.HasField("pose") else _NOWHERE for message in messages]
    after = np.stack([np.array([getattr(pose, axis) for pose in poses], np.float64) for axis in _AXES], axis=1)
    first = np.array([pose_row(start.pose) for start in starts], np.float64).reshape(-1, len(_AXES))
    columns: dict[str, NDArray[Any]] = {"poses": np.insert(after, resets, first, axis=0)}
    for column, name, dtype in (
        ("t_ns", "t_ns", np.int64),
        ("state_hashes", "state_hash", np.uint64),
        ("observation_hashes", "observation_hash", np.uint64),
    ):
        after = np.array([getattr(message, name) for message in messages], dtype)
        columns[column] = np.insert(after, resets, np.array([getattr(start, name) for start in starts], dtype))
    return columns
