"""A session played again: inputs found in what was recorded, fed to the machine, every event compared. No I/O.

The machine has no clock and no chance in it, so the same inputs give the same events: whatever else stands in a log is
a difference. What a person or a device did (which key, when, when a picture was on the display) is an input: it cannot
be worked out from anything else, only kept from being changed by a seal.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import fields
from itertools import islice
from typing import Any, get_args, get_type_hints

from minihuman.errors import MinihumanError
from minihuman.study.events import (
    EpisodeEnded,
    Event,
    FrameShown,
    KeyPressed,
    Noted,
    Sampled,
    SessionEnded,
    SessionStarted,
)
from minihuman.study.inputs import Asked, FocusChanged, Input, KeyDown, KeyUp, Shown, Stop, Tick
from minihuman.study.session import MakeWorld, Session

RULES = 1  # goes up when the machine gives other events for the same inputs; a log says by which it was made
_STOPS: tuple[Any, ...] = get_args(get_type_hints(Stop)["reason"])
_ASKED: tuple[Any, ...] = get_args(get_type_hints(Asked)["what"])


def differences(events: Sequence[Event], make_world: MakeWorld) -> Iterator[str]:
    """Yield what in a segment's events the machine does not say again; nothing if it says the very same.

    Events that a device gave are passed over. A segment that was cut off is compared as far as it goes.

    Raises:
        WorldError: if a world of the plan cannot be made here.
    """
    told = deque((number, event) for number, event in enumerate(events, 1) if not isinstance(event, Sampled))
    if not told or not isinstance(told[0][1], SessionStarted):
        yield "event 1: a segment starts with its plan"
        return
    first = told[0][1]
    try:
        session = Session(first.plan, make_world, first.facts, picture_px=None)
    except MinihumanError as error:
        yield f"event 1: {error}"
        return
    with closing(session):
        expected: deque[Event] = deque()
        while told:
            if not expected:
                coming: list[Event] = [event for _, event in islice(told, 3)]
                for happened in _inputs(coming, session):
                    expected += session.receive(happened)
            number, event = told.popleft()
            if not expected:
                yield f"event {number}, {_name(event)}: nothing leads to it"
                return
            again = expected.popleft()
            if again != event:
                yield f"event {number}, {_difference(event, again)}"
                return
        if expected and isinstance(event, SessionEnded):
            yield f"after event {number}: {_name(expected[0])} is missing"


def _inputs(coming: list[Event], session: Session) -> Iterator[Input]:
    """What must have reached the machine for the first of these events to come next."""
    event = coming[0]
    yield Tick(event.t_ns)  # whatever was due by then
    match event:
        case KeyPressed(down=True):
            yield KeyDown(event.t_ns - event.waited_ns, event.key, event.symbol, repeat=event.verdict == "repeat")
        case KeyPressed():
            yield KeyUp(event.t_ns - event.waited_ns, event.key, event.symbol)
        case FrameShown():
            yield Shown(event.t_ns, event.submit_ns, event.flip_ns)
        case Noted(kind="focus"):
            yield FocusChanged(event.t_ns, event.text == "found")
        case Noted(kind="experimenter"):
            what, _, text = event.text.partition(": ")
            for known in _ASKED:
                if known == what:
                    yield Asked(event.t_ns, known, text)
        case EpisodeEnded() | SessionEnded():
            ended = next((found for found in coming if isinstance(found, SessionEnded)), None)
            said: Any = "complete" if ended is None else ended.reason
            if said in (*_STOPS, "complete"):  # the others come of keys
                yield Stop(event.t_ns, said if said in _STOPS else "window_closed", ended.detail if ended else "")


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
