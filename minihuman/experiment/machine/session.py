"""The session machine: inputs in, events out. It has no clock, files or windows.

    session = SessionMachine(plan, World, facts)
    events = session.receive(Tick(t_ns=0))    # write these
    screen = session.screen                   # then show this, and return the window's ScreenShown

Write the events before showing the new screen. The same inputs give the same events. The session itself handles pauses,
questions about the session and its end; `PartSequence` handles the order of parts, and each activity its own content.
"""

from collections.abc import Mapping
from enum import StrEnum
from functools import partial
from typing import TYPE_CHECKING, Literal

from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import ENTER_KEYS, Activity, ActivityRequest, SessionContext, WorldFactory
from minihuman.experiment.machine.events import (
    AxisMoved,
    EndReason,
    Event,
    Noted,
    PauseReason,
    PointerUse,
    PointerUsed,
    SessionEnded,
    SessionStarted,
)
from minihuman.experiment.machine.inputs import (
    ActivityInput,
    AxisChanged,
    ExperimenterCommand,
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerInput,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    ScreenShown,
    Stop,
    TextEdited,
    TextInput,
    Tick,
    precedes_due_changes,
)
from minihuman.experiment.machine.key_state import KeyState
from minihuman.experiment.machine.part_sequence import PartSequence
from minihuman.experiment.machine.running_episode import RunningEpisode, WorldFailedError
from minihuman.experiment.machine.screens import Screen, TextScreen
from minihuman.experiment.machine.transitions import SESSION_TRANSITIONS, Phase, TransitionCause
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.moved import forward_names

CONSENT_RULES = "2"  # the fact "consent_rules" of a session: Escape on a consent text declines; before, it quit
KEY_RULES = "2"  # the fact "key_rules": keys held before the focus, and shortcuts, have no effect; before, they had one

PAUSE_KEY = "f8"
_PAUSE_REASONS: dict[TransitionCause, PauseReason] = {
    TransitionCause.PAUSE: "participant",
    TransitionCause.FOCUS_LOST: "focus_lost",
    TransitionCause.ASK_QUIT: "quit_question",
    TransitionCause.ASK_ABORT: "abort_question",
}

_POINTER_USES: dict[type[PointerInput], PointerUse] = {
    PointerPressed: "pressed",
    PointerMoved: "moved",
    PointerReleased: "released",
}
_IGNORED_POINTER_CAUSES: dict[type[PointerInput], Literal["held_before_focus", "cancelled"]] = {
    PointerPressed: "held_before_focus",
    PointerReleased: "cancelled",
}


class SessionMachine:
    """One segment of one participant's session.

    Args:
        plan: the plan of the whole session.
        make_world: makes a world from its id and options; ``World`` itself can be passed.
        facts: versions, platform and display, which are logged with the plan.
        picture_px: the largest picture wanted, as width and height in pixels; None draws none.
        renders_steps: whether play screens have pictures. A page that draws them itself needs only the last one.

    Raises:
        AllocationError: if the plan has no part left.
    """

    def __init__(
        self,
        plan: SessionPlan,
        make_world: WorldFactory,
        facts: Mapping[str, str],
        *,
        picture_px: tuple[int, int] | None = (640, 480),
        renders_steps: bool = True,
    ) -> None:
        self._facts = dict(facts)
        self._make_context = partial(
            SessionContext,
            make_world=make_world,
            picture_px=picture_px,
            renders_steps=renders_steps,
            facts=self._facts,
        )
        self._reset(plan)

    def _reset(self, plan: SessionPlan) -> None:
        """Put the session into the state before the first input of a session with this plan."""
        self.plan = plan
        self.failure: BaseException | None = None  # the exception of a world that failed
        self._phase = Phase.START
        self._context = self._make_context(plan)
        self._parts = PartSequence(self._context)
        self._screen: Screen = TextScreen("", "", "")
        self._is_drawn = True
        self._phases_to_resume: list[Phase] = []  # those that questions about the session interrupted, the latest last
        self._keys = KeyState(self._context.keys_down)
        self._focused = True
        self._pointer_acts = True  # whether the pointer was pressed while the window had the focus
        self._end_reason: EndReason = "complete"
        self._end_detail = ""

    # State that windows, pages and simulated participants read

    @property
    def phase(self) -> StrEnum:
        """Return the session's phase; while a part runs, the part's phase."""
        if self._phase is Phase.PART:
            return self.part.phase
        return self._phase

    @property
    def now_ns(self) -> int:
        """Return the time of the latest input in nanoseconds."""
        return self._context.now_ns

    @property
    def next_episode(self) -> int:
        """Return the index of the running or next episode."""
        return self._context.next_episode

    @property
    def over(self) -> bool:
        """Return whether the session has ended, so that no more events follow."""
        return self._phase is Phase.OVER

    @property
    def screen(self) -> Screen:
        """Return the present screen; a new object whenever it has changed."""
        if not self._is_drawn:
            self._refresh_screen()
        return self._screen

    @property
    def end_reason(self) -> EndReason:
        """Return the reason why the session ended; "complete" while it is running."""
        return self._end_reason

    @property
    def end_detail(self) -> str:
        """Return the details of the end, such as a failed world's error, or ""; never shown to a participant."""
        return self._end_detail

    @property
    def next_tick_ns(self) -> int | None:
        """Return the time at which the session needs a Tick unless another input comes first; None if it needs none."""
        if self._phase is Phase.PART:
            return self.part.next_tick_ns
        if self._phase is Phase.QUIT_QUESTION:
            return self._keys.end_ns
        return None

    @property
    def play(self) -> RunningEpisode | None:
        """Return the running episode, for simulated participants that read its world; None if none is being played."""
        if self._phase is Phase.PART and (part := self._parts.part).playing:
            return part.play
        return None

    @property
    def part(self) -> Activity:
        """Return the running part."""
        return self._parts.part

    @property
    def next_part(self) -> int | None:
        """Return the index of the part that follows the one that has ended; None if the session ends."""
        return self._parts.next_part

    @property
    def request(self) -> ActivityRequest | None:
        """Return the running part's request to the session host; None if there is none."""
        if self._phase is Phase.PART:
            return self.part.request
        return None

    def close(self) -> None:
        """Close the open world."""
        self._context.close()

    # Inputs

    def receive(self, happened: Input, *, at_ns: int = 0, draws: bool = True) -> list[Event]:
        """Handle one input and return its events in order; after SessionEnded there are no more.

        Event times never go back: an input whose time is before that of the last one counts as simultaneous.

        Args:
            happened: the input, with its own time.
            at_ns: the time at which the input arrived, if later than its own time; its events get this time.
            draws: whether to draw the screen now rather than when it is next read.
        """
        if self._phase is Phase.OVER:
            return []
        play = None if draws else self.play
        context = self._context
        context.now_ns = max(context.now_ns, happened.t_ns, at_ns)
        try:
            if self._phase is Phase.START:
                context.emit(SessionStarted(context.now_ns, self.plan, self._facts))
                self._move(TransitionCause.BEGAN)
            self._handle(happened)
        except WorldFailedError as error:
            self.failure = error.__cause__
            self._end("world_error", str(error))
        self._is_drawn = False
        if draws or self.play is not play:
            self._refresh_screen()
        return context.pop_events()

    def _handle(self, happened: Input) -> None:
        """Process what is due before an input, and pass the input on unless the session has ended."""
        if not precedes_due_changes(happened, self._facts):
            self._let_time_pass(happened.t_ns)
            if self.over:
                return
        self._dispatch(happened)

    def _dispatch(self, happened: Input) -> None:
        """Pass an input to the method for its type; the commonest types come first."""
        match happened:
            case KeyDown():
                self._key_down(happened)
            case KeyUp():
                self._key_up(happened)
            case ScreenShown() | TextEdited() | ActivityInput():
                self._pass_to_part(happened)
            case FocusChanged():
                self._change_focus(happened.focused)
            case Stop():
                self._stop(happened)
            case TextInput():
                self._context.emit(self.part.typed_event(self.now_ns, happened.text))
                self._pass_to_part(happened)
            case PointerInput():
                self._use_pointer(happened)
            case AxisChanged():
                self._context.move_axis(happened)
                self._context.emit(AxisMoved(self.now_ns, happened.axis, happened.value, self.now_ns - happened.t_ns))
            case ExperimenterCommand():
                self._execute_command(happened)

    def _stop(self, stop: Stop) -> None:
        """End the session from outside; a session whose closing text is shown still counts as complete."""
        if self.phase is Phase.CLOSING and stop.reason in ("window_closed", "signal"):
            self._end("complete", stop.detail)
        else:
            self._end(stop.reason, stop.detail)

    def _pass_to_part(self, happened: Input) -> None:
        if self._phase is Phase.PART:
            self.part.receive(happened)
            if self.part.ended is not None:
                self._follow_part()

    def _let_time_pass(self, t_ns: int) -> None:
        """Process everything that is due before an input whose time is ``t_ns``.

        The time for which Escape is held is measured by the inputs' own times, so that a machine that stalls during a
        short press does not end the session.
        """
        if self._phase is Phase.PART:
            self._pass_to_part(Tick(self.now_ns))
        elif self._phase is Phase.QUIT_QUESTION and (due_ns := self.next_tick_ns) is not None and t_ns >= due_ns:
            if self._is_declining:
                self._end("declined", "the participant did not agree")
            else:
                self._end("quit", "the participant ended the session")

    @property
    def _is_declining(self) -> bool:
        """Return whether ending the session now refuses consent; under the first consent rules it did not."""
        can_decline = self._facts.get("consent_rules", "1") == CONSENT_RULES
        return can_decline and self._parts.has_begun and self.part.phase is Phase.CONSENT

    def _change_focus(self, focused: bool) -> None:
        self._context.emit(Noted(self.now_ns, "focus", "found" if focused else "lost"))
        self._focused = focused
        if focused:
            self._move(TransitionCause.FOCUS_FOUND)
            return
        self._keys.forget()
        self._move(TransitionCause.FOCUS_LOST)

    def _execute_command(self, happened: ExperimenterCommand) -> None:
        """Log the experimenter's command, and execute it if possible."""
        self._context.emit(Noted(self.now_ns, "experimenter", f"{happened.command}: {happened.text}"))
        match happened.command:
            case "pause":
                self._move(TransitionCause.PAUSE, "experimenter")
            case "go_on":
                self._move(TransitionCause.RESUME)
            case "abort":
                self._end("aborted", happened.text)

    @property
    def _judges_causes(self) -> bool:
        """Return whether the rules of keys consider the cause of a key or pointer press; the first version did not."""
        return self._facts.get("key_rules", "1") == KEY_RULES

    def _use_pointer(self, happened: PointerInput) -> None:
        """Log a pointer input and pass it to the part, unless its press began before the window had the focus."""
        use: PointerUse = _POINTER_USES[type(happened)]
        ignored_cause = _IGNORED_POINTER_CAUSES.get(type(happened))
        if self._judges_causes and ignored_cause is not None and happened.cause == ignored_cause:
            use = ignored_cause
        if isinstance(happened, PointerPressed):
            self._pointer_acts = use == "pressed"
        self._context.emit(
            PointerUsed(
                t_ns=self.now_ns,
                what=use,
                x=happened.x,
                y=happened.y,
                target=happened.target,
                along=happened.along,
                waited_ns=self.now_ns - happened.t_ns,
            )
        )
        if self._pointer_acts and use != "cancelled":
            self._pass_to_part(happened)

    # Keys

    def _key_down(self, press: KeyDown) -> None:
        """Handle a key press: as a command to the session, as an input to the part, or on the screen over the part."""
        if self._judges_causes and press.cause != "finger":
            self._context.emit_key(press, press.cause, self.phase)
            return
        self._keys.down(press.key, press.t_ns)
        if not press.repeat and self._handle_session_key(press):
            return
        if self._phase is Phase.PART:
            self._pass_to_part(press)
        elif press.repeat:
            self._context.emit_key(press, "repeat", self.phase)
        else:
            self._handle_overlay_key(press)

    def _handle_session_key(self, press: KeyDown) -> bool:
        """Handle a key that aborts, leaves or pauses the session, and return True; return False for any other key."""
        if self._keys.completes_chord(press.key) and self._can_ask_abort:
            self._accept_key(press)
            self._move(TransitionCause.ASK_ABORT)
        elif press.key == "escape":
            self._press_escape(press)
        elif press.key == PAUSE_KEY and self._is_pausable:
            self._accept_key(press)
            self._move(TransitionCause.RESUME if self._phase is Phase.PAUSED else TransitionCause.PAUSE)
        else:
            return False
        return True

    @property
    def _can_ask_abort(self) -> bool:
        return SESSION_TRANSITIONS.find(self._phase, TransitionCause.ASK_ABORT, self) is not None

    @property
    def _is_pausable(self) -> bool:
        return self._phase is Phase.PAUSED or (self._phase is Phase.PART and self.part.playing)

    def _press_escape(self, press: KeyDown) -> None:
        """Ask whether to end the session; on that question, a short press returns and a long one ends the session."""
        self._accept_key(press)
        if self._phase is Phase.QUIT_QUESTION:
            self._keys.hold_escape(press.t_ns)
        elif self._phase is Phase.ABORT_QUESTION:
            self._move(TransitionCause.STAY)
        else:
            self._move(TransitionCause.ASK_QUIT)

    def _key_up(self, release: KeyUp) -> None:
        self._keys.up(release.key)
        if self._judges_causes and release.cause == "focus_loss":
            self._context.emit_key(release, "release_at_focus_loss", self.phase)
            return
        self._context.emit_key(release, "release", self.phase)
        if release.key == "escape" and self._keys.release_escape():
            self._move(TransitionCause.STAY)

    def _handle_overlay_key(self, press: KeyDown) -> None:
        """Handle a key press on a screen that covers the part; log a key that has no effect there."""
        causes = {
            Phase.PAUSED: TransitionCause.RESUME,
            Phase.UNFOCUSED: TransitionCause.FOCUS_FOUND,  # a key that arrives is proof of the focus
            Phase.QUIT_QUESTION: TransitionCause.STAY,
        }
        if press.key in ENTER_KEYS and self._phase in causes:
            self._accept_key(press)
            self._move(causes[self._phase])
            return
        if self._phase is Phase.ABORT_QUESTION:
            reason = screen_texts.find_abort_reason(press.key)
            if reason is not None:
                self._accept_key(press)
                self._end("aborted", reason)
                return
        play = self.part.play
        has_meaning = press.key in ENTER_KEYS or (play is not None and play.action_of(press.key) is not None)
        self._context.emit_key(press, "not_playing" if has_meaning else "unmapped", self.phase)

    def _accept_key(self, press: KeyDown) -> None:
        self._context.emit_key(press, "accepted", self.phase)

    # Moving on

    def _move(self, cause: TransitionCause, pause_reason: PauseReason | None = None) -> bool:
        """Move to the phase that follows for a cause in the transition table; return whether one of its rows applies.

        ``pause_reason`` is logged if a part is suspended; by default, it is that of the cause.
        """
        transition = SESSION_TRANSITIONS.find(self._phase, cause, self)
        if transition is None:
            return False
        previous = self._phase
        if transition.end is None:
            self._phase = self._phases_to_resume.pop()
        else:
            assert isinstance(transition.end, Phase)
            self._phase = transition.end
        self._keys.release_escape()
        if self._phase is Phase.OVER:
            self._finish()
        elif cause is TransitionCause.BEGAN or cause is TransitionCause.DONE:
            self._parts.begin()
            self._follow_part()
        elif self._phase is Phase.PART:
            self.part.resume()
            self._follow_part()
        else:
            if previous is Phase.PART:
                self.part.suspend(pause_reason or _PAUSE_REASONS[cause])
            if cause in (TransitionCause.ASK_QUIT, TransitionCause.ASK_ABORT):
                self._phases_to_resume.append(previous)
            self._context.emit(Noted(self.now_ns, "phase", self._phase))
            if self._phase is Phase.UNFOCUSED and self._focused:  # the focus returned while a question was shown
                self._move(TransitionCause.FOCUS_FOUND)
        return True

    def _follow_part(self) -> None:
        """If the running part has ended, continue with the next part or end the session."""
        part_ending = self._parts.finish_part()
        if part_ending is None:
            return
        if part_ending.reason is not None:
            self._end(part_ending.reason, part_ending.detail)
        else:
            self._move(TransitionCause.DONE)

    def _end(self, reason: EndReason, detail: str) -> None:
        """Note why the session ends, and enter its last phase."""
        self._end_reason = reason
        self._end_detail = detail
        self._move(TransitionCause.END)

    def _finish(self) -> None:
        """Stop the running part and log the end of the session."""
        self._parts.stop()
        end = SessionEnded(self.now_ns, self._end_reason, self._end_detail, self._context.completed)
        self._context.emit(end)

    # Screens

    def _refresh_screen(self) -> None:
        """Build the present screen, and replace the last one unless the two are equal."""
        overlay = screen_texts.build_overlay_screen(
            self._context.words, self._phase, self._end_reason, self._end_detail, declining=self._is_declining
        )
        screen = overlay or self.part.screen()
        if screen != self._screen:
            self._screen = screen
        self._is_drawn = True


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
