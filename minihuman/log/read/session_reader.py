"""Read a session: a log's events in order, or all its segments assembled into episodes.

Messages are collected per topic and turned into columns at once. No object is made per step, key press or frame: that
is what makes a study quick to read.
"""

from bisect import bisect
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, get_args, overload

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.activities.agent_blocks.events import PolicyGiven
from minihuman.activities.team.events import SeatsReadied, TeamFormed
from minihuman.errors import LogError
from minihuman.experiment.machine import events
from minihuman.log import topics
from minihuman.log.codec import RECORD_TOPICS, decode_event, require_one_of
from minihuman.log.model.event_columns import NO_ACTION, EventColumns
from minihuman.log.model.session_log import (
    CUT_OFF,
    EpisodeLog,
    PartEvent,
    Segment,
    SegmentNote,
    SessionLog,
    gather_team,
    notes_in_session_time,
    part_events_in_session_time,
    pose_as_row,
)
from minihuman.log.model.teaching_events import TeachingRecord, gather_teaching
from minihuman.log.observations import ObservationSequence
from minihuman.log.paths import PART_SUFFIX, list_sessions, raise_as_log_error
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.protobuf_columns import BEYOND, FieldColumn, MessageColumns
from minihuman.log.read.reader import LogReader
from minihuman.log.read.world_statements import read_infos, read_successes
from minihuman.log.salvage.records import TopicMessages
from minihuman.log.salvage.summary_section import all_ended_cleanly
from minihuman.storage.outside_names import require_name
from minihuman.trust import find_logged_sources


class SampleSequence(Sequence[events.Sampled]):
    """Samples in the order they were recorded, in session time.

    Raises:
        google.protobuf.message.DecodeError: when one is looked at that is none.
    """

    def __init__(self, messages: Sequence[bytes], start_ns: int) -> None:
        """``start_ns`` is the session time at which their segment began."""
        self._messages = messages
        self._start_ns = start_ns

    def __len__(self) -> int:
        return len(self._messages)

    def __iter__(self) -> Iterator[events.Sampled]:
        return map(self._read, self._messages)

    @overload
    def __getitem__(self, place: int) -> events.Sampled: ...
    @overload
    def __getitem__(self, place: slice) -> "SampleSequence": ...
    def __getitem__(self, place: int | slice) -> "events.Sampled | SampleSequence":
        if isinstance(place, slice):
            return SampleSequence(self._messages[place], self._start_ns)
        return self._read(self._messages[place])

    def _read(self, message: bytes) -> events.Sampled:
        sampled = decode_event(topics.SAMPLE, message)
        assert isinstance(sampled, events.Sampled)
        return replace(sampled, t_ns=sampled.t_ns + self._start_ns)


_AXES = ("x", "y", "z", "yaw_rad")
_VERDICTS = get_args(events.KeyVerdict)


def check_step_numbers(episode: int, episodes: NDArray[np.int64], steps: NDArray[np.int64]) -> None:
    """Refuse an episode in which a step is missing, or another's is."""
    wrong = np.flatnonzero((episodes != episode) | (steps != np.arange(1, len(steps) + 1)))
    if wrong.size:
        first = wrong[0]
        raise LogError(
            f"episode {episodes[first] + 1} step {steps[first]} follows episode {episode + 1} step {first}; "
            "the steps in between are missing"
        )


def build_step_columns(column: Callable[[str], FieldColumn]) -> dict[str, NDArray[Any]]:
    """The columns of ``Episode`` that have a row for each step."""
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
    """The columns of ``Episode`` that have a row for its reset and one for each step, put before its first."""
    pose = column("pose")
    after = np.stack([np.where(pose.is_present, pose.values[axis].values, np.nan) for axis in _AXES], axis=1)
    first = np.array([pose_as_row(start.pose) for start in starts], np.float64).reshape(-1, len(_AXES))
    moments: dict[str, NDArray[Any]] = {"poses": np.insert(after, resets, first, axis=0)}
    for of_episode, name, dtype in (
        ("t_ns", "t_ns", np.int64),
        ("state_hashes", "state_hash", np.uint64),
        ("observation_hashes", "observation_hash", np.uint64),
        ("onsets", "onset", np.bool_),
    ):
        first = np.array([getattr(start, name) for start in starts], dtype)
        moments[of_episode] = np.insert(column(name).values, resets, first)
    return moments


def build_key_columns(column: Callable[[str], FieldColumn], count: int) -> EventColumns[events.KeyPressed]:
    """Key presses and releases from the columns of their messages.

    Raises:
        LogError: if a verdict is outside its vocabulary.
    """
    for word in column("verdict").values.categories:
        require_one_of(_VERDICTS, word)

    def values(name: str) -> Any:
        found = column(name)
        if name == "action":
            return np.where(found.is_present, found.values, NO_ACTION)
        return found.values

    return EventColumns(events.KeyPressed, cache(values), range(count))


_BREAK = ""  # the topic that stands for messages that are missing
_THOUSANDS: dict[str, type[Message]] = {topics.STEP: v1.Step, topics.KEY: v1.KeyEvent, topics.FRAME: v1.FrameShown}
_TIMES = frozenset({"t_ns", "pressed_ns", "key_t_ns", "submit_ns", "flip_ns"})  # columns that are times


@dataclass(slots=True)
class _SegmentDraft:
    """A segment as far as it has been read: its messages are those from one place on, its times begin at 0."""

    started: events.SessionStarted
    begin: int
    ended: events.SessionEnded | None = None
    last_ns: int = 0  # of what has been read one by one
    notes: list[SegmentNote] = field(default_factory=list)
    part_events: list[PartEvent] = field(default_factory=list)


@dataclass(slots=True)
class _EpisodeDraft:
    """An episode as far as it has been read: its messages are those between two places."""

    start: events.EpisodeStarted
    segment: int  # 0 for the first that was read
    begin: int
    end: int | None = None  # None: the log broke off first
    outcome: events.Outcome | None = None
    end_cause: events.EndCause = ""
    policy: str = ""  # of an agent, in force when it began
    formed: TeamFormed | None = None  # the team that plays it
    ready: SeatsReadied | None = None  # and where it stood at the reset
    activity_events: list[events.ActivityEvent] = field(default_factory=list)  # of activities


class _TopicRows:
    """All of a session's messages on one topic: their places among all, and their fields, read when asked for."""

    def __init__(self, topic: str, found: Sequence[TopicMessages], data: bytes) -> None:
        self._topic = topic
        self.places, self._begins, self._ends = (
            np.concatenate([np.zeros(0, np.int64), *(getattr(of_topic, name) for of_topic in found)])
            for name in ("places", "begins", "ends")
        )
        self._data = data
        self._shifted: dict[str, FieldColumn] = {}
        self._offsets_ns: NDArray[np.int64] | None = None  # from segment time to session time; None: all are 0

    def __len__(self) -> int:
        return len(self.places)

    def shift_to_session_time(self, begins: NDArray[np.int64], starts_ns: NDArray[np.int64]) -> None:
        """Add to each time the session time at which its segment starts.

        Args:
            begins: int64[segments], the first place of each segment.
            starts_ns: int64[segments].
        """
        if starts_ns.any():
            self._offsets_ns = starts_ns[np.searchsorted(begins, self.places, side="right") - 1]

    @cached_property
    def _columns(self) -> MessageColumns:
        return MessageColumns(_THOUSANDS[self._topic].DESCRIPTOR, self._data, self._begins, self._ends)

    def column(self, name: str) -> FieldColumn:
        """One field of them all.

        Raises:
            LogError: if it cannot be read.
        """
        if name in self._shifted:
            return self._shifted[name]
        try:
            found = self._columns[name]
        except ValueError as error:
            raise LogError(f"a message on {self._topic} cannot be read: {error}") from error
        if self._offsets_ns is not None and name in _TIMES:
            found = self._shifted[name] = found._replace(values=found.values + self._offsets_ns)
        return found

    def between(self, begin: int, end: int | None) -> slice:
        """Which of them lie between two places, the second left out; None for the log's end."""
        first = int(np.searchsorted(self.places, begin))
        return slice(first, len(self.places) if end is None else int(np.searchsorted(self.places, end)))


class _SessionRows:
    """The messages on the topics that have thousands: steps, keys and frames."""

    def __init__(self, found: Mapping[str, Sequence[TopicMessages]], chunks: Sequence[bytes]) -> None:
        data = b"".join((*chunks, BEYOND))
        self.steps, self.keys, self.frames = (_TopicRows(topic, found.get(topic, ()), data) for topic in _THOUSANDS)

    def shift_to_session_time(self, begins: NDArray[np.int64], starts_ns: NDArray[np.int64]) -> None:
        """Put all times on the session's clock."""
        for rows in (self.steps, self.keys, self.frames):
            rows.shift_to_session_time(begins, starts_ns)

    @cached_property
    def key_events(self) -> EventColumns[events.KeyPressed]:
        """Every press and release."""
        return build_key_columns(self.keys.column, len(self.keys))

    @cached_property
    def frame_events(self) -> EventColumns[events.FrameShown]:
        """Every picture that was shown."""
        frames = self.frames  # alone: what is cached here and held this would be a cycle, freed only by the collector
        return EventColumns(events.FrameShown, lambda name: frames.column(name).values, range(len(frames)))


class SessionAssembler:
    """Takes a session's messages in the order they were recorded. What lies between episodes belongs to none."""

    def __init__(self) -> None:
        self._parts: list[_SegmentDraft] = []
        self._chunks: list[bytes] = []  # that hold messages of the topics that have thousands
        self._found: dict[str, list[TopicMessages]] = defaultdict(list)  # among those chunks' bytes
        self._observed: tuple[list[int], list[bytes]] = ([], [])  # places and messages, not looked at yet
        self._sampled: tuple[list[int], list[bytes]] = ([], [])
        self._spans: list[_EpisodeDraft] = []
        self._policy = ""  # of an agent, in force
        self._formed: TeamFormed | None = None  # of the part that runs
        self._ready: SeatsReadied | None = None  # of the episode that comes
        self._count = 0  # of messages, so far
        self._size = 0  # of those chunks, so far

    def read(self, reading: LogReader) -> None:
        """Take a file's messages.

        Raises:
            LogError: as ``Reading.events``, but for steps, keys and pictures.
        """
        for chunk in reading.chunks():
            others: list[tuple[int, str, bytes]] = []
            size = self._size
            for topic, places, begins, ends in chunk.by_topic(among=RECORD_TOPICS):
                if topic in _THOUSANDS:
                    self._found[topic].append(TopicMessages(topic, places + self._count, begins + size, ends + size))
                    self._size = size + len(chunk.data)
                else:
                    numbers = (self._count + places).tolist()
                    payloads = [
                        chunk.data[begin:end] for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)
                    ]
                    if topic in (topics.OBSERVATION, topics.SAMPLE):
                        if topic == topics.OBSERVATION:
                            kept = self._observed
                        else:
                            kept = self._sampled
                        kept[0].extend(numbers)
                        kept[1].extend(payloads)
                    else:
                        others += ((number, topic, data) for number, data in zip(numbers, payloads, strict=True))
            if self._size > size:
                self._chunks.append(chunk.data)
            others += ((self._count + place, _BREAK, b"") for place in chunk.breaks)
            for place, topic, data in sorted(others, key=lambda other: (other[0], other[1] != _BREAK)):
                if topic == _BREAK:
                    self._close(place)  # what is behind a gap may be another episode's
                else:
                    self._take(place, reading.event(topic, data))
            self._count += len(chunk)

    @property
    def started(self) -> list[events.SessionStarted]:
        """How each segment began."""
        return [part.started for part in self._parts]

    @property
    def end_reason(self) -> str:
        """Why the last segment ended; "cut_off" where its log does not say."""
        ended = self._parts[-1].ended
        return CUT_OFF if ended is None else ended.reason

    def session(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]]
    ) -> tuple[tuple[Segment, ...], tuple[EpisodeLog, ...]]:
        """The session's segments and every episode in the order played, all on one clock.

        ``starts`` and ``ends`` are what the files say of each segment that was read, and of each that was finished.

        Raises:
            LogError: if a step or a key press cannot be read, or a step is missing. Pictures are read when looked at.
        """
        rows = _SessionRows(self._found, self._chunks)
        placed = self._placed(starts, ends, rows)
        rows.shift_to_session_time(
            np.array([part.begin for part in self._parts], np.int64),
            np.array([segment.start_ns for segment, _ in placed], np.int64),
        )
        segments = tuple(
            replace(
                segment,
                keys=rows.key_events[rows.keys.between(*between)],
                samples=self._samples(segment, *between),
            )
            for segment, between in placed
        )
        return segments, tuple(self._episodes(segments, rows))

    def _episodes(self, segments: Sequence[Segment], rows: _SessionRows) -> Iterator[EpisodeLog]:
        """Every episode in the order played; checks that none of its steps is missing."""
        starts = [replace(span.start, t_ns=span.start.t_ns + segments[span.segment].start_ns) for span in self._spans]
        steps = [rows.steps.between(span.begin, span.end) for span in self._spans]
        of_states = build_state_columns(starts, [its.start for its in steps], rows.steps.column)
        of_steps = build_step_columns(rows.steps.column)
        episode_numbers, step_numbers, step_keys = (
            rows.steps.column(name).values for name in ("episode", "step", "key")
        )
        vectors = rows.steps.column("action_vector").values
        nexts = [*(span.begin for span in self._spans[1:]), None]
        attempts: Counter[int] = Counter()
        for number, (span, start, its) in enumerate(zip(self._spans, starts, steps, strict=True)):
            episode = start.plan.episode
            segment = segments[span.segment]
            check_step_numbers(episode, episode_numbers[its], step_numbers[its])
            attempts[episode] += 1
            with_reset = slice(its.start + number, its.stop + number + 1)  # every episode before has a reset too
            first_ns, last_ns = (int(of_states["t_ns"][with_reset][at]) for at in (0, -1))
            used = ~np.isnan(vectors[its]).all(axis=0)  # other columns are another world's
            yield EpisodeLog(
                start=start,
                **{name: column[with_reset] for name, column in of_states.items()},
                **{name: column[its] for name, column in of_steps.items()},
                step_keys=step_keys[its],
                action_vectors=vectors[its][:, used] if used.any() else None,  # its actions are numbers
                successes=read_successes(start.plan, rows.steps.column, its),
                infos=read_infos(start.plan, rows.steps.column, its),
                keys=rows.key_events[rows.keys.between(span.begin, span.end)],
                frames=rows.frame_events[rows.frames.between(span.begin, nexts[number])],  # the last one stays
                outcome=span.outcome,
                end_cause=span.end_cause,
                observations=self._observations(span, its.stop - its.start),
                segment=segment.number,
                attempt=attempts[episode],
                pauses=tuple(
                    (max(begin, first_ns), min(end, last_ns))
                    for begin, end in segment.pauses
                    if begin < last_ns and end > first_ns
                ),
                taught=_build_teaching(span, its.stop - its.start, segment.start_ns),
                team=gather_team(span.formed, span.ready, span.activity_events, its.stop - its.start),
            )

    def _placed(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]], rows: _SessionRows
    ) -> list[tuple[Segment, tuple[int, int | None]]]:
        """Every segment where it lies in the session, without its keys, and which places its messages have."""
        clean = {int(end["segment"]): end["clean"] == "true" for end in ends}
        placed: list[tuple[Segment, tuple[int, int | None]]] = []
        after_ns = 0
        for number, (part, facts) in enumerate(zip(self._parts, starts, strict=True)):
            between = (part.begin, self._parts[number + 1].begin if number + 1 < len(self._parts) else None)
            unix_ns = int(facts["started_unix_ns"])
            start_ns = max(unix_ns - int(starts[0]["started_unix_ns"]), after_ns)
            end_ns = start_ns + self._lasted_ns(
                part, [its.column("t_ns").values[its.between(*between)] for its in (rows.steps, rows.keys)]
            )
            monotonic_ns = part.started.facts.get("started_monotonic_ns", "")
            segment = Segment(
                number=int(facts["segment"]),
                started_at=facts["started_at"],
                started_unix_ns=unix_ns,
                started_monotonic_ns=int(monotonic_ns) if monotonic_ns else None,
                monotonic_clock=part.started.facts.get("monotonic_clock", ""),
                start_ns=start_ns,
                end_ns=end_ns,
                end_reason=CUT_OFF if part.ended is None else part.ended.reason,
                clean=clean.get(int(facts["segment"]), False),
                facts=part.started.facts,
                notes=notes_in_session_time(part.notes, start_ns),
                part_events=part_events_in_session_time(part.part_events, start_ns),
                keys=EventColumns.of(events.KeyPressed, ()),
            )
            placed.append((segment, between))
            after_ns = end_ns + 1  # a clock that was set back does not turn session time back
        return placed

    @staticmethod
    def _lasted_ns(part: _SegmentDraft, times_ns: Sequence[NDArray[np.int64]]) -> int:
        """Segment time of the last that is known of a segment, ns; ``times_ns`` are those of its steps and keys."""
        if part.ended is not None:
            return part.last_ns
        return max(part.last_ns, *(int(its.max(initial=0)) for its in times_ns))

    def _samples(self, segment: Segment, begin: int, end: int | None) -> SampleSequence:
        places, messages = self._sampled
        return SampleSequence(
            messages[bisect(places, begin) : None if end is None else bisect(places, end)], segment.start_ns
        )

    def _observations(self, span: _EpisodeDraft, steps: int) -> ObservationSequence | None:
        """What was observed in an episode; a log may break off between an observation and its step."""
        places, messages = self._observed
        its = messages[bisect(places, span.begin) : None if span.end is None else bisect(places, span.end)]
        if len(its) > steps:
            return ObservationSequence(span.start.plan.episode, its[: steps + 1])
        return None

    def _take(self, place: int, event: events.Event | None) -> None:
        if not self._parts and not isinstance(event, events.SessionStarted):
            return  # the plan is lost, and nothing says what this belongs to
        match event:
            case events.SessionStarted():
                self._close(place)
                self._parts.append(_SegmentDraft(event, place))
            case events.SessionEnded():
                self._parts[-1].ended = event
            case events.EpisodeStarted():
                self._close(place)
                segment = len(self._parts) - 1
                self._spans.append(
                    _EpisodeDraft(event, segment, place, policy=self._policy, formed=self._formed, ready=self._ready)
                )
            case events.EpisodeEnded():
                self._close(place, event.outcome, event.cause)
            case events.Noted() | events.Paused() | events.Resumed():
                self._parts[-1].notes.append(event)
            case _ if isinstance(event, PartEvent):
                self._parts[-1].part_events.append(event)
                self._of_a_kind(event)
        if event is not None:
            self._parts[-1].last_ns = max(self._parts[-1].last_ns, event.t_ns)

    def _of_a_kind(self, event: PartEvent) -> None:
        """Give an episode what a kind of activity says of it: also what comes when it has just ended."""
        match event:
            case PolicyGiven():
                self._policy = event.policy
            case TeamFormed():
                self._formed = event
            case SeatsReadied():
                self._ready = event
            case events.PartStarted():
                self._policy = ""
                self._formed = None
                self._ready = None
            case events.ModelCall() | events.DesignDecided():
                return  # who sits in the seat, or what comes next: not what happens in the episode
            case events.ActivityEvent() if (
                self._spans and getattr(event, "episode", None) == self._spans[-1].start.plan.episode
            ):
                self._spans[-1].activity_events.append(event)

    def _close(self, place: int, outcome: events.Outcome | None = None, cause: events.EndCause = "") -> None:
        """End the last episode, if it has not ended."""
        if self._spans and self._spans[-1].end is None:
            span = self._spans[-1]
            span.end = place
            span.outcome = outcome
            span.end_cause = cause


def _build_teaching(span: _EpisodeDraft, steps: int, start_ns: int) -> TeachingRecord | None:
    """Who controlled an episode, in session time."""
    if not span.activity_events or span.formed is not None:
        return None
    in_time = part_events_in_session_time(span.activity_events, start_ns)
    found = [event for event in in_time if isinstance(event, events.ActivityEvent)]
    return gather_teaching(found, steps=steps, actions=len(span.start.action_names), policy=span.policy)


def read_events(path: Path) -> Iterator[events.Event]:
    """Yield a log's events in the order they were recorded.

    A live or cut-off log (``.mcap.part``) yields what is whole; a finished one must be whole.

    Raises:
        LogError: if the file cannot be opened, is no session log, of another schema version, or damaged.
    """
    return LogReader(path).events()


def read_log(path: Path | str) -> SessionLog:
    """Read a session: a finished log, a live or cut-off ``.mcap.part``, or a session's folder with every segment in it.

    Raises:
        LogError: if there is no session log, it is of another schema version, damaged, or holds no plan.
    """
    path = Path(path)
    files = list_session_files(path)
    readings = [LogReader(file) for file in files]
    gathered = SessionAssembler()
    for file, reading in zip(files, readings, strict=True):
        with raise_as_log_error(file):
            gathered.read(reading)
    if not gathered.started:
        raise LogError(f"{path} was cut off before its session started, so it has nothing to read; name another log")
    for started in gathered.started:
        find_logged_sources(started.facts)
    try:
        with raise_as_log_error(path):
            return _session(path, gathered, readings)
    except LogError as error:
        if str(path) in str(error):
            raise
        raise LogError(f"{path}: {error}") from error


def list_session_files(path: Path) -> list[Path]:
    """The files of one session: a log, or all of the one session in a folder, in order.

    Raises:
        LogError: if a folder holds none, or more than one.
    """
    if not path.is_dir():
        return [path]
    sessions = list_sessions(path)
    if len(sessions) != 1:
        raise LogError(
            f"{path} contains {len(sessions)} session logs (*.mcap or *{PART_SUFFIX}) instead of one; name a single "
            "file"
        )
    (files,) = sessions.values()
    return files


def _session(path: Path, gathered: SessionAssembler, readings: list[LogReader]) -> SessionLog:
    first = gathered.started[0]
    require_name(first.plan.study, "the study")  # a log from elsewhere says so; exports name files by them
    require_name(first.plan.participant.id, "the participant")
    starts = [facts for reading in readings for facts in reading.starts]
    ends = [facts for reading in readings for facts in reading.ends]
    segments, episodes = gathered.session(starts, ends)
    return SessionLog(
        path=path,
        plan=first.plan,
        player=first.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        clean=all_ended_cleanly(starts, ends),
        end_reason=gathered.end_reason,
        facts=first.facts,
        episodes=episodes,
        segments=segments,
        metadata={"segments": starts, "ends": ends},
    )
