"""The session: inputs in, events out. No clock, file or window.

    session = Session(plan, World, facts)
    events = session.receive(Tick(t_ns=0))    # write these
    screen = session.screen                   # then show this, and hand back what the window says was Shown

Events are to be written before the new screen is shown. The same inputs give the same events.
"""

from collections.abc import Callable, Mapping
from typing import Any

from minihuman.errors import AllocationError
from minihuman.study import texts
from minihuman.study.events import (
    EndReason,
    Event,
    KeyMapDrawn,
    KeyPressed,
    Noted,
    Paused,
    PauseReason,
    Resumed,
    SessionEnded,
    SessionStarted,
    Stepped,
    Verdict,
)
from minihuman.study.inputs import Asked, FocusChanged, Input, KeyDown, KeyUp, Shown, Stop, Tick
from minihuman.study.phases import TRANSITIONS, Cause, Phase
from minihuman.study.plan import BlockText, EpisodePlan, KeyMap, SessionPlan
from minihuman.study.play import Play, WorldBrokeError, world_calls
from minihuman.study.present import Scene, screen_of
from minihuman.study.screens import Screen, TextScreen
from minihuman.worlds.adapt.world import World

NS_PER_S = 1_000_000_000
ENTER = ("enter", "kp_enter")
PAUSE = "f8"
ABORT_CHORD = frozenset({"f9", "f12"})

MakeWorld = Callable[[str, dict[str, Any]], World]


class Session:
    """One segment of one participant's session.

    Args:
        plan: everything that is to happen.
        make_world: gives a world for an id and its options; ``World`` itself will do.
        facts: what is to be known of the machine; logged with the plan.
        picture_px: the largest picture wanted, width and height; None draws none (nobody looks).

    Raises:
        AllocationError: if the plan has no episode left to play.
    """

    def __init__(
        self,
        plan: SessionPlan,
        make_world: MakeWorld,
        facts: Mapping[str, str],
        *,
        picture_px: tuple[int, int] | None = (640, 480),
    ) -> None:
        if plan.first_episode >= len(plan.episodes):
            raise AllocationError(
                f"{plan.participant.id} has played all {len(plan.episodes)} episodes of session {plan.session}; "
                "nothing is left to play"
            )
        self.plan = plan
        self.phase = Phase.START
        self.failure: BaseException | None = None  # what a broken world raised, for whoever reads tracebacks
        self._make_world = make_world
        self._facts = dict(facts)
        self._picture_px = picture_px
        self._now_ns = 0
        self._events: list[Event] = []
        self._screen: Screen = TextScreen("", "", "")
        self._asked_from: list[Phase] = []
        self._held: set[str] = set()
        self._checked: dict[str, str] = {}  # keyboard check: key -> symbol
        self._next = plan.first_episode  # index of the episode being played or to be played next
        self._world: tuple[tuple[str, dict[str, Any]], World] | None = None
        self._play: Play | None = None  # from the ready screen to the end of the feedback
        self._key_map: KeyMap | None = None  # in force
        self._rest_until_ns = 0
        self._end_reason: EndReason = "complete"
        self._end_detail = ""

    # What the outside looks at

    @property
    def over(self) -> bool:
        """Whether the last event has been given."""
        return self.phase is Phase.OVER

    @property
    def screen(self) -> Screen:
        """What should be seen now; a new object whenever it has changed."""
        return self._screen

    @property
    def next_tick_ns(self) -> int | None:
        """When the session wants a Tick, if nothing else comes before; None: never."""
        if self.phase is Phase.PLAYING and self._play:
            return self._play.next_tick_ns
        if self.phase is Phase.REST and self._now_ns < self._rest_until_ns:
            return self._rest_until_ns - (self._rest_left_s - 1) * NS_PER_S
        return None

    @property
    def play(self) -> Play | None:
        """The episode that is being played, for players who may look at its world; None in every other phase."""
        return self._play if self.phase is Phase.PLAYING else None

    def close(self) -> None:
        """Let go of the world."""
        if self._world:
            self._world[1].close()
            self._world = None

    # Inputs

    def receive(self, happened: Input) -> list[Event]:
        """Take one input; say what came of it, in order. Nothing follows SessionEnded.

        An input stamped before the one it follows counts as coming with it: event times never go back.
        """
        if self.over:
            return []
        self._now_ns = max(self._now_ns, happened.t_ns)
        self._events = []
        try:
            if self.phase is Phase.START:
                self._say(SessionStarted(self._now_ns, self.plan, self._facts))
                self._move(Cause.BEGAN)
            self._handle(happened)
        except WorldBrokeError as broke:
            self.failure = broke.__cause__
            self._end("world_error", str(broke))
        return self._events

    def _handle(self, happened: Input) -> None:
        match happened:
            case Shown():
                if self.phase is Phase.PLAYING and self._play:
                    self._say(self._play.shown(happened))
                return
            case Stop():
                finished = self.phase is Phase.CLOSING and happened.reason in ("window_closed", "signal")
                self._end("complete" if finished else happened.reason, happened.detail)
                return
        self._let_time_pass()
        if self.over:
            return
        match happened:
            case KeyDown():
                self._key_down(happened)
            case KeyUp():
                self._held.discard(happened.key)
                self._say_key(happened, "release")
            case FocusChanged():
                self._focus_changed(happened.focused)
            case Asked():
                self._asked(happened)
            case Tick():
                pass

    def _let_time_pass(self) -> None:
        """Do what was due by now, before anything that came later is looked at."""
        play = self._play
        if self.phase is Phase.REST:
            self._draw()
        elif self.phase is Phase.PLAYING and play and (stepped := play.tick(self._now_ns)):
            self._stepped(stepped)

    def _focus_changed(self, focused: bool) -> None:
        self._say(Noted(self._now_ns, "focus", "found" if focused else "lost"))
        if focused:
            return
        self._held.clear()  # their releases go elsewhere
        if self.phase is Phase.PLAYING and self._play and self._play.real_time:
            self._suspend("focus_lost")
            self._move(Cause.PAUSE)

    def _asked(self, asked: Asked) -> None:
        """Note what the experimenter asks for, and do it where it can be done."""
        self._say(Noted(self._now_ns, "experimenter", f"{asked.what}: {asked.text}"))
        match asked.what:
            case "pause" if self.phase is Phase.PLAYING:
                self._suspend("experimenter")
                self._move(Cause.PAUSE)
            case "go_on" if self.phase is Phase.PAUSED:
                self._move(Cause.RESUME)
            case "abort":
                self._end("aborted", asked.text)

    # Keys

    def _key_down(self, press: KeyDown) -> None:
        self._held.add(press.key)
        chord = press.key in ABORT_CHORD and self._held >= ABORT_CHORD and not press.repeat
        if chord and (self.phase, Cause.ASK_ABORT) in TRANSITIONS:
            self._say_key(press, "accepted")
            self._ask(Cause.ASK_ABORT)
        elif press.key == "escape" and not press.repeat:
            self._say_key(press, "accepted")
            if self._asked_from:
                self._move(Cause.STAY)
            else:
                self._ask(Cause.ASK_QUIT)
        elif self.phase is Phase.PLAYING:
            self._key_in_play(press)
        elif press.repeat:
            self._say_key(press, "repeat")
        else:
            self._key_outside_play(press)

    def _key_in_play(self, press: KeyDown) -> None:
        play = self._play
        assert play is not None
        action = play.action_of(press.key)
        if press.repeat and (play.real_time or not play.plan.auto_repeat or action is None):
            self._say_key(press, "repeat", action)
        elif action is None and press.key == PAUSE:
            self._say_key(press, "accepted")
            self._suspend("participant")
            self._move(Cause.PAUSE)
        elif action is None:
            self._say_key(press, "spare" if press.key in play.plan.key_map.spare_keys else "unmapped")
        elif play.real_time:
            self._say_key(press, "queued", action)
            play.queue(press.t_ns, press.key, action)
        else:
            self._say_key(press, "accepted", action)
            self._stepped(play.step(self._now_ns, action, key=press.key, key_t_ns=press.t_ns))

    def _key_outside_play(self, press: KeyDown) -> None:
        """Keys of every other phase. What moves the session on is accepted before it moves."""
        match self.phase, press.key:
            case Phase.CONSENT, key if key in ENTER:
                self._say_key(press, "accepted")
                self._say(Noted(self._now_ns, "consent", f"agreed to the text with SHA-256 {self.plan.consent_sha256}"))
                self._move(Cause.DONE)
            case ((Phase.INSTRUCTIONS | Phase.READY | Phase.FEEDBACK | Phase.CLOSING), key) if key in ENTER:
                self._say_key(press, "accepted")
                self._move(self._way_on())
            case Phase.REST, key if key in ENTER and self._now_ns >= self._rest_until_ns:
                self._say_key(press, "accepted")
                self._move(self._way_on())
            case Phase.PAUSED, key if key in (*ENTER, PAUSE):
                self._say_key(press, "accepted")
                self._move(Cause.RESUME)
            case Phase.QUIT_QUESTION, key if key in ENTER:
                self._say_key(press, "accepted")
                self._end("quit", "the participant ended the session")
            case Phase.ABORT_QUESTION, key if (reason := texts.abort_reason(key)) is not None:
                self._say_key(press, "accepted")
                self._end("aborted", reason)
            case Phase.KEYBOARD_CHECK, key if key in self.plan.key_pool:
                self._say_key(press, "accepted")
                self._check_key(press)
            case _, key:
                meant = key in ENTER or (self._play is not None and self._play.action_of(key) is not None)
                self._say_key(press, "not_playing" if meant else "unmapped")

    def _check_key(self, press: KeyDown) -> None:
        self._checked.setdefault(press.key, press.symbol)
        if len(self._checked) < len(set(self.plan.key_pool)):
            self._draw()
            return
        typed = ", ".join(f"{key} types {self._checked[key]!r}" for key in self.plan.key_pool)
        self._say(Noted(self._now_ns, "keyboard_check", f"every key arrived: {typed}"))
        self._move(Cause.DONE)

    # Moving on

    def _ask(self, question: Cause) -> None:
        if self.phase is Phase.PLAYING:
            self._suspend("quit_question" if question is Cause.ASK_QUIT else "abort_question")
        self._asked_from.append(self.phase)
        self._move(question)

    def _suspend(self, reason: PauseReason) -> None:
        assert self._play is not None
        self._play.suspend()
        self._say(Paused(self._now_ns, reason))

    def _end(self, reason: EndReason, detail: str) -> None:
        self._end_reason, self._end_detail = reason, detail
        self._move(Cause.END)

    def _way_on(self) -> Cause:
        """How the present phase is left when it has been read or has nothing to show."""
        if self.phase is not Phase.FEEDBACK:
            return Cause.DONE
        if self._next >= len(self.plan.episodes):
            return Cause.STUDY_ENDED
        played = self._current.plan
        return Cause.NEXT_EPISODE if self.plan.episodes[self._next].block == played.block else Cause.BLOCK_ENDED

    def _move(self, cause: Cause) -> None:
        """Follow the table, and on through phases that have nothing to show."""
        target = TRANSITIONS[self.phase, cause]
        self.phase = self._asked_from.pop() if target is None else target
        if self.phase is Phase.OVER:
            self._finish()
            return
        if self.phase is Phase.READY:
            self._prepare()
        elif self.phase is Phase.REST and cause is Cause.BLOCK_ENDED:
            self._rest_until_ns = self._now_ns + round(self._text(self._current.plan).rest_s * NS_PER_S)
        if not self._has_something_to_show(cause):
            self._move(self._way_on())
            return
        self._say(Noted(self._now_ns, "phase", self.phase))
        if self.phase is Phase.PLAYING:
            self._play_on()
        self._draw()

    def _has_something_to_show(self, cause: Cause) -> bool:
        match self.phase:
            case Phase.CONSENT:
                return bool(self.plan.consent_text) and self.plan.segment == 1
            case Phase.KEYBOARD_CHECK:
                return self.plan.keyboard_check
            case Phase.INSTRUCTIONS:
                return bool(self._text(self.plan.episodes[self._next]).instruction)
            case Phase.READY:  # whoever has just acknowledged the feedback is ready
                return cause is not Cause.NEXT_EPISODE or not self._text(self._current.plan).feedback
            case Phase.FEEDBACK:
                return bool(self._text(self._current.plan).feedback)
            case Phase.REST:
                text = self._text(self._current.plan)
                return bool(text.rest) or text.rest_s > 0
            case Phase.CLOSING:
                return bool(self.plan.closing_text)
        return True

    def _prepare(self) -> None:
        """Reset the world while a text is on the screen, so that play starts at once."""
        if self._play and self._play.outcome is None:
            return  # back from a question
        plan = self.plan.episodes[self._next]
        key = (plan.world, plan.options)
        if self._world is None or self._world[0] != key:
            with world_calls():
                self.close()
                self._world = (key, self._make_world(plan.world, plan.options))
        self._play = Play(plan, self._world[1], picture_px=self._picture_px)
        self._play.picture()  # a world's first picture may have to be compiled: not after the key that starts play

    def _play_on(self) -> None:
        """Start the episode that is ready, or go on with the one that was suspended."""
        play = self._current
        if play.started:
            self._say(Resumed(self._now_ns))
            return
        if self._key_map != play.plan.key_map:
            self._key_map = play.plan.key_map
            self._say(KeyMapDrawn(self._now_ns, play.plan.episode, self._key_map))
        self._events += [play.start(self._now_ns), *play.stored(self._now_ns)]

    def _stepped(self, stepped: Stepped) -> None:
        play = self._current
        self._events += [*play.stored(self._now_ns), stepped]
        if play.outcome is None:
            self._draw()
            return
        self._say(play.end(self._now_ns))
        self._next += 1
        self._move(Cause.EPISODE_ENDED)

    def _finish(self) -> None:
        if self._play and self._play.started and self._play.outcome is None:
            self._say(self._play.end(self._now_ns))
        completed = self._next - self.plan.first_episode
        self._say(SessionEnded(self._now_ns, self._end_reason, self._end_detail, completed))
        self._screen = texts.over(self._end_reason, self._end_detail)

    # Screens

    def _draw(self) -> None:
        screen = screen_of(
            self.phase, self.plan, Scene(self._next, self._play, frozenset(self._checked), self._rest_left_s)
        )
        if screen != self._screen:
            self._screen = screen

    # Small things

    @property
    def _current(self) -> Play:
        assert self._play is not None
        return self._play

    @property
    def _rest_left_s(self) -> int:
        return max(0, -(-(self._rest_until_ns - self._now_ns) // NS_PER_S))

    def _text(self, episode: EpisodePlan) -> BlockText:
        return self.plan.texts[episode.block]

    def _say(self, event: Event) -> None:
        self._events.append(event)

    def _say_key(self, key: KeyDown | KeyUp, verdict: Verdict, action: int | None = None) -> None:
        down = isinstance(key, KeyDown)
        waited_ns = self._now_ns - key.t_ns
        self._say(KeyPressed(self._now_ns, key.key, key.symbol, down, action, verdict, self.phase, waited_ns))
