"""A session gathered from its messages: each kind in a row, then all of a kind made into columns at once.

No object is made of a step, a key press or a picture shown: that is what makes a study quick to read.
"""

from bisect import bisect
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np
from google.protobuf.message import Message
from numpy.typing import NDArray

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.kinds import TRUTHS
from minihuman.log.observations import Observations
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.read.chunk import OfTopic
from minihuman.log.read.columns import by_step, check_steps, frames_of, moments_of, presses_of
from minihuman.log.read.file import Reading
from minihuman.log.read.wire import Column, Columns, read_columns
from minihuman.log.samples import Samples
from minihuman.recorded.columns import EventColumns
from minihuman.recorded.episode import CUT_OFF, Episode
from minihuman.recorded.segment import Note, PartEvent, Pauses, Segment, in_session, parts_in_session
from minihuman.recorded.taught import Taught, taught
from minihuman.study import events as ev
from minihuman.study.activities.agent_events import PolicyGiven
from minihuman.study.events import PartStarted

_BREAK = ""  # the topic that stands for messages that are missing
_THOUSANDS: dict[str, type[Message]] = {topics.STEP: v1.Step, topics.KEY: v1.KeyEvent, topics.FRAME: v1.FrameShown}
_TIMES = frozenset(
    {"t_ns", "pressed_ns", "key_t_ns", "submit_ns", "flip_ns"}
)  # columns that are times, whatever the message


@dataclass(slots=True)
class _Part:
    """A segment as far as it has been read: its messages are those from one place on, its times begin at 0."""

    started: ev.SessionStarted
    begin: int
    ended: ev.SessionEnded | None = None
    last_ns: int = 0  # of what has been read one by one
    notes: list[Note] = field(default_factory=list)
    part_events: list[PartEvent] = field(default_factory=list)


@dataclass(slots=True)
class _Span:
    """An episode as far as it has been read: its messages are those between two places."""

    start: ev.EpisodeStarted
    segment: int  # 0 for the first that was read
    begin: int
    end: int | None = None  # None: the log broke off first
    outcome: ev.Outcome | None = None
    policy: str = ""  # of an agent, in force when it began
    events: list[ev.KindEvent] = field(default_factory=list)  # that kinds of activity said of it


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
        return self.between(span.begin, span.end)

    def between(self, begin: int, end: int | None) -> slice:
        """Which of them lie between two places, the second left out; None for the log's end."""
        first = int(np.searchsorted(self.places, begin))
        return slice(first, len(self.places) if end is None else int(np.searchsorted(self.places, end)))


class Gathering:
    """Takes a session's messages in the order they were recorded. What lies between episodes belongs to none."""

    def __init__(self) -> None:
        self._parts: list[_Part] = []
        self._chunks: list[bytes] = []  # that hold messages of the topics that have thousands
        self._found: dict[str, list[OfTopic]] = defaultdict(list)  # among those chunks' bytes
        self._observed: tuple[list[int], list[bytes]] = ([], [])  # places and messages, not looked at yet
        self._sampled: tuple[list[int], list[bytes]] = ([], [])
        self._spans: list[_Span] = []
        self._policy = ""  # of an agent, in force
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
            for topic, places, begins, ends in chunk.by_topic(among=TRUTHS):
                if topic in _THOUSANDS:
                    self._found[topic].append(OfTopic(topic, places + self._count, begins + size, ends + size))
                    self._size = size + len(chunk.data)
                else:
                    numbers = (self._count + places).tolist()
                    payloads = [
                        chunk.data[begin:end] for begin, end in zip(begins.tolist(), ends.tolist(), strict=True)
                    ]
                    if topic in (topics.OBSERVATION, topics.SAMPLE):
                        kept = self._observed if topic == topics.OBSERVATION else self._sampled
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
    def started(self) -> list[ev.SessionStarted]:
        """How each segment began."""
        return [part.started for part in self._parts]

    @property
    def end_reason(self) -> str:
        """Why the last segment ended, as far as it said so."""
        ended = self._parts[-1].ended
        return CUT_OFF if ended is None else ended.reason

    def session(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]]
    ) -> tuple[tuple[Segment, ...], tuple[Episode, ...]]:
        """The session's segments and every episode in the order played, all on one clock.

        ``starts`` and ``ends`` are what the files say of each segment that was read, and of each that was finished.

        Raises:
            LogError: if a step or a key press cannot be read, or a step is missing. Pictures are read when looked at.
        """
        data = b"".join(self._chunks)
        steps, downs, pictures = (_Rows(topic, self._found[topic], data) for topic in _THOUSANDS)
        placed = self._placed(starts, ends, steps, downs)
        segments = [segment for segment, _ in placed]
        starts_ns = np.array([segment.start_ns for segment in segments], np.int64)
        begins = np.array([part.begin for part in self._parts], np.int64)

        def on_one_clock(rows: _Rows) -> Callable[[str], Column]:
            """The columns of these messages, session time in those that are times."""

            @cache
            def column(name: str) -> Column:
                found = rows.column(name)
                if name not in _TIMES or not starts_ns.any():
                    return found
                start_ns = starts_ns[np.searchsorted(begins, rows.places, side="right") - 1]
                return found._replace(values=found.values + start_ns)

            return column

        of_downs = presses_of(on_one_clock(downs), len(downs.places))
        shown = frames_of(on_one_clock(pictures), len(pictures.places))
        segments = [
            replace(segment, keys=of_downs[downs.between(*between)], samples=self._samples(segment, *between))
            for segment, between in placed
        ]
        for span in self._spans:
            if start_ns := segments[span.segment].start_ns:
                span.start = replace(span.start, t_ns=span.start.t_ns + start_ns)
        column = on_one_clock(steps)
        of_steps = [steps.within(span) for span in self._spans]
        moments = moments_of([span.start for span in self._spans], [its.start for its in of_steps], column)
        stepwise = by_step(column)
        numbers = [column(name).values for name in ("episode", "step")]
        step_keys = column("key").values
        pauses = [segment.pauses for segment in segments]
        attempts: Counter[int] = Counter()
        episodes = []
        nexts: list[int | None] = [*(span.begin for span in self._spans[1:]), None][: len(self._spans)]
        for number, (span, its, until) in enumerate(zip(self._spans, of_steps, nexts, strict=True)):
            check_steps(span.start.plan.episode, *(column[its] for column in numbers))
            attempts[span.start.plan.episode] += 1
            with_reset = slice(its.start + number, its.stop + number + 1)  # every episode before has a reset too
            episodes.append(
                Episode(
                    start=span.start,
                    **{name: column[with_reset] for name, column in moments.items()},
                    **{name: column[its] for name, column in stepwise.items()},
                    step_keys=step_keys[its],
                    keys=of_downs[downs.within(span)],
                    frames=shown[pictures.between(span.begin, until)],  # the last picture stays when it is over
                    outcome=span.outcome,
                    observations=self._observations(span, its.stop - its.start),
                    segment=segments[span.segment].number,
                    attempt=attempts[span.start.plan.episode],
                    pauses=_within(pauses[span.segment], moments["t_ns"][with_reset]),
                    taught=_taught(span, its.stop - its.start, segments[span.segment].start_ns),
                )
            )
        return tuple(segments), tuple(episodes)

    def _placed(
        self, starts: Sequence[dict[str, str]], ends: Sequence[dict[str, str]], steps: _Rows, downs: _Rows
    ) -> list[tuple[Segment, tuple[int, int | None]]]:
        """Every segment where it lies in the session, without its keys, and which places its messages have."""
        clean = {int(end["segment"]): end["clean"] == "true" for end in ends}
        placed: list[tuple[Segment, tuple[int, int | None]]] = []
        after_ns = 0
        for number, (part, facts) in enumerate(zip(self._parts, starts, strict=True)):
            between = (part.begin, self._parts[number + 1].begin if number + 1 < len(self._parts) else None)
            unix_ns = int(facts["started_unix_ns"])
            start_ns = max(unix_ns - int(starts[0]["started_unix_ns"]), after_ns)
            end_ns = start_ns + self._lasted_ns(part, [(rows, rows.between(*between)) for rows in (steps, downs)])
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
                notes=in_session(part.notes, start_ns),
                part_events=parts_in_session(part.part_events, start_ns),
                keys=EventColumns.of(ev.KeyPressed, ()),
            )
            placed.append((segment, between))
            after_ns = end_ns + 1  # a clock that was set back does not turn session time back
        return placed

    @staticmethod
    def _lasted_ns(part: _Part, thousands: Sequence[tuple[_Rows, slice]]) -> int:
        """Segment time of the last that is known of a segment, ns."""
        if part.ended is not None:
            return part.last_ns
        times = [rows.column("t_ns").values[its] for rows, its in thousands]
        return max(part.last_ns, *(int(theirs.max(initial=0)) for theirs in times))

    def _samples(self, segment: Segment, begin: int, end: int | None) -> Samples:
        places, messages = self._sampled
        return Samples(messages[bisect(places, begin) : None if end is None else bisect(places, end)], segment.start_ns)

    def _observations(self, span: _Span, steps: int) -> Observations | None:
        """What was observed in an episode; a log may break off between an observation and its step."""
        places, messages = self._observed
        its = messages[bisect(places, span.begin) : None if span.end is None else bisect(places, span.end)]
        return Observations(span.start.plan.episode, its[: steps + 1]) if len(its) > steps else None

    def _take(self, place: int, event: ev.Event | None) -> None:
        if not self._parts and not isinstance(event, ev.SessionStarted):
            return  # the plan is lost, and nothing says what this belongs to
        match event:
            case ev.SessionStarted():
                self._close(place)
                self._parts.append(_Part(event, place))
            case ev.SessionEnded():
                self._parts[-1].ended = event
            case ev.EpisodeStarted():
                self._close(place)
                self._spans.append(_Span(event, len(self._parts) - 1, begin=place, policy=self._policy))
            case ev.EpisodeEnded():
                self._close(place, event.outcome)
            case ev.Noted() | ev.Paused() | ev.Resumed():
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
            case PartStarted():
                self._policy = ""
            case ev.KindEvent() if (
                self._spans and getattr(event, "episode", None) == self._spans[-1].start.plan.episode
            ):
                self._spans[-1].events.append(event)

    def _close(self, place: int, outcome: ev.Outcome | None = None) -> None:
        """End the last episode, if it has not ended."""
        if self._spans and self._spans[-1].end is None:
            self._spans[-1].end, self._spans[-1].outcome = place, outcome


def _taught(span: _Span, steps: int, start_ns: int) -> Taught | None:
    """Who steered an episode, told in session time."""
    if not span.events:
        return None
    events = [event for event in parts_in_session(span.events, start_ns) if isinstance(event, ev.KindEvent)]
    return taught(events, steps=steps, actions=len(span.start.action_names), policy=span.policy)


def _within(pauses: Pauses, t_ns: NDArray[np.int64]) -> Pauses:
    """The pauses, or what of them lies between an episode's reset and its last step."""
    first, last = int(t_ns[0]), int(t_ns[-1])
    return tuple((max(begin, first), min(end, last)) for begin, end in pauses if begin < last and end > first)
