"""A segment of a session: from one start of the program to its end. A session that was resumed has several.

Every time here and in ``Episode`` is session time: ns since the session's first segment began, by one clock over all
segments. In the log each segment's times begin at 0; where a segment lies in the session is told by the wall clock at
its start, and it never begins before the one before it ended.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace

from minihuman.recorded.columns import EventColumns
from minihuman.study.events import (
    AnswerChanged,
    Answered,
    ClauseDone,
    EpisodesSkipped,
    KeyPressed,
    KindEvent,
    Linked,
    Noted,
    PageShown,
    PartEnded,
    PartStarted,
    Paused,
    PointerUsed,
    Resumed,
    Sampled,
    Scored,
    TextTyped,
)

PartEvent = (
    PartStarted
    | PartEnded
    | PageShown
    | EpisodesSkipped
    | Scored
    | ClauseDone
    | AnswerChanged
    | Answered
    | TextTyped
    | PointerUsed
    | KindEvent
    | Linked
)
Note = Noted | Paused | Resumed
Pauses = tuple[tuple[int, int], ...]  # begin and end of each, ns of session time


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """One stretch of a session in which the program ran, as it was logged."""

    number: int  # 1 for the session's first
    started_at: str  # ISO 8601 UTC, from the wall clock
    started_unix_ns: int  # the same, ns since 1970
    started_monotonic_ns: int | None  # the machine's monotonic clock then; None in logs that do not say
    monotonic_clock: str  # that clock's name, such as "clock_gettime(CLOCK_MONOTONIC)"; "" where the log does not say
    start_ns: int  # session time at which it began; 0 for the first
    end_ns: int  # session time of the last that is known of it
    end_reason: str  # an EndReason, or "cut_off"
    clean: bool  # whether it ended by itself; False if it was cut off or is still live
    facts: dict[str, str]  # of the station: versions, platform, display
    notes: tuple[Note, ...]  # consent, focus, pauses, errors, in order of time
    keys: EventColumns[KeyPressed]  # every press and release, outside episodes too
    part_events: tuple[PartEvent, ...] = ()  # parts, pages, answers, points, in the order logged
    samples: Sequence[Sampled] = ()  # of the protocol's devices, read when looked at

    @property
    def pauses(self) -> Pauses:
        """Begin and end of every pause, ns of session time; one that nobody ended ends with the segment."""
        found: list[tuple[int, int]] = []
        began_ns: int | None = None
        for note in self.notes:
            match note:
                case Paused() if began_ns is None:
                    began_ns = note.t_ns
                case Resumed() if began_ns is not None:
                    found.append((began_ns, note.t_ns))
                    began_ns = None
        return tuple(found) if began_ns is None else (*found, (began_ns, max(began_ns, self.end_ns)))


def in_session(notes: Iterable[Note], start_ns: int) -> tuple[Note, ...]:
    """A segment's notes as they were logged, told in session time, in order of time."""
    return tuple(sorted((replace(note, t_ns=note.t_ns + start_ns) for note in notes), key=lambda note: note.t_ns))


def parts_in_session(events: Iterable[PartEvent], start_ns: int) -> tuple[PartEvent, ...]:
    """What happened in a segment's parts as it was logged, told in session time."""
    return tuple(_moved(event, start_ns) for event in events)


def _moved(event: PartEvent, start_ns: int) -> PartEvent:
    if isinstance(event, Linked):  # whose other times are how long something took
        return replace(event, t_ns=event.t_ns + start_ns)
    names = (field.name for field in fields(event) if field.name.endswith("_ns"))
    times = {name: getattr(event, name) for name in names}
    known = {name: t_ns + start_ns for name, t_ns in times.items() if t_ns or name == "t_ns"}  # 0: nobody said
    return replace(event, **known)
