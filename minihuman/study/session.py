"""The session: inputs in, events out. No clock, file or window.

    session = Session(plan, World, facts)
    events = session.receive(Tick(t_ns=0))    # write these
    screen = session.screen                   # then show this, and hand back what the window says was Shown

Events are to be written before the new screen is shown. The same inputs give the same events. The session owns
pauses, questions about itself and its end; the order of its parts is its course's, what a part is about its activity's.
"""

from collections.abc import Mapping
from enum import StrEnum
from functools import partial

from minihuman.study import texts
from minihuman.study.activities.port import Activity, Want
from minihuman.study.course import Course
from minihuman.study.events import (
    EndReason,
    Event,
    Noted,
    PauseReason,
    PointerUsed,
    SessionEnded,
    SessionStarted,
    TextTyped,
)
from minihuman.study.held_keys import HeldKeys
from minihuman.study.inputs import (
    Asked,
    FocusChanged,
    ForPart,
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
from minihuman.study.phases import MOVES, Cause, Phase
from minihuman.study.plan import SessionPlan
from minihuman.study.play import Play, WorldBrokeError
from minihuman.study.screens import Screen, TextScreen
from minihuman.study.stage import ENTER, MakeWorld, Stage

PAUSE = "f8"

_PAUSE_REASONS: dict[Cause, PauseReason] = {
    Cause.PAUSE: "participant",
    Cause.FOCUS_LOST: "focus_lost",
    Cause.ASK_QUIT: "quit_question",
    Cause.ASK_ABORT: "abort_question",
}


class Session:
    """One segment of one participant's session.

    Args:
        plan: everything that is to happen.
        make_world: gives a world for an id and its options; ``World`` itself will do.
        facts: what is to be known of the machine; logged with the plan.
        picture_px: the largest picture wanted, width and height; None draws none (nobody looks).
        draws_steps: whether screens of play have pictures, as those who draw them themselves need only the held last.

    Raises:
        AllocationError: if the plan has no part left.
    """

    def __init__(
        self,
        plan: SessionPlan,
        make_world: MakeWorld,
        facts: Mapping[str, str],
        *,
        picture_px: tuple[int, int] | None = (640, 480),
        draws_steps: bool = True,
    ) -> None:
        self._facts = dict(facts)
        self._staged = partial(Stage, make_world=make_world, picture_px=picture_px, draws_steps=draws_steps)
        self._set_out(plan)

    def _set_out(self, plan: SessionPlan) -> None:
        """Stand before the first input."""
        self.plan = plan
        self.failure: BaseException | None = None  # what a broken world raised, for whoever reads tracebacks
        self._phase = Phase.START
        self._stage = self._staged(plan)
        self._course = Course(self._stage)
        self._screen: Screen = TextScreen("", "", "")
        self._came_from: list[Phase] = []
        self._held = HeldKeys()
        self._focused = True
        self._end_reason: EndReason = "complete"
        self._end_detail = ""

    # What the outside looks at

    @property
    def phase(self) -> StrEnum:
        """Where it is: in a part, the part's own phase."""
        return self.part.phase if self._phase is Phase.PART else self._phase

    @property
    def now_ns(self) -> int:
        """The time of the latest input."""
        return self._stage.now_ns

    @property
    def next_episode(self) -> int:
        """Index of the episode that is played or comes next."""
        return self._stage.next_episode

    @property
    def over(self) -> bool:
        """Whether the last event has been given."""
        return self._phase is Phase.OVER

    @property
    def screen(self) -> Screen:
        """What should be seen now; a new object whenever it has changed."""
        return self._screen

    @property
    def end_reason(self) -> EndReason:
        """Why it ended; "complete" as long as it has not."""
        return self._end_reason

    @property
    def next_tick_ns(self) -> int | None:
        """When the session wants a Tick, if nothing else comes before; None: never."""
        if self._phase is Phase.PART:
            return self.part.next_tick_ns
        return self._held.end_ns if self._phase is Phase.QUIT_QUESTION else None

    @property
    def play(self) -> Play | None:
        """The episode that is being played, for players who may look at its world; None in every other phase."""
        return self.part.play if self._phase is Phase.PART and self.part.playing else None

    @property
    def part(self) -> Activity:
        """The part that runs."""
        return self._course.part

    @property
    def next_part(self) -> int | None:
        """Index of the part that follows the one that has ended; None where none does."""
        return self._course.next_part

    @property
    def wants(self) -> Want | None:
        """What the part that runs waits for from outside; None: nothing."""
        return self.part.wants if self._phase is Phase.PART else None

    def close(self) -> None:
        """Let go of the world."""
        self._stage.close()

    # Inputs

    def receive(self, happened: Input, *, at_ns: int = 0) -> list[Event]:
        """Take one input; say what came of it, in order. Nothing follows SessionEnded.

        An input stamped before the one it follows counts as coming with it: event times never go back.

        Args:
            happened: the input, with its own time.
            at_ns: when it came in, where that was later: its events have this time.
        """
        if self.over:
            return []
        self._stage.now_ns = max(self._now_ns, happened.t_ns, at_ns)
        try:
            if self._phase is Phase.START:
                self._stage.say(SessionStarted(self._now_ns, self.plan, self._facts))
                self._move(Cause.BEGAN)
            self._handle(happened)
        except WorldBrokeError as broke:
            self.failure = broke.__cause__
            self._end("world_error", str(broke))
        self._draw()
        return self._stage.take_events()

    def _handle(self, happened: Input) -> None:
        match happened:
            case Stop():
                finished = self.phase is Phase.CLOSING and happened.reason in ("window_closed", "signal")
                self._end("complete" if finished else happened.reason, happened.detail)
            case Shown():
                self._to_part(happened)
            case FocusChanged():
                self._let_time_pass(happened.t_ns)
                self._focus_changed(happened.focused)
            case KeyDown():
                self._let_time_pass(happened.t_ns)
                self._key_down(happened)
            case KeyUp():
                self._let_time_pass(happened.t_ns)
                self._key_up(happened)
            case Typed():
                self._stage.say(TextTyped(self._now_ns, happened.text))
                self._to_part(happened)
            case PointerPressed():
                self._pointer("pressed", happened)
            case PointerMoved():
                self._pointer("moved", happened)
            case PointerReleased():
                self._pointer("released", happened)
            case Asked():
                self._let_time_pass(happened.t_ns)
                self._asked(happened)
            case ForPart():
                self._let_time_pass(happened.t_ns)
                self._to_part(happened)
            case Tick():
                self._let_time_pass(happened.t_ns)

    def _to_part(self, happened: Input) -> None:
        if self._phase is Phase.PART:
            self.part.receive(happened)
            self._follow_part()

    def _let_time_pass(self, t_ns: int) -> None:
        """Do what was due by now, before anything that came later is looked at.

        How long Escape is held is told by its own times: a machine that stalled over a tap must not end the session.
        """
        due_ns = self.next_tick_ns
        if self._phase is Phase.PART:
            self._to_part(Tick(self._now_ns))
        elif self._phase is Phase.QUIT_QUESTION and due_ns is not None and t_ns >= due_ns:
            self._end("quit", "the participant ended the session")

    def _pointer(self, what: str, used: PointerPressed | PointerMoved | PointerReleased) -> None:
        assert what in ("pressed", "moved", "released")
        self._stage.say(PointerUsed(self._now_ns, what, used.x, used.y, used.target, used.along))  # type: ignore[arg-type]
        self._to_part(used)

    def _focus_changed(self, focused: bool) -> None:
        if self.over:
            return
        self._stage.say(Noted(self._now_ns, "focus", "found" if focused else "lost"))
        self._focused = focused
        if focused:
            self._move(Cause.FOCUS_FOUND)
            return
        self._held.forget()
        self._move(Cause.FOCUS_LOST)

    def _asked(self, asked: Asked) -> None:
        """Note what the experimenter asks for, and do it where it can be done."""
        if self.over:
            return
        self._stage.say(Noted(self._now_ns, "experimenter", f"{asked.what}: {asked.text}"))
        match asked.what:
            case "pause":
                self._move(Cause.PAUSE, "experimenter")
            case "go_on":
                self._move(Cause.RESUME)
            case "abort":
                self._end("aborted", asked.text)

    # Keys

    def _key_down(self, press: KeyDown) -> None:
        if self.over:
            return
        self._held.down(press.key)
        chord = self._held.completes_chord(press.key) and not press.repeat
        if chord and MOVES.find(self._phase, Cause.ASK_ABORT, self):
            self._say_key(press)
            self._move(Cause.ASK_ABORT)
        elif press.key == "escape" and not press.repeat:
            self._escape(press)
        elif press.key == PAUSE and not press.repeat and self._pausable:
            self._say_key(press)
            self._move(Cause.RESUME if self._phase is Phase.PAUSED else Cause.PAUSE)
        elif self._phase is Phase.PART:
            self._to_part(press)
        elif press.repeat:
            self._stage.say_key(press, "repeat", self.phase)
        else:
            self._key_over_part(press)

    @property
    def _pausable(self) -> bool:
        return self._phase is Phase.PAUSED or (self._phase is Phase.PART and self.part.playing)

    def _escape(self, press: KeyDown) -> None:
        """Ask whether to end the session; over that question, a tap goes back and holding ends it."""
        self._say_key(press)
        if self._phase is Phase.QUIT_QUESTION:
            self._held.hold_escape(press.t_ns)
        elif self._phase is Phase.ABORT_QUESTION:
            self._move(Cause.STAY)
        else:
            self._move(Cause.ASK_QUIT)

    def _key_up(self, release: KeyUp) -> None:
        if self.over:
            return
        self._held.up(release.key)
        self._stage.say_key(release, "release", self.phase)
        if release.key == "escape" and self._held.let_escape_go():
            self._move(Cause.STAY)

    def _key_over_part(self, press: KeyDown) -> None:
        match self._phase, press.key:
            case Phase.PAUSED, key if key in ENTER:
                self._say_key(press)
                self._move(Cause.RESUME)
            case Phase.UNFOCUSED, key if key in ENTER:  # a key that arrives is proof of the focus
                self._say_key(press)
                self._move(Cause.FOCUS_FOUND)
            case Phase.QUIT_QUESTION, key if key in ENTER:
                self._say_key(press)
                self._move(Cause.STAY)
            case Phase.ABORT_QUESTION, key if (reason := texts.abort_reason(key)) is not None:
                self._say_key(press)
                self._end("aborted", reason)
            case _, key:
                meant = key in ENTER or (self.part.play is not None and self.part.play.action_of(key) is not None)
                self._stage.say_key(press, "not_playing" if meant else "unmapped", self.phase)

    def _say_key(self, press: KeyDown) -> None:
        self._stage.say_key(press, "accepted", self.phase)

    # Moving on

    def _move(self, cause: Cause, why: PauseReason | None = None) -> bool:
        """Follow the table; False, and nothing changed, where no row allows it."""
        move = MOVES.find(self._phase, cause, self)
        if move is None:
            return False
        before = self._phase
        if move.end is None:
            self._phase = self._came_from.pop()
        else:
            assert isinstance(move.end, Phase)
            self._phase = move.end
        self._held.let_escape_go()
        if self._phase is Phase.OVER:
            self._finish()
        elif cause is Cause.BEGAN or cause is Cause.DONE:
            self._begin_part()
        elif self._phase is Phase.PART:
            self._return_to_part()
        else:
            if before is Phase.PART:
                self.part.suspend(why or _PAUSE_REASONS[cause])
            if cause in (Cause.ASK_QUIT, Cause.ASK_ABORT):
                self._came_from.append(before)
            self._stage.say(Noted(self._now_ns, "phase", self._phase))
            if self._phase is Phase.UNFOCUSED and self._focused:  # found while a question was in front
                self._move(Cause.FOCUS_FOUND)
        return True

    def _return_to_part(self) -> None:
        self.part.resume()
        self._follow_part()

    def _begin_part(self) -> None:
        self._course.begin()
        self._follow_part()

    def _follow_part(self) -> None:
        """If the part is over, go on with the next, or end the session."""
        ended = self._course.leave()
        if ended is None:
            return
        if ended.reason is not None:
            self._end(ended.reason, ended.detail)
        else:
            self._move(Cause.DONE)

    def _end(self, reason: EndReason, detail: str) -> None:
        self._end_reason, self._end_detail = reason, detail
        self._move(Cause.END)

    def _finish(self) -> None:
        self._course.stop()
        reason, detail = self._end_reason, self._end_detail
        self._stage.say(SessionEnded(self._now_ns, reason, detail, self._stage.completed))

    # Screens

    def _draw(self) -> None:
        over_part = texts.over_part(self._stage.words, self._phase, self._end_reason, self._end_detail)
        screen = over_part or self.part.screen()
        if screen != self._screen:
            self._screen = screen

    @property
    def _now_ns(self) -> int:
        return self._stage.now_ns
