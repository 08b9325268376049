"""Reads a session: a log's events in order, or all its segments assembled into episodes.

`session_rows` has the columns of the frequent topics.
"""

from bisect import bisect
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.agent_blocks.events import PolicyGiven
from minihuman.activities.team.events import SeatsReadied, TeamFormed
from minihuman.errors import LogError
from minihuman.experiment.machine import events
from minihuman.log import topics
from minihuman.log.codec import RECORD_TOPICS
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.session_log import (
    CUT_OFF,
    EpisodeLog,
    PartEvent,
    PauseSpans,
    Segment,
    SegmentNote,
    SessionLog,
    gather_team,
    notes_in_session_time,
    part_events_in_session_time,
)
from minihuman.log.model.teaching_events import TeachingRecord, gather_teaching
from minihuman.log.observations import ObservationSequence
from minihuman.log.paths import PART_SUFFIX, list_sessions, raise_as_log_error
from minihuman.log.read.reader import LogReader
from minihuman.log.read.session_rows import (
    FREQUENT_TOPICS,
    FrequentRows,
    SampleSequence,
    build_state_columns,
    build_step_columns,
    check_step_numbers,
)
from minihuman.log.read.world_statements import read_infos, read_successes
from minihuman.log.salvage.records import ChunkMessages, TopicMessages
from minihuman.log.salvage.summary_section import all_ended_cleanly
from minihuman.storage.outside_names import require_name
from minihuman.trust import find_logged_sources

_BREAK = ""  # the topic of a placeholder for missing messages


@dataclass(slots=True)
class _SegmentDraft:
    """A segment as far as it has been read. Its messages start at ``begin``, and its times begin at 0."""

    started: events.SessionStarted
    begin: int
    ended: events.SessionEnded | None = None
    last_ns: int = 0  # the latest time of its rare messages
    notes: list[SegmentNote] = field(default_factory=list)
    part_events: list[PartEvent] = field(default_factory=list)


@dataclass(slots=True)
class _EpisodeDraft:
    """An episode as far as it has been read. Its messages are those from ``begin`` to ``end``."""

    start: events.EpisodeStarted
    segment: int  # index of the segment among those read
    begin: int
    end: int | None = None  # None if the log ended first
    outcome: events.Outcome | None = None
    end_cause: events.EndCause = ""
    policy: str = ""  # of an agent, when the episode began
    formed: TeamFormed | None = None  # the team that plays it
    ready: SeatsReadied | None = None  # the team's poses at the reset
    activity_events: list[events.ActivityEvent] = field(default_factory=list)


class SessionAssembler:
    """Assembles a session from its messages, in the order in which they were recorded."""

    def __init__(self) -> None:
        self._segments: list[_SegmentDraft] = []
        self._chunks: list[bytes] = []  # that hold messages of the topics that have thousands
        self._batches: dict[str, list[TopicMessages]] = defaultdict(list)  # with positions in the bytes of these chunks
        self._unread: dict[str, tuple[list[int], list[bytes]]] = {  # places and messages, which are read on access
            topics.OBSERVATION: ([], []),
            topics.SAMPLE: ([], []),
        }
        self._episodes: list[_EpisodeDraft] = []
        self._policy = ""  # of an agent, currently
        self._formed: TeamFormed | None = None  # of the current part
        self._ready: SeatsReadied | None = None  # of the next episode
        self._count = 0  # number of messages so far
        self._size = 0  # bytes in ``_chunks``

    def read(self, reader: LogReader) -> None:
        """Add a file's messages.

        Raises:
            LogError: as ``LogReader.events`` does, except for steps, keys and pictures, which are decoded later.
        """
        for chunk in reader.chunks():
            rare_messages = self._collect_frequent(chunk)
            rare_messages += ((self._count + position, _BREAK, b"") for position in chunk.breaks)
            # in the order of positions; a break comes before the message at its position
            for position, topic, data in sorted(rare_messages, key=lambda message: (message[0], message[1] != _BREAK)):
                if topic == _BREAK:
                    self._end_episode(position)  # messages after a gap may belong to another episode
                else:
                    self._add_event(position, reader.decode(topic, data))
            self._count += len(chunk)

    def _collect_frequent(self, chunk: ChunkMessages) -> list[tuple[int, str, bytes]]:
        """Store a chunk's frequent messages, observations and samples.

        Returns:
            The position among all messages, the topic and the bytes of each other message of the record.
        """
        rare_messages: list[tuple[int, str, bytes]] = []
        chunk_begin = self._size
        for topic, positions, begins, ends in chunk.by_topic(among=RECORD_TOPICS):
            if topic in FREQUENT_TOPICS:
                batch = TopicMessages(topic, positions + self._count, begins + chunk_begin, ends + chunk_begin)
                self._batches[topic].append(batch)
                self._size = chunk_begin + len(chunk.data)
                continue
            numbers = (self._count + positions).tolist()
            payloads = [chunk.data[begin:end] for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)]
            if topic in self._unread:
                self._unread[topic][0].extend(numbers)
                self._unread[topic][1].extend(payloads)
            else:
                rare_messages += ((number, topic, data) for number, data in zip(numbers, payloads, strict=True))
        if self._size > chunk_begin:
            self._chunks.append(chunk.data)
        return rare_messages

    @property
    def started(self) -> list[events.SessionStarted]:
        """Return the first event of each segment."""
        return [draft.started for draft in self._segments]

    @property
    def end_reason(self) -> str:
        """Return the reason why the last segment ended; "cut_off" if its log states none."""
        ended = self._segments[-1].ended
        return CUT_OFF if ended is None else ended.reason

    def assemble(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]]
    ) -> tuple[tuple[Segment, ...], tuple[EpisodeLog, ...]]:
        """Return the session's segments and every episode in the order played, all on one clock.

        Args:
            starts: the metadata of each segment that was read.
            ends: the metadata of each finished segment's end.

        Raises:
            LogError: if a step or a key press cannot be read, or a step is missing. Pictures are read when they are
                accessed.
        """
        rows = FrequentRows(self._batches, self._chunks)
        placed = self._place_segments(starts, ends, rows)
        rows.shift_to_session_time(
            np.array([draft.begin for draft in self._segments], np.int64),
            np.array([segment.start_ns for segment, _ in placed], np.int64),
        )
        segments = tuple(
            replace(
                segment,
                keys=rows.key_events[rows.keys.between(*message_range)],
                samples=self._find_samples(segment, *message_range),
            )
            for segment, message_range in placed
        )
        return segments, tuple(self._build_episodes(segments, rows))

    def _build_episodes(self, segments: Sequence[Segment], rows: FrequentRows) -> Iterator[EpisodeLog]:
        """Yield every episode in the order played, after checking that none of its steps is missing."""
        starts = self._shift_starts(segments)
        steps = [rows.steps.between(draft.begin, draft.end) for draft in self._episodes]
        of_states = build_state_columns(starts, [step_rows.start for step_rows in steps], rows.steps.column)
        of_steps = build_step_columns(rows.steps.column)
        episode_numbers = rows.steps.column("episode").values
        step_numbers = rows.steps.column("step").values
        vectors = rows.steps.column("action_vector").values
        nexts = [*(draft.begin for draft in self._episodes[1:]), None]
        attempts: Counter[int] = Counter()
        for number, (draft, start, step_rows) in enumerate(zip(self._episodes, starts, steps, strict=True)):
            episode = start.plan.episode
            segment = segments[draft.segment]
            check_step_numbers(episode, episode_numbers[step_rows], step_numbers[step_rows])
            attempts[episode] += 1
            n_steps = step_rows.stop - step_rows.start
            begin = step_rows.start + number  # each earlier episode has one more row, for its reset
            state_columns = {name: column[begin : begin + n_steps + 1] for name, column in of_states.items()}
            times_ns = state_columns["t_ns"]
            has_vectors = ~np.isnan(vectors[step_rows]).all(axis=0)  # of this world; none if its actions are numbers
            yield EpisodeLog(
                start=start,
                **state_columns,
                **{name: column[step_rows] for name, column in of_steps.items()},
                step_keys=rows.steps.column("key").values[step_rows],
                action_vectors=vectors[step_rows][:, has_vectors] if has_vectors.any() else None,
                successes=read_successes(start.plan, rows.steps.column, step_rows),
                infos=read_infos(start.plan, rows.steps.column, step_rows),
                keys=rows.key_events[rows.keys.between(draft.begin, draft.end)],
                frames=rows.frame_events[rows.frames.between(draft.begin, nexts[number])],  # it stays visible
                outcome=draft.outcome,
                end_cause=draft.end_cause,
                observations=self._find_observations(draft, n_steps),
                segment=segment.number,
                attempt=attempts[episode],
                pauses=_clip_pauses(segment.pauses, int(times_ns[0]), int(times_ns[-1])),
                taught=_build_teaching(draft, n_steps, segment.start_ns),
                team=gather_team(draft.formed, draft.ready, draft.activity_events, n_steps),
            )

    def _shift_starts(self, segments: Sequence[Segment]) -> list[events.EpisodeStarted]:
        """Return the start of each episode in session time."""
        starts = []
        for draft in self._episodes:
            segment = segments[draft.segment]
            starts.append(replace(draft.start, t_ns=draft.start.t_ns + segment.start_ns))
        return starts

    def _place_segments(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]], rows: FrequentRows
    ) -> list[tuple[Segment, tuple[int, int | None]]]:
        """Return every segment in session time, still without keys and samples, and the range of its messages.

        A range has the positions of the segment's first message and of the next segment's first; None for the log's
        end.
        """
        ended_cleanly = {int(end["segment"]): end["clean"] == "true" for end in ends}
        first_unix_ns = int(starts[0]["started_unix_ns"])
        begins = [draft.begin for draft in self._segments]
        message_ranges = list(zip(begins, [*begins[1:], None], strict=True))
        placed: list[tuple[Segment, tuple[int, int | None]]] = []
        after_ns = 0
        for draft, facts, message_range in zip(self._segments, starts, message_ranges, strict=True):
            number = int(facts["segment"])
            unix_ns = int(facts["started_unix_ns"])
            monotonic_ns = draft.started.facts.get("started_monotonic_ns", "")
            start_ns = max(unix_ns - first_unix_ns, after_ns)
            step_times_ns = rows.steps.column("t_ns").values[rows.steps.between(*message_range)]
            key_times_ns = rows.keys.column("t_ns").values[rows.keys.between(*message_range)]
            end_ns = start_ns + self._find_duration_ns(draft, [step_times_ns, key_times_ns])
            segment = Segment(
                number=number,
                started_at=facts["started_at"],
                started_unix_ns=unix_ns,
                started_monotonic_ns=int(monotonic_ns) if monotonic_ns else None,
                monotonic_clock=draft.started.facts.get("monotonic_clock", ""),
                start_ns=start_ns,
                end_ns=end_ns,
                end_reason=CUT_OFF if draft.ended is None else draft.ended.reason,
                clean=ended_cleanly.get(number, False),
                facts=draft.started.facts,
                notes=notes_in_session_time(draft.notes, start_ns),
                part_events=part_events_in_session_time(draft.part_events, start_ns),
                keys=EventColumns.of(events.KeyPressed, ()),
            )
            placed.append((segment, message_range))
            after_ns = end_ns + 1  # session time goes on even if the clock was set back
        return placed

    @staticmethod
    def _find_duration_ns(draft: _SegmentDraft, times_ns: Sequence[NDArray[np.int64]]) -> int:
        """Return the last known time of a segment, in nanoseconds since its start.

        Args:
            draft: the segment.
            times_ns: the times of the segment's steps, and those of its keys, in segment time.
        """
        if draft.ended is not None:
            return draft.last_ns
        return max(draft.last_ns, *(int(topic_times_ns.max(initial=0)) for topic_times_ns in times_ns))

    def _find_samples(self, segment: Segment, begin: int, end: int | None) -> SampleSequence:
        """Return the samples of a segment.

        Args:
            segment: the segment, in session time.
            begin: the position of its first message.
            end: the position of the next segment's first message; None for the log's end.
        """
        positions, messages = self._unread[topics.SAMPLE]
        return SampleSequence(messages[_slice_between(positions, begin, end)], segment.start_ns)

    def _find_observations(self, draft: _EpisodeDraft, steps: int) -> ObservationSequence | None:
        """Return the observations of an episode with a number of steps; None if the log does not have all of them."""
        positions, messages = self._unread[topics.OBSERVATION]
        observed = messages[_slice_between(positions, draft.begin, draft.end)]
        if len(observed) > steps:
            return ObservationSequence(draft.start.plan.episode, observed[: steps + 1])
        return None

    def _add_event(self, position: int, event: events.Event | None) -> None:
        """Add an event at a position among all messages to the segment and the episode to which it belongs."""
        if not self._segments and not isinstance(event, events.SessionStarted):
            return  # the plan is lost, so the segment is unknown
        match event:
            case events.SessionStarted():
                self._end_episode(position)
                self._segments.append(_SegmentDraft(event, position))
            case events.SessionEnded():
                self._segments[-1].ended = event
            case events.EpisodeStarted():
                self._end_episode(position)
                segment = len(self._segments) - 1
                self._episodes.append(
                    _EpisodeDraft(event, segment, position, policy=self._policy, formed=self._formed, ready=self._ready)
                )
            case events.EpisodeEnded():
                self._end_episode(position, event.outcome, event.cause)
            case events.Noted() | events.Paused() | events.Resumed():
                self._segments[-1].notes.append(event)
            case _ if isinstance(event, PartEvent):
                self._segments[-1].part_events.append(event)
                self._assign_activity_event(event)
        if event is not None:
            self._segments[-1].last_ns = max(self._segments[-1].last_ns, event.t_ns)

    def _assign_activity_event(self, event: PartEvent) -> None:
        """Assign an activity's event to the latest episode if it belongs to it, even if the episode has ended.

        Events about a policy or a team are kept for the episodes that begin later in the same part.
        """
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
                return  # about the agent or the next episode, not about this one
            case events.ActivityEvent() if (
                self._episodes and getattr(event, "episode", None) == self._episodes[-1].start.plan.episode
            ):
                self._episodes[-1].activity_events.append(event)

    def _end_episode(self, position: int, outcome: events.Outcome | None = None, cause: events.EndCause = "") -> None:
        """End the latest episode, if it has not ended yet, before the message at a position.

        Args:
            position: the position among all messages.
            outcome: the episode's outcome; None if the log does not state one.
            cause: what ended the episode, if no step did; "" otherwise.
        """
        if self._episodes and self._episodes[-1].end is None:
            episode = self._episodes[-1]
            episode.end = position
            episode.outcome = outcome
            episode.end_cause = cause


def _slice_between(positions: Sequence[int], begin: int, end: int | None) -> slice:
    """Return the slice of a sorted list of positions that holds those above ``begin`` and up to ``end``, inclusive.

    If ``end`` is None, it holds all above ``begin``.
    """
    first = bisect(positions, begin)
    if end is None:
        return slice(first, None)
    return slice(first, bisect(positions, end))


def _clip_pauses(pauses: PauseSpans, first_ns: int, last_ns: int) -> PauseSpans:
    """Return the parts of a segment's pauses that lie between two times, those of an episode's reset and last step."""
    within = ((begin, end) for begin, end in pauses if begin < last_ns and end > first_ns)
    return tuple((max(begin, first_ns), min(end, last_ns)) for begin, end in within)


def _build_teaching(draft: _EpisodeDraft, steps: int, start_ns: int) -> TeachingRecord | None:
    """Return the record of an agent's part in an episode; None if a team played it or no agent took part.

    Args:
        draft: the episode.
        steps: the number of its steps.
        start_ns: the session time at which its segment began.
    """
    if not draft.activity_events or draft.formed is not None:
        return None
    in_time = part_events_in_session_time(draft.activity_events, start_ns)
    activity_events = [event for event in in_time if isinstance(event, events.ActivityEvent)]
    return gather_teaching(activity_events, steps=steps, actions=len(draft.start.action_names), policy=draft.policy)


def read_events(path: Path) -> Iterator[events.Event]:
    """Yield a log's events in the order in which they were recorded.

    Of a live or cut-off log (``.mcap.part``) the intact part is read; a finished log must be intact.

    Raises:
        LogError: if the file cannot be opened, is not a session log, has a newer schema version, or is damaged.
    """
    return LogReader(path).events()


def read_log(path: Path | str) -> SessionLog:
    """Read a session from a finished log, a live or cut-off ``.mcap.part``, or a folder of its segments.

    Raises:
        LogError: if there is no session log, or it has a newer schema version, is damaged, or holds no plan.
    """
    path = Path(path)
    files = list_session_files(path)
    readers = [LogReader(file) for file in files]
    assembler = SessionAssembler()
    for file, reader in zip(files, readers, strict=True):
        with raise_as_log_error(file):
            assembler.read(reader)
    if not assembler.started:
        raise LogError(f"{path} was cut off before its session started, so it has nothing to read; name another log")
    for started in assembler.started:
        find_logged_sources(started.facts)
    try:
        with raise_as_log_error(path):
            return _build_session_log(path, assembler, readers)
    except LogError as error:
        if str(path) in str(error):
            raise
        raise LogError(f"{path}: {error}") from error


def list_session_files(path: Path) -> list[Path]:
    """Return the files of one session, in order: a log itself, or all files of the session in a folder.

    Raises:
        LogError: if a folder holds no session, or more than one.
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


def _build_session_log(path: Path, assembler: SessionAssembler, readers: list[LogReader]) -> SessionLog:
    """Build a session's log from its files, after all of them have been read.

    Args:
        path: the log, or the folder of the files.
        assembler: the assembler, which has the files' messages.
        readers: the readers of the files, in order.

    Raises:
        LogError: if a step or a key press cannot be read, or a step is missing.
        OutsideNameError: if the name of the study or the participant cannot be a file's name.
    """
    first = assembler.started[0]
    require_name(first.plan.study, "the study")  # exports name files by these, and a foreign log may contain anything
    require_name(first.plan.participant.id, "the participant")
    starts = [facts for reader in readers for facts in reader.starts]
    ends = [facts for reader in readers for facts in reader.ends]
    segments, episodes = assembler.assemble(starts, ends)
    return SessionLog(
        path=path,
        plan=first.plan,
        player=first.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        clean=all_ended_cleanly(starts, ends),
        end_reason=assembler.end_reason,
        facts=first.facts,
        episodes=episodes,
        segments=segments,
        metadata={"segments": starts, "ends": ends},
    )
