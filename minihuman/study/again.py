"""A session played again: inputs found in what was recorded, fed to the machine, every event compared. No I/O.

The machine has no clock and no chance in it, so the same inputs give the same events: whatever else stands in a log is
a difference. What a person or a device did (which key, when, when a picture was on the display) is an input: it cannot
be worked out from anything else, only kept from being changed by a seal.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import fields, replace
from itertools import islice
from typing import Any, get_args, get_type_hints

from minihuman.errors import LogError, MinihumanError
from minihuman.study.events import (
    Answered,
    ClauseDone,
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyPressed,
    KindEvent,
    Linked,
    Noted,
    PageShown,
    PointerUsed,
    Sampled,
    SessionEnded,
    SessionStarted,
    Stepped,
    TextTyped,
)
from minihuman.study.inputs import (
    Asked,
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    Shown,
    Stop,
    Tick,
    Typed,
)
from minihuman.study.phases import Phase
from minihuman.study.session import Session
from minihuman.study.stage import ENTER, MakeWorld
from minihuman.worlds.adapt.world import World
from minihuman.worlds.contract import CLAUSES, PICTURES

RULES = 1  # goes up when the machine gives other events for the same inputs; a log says by which it was made
_STOPS: tuple[Any, ...] = get_args(get_type_hints(Stop)["reason"])
_FROM_OUTSIDE = (  # nothing that happens inside says these
    "window_closed",
    "signal",
    "timed_out",
    "connection_lost",
    "disk_full",
    "internal_error",
)
_ASKED: tuple[Any, ...] = get_args(get_type_hints(Asked)["what"])
_POINTERS: dict[str, type[PointerPressed | PointerMoved | PointerReleased]] = {
    "pressed": PointerPressed,
    "moved": PointerMoved,
    "released": PointerReleased,
}
_OVER_PARTS = (Phase.PAUSED, Phase.UNFOCUSED, Phase.QUIT_QUESTION, Phase.ABORT_QUESTION)
_STANDING = (Phase.INTERVAL, Phase.FIXATION, Phase.LEARNING)  # for some time from when they are seen
_AHEAD = 2_000  # events that are looked through for an answer
_LAST_EVENTS = 8  # at most, that an end has
OF_PAGE = "page"  # notes of this kind are a browser's page's own


def same_pictures(facts: Mapping[str, str]) -> bool:
    """Whether worlds in first person are drawn here as they were where a log with these facts was recorded."""
    return facts.get("pictures", "1") == str(PICTURES)


def differences(events: Sequence[Event], make_world: MakeWorld) -> Iterator[str]:
    """Yield what in a segment's events the machine does not say again; nothing if it says the very same.

    Events that a device gave are passed over. A segment that was cut off is compared as far as it goes. Where pictures
    in first person were drawn by an earlier renderer, what was seen of them is not compared; clauses that worlds told
    nothing of then are passed over.

    Raises:
        WorldError: if a world of the plan cannot be made here.
    """
    told: deque[tuple[int, Event]] = deque(
        (number, event) for number, event in enumerate(events, 1) if not _beside(event)
    )
    if not told or not isinstance(told[0][1], SessionStarted):
        yield "event 1: a segment starts with its plan"
        return
    first = told[0][1]
    drawn: dict[str, bool] = {}  # by world

    def make(world_id: str, options: dict[str, Any]) -> World:
        world = make_world(world_id, options)
        drawn[world_id] = world.drawn
        return world

    same, otherwise = same_pictures(first.facts), False
    told_less = first.facts.get("clauses", "1") != str(CLAUSES)
    try:
        session = Session(first.plan, make, first.facts, picture_px=None)
    except MinihumanError as error:
        yield f"event 1: {error}"
        return
    with closing(session):
        expected: deque[Event] = deque()
        has_questions = any(isinstance(event, Answered) for event in events)
        while told:
            if not expected:
                coming = [event for _, event in islice(told, _AHEAD if has_questions else _LAST_EVENTS)]
                expected += _fed(session, coming)
            number, event = told.popleft()
            if not expected:
                yield f"event {number}, {_name(event)}: nothing leads to it"
                return
            again = expected.popleft()
            while told_less and isinstance(again, ClauseDone) and again != event and expected:
                again = expected.popleft()
            if isinstance(event, EpisodeStarted):
                otherwise = not same and drawn.get(event.plan.world, False)
            if otherwise and isinstance(event, EpisodeStarted | Stepped) and type(again) is type(event):
                event = replace(event, observation_hash=again.observation_hash)
            if again != event:
                yield f"event {number}, {_difference(event, again)}"
                return
        if expected and isinstance(event, SessionEnded):
            yield f"after event {number}: {_name(expected[0])} is missing"


def taken_up(
    events: Sequence[Event],
    make_world: MakeWorld,
    *,
    picture_px: tuple[int, int] | None,
    draws_steps: bool = True,
) -> tuple[Session, list[Event]]:
    """The machine that said a segment's events, to go on with, and what it says beyond them.

    That is nothing, or what the last write of a killed program had no time for.

    Raises:
        LogError: if the events are not what the machine says, or the session is over.
        WorldError: if a world of the plan cannot be made here.
    """
    told = deque(event for event in events if not _beside(event))
    first = told[0] if told else None
    if not isinstance(first, SessionStarted):
        raise LogError("a segment starts with its plan")
    session = Session(first.plan, make_world, first.facts, picture_px=picture_px, draws_steps=draws_steps)
    expected: deque[Event] = deque()
    while told:
        if not expected:
            expected += _fed(session, list(islice(told, _AHEAD)))
        event = told.popleft()
        if not expected or expected.popleft() != event:
            session.close()
            raise LogError(f"{_name(event)} at {event.t_ns} ns is not what the session says")
    if session.over:
        session.close()
        raise LogError("the session is over")
    return session, list(expected)


def _beside(event: Event) -> bool:
    """Whether an event is not the machine's: what a device gave, or what a browser says of itself."""
    return isinstance(event, Sampled | Linked) or (isinstance(event, Noted) and event.kind == OF_PAGE)


def _fed(session: Session, coming: list[Event]) -> list[Event]:
    """What the machine says to the input that must have come next."""
    event = coming[0]
    _see_question(session, coming)
    _see_screen(session, event)
    happened = _input(event, session)
    if happened is not None:
        if happened.t_ns < event.t_ns:  # it came late, behind something that left no event
            session.receive(Shown(event.t_ns, 0, 0) if session.phase in _OVER_PARTS else Tick(event.t_ns))
        return session.receive(happened)
    stop = _stop(coming, session.phase)
    if stop is not None and stop.reason in _FROM_OUTSIDE:
        return session.receive(stop)
    return session.receive(Tick(event.t_ns)) or (session.receive(stop) if stop else [])


def _input(event: Event, session: Session) -> Input | None:
    """The input that an event tells of; None for one that tells of none."""
    match event:
        case KeyPressed(down=True):
            return KeyDown(event.t_ns - event.waited_ns, event.key, event.symbol, repeat=event.verdict == "repeat")
        case KeyPressed():
            return KeyUp(event.t_ns - event.waited_ns, event.key, event.symbol)
        case FrameShown():
            return Shown(event.t_ns, event.submit_ns, event.flip_ns, event.step)
        case PageShown():
            return Shown(event.t_ns, event.submit_ns, event.flip_ns)
        case TextTyped():
            return Typed(event.t_ns, event.text)
        case PointerUsed():
            return _POINTERS[event.what](event.t_ns, event.x, event.y, event.target, event.along)
        case Noted(kind="focus"):
            return FocusChanged(event.t_ns, event.text == "found")
        case Noted(kind="experimenter"):
            what, _, text = event.text.partition(": ")
            return next((Asked(event.t_ns, known, text) for known in _ASKED if known == what), None)
        case KindEvent():
            return session.part.input_of(event)
    return None


def _see_question(session: Session, coming: list[Event]) -> None:
    """Let a question be seen when its answer says that it was: that it reached the display is no event of its own."""
    if isinstance(coming[0], SessionStarted):
        return
    answered = next((event for event in coming if isinstance(event, Answered)), None)
    if answered is not None and answered.shown_ns and session.part.number == answered.part:
        seen_ns = answered.shown_ns
        session.receive(Shown(min(seen_ns, coming[0].t_ns), seen_ns, seen_ns))


def _see_screen(session: Session, event: Event) -> None:
    """Let a text, a blank or a cross be seen as late as a key says that it was: that is no event of its own either.

    Who presses Enter before "Ready?" is to be seen meant the screen before. A screen that stands for some time does so
    from when it was seen, so a key that found it still there says that its time was not over.
    """
    if not isinstance(event, KeyPressed) or event.phase != session.phase:
        return
    if session.phase is Phase.READY and event.down and event.verdict == "not_playing" and event.key in ENTER:
        pressed_ns = event.t_ns - event.waited_ns
        session.receive(Shown(0, 0, pressed_ns + 1))
    elif session.phase in _STANDING and session.next_tick_ns is not None and session.next_tick_ns <= event.t_ns:
        session.receive(Shown(0, 0, event.t_ns))
        over_ns = session.next_tick_ns  # had it been seen just now
        session.receive(Shown(0, 0, event.t_ns + 1 - (over_ns - event.t_ns)))


def _stop(coming: list[Event], phase: str) -> Stop | None:
    """What ended the session from outside, if its end is what comes now."""
    at_once = [event for event in coming[:_LAST_EVENTS] if event.t_ns == coming[0].t_ns]
    ended = next((event for event in at_once if isinstance(event, SessionEnded)), None)
    if ended is None:
        last = coming[0]
        cut_off = len(at_once) == len(coming) and isinstance(last, EpisodeEnded) and last.outcome == "abandoned"
        return Stop(coming[0].t_ns, "window_closed") if cut_off else None
    reason: Any = ended.reason if ended.reason in _STOPS else "window_closed"
    closed = ended.reason == "complete" and phase == Phase.CLOSING  # over the last words; else nobody stopped it
    return Stop(ended.t_ns, reason, ended.detail) if closed or ended.reason in _STOPS else None


def _difference(event: Event, again: Event) -> str:
    if type(event) is not type(again):
        return f"{_name(event)}: the machine says {_name(again)}"
    for field in fields(event):
        logged, now = getattr(event, field.name), getattr(again, field.name)
        if logged != now:
            return f"{_name(event)}: {field.name} {_short(logged)} in the log, now {_short(now)}"
    return f"{_name(event)}: what was observed differs"


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) < 200 else f"{text[:200]}..."


def _name(event: Event) -> str:
    return type(event).__name__
