"""Replay of a session from its recorded events. No I/O.

The session machine has no clock and no randomness, so the same inputs give the same events, and any other event in a
log is a difference. What a person or device did (which key, when, when an image was displayed) is an input: it
cannot be recomputed, only protected by a manifest.
"""

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import fields, replace
from itertools import islice, pairwise, takewhile
from typing import TYPE_CHECKING, Any, TypeGuard, cast, get_args, get_type_hints

from minihuman.activities.team.events import PictureCorrected
from minihuman.errors import LogError, MinihumanError
from minihuman.experiment.machine.activity import ENTER_KEYS, WorldFactory
from minihuman.experiment.machine.events import (
    ActivityEvent,
    Answered,
    AxisMoved,
    ClauseDone,
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyPressed,
    Linked,
    ModelCall,
    Noted,
    PageShown,
    PointerUsed,
    Sampled,
    SessionEnded,
    SessionStarted,
    Stepped,
    TextChanged,
    TextTyped,
)
from minihuman.experiment.machine.inputs import (
    AxisChanged,
    ExperimenterCommand,
    FocusChanged,
    Input,
    KeyDown,
    KeyReleaseCause,
    KeyUp,
    PointerCause,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    Stop,
    TextChange,
    TextEdited,
    TextInput,
    Tick,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.picture_versions import may_draw_other_shadows, renders_same_images
from minihuman.moved import forward_names
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import CLAUSES_VERSION

MACHINE_VERSION = 1  # increased when the same inputs give other events; logs record it
_STOP_REASONS: tuple[Any, ...] = get_args(get_type_hints(Stop)["reason"])
_EXTERNAL_STOP_REASONS = (  # reasons that the session machine itself does not give without an earlier event
    "aborted",
    "window_closed",
    "signal",
    "timed_out",
    "connection_lost",
    "disk_full",
    "player_failed",
    "internal_error",
)
_COMMANDS: tuple[Any, ...] = get_args(get_type_hints(ExperimenterCommand)["command"])
_POINTER_INPUTS: dict[str, tuple[type[PointerPressed | PointerMoved | PointerReleased], PointerCause]] = {
    "pressed": (PointerPressed, "finger"),
    "moved": (PointerMoved, "finger"),
    "released": (PointerReleased, "finger"),
    "held_before_focus": (PointerPressed, "held_before_focus"),
    "cancelled": (PointerReleased, "cancelled"),
}
_OVER_PARTS = (Phase.PAUSED, Phase.UNFOCUSED, Phase.QUIT_QUESTION, Phase.ABORT_QUESTION)
_TIMED_PHASES = (Phase.INTERVAL, Phase.FIXATION, Phase.FEEDBACK, Phase.LEARNING)  # timed from the screen's display
_MAX_LOOK_AHEAD = 2_000  # events that are searched for an answer
_LAST_EVENTS = 8  # the largest number of events at a session's end
_MAX_SHOWN_CHARACTERS = 200  # of a field's value in the description of a difference
_EXTERNAL_EVENTS = (Sampled, Linked, ModelCall, PictureCorrected)
BROWSER_NOTE = "page"  # the kind of notes that come from a browser's page


SeatFollower = Callable[[SessionMachine, ModelCall | None], str]  # see ``follow`` of `compare_replay`


def compare_replay(
    events: Sequence[Event],
    make_world: WorldFactory,
    *,
    follow: SeatFollower | None = None,
    picture_px: tuple[int, int] | None = None,
) -> Iterator[str]:
    """Yield a line for each difference between a segment's events and their replay; nothing if they agree.

    Events of devices are skipped. A segment that was cut off is compared up to its end. First-person observations of an
    earlier renderer, and subgoals that worlds did not report when the log was recorded, are not compared. ``follow`` is
    called with each model call, returns how it differs or "", and with None after each input; None skips model calls.
    ``picture_px`` is the largest picture of screens; without it none is drawn.

    Raises:
        WorldError: if a world of the plan cannot be made here.
    """
    logged: deque[tuple[int, Event]] = deque()
    for number, event in enumerate(events, 1):
        if _is_replayed(event, with_model_calls=follow is not None):
            logged.append((number, event))
    _, first = logged[0] if logged else (0, None)
    if not isinstance(first, SessionStarted):
        yield "event 1: a segment starts with its plan"
        return
    comparison = _EventComparison(make_world, first.facts)
    try:
        session = SessionMachine(first.plan, comparison.make_world, first.facts, picture_px=picture_px)
    except MinihumanError as error:
        yield f"event 1: {error}"
        return
    has_questions = any(isinstance(event, Answered) for event in events)
    look_ahead = _MAX_LOOK_AHEAD if has_questions else _LAST_EVENTS
    with closing(session):
        yield from _compare_events(session, logged, comparison, follow, look_ahead)


def _is_replayed(event: Event, *, with_model_calls: bool) -> bool:
    """Return whether an event is compared with the replay, which an event from outside the session is not."""
    if isinstance(event, ModelCall):
        return with_model_calls
    return not _is_external(event)


def _compare_events(
    session: SessionMachine,
    logged: deque[tuple[int, Event]],
    comparison: "_EventComparison",
    follow: SeatFollower | None,
    look_ahead: int,
) -> Iterator[str]:
    """Feed a session the inputs behind numbered events; yield the differences, up to the first differing event."""
    expected: deque[Event] = deque()
    while logged:
        number, event = logged[0]
        if follow is not None and isinstance(event, ModelCall):
            logged.popleft()
            call_difference = follow(session, event)
            if call_difference:
                yield f"event {number}, {call_difference}"
            continue
        if not expected:
            upcoming = [coming for _, coming in islice(logged, look_ahead)]
            if follow is not None:
                upcoming = [coming for coming in upcoming if not isinstance(coming, ModelCall)]
            expected += _feed_next_input(session, upcoming, draws=False)
            if follow is not None:
                follow(session, None)
        logged.popleft()
        if not expected:
            yield f"event {number}, {_event_name(event)}: nothing leads to it"
            return
        difference = comparison.find_difference(event, comparison.take_replayed(event, expected))
        if difference:
            yield f"event {number}, {difference}"
            return
    if expected and isinstance(event, SessionEnded):
        yield f"after event {number}: {_event_name(expected[0])} is missing"


class _EventComparison:
    """Compares logged with replayed events; a log of an earlier version may have other pictures and lack subgoals."""

    def __init__(self, make_world: WorldFactory, facts: Mapping[str, str]) -> None:
        self._make_world = make_world
        self._is_drawn_here: dict[str, bool] = {}  # by a world's id: whether this package draws its pictures
        self._facts = facts
        self._has_same_images = renders_same_images(facts)
        self._lacks_subgoals = facts.get("clauses", "1") != str(CLAUSES_VERSION)
        self._skips_hashes = False  # whether the running episode's observations are not compared
        self._may_differ = False  # whether the running episode's observations may have other shadows

    def make_world(self, world_id: str, options: dict[str, Any]) -> World:
        """Make a world and remember whether this package draws its pictures."""
        world = self._make_world(world_id, options)
        self._is_drawn_here[world_id] = world.drawn
        return world

    def take_replayed(self, logged: Event, expected: deque[Event]) -> Event:
        """Remove from ``expected``, and return, the replayed event to compare with a logged one.

        Subgoals that the log's version did not report are skipped.
        """
        replayed = expected.popleft()
        while self._lacks_subgoals and isinstance(replayed, ClauseDone) and replayed != logged and expected:
            replayed = expected.popleft()
        return replayed

    def find_difference(self, logged: Event, replayed: Event) -> str:
        """Return a text on how an event differs from its replay; "" if it does not."""
        if isinstance(logged, EpisodeStarted):
            is_drawn_here = self._is_drawn_here.get(logged.plan.world, False)
            self._skips_hashes = is_drawn_here and not self._has_same_images
            self._may_differ = may_draw_other_shadows(self._facts, logged.plan.options)
        skips_hash = self._skips_hashes or self._may_differ
        if skips_hash and isinstance(logged, EpisodeStarted | Stepped) and type(replayed) is type(logged):
            logged = replace(logged, observation_hash=replayed.observation_hash)
        if is_same_event(logged, replayed):
            return ""
        return _describe_difference(logged, replayed)


def resume_from_events(
    events: Sequence[Event],
    make_world: WorldFactory,
    *,
    picture_px: tuple[int, int] | None,
    renders_steps: bool = True,
    follow: Callable[[SessionMachine, Event | None], object] | None = None,
) -> tuple[SessionMachine, list[Event]]:
    """Rebuild the machine that emitted a segment's events; return it with the events that were never written.

    ``follow`` is called with each event, model calls included, and with None after each input.

    Raises:
        LogError: if the replay differs from the events, or the session has ended.
        WorldError: if a world of the plan cannot be made here.
    """
    logged = deque(event for event in events if _is_replayed(event, with_model_calls=follow is not None))
    first = logged[0] if logged else None
    if not isinstance(first, SessionStarted):
        raise LogError(
            "a segment does not start with SessionStarted, so the log is damaged; repair it with `minihuman recover`"
        )
    session = SessionMachine(first.plan, make_world, first.facts, picture_px=picture_px, renders_steps=renders_steps)
    try:
        unwritten = _replay_logged(session, logged, follow or (lambda session, event: None))
        if session.over:
            raise LogError(
                f"session {first.plan.session} of {first.plan.participant.id} has ended and cannot be resumed; start "
                "another session"
            )
    except LogError:
        session.close()
        raise
    return session, unwritten


def _replay_logged(
    session: SessionMachine, logged: deque[Event], follow: Callable[[SessionMachine, Event | None], object]
) -> list[Event]:
    """Feed a session the inputs behind logged events; return the events that it emits beyond them.

    Raises:
        LogError: if an event differs.
    """
    expected: deque[Event] = deque()
    while logged:
        if isinstance(logged[0], ModelCall):
            follow(session, logged.popleft())
            continue
        if not expected:
            coming = islice(logged, _MAX_LOOK_AHEAD)
            expected += _feed_next_input(
                session, [event for event in coming if not isinstance(event, ModelCall)], draws=True
            )
            follow(session, None)
        event = logged.popleft()
        follow(session, event)
        if not expected or not is_same_event(event, expected.popleft()):
            raise LogError(
                f"{_event_name(event)} at {event.t_ns} ns differs in the replay; see how with `minihuman verify`"
            )
    return list(expected)


def _is_external(event: Event) -> bool:
    """Return whether an event comes from a device or a browser rather than from the machine."""
    return isinstance(event, _EXTERNAL_EVENTS) or (isinstance(event, Noted) and event.kind == BROWSER_NOTE)


def _feed_next_input(session: SessionMachine, coming: list[Event], *, draws: bool) -> list[Event]:
    """Feed the session the input that led to the first of the coming events; return the events that it then emits.

    Without ``draws``, a screen is built only if it is read.
    """
    event = coming[0]
    _show_question(session, coming, draws=draws)
    _show_screen(session, event, draws=draws)
    happened = _find_input(event, session)
    if isinstance(event, PointerUsed) and happened is not None:
        # a pointer's event precedes what is due at its time, unlike a key's
        return session.receive(happened, at_ns=event.t_ns, draws=draws)
    if happened is not None:
        if happened.t_ns < event.t_ns:  # an input that left no event moved the session's time first
            is_covered = session.phase in _OVER_PARTS
            session.receive(ScreenShown(event.t_ns, 0, 0) if is_covered else Tick(event.t_ns), draws=draws)
        return session.receive(happened, draws=draws)
    late_input = _find_input_at_phase_end(coming, session)
    if late_input is not None:
        return session.receive(late_input, at_ns=event.t_ns, draws=draws)
    stop = _find_stop(coming, session.phase)
    if stop is not None and stop.reason in _EXTERNAL_STOP_REASONS:
        return session.receive(stop, draws=draws)
    timed_events = session.receive(Tick(event.t_ns), draws=draws)
    if timed_events or stop is None:
        return timed_events
    return session.receive(stop, draws=draws)


def _find_input_at_phase_end(coming: list[Event], session: SessionMachine) -> Input | None:
    """Return the input whose arrival ended the phase of a timed screen; None if there is none.

    A Tick fed before this input would prepare the world too early.
    """
    simultaneous = takewhile(lambda candidate: candidate.t_ns == coming[0].t_ns, coming)
    for previous, event in pairwise(simultaneous):
        begins_preparing = previous == Noted(event.t_ns, "phase", Phase.PREPARING)
        if begins_preparing and isinstance(event, KeyPressed | AxisMoved | Noted):
            return _find_input(event, session)
    return None


def _find_input(event: Event, session: SessionMachine) -> Input | None:
    """Return the input that caused an event; None if no input did."""
    match event:
        case KeyPressed():
            return _find_key_input(event)
        case FrameShown():
            return ScreenShown(event.t_ns, event.submit_ns, event.flip_ns, event.step)
        case PageShown():
            return ScreenShown(event.t_ns, event.submit_ns, event.flip_ns)
        case TextTyped():
            return TextInput(event.t_ns, event.text)
        case TextChanged():
            changes = cast("tuple[TextChange, ...]", event.changes)
            return TextEdited(event.t_ns, event.text, changes, event.keys, event.t_ns - event.waited_ns, event.item)
        case PointerUsed():
            used_ns = event.t_ns - event.waited_ns
            pointer_input, pointer_cause = _POINTER_INPUTS[event.what]
            return pointer_input(used_ns, event.x, event.y, event.target, event.along, pointer_cause)
        case AxisMoved():
            return AxisChanged(event.t_ns - event.waited_ns, event.axis, event.value)
        case Noted(kind="focus"):
            return FocusChanged(event.t_ns, event.text == "found")
        case Noted(kind="experimenter"):
            word, _, text = event.text.partition(": ")
            return next((ExperimenterCommand(event.t_ns, name, text) for name in _COMMANDS if name == word), None)
        case ActivityEvent():
            return session.part.input_of(event)
    return None


def _find_key_input(event: KeyPressed) -> KeyDown | KeyUp:
    key_ns = event.t_ns - event.waited_ns
    if not event.down:
        cause: KeyReleaseCause = "focus_loss" if event.verdict == "release_at_focus_loss" else "finger"
        return KeyUp(key_ns, event.key, event.symbol, cause)
    if event.verdict == "held_before_focus" or event.verdict == "shortcut":
        return KeyDown(key_ns, event.key, event.symbol, cause=event.verdict)
    return KeyDown(key_ns, event.key, event.symbol, repeat=event.verdict == "repeat")


def _show_question(session: SessionMachine, coming: list[Event], *, draws: bool) -> None:
    """Report a question as shown at the time that its answer states, since its display leaves no event of its own."""
    if isinstance(coming[0], SessionStarted):
        return
    for event in coming:
        if isinstance(event, Answered):
            _show_answered_question(session, event, coming[0].t_ns, draws=draws)
            return


def _show_answered_question(session: SessionMachine, answered: Answered, next_ns: int, *, draws: bool) -> None:
    """Report the question of an answer as shown; the report arrives no later than the next event."""
    shown_ns = answered.shown_ns
    if shown_ns and session.part.number == answered.part:
        session.receive(ScreenShown(min(shown_ns, next_ns), shown_ns, shown_ns), draws=draws)


def _show_screen(session: SessionMachine, event: Event, *, draws: bool) -> None:
    """Report a text, blank or fixation screen as shown, at the time that the next event implies.

    The display of such a screen leaves no event. If Enter was pressed before the ready screen was visible, the screen
    was displayed after that press. A timed screen's duration counts from its display, so an event that arrived during
    the screen implies that its time was not over.
    """
    if _is_enter_before_ready(event, session.phase):
        pressed_ns = event.t_ns - event.waited_ns
        session.receive(ScreenShown(0, 0, pressed_ns + 1), draws=draws)  # of the three times, only the flip's counts
    elif session.phase in _TIMED_PHASES and _proves_phase(event, session.phase):
        phase_end_ns = session.next_tick_ns
        if phase_end_ns is None or phase_end_ns > event.t_ns:
            return
        session.receive(ScreenShown(0, 0, event.t_ns), draws=draws)
        phase_end_ns = session.next_tick_ns  # if the screen was displayed at the event's time
        assert phase_end_ns is not None, "a timed screen that was displayed has an end"
        duration_ns = phase_end_ns - event.t_ns
        earliest_flip_ns = event.t_ns - duration_ns + 1  # the phase then ends 1 ns after the event
        session.receive(ScreenShown(0, 0, earliest_flip_ns), draws=draws)


def _is_enter_before_ready(event: Event, phase: str) -> TypeGuard[KeyPressed]:
    """Return whether an event is a press of Enter before the ready screen was visible."""
    if not isinstance(event, KeyPressed) or phase != Phase.READY or event.phase != phase:
        return False
    return event.down and event.verdict == "not_playing" and event.key in ENTER_KEYS


def _proves_phase(event: Event, phase: str) -> bool:
    """Return whether an event proves that the phase had not ended before it.

    If the phase had ended, the events of its end would have come first.
    """
    match event:
        case KeyPressed():
            return event.phase == phase
        case AxisMoved() | Noted(kind="focus" | "experimenter"):
            return True
    return False


def _find_stop(coming: list[Event], phase: str) -> Stop | None:
    """Return the input that ended the session from outside at the time of the first coming event; None without one."""
    first = coming[0]
    simultaneous = [event for event in coming[:_LAST_EVENTS] if event.t_ns == first.t_ns]
    end = next((event for event in simultaneous if isinstance(event, SessionEnded)), None)
    if end is not None:
        if end.reason in _STOP_REASONS:
            reason: Any = end.reason
            return Stop(end.t_ns, reason, end.detail)
        is_closed_on_last_page = end.reason == "complete" and phase == Phase.CLOSING
        return Stop(end.t_ns, "window_closed", end.detail) if is_closed_on_last_page else None
    is_end_of_log = len(simultaneous) == len(coming)  # the log was cut off before SessionEnded
    if is_end_of_log and isinstance(first, EpisodeEnded) and first.outcome == "abandoned":
        return Stop(first.t_ns, "window_closed")
    return None


def _describe_difference(logged: Event, replayed: Event) -> str:
    if type(logged) is not type(replayed):
        return f"{_event_name(logged)}: the machine says {_event_name(replayed)}"
    for field in fields(logged):
        logged_value = getattr(logged, field.name)
        replayed_value = getattr(replayed, field.name)
        if not _is_same_value(logged_value, replayed_value):
            values = f"{_shorten(logged_value)} in the log, now {_shorten(replayed_value)}"
            return f"{_event_name(logged)}: {field.name} {values}"
    return f"{_event_name(logged)}: what was observed differs"


def is_same_event(logged: Event, replayed: Event) -> bool:
    """Return whether an event equals its replay.

    NaN equals NaN. The text of a world's failure is not compared, because it differs between versions of Python and of
    this program. Hashes of pictures are not compared, because a replay draws no pictures.
    """
    if logged == replayed:
        return True
    if type(logged) is not type(replayed):
        return False
    ignored_fields = {"picture_hash"}
    if isinstance(replayed, SessionEnded) and replayed.reason == "world_error":
        ignored_fields.add("detail")
    return all(
        _is_same_value(getattr(logged, field.name), getattr(replayed, field.name))
        for field in fields(logged)
        if field.name not in ignored_fields
    )


def _is_same_value(logged: object, replayed: object) -> bool:
    """Return whether a field's logged value equals the replayed one, where NaN equals NaN."""
    if isinstance(logged, float) and isinstance(replayed, float) and math.isnan(logged) and math.isnan(replayed):
        return True
    return bool(logged == replayed)


def _shorten(field_value: object) -> str:
    """Return the start of the representation of a field's value, short enough for a line."""
    text = repr(field_value)
    if len(text) < _MAX_SHOWN_CHARACTERS:
        return text
    return f"{text[:_MAX_SHOWN_CHARACTERS]}..."


def _event_name(event: Event) -> str:
    return type(event).__name__


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
