"""The session: inputs in, events out. No clock, file or window.

    session = Session(plan, World, facts)
    events = session.receive(Tick(t_ns=0))    # write these
    screen = session.screen                   # then show this, and hand back what the window says was Shown

Events are to be written before the new screen is shown. The same inputs give the same events. The session owns the
order of its parts, pauses, questions about itself and its end; what a part is about is its activity's.
"""

from collections.abc import Mapping
from enum import StrEnum

from minihuman.errors import AllocationError
from minihuman.study import texts
from minihuman.study.activities.port import Activity, Ended
from minihuman.study.activities.registry import activity_of
from minihuman.study.events import (
    EndReason,
    Event,
    Noted,
    PartEnded,
    PartStarted,
    PauseReason,
    PointerUsed,
    SessionEnded,
    SessionStarted,
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
from minihuman.study.parts import first_part, parts_of
from minihuman.study.phases import MOVES, Cause, Phase
from minihuman.study.plan import SessionPlan
from minihuman.study.play import Play, WorldBrokeError
from minihuman.study.screens import Screen, TextScreen
from minihuman.study.stage import ENTER, MakeWorld, Stage

PAUSE = "f8"
ABORT_CHORD = frozenset({"f9", "f12"})
HOLD_TO_END_NS = 2_000_000_000  # Escape, held over the question whether to end the session

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
    ) -> None:
        self._parts = parts_of(plan)
        self._to_do = first_part(plan, self._parts)
        if not self._to_do:
            raise AllocationError(
                f"{plan.participant.id} has played all {len(plan.episodes)} episodes of session {plan.session}; "
                "nothing is left to play"
            )
        self.plan = plan
        self.failure: BaseException | None = None  # what a broken world raised, for whoever reads tracebacks
        self._phase = Phase.START
        self._facts = dict(facts)
        self._stage = Stage(plan, make_world, picture_px)
        self._part: Activity | None = None
        self._screen: Screen = TextScreen("", "", "")
        self._came_from: list[Phase] = []
        self._held: set[str] = set()
        self._escape_since_ns: int | None = None  # held over the question
        self._focused = True
        self._end_reason: EndReason = "complete"
        self._end_detail = ""

    # What the outside looks at

    @property
    def phase(self) -> StrEnum:
        """Where it is: in a part, the part's own phase."""
        return self.part.phase if self._phase is Phase.PART else self._phase

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
        if self._phase is Phase.QUIT_QUESTION and self._escape_since_ns is not None:
            return self._escape_since_ns + HOLD_TO_END_NS
        return None

    @property
    def play(self) -> Play | None:
        """The episode that is being played, for players who may look at its world; None in every other phase."""
        return self.part.play if self._phase is Phase.PART and self.part.playing else None

    @property
    def part(self) -> Activity:
        """The part that runs."""
        assert self._part is not None, "the session has not begun"
        return self._part

    @property
    def next_part(self) -> int | None:
        """Index of the part that follows the one that has ended; None where none does."""
        ended = self.part.ended
        assert ended is not None
        if ended.reason is not None:
            return None
        if ended.back_to is not None:
            self._to_do = [*range(ended.back_to, len(self._parts))]
        return self._to_do[0] if self._to_do else None

    def close(self) -> None:
        """Let go of the world."""
        self._stage.close()

    # Inputs

    def receive(self, happened: Input) -> list[Event]:
        """Take one input; say what came of it, in order. Nothing follows SessionEnded.

        An input stamped before the one it follows counts as coming with it: event times never go back.
        """
        if self.over:
            return []
        self._stage.now_ns = max(self._now_ns, happened.t_ns)
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
        self._held.clear()  # their releases go elsewhere
        self._escape_since_ns = None
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
        self._held.add(press.key)
        chord = press.key in ABORT_CHORD and self._held >= ABORT_CHORD and not press.repeat
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
            self._escape_since_ns = press.t_ns
        elif self._phase is Phase.ABORT_QUESTION:
            self._move(Cause.STAY)
        else:
            self._move(Cause.ASK_QUIT)

    def _key_up(self, release: KeyUp) -> None:
        if self.over:
            return
        self._held.discard(release.key)
        self._stage.say_key(release, "release", self.phase)
        if release.key == "escape" and self._escape_since_ns is not None:
            self._escape_since_ns = None
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
        self._escape_since_ns = None
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
        number = self._to_do.pop(0)
        part = self._parts[number]
        if self.plan.parts:  # older logs have no word of parts
            self._stage.say(PartStarted(self._now_ns, number, part.kind, part.name))
        self._part = activity_of(number, part, self._stage)
        self.part.begin()
        self._follow_part()

    def _follow_part(self) -> None:
        """If the part is over, go on with the next, or end the session."""
        ended = self.part.ended
        if ended is None:
            return
        following = self.next_part
        if self.plan.parts:
            past = len(self._parts) if following is None else following
            self._stage.say(PartEnded(self._now_ns, self.part.number, ended.end, past))
        self._conclude(ended)

    def _conclude(self, ended: Ended) -> None:
        if ended.reason is not None:
            self._end(ended.reason, ended.detail)
        else:
            self._move(Cause.DONE)

    def _end(self, reason: EndReason, detail: str) -> None:
        self._end_reason, self._end_detail = reason, detail
        self._move(Cause.END)

    def _finish(self) -> None:
        if self._part is not None:
            self._part.stop()
        reason, detail = self._end_reason, self._end_detail
        self._stage.say(SessionEnded(self._now_ns, reason, detail, self._stage.completed))

    # Screens

    def _draw(self) -> None:
        screen = self._screen_now()
        if screen != self._screen:
            self._screen = screen

    def _screen_now(self) -> Screen:
        words = self._stage.words
        match self._phase:
            case Phase.PAUSED:
                return texts.paused(words)
            case Phase.UNFOCUSED:
                return texts.unfocused(words)
            case Phase.QUIT_QUESTION:
                return texts.quit_question(words)
            case Phase.ABORT_QUESTION:
                return texts.abort_question(words)
            case Phase.OVER:
                return texts.over(words, self._end_reason, self._end_detail)
        return self.part.screen()

    @property
    def _now_ns(self) -> int:
        return self._stage.now_ns
