"""Rows of a session: the messages of one topic with their positions, and the columns of their fields.

Messages are collected per topic and converted to columns at once. No object is created per step, key press or frame,
which is what makes reading a study fast.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, cached_property
from typing import Any, get_args, overload

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.experiment.machine import events
from minihuman.log import topics
from minihuman.log.codec import decode_event, require_one_of
from minihuman.log.model.event_columns import NO_ACTION, EventColumns
from minihuman.log.model.session_log import pose_as_row
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.protobuf_columns import BEYOND, FieldColumn, MessageColumns
from minihuman.log.salvage.records import TopicMessages

FREQUENT_TOPICS: dict[str, type[Message]] = {topics.STEP: v1.Step, topics.KEY: v1.KeyEvent, topics.FRAME: v1.FrameShown}
_TIMES = frozenset({"t_ns", "pressed_ns", "key_t_ns", "submit_ns", "flip_ns"})  # columns that are times


class SampleSequence(Sequence[events.Sampled]):
    """A segment's samples in the order in which they were recorded, in session time.

    Raises:
        google.protobuf.message.DecodeError: when a message is accessed that is not a sample.
    """

    def __init__(self, messages: Sequence[bytes], start_ns: int) -> None:
        """Create the sequence.

        Args:
            messages: the encoded samples of one segment.
            start_ns: the session time at which the segment began.
        """
        self._messages = messages
        self._start_ns = start_ns

    def __len__(self) -> int:
        return len(self._messages)

    def __iter__(self) -> Iterator[events.Sampled]:
        return map(self._read_sample, self._messages)

    @overload
    def __getitem__(self, index: int) -> events.Sampled: ...
    @overload
    def __getitem__(self, index: slice) -> "SampleSequence": ...
    def __getitem__(self, index: int | slice) -> "events.Sampled | SampleSequence":
        if isinstance(index, slice):
            return SampleSequence(self._messages[index], self._start_ns)
        return self._read_sample(self._messages[index])

    def _read_sample(self, message: bytes) -> events.Sampled:
        """Return the sample in a message, with its time shifted to session time."""
        sampled = decode_event(topics.SAMPLE, message)
        assert isinstance(sampled, events.Sampled)
        return replace(sampled, t_ns=sampled.t_ns + self._start_ns)


_AXES = ("x", "y", "z", "yaw_rad")
_VERDICTS = get_args(events.KeyVerdict)


def check_step_numbers(episode: int, episodes: NDArray[np.int64], steps: NDArray[np.int64]) -> None:
    """Refuse an episode that lacks a step, or has a step of another episode.

    Args:
        episode: the episode's number, counted from 0.
        episodes: the number of the episode that each of its steps states, int64[steps].
        steps: the number that each of its steps states, counted from 1, int64[steps].

    Raises:
        LogError: if a step is missing or belongs to another episode.
    """
    wrong = np.flatnonzero((episodes != episode) | (steps != np.arange(1, len(steps) + 1)))
    if wrong.size:
        first = wrong[0]
        raise LogError(
            f"episode {episodes[first] + 1} step {steps[first]} follows episode {episode + 1} step {first}; "
            "the steps in between are missing"
        )


def build_step_columns(column: Callable[[str], FieldColumn]) -> dict[str, NDArray[Any]]:
    """Return the columns of ``EpisodeLog`` with a row per step, by name; ``column`` returns a field of all steps."""
    rt_ms = column("rt_ms")
    return {
        "actions": column("action").values,
        "key_t_ns": column("key_t_ns").values,
        "rewards": column("reward").values,
        "terminated": column("terminated").values,
        "truncated": column("truncated").values,
        "rt_ms": np.where(rt_ms.is_present, rt_ms.values, np.nan),
    }


def build_state_columns(
    starts: Sequence[events.EpisodeStarted], resets: Sequence[int], column: Callable[[str], FieldColumn]
) -> dict[str, NDArray[Any]]:
    """Build the columns of ``EpisodeLog`` that have a row for each episode's reset and for each step.

    Args:
        starts: the start of each episode.
        resets: the row of each episode's first step among the steps of all episodes.
        column: returns a field of all steps, given its name.
    """
    pose = column("pose")
    step_poses = np.stack([np.where(pose.is_present, pose.values[axis].values, np.nan) for axis in _AXES], axis=1)
    reset_poses = np.array([pose_as_row(start.pose) for start in starts], np.float64).reshape(-1, len(_AXES))
    state_columns: dict[str, NDArray[Any]] = {"poses": np.insert(step_poses, resets, reset_poses, axis=0)}
    for column_name, field_name, dtype in (
        ("t_ns", "t_ns", np.int64),
        ("state_hashes", "state_hash", np.uint64),
        ("observation_hashes", "observation_hash", np.uint64),
        ("onsets", "onset", np.bool_),
    ):
        reset_cells = np.array([getattr(start, field_name) for start in starts], dtype)
        state_columns[column_name] = np.insert(column(field_name).values, resets, reset_cells)
    return state_columns


def build_key_columns(column: Callable[[str], FieldColumn], count: int) -> EventColumns[events.KeyPressed]:
    """Build the columns of key presses and releases from the columns of their messages.

    Args:
        column: returns a field of all the messages, given its name.
        count: the number of messages.

    Raises:
        LogError: if a verdict is outside its vocabulary.
    """
    for word in column("verdict").values.categories:
        require_one_of(_VERDICTS, word)

    @cache
    def read_column(name: str) -> Any:
        cells = column(name)
        if name == "action":
            return np.where(cells.is_present, cells.values, NO_ACTION)
        return cells.values

    return EventColumns(events.KeyPressed, read_column, range(count))


class TopicRows:
    """A session's messages on one topic: their positions among all messages, and their fields, read on demand.

    Args:
        topic: a topic of ``FREQUENT_TOPICS``.
        batches: the places of the messages, and where each begins and ends in ``data``.
        data: the bytes of the messages, followed by ``BEYOND``.
    """

    def __init__(self, topic: str, batches: Sequence[TopicMessages], data: bytes) -> None:
        self._topic = topic
        no_positions = np.zeros(0, np.int64)
        self.places = np.concatenate([no_positions, *(batch.places for batch in batches)])
        self._begins = np.concatenate([no_positions, *(batch.begins for batch in batches)])
        self._ends = np.concatenate([no_positions, *(batch.ends for batch in batches)])
        self._data = data
        self._shifted: dict[str, FieldColumn] = {}
        self._offsets_ns: NDArray[np.int64] | None = None  # from segment time to session time; None if all are 0

    def __len__(self) -> int:
        return len(self.places)

    def shift_to_session_time(self, begins: NDArray[np.int64], starts_ns: NDArray[np.int64]) -> None:
        """Add to each time the session time at which its segment starts.

        Args:
            begins: the position of the first message of each segment, int64[segments].
            starts_ns: the session time at which each segment starts, int64[segments].
        """
        if starts_ns.any():
            self._offsets_ns = starts_ns[np.searchsorted(begins, self.places, side="right") - 1]

    @cached_property
    def _columns(self) -> MessageColumns:
        return MessageColumns(FREQUENT_TOPICS[self._topic].DESCRIPTOR, self._data, self._begins, self._ends)

    def column(self, name: str) -> FieldColumn:
        """Return one field of all the messages.

        Raises:
            LogError: if the field cannot be read.
        """
        if name in self._shifted:
            return self._shifted[name]
        try:
            cells = self._columns[name]
        except ValueError as error:
            raise LogError(f"a message on {self._topic} cannot be read: {error}") from error
        if self._offsets_ns is not None and name in _TIMES:
            cells = cells._replace(values=cells.values + self._offsets_ns)
            self._shifted[name] = cells
        return cells

    def between(self, begin: int, end: int | None) -> slice:
        """Return the rows of the messages at positions from ``begin`` to before ``end``; None means the log's end."""
        first = int(np.searchsorted(self.places, begin))
        if end is None:
            return slice(first, len(self.places))
        return slice(first, int(np.searchsorted(self.places, end)))


class FrequentRows:
    """A session's messages on the most frequent topics: steps, keys and frames.

    Args:
        batches: the places of the messages by topic, and where each begins and ends in the joined chunks.
        chunks: the bytes of the chunks that hold the messages, in order.
    """

    def __init__(self, batches: Mapping[str, Sequence[TopicMessages]], chunks: Sequence[bytes]) -> None:
        data = b"".join((*chunks, BEYOND))
        self.steps, self.keys, self.frames = (
            TopicRows(topic, batches.get(topic, ()), data) for topic in FREQUENT_TOPICS
        )

    def shift_to_session_time(self, begins: NDArray[np.int64], starts_ns: NDArray[np.int64]) -> None:
        """Shift all times to session time; the arguments are those of ``TopicRows.shift_to_session_time``."""
        for rows in (self.steps, self.keys, self.frames):
            rows.shift_to_session_time(begins, starts_ns)

    @cached_property
    def key_events(self) -> EventColumns[events.KeyPressed]:
        """Return the columns of every key press and release."""
        return build_key_columns(self.keys.column, len(self.keys))

    @cached_property
    def frame_events(self) -> EventColumns[events.FrameShown]:
        """Return the columns of every displayed frame."""
        frames = self.frames  # the closure must not refer to self: that would be a reference cycle
        return EventColumns(events.FrameShown, lambda name: frames.column(name).values, range(len(frames)))
