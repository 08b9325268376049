"""Play: the episodes of one block, with what is read before, between and after them."""

from minihuman.study.activities.pages import BACK, FORWARD, Reader, page_shown
from minihuman.study.activities.play_limits import Limits
from minihuman.study.activities.play_moves import MOVES, SHOWN_IF
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.activities.play_tally import Tally
from minihuman.study.activities.play_timer import Timer
from minihuman.study.activities.play_view import View
from minihuman.study.activities.port import Activity, Ended, Kind
from minihuman.study.events import (
    EndCause,
    EpisodesSkipped,
    KeyMapDrawn,
    Noted,
    Paused,
    PauseReason,
    Resumed,
    Scored,
    Stepped,
)
from minihuman.study.inputs import Input, KeyDown, PointerPressed, Shown
from minihuman.study.phases import Cause, Phase
from minihuman.study.plan import Part
from minihuman.study.play import Play
from minihuman.study.screens import PlayScreen, Screen
from minihuman.study.stage import ENTER, Stage

_READ = (Phase.READY, Phase.FEEDBACK)


class Playing(Activity):
    """Plays a block's episodes from the next one that the session has not completed."""

    plan: PlayPlan
    play: Play | None = None
    learning_s = 0.0  # how long the next episode may wait for an agent that learns

    def __init__(self, number: int, part: Part, stage: Stage) -> None:
        super().__init__(number, part, stage)
        self.plan = part.plan
        self.phase = Phase.START
        self.wants_ready: bool = True
        self._play: Play | None = None  # from the ready screen to the end of the feedback
        self._timer = Timer(self.plan, lambda: self.learning_s)
        self._limits = Limits(self.plan.max_s, self.plan.block_max_s)
        self._reader = Reader(len(self.plan.instruction))
        self._tally = Tally(self.plan)
        self._view = View(self.plan, stage)
        self._flip_ns: int | None = None  # when the present text reached the display
        self._drawn: tuple[object, Screen] | None = None  # a world's picture is drawn once

    # What the conditions beside the table ask

    @property
    def another_episode(self) -> bool:
        """Whether the block goes on."""
        return self._tally.another(self.stage.next_episode)

    @property
    def world_takes_a_moment(self) -> bool:
        """Whether the next episode's world has to be made."""
        plan = self.stage.plan.episodes[self.stage.next_episode]
        return not self.stage.has_world(plan.world, plan.options)

    @property
    def feedback_text(self) -> str:
        """What is said about the episode that was played; "" where nothing is."""
        return self.plan.feedback.get(self._play.outcome or "", "") if self._play else ""

    # The port

    def begin(self) -> None:
        """Begin the block, or go on with it."""
        if self.number == self.stage.plan.standing.part and self.stage.next_episode == self.stage.plan.first_episode:
            self._tally.go_on_from(self.stage.plan.standing.outcomes)
        self._decide()
        if not self.another_episode:
            self._end()
            return
        self._move(Cause.BEGAN)

    def receive(self, happened: Input) -> None:
        """Take an input."""
        match happened:
            case Shown():
                self._shown(happened)
                return
        self._let_time_pass()
        if self.ended:
            if isinstance(happened, KeyDown):
                self.stage.say_key(happened, "not_playing", self.phase)
            return
        match happened:
            case KeyDown() if self.phase is Phase.PLAYING:
                self._key_in_play(happened)
            case KeyDown(repeat=True):
                self.stage.say_key(happened, "repeat", self.phase)
            case KeyDown():
                self._key_outside_play(happened)
            case PointerPressed(target="go_on" | "back" as target) if self.phase is Phase.INSTRUCTIONS:
                self._turn(1 if target == "go_on" else -1, by_enter=True)

    def suspend(self, reason: PauseReason) -> None:
        """Stop the clocks."""
        self._timer.suspend(self.phase)
        if self.phase is Phase.PLAYING:
            self._current.suspend()
            self._limits.stop(self.stage.now_ns)
            self.stage.say(Paused(self.stage.now_ns, reason))

    def resume(self) -> None:
        """Let them run again."""
        super().resume()
        if self.phase is Phase.PLAYING:
            self._limits.run(self.stage.now_ns)
            self.stage.say(Resumed(self.stage.now_ns))
        else:
            self._timer.resume(self.phase, self.stage.now_ns)

    def stop(self) -> None:
        """Abandon what is being played."""
        if self._play and self._play.started and self._play.outcome is None:
            self.stage.say(self._play.end(self.stage.now_ns))

    @property
    def playing(self) -> bool:  # type: ignore[override]
        """Whether an episode runs."""
        return self.phase is Phase.PLAYING

    @property
    def real_time(self) -> bool:  # type: ignore[override]
        """Whether time makes its steps."""
        return self.playing and self._current.real_time

    @property
    def limit_ns(self) -> int | None:
        """When the time for the episode, or for the block, is over; None while nothing is played or without a limit."""
        return self._limits.due_ns if self.playing else None

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """The next step of real time, a limit, the end of a timed screen, or a rest's next second."""
        if self.phase is Phase.PLAYING:
            self.play = self._current
            due = [t for t in (self._current.next_tick_ns, self._limits.due_ns) if t is not None]
            return min(due, default=None)
        if self.phase is Phase.PREPARING:
            return self.stage.now_ns
        return self._timer.due_ns(self.phase, self.stage.now_ns)

    def screen(self) -> Screen:
        """What belongs to the phase."""
        steps = self._play and self._play.steps
        now = (self.phase, self._reader.page, self._play, steps, self._rest_left_s, self._look)
        if self._drawn is None or self._drawn[0] != now:
            self._drawn = (now, self._screen())
        return self._drawn[1]

    def _screen(self) -> Screen:
        before = self._view.before(self.phase, self._reader)
        if before is not None:
            return before
        match self.phase:
            case Phase.READY:
                return self._view.ready(self._current)
            case Phase.FEEDBACK:
                return self._view.feedback(self._current, self._tally.scored)
            case Phase.REST:
                return self._view.rest(self._rest_left_s)
        return self._play_screen()

    def _play_screen(self) -> PlayScreen:
        return self._view.play(self._current, held=self.phase is Phase.HOLD, scored=self._tally.scored)

    # Inputs

    def _shown(self, shown: Shown) -> None:
        if self.phase in (Phase.PLAYING, Phase.HOLD):
            self.stage.say(self._current.shown(shown))
            if shown.step is not None and shown.step < self._current.steps:
                return
        elif shown.step is not None:  # late word of a picture: the episode is over by now
            if self._play is not None and self._play.started:
                self.stage.say(self._play.shown(shown))
            return
        elif self.phase is Phase.INSTRUCTIONS:
            self.stage.say(page_shown(self.number, self._reader, shown))
        self._flip_ns = shown.flip_ns
        self._timer.seen(self.phase, shown.flip_ns)

    def _let_time_pass(self) -> None:
        """Do what was due by now, before anything that came later is looked at."""
        now_ns = self.stage.now_ns
        if self.phase is Phase.PLAYING:
            cause = self._limits.over(now_ns)
            if cause:
                self._episode_ended(cause)
            elif stepped := self._current.tick(now_ns):
                self._stepped(stepped)
        elif self.phase is Phase.PREPARING or self._timer.over(self.phase, now_ns):
            self._move(Cause.DONE)

    def _key_in_play(self, press: KeyDown) -> None:
        play, say_key = self._current, self.stage.say_key
        action = play.action_of(press.key)
        if press.repeat and (play.real_time or not play.plan.auto_repeat or action is None):
            say_key(press, "repeat", self.phase, action)
        elif action is None:
            say_key(press, "spare" if press.key in play.plan.key_map.spare_keys else "unmapped", self.phase)
        elif play.real_time:
            play.queue(press.t_ns, press.key, action)
            say_key(press, "queued", self.phase, action)
        else:
            say_key(press, "accepted", self.phase, action)
            self._stepped(play.step(self.stage.now_ns, action, key=press.key, key_t_ns=press.t_ns))

    def _key_outside_play(self, press: KeyDown) -> None:
        key, phase, say_key = press.key, self.phase, self.stage.say_key
        if phase is Phase.INSTRUCTIONS and key in (*FORWARD, *BACK):
            by = 1 if key in FORWARD else -1
            can = self._reader.page + by in range(self._reader.pages) or (by > 0 and key in ENTER)
            say_key(press, "accepted" if can else "unmapped", phase)
            self._turn(by, by_enter=key in ENTER)
        elif phase is Phase.READY and key in ENTER and self._flip_ns is not None and press.t_ns < self._flip_ns:
            say_key(press, "not_playing", phase)  # meant for the screen before: nobody has seen this one yet
        elif key in ENTER and (phase in _READ or (phase is Phase.REST and not self._rest_left_s)):
            say_key(press, "accepted", phase)
            self._move(Cause.DONE)
        else:
            meant = key in ENTER or (self._play is not None and self._play.action_of(key) is not None)
            say_key(press, "not_playing" if meant else "unmapped", phase)

    def _turn(self, by: int, *, by_enter: bool) -> None:
        if not self._reader.turn(by) and by > 0 and by_enter:
            self._move(Cause.DONE)

    # Moving on

    def _move(self, cause: Cause) -> None:
        """Follow the table, and on through phases that have nothing to show. An impossible move changes nothing."""
        move = MOVES.find(self.phase, cause, self)
        if move is None:
            return
        assert isinstance(move.end, Phase)
        before, self.phase = self.phase, move.end
        if self.phase is Phase.OVER:
            self._end()
            return
        if before is Phase.FEEDBACK:
            self.wants_ready = not self.feedback_text  # who has just gone on from the feedback is ready
        elif self.phase is Phase.READY:
            self._prepare()
        self._flip_ns = None
        if not SHOWN_IF.get(self.phase, _always)(self):
            self._move(Cause.DONE)
            return
        self._timer.begin(self.phase, self.stage.now_ns)
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))
        if self.phase is Phase.PLAYING:
            self._start_episode()

    def _prepare(self) -> None:
        """Reset the world while a text is on the screen, so that play starts at once."""
        plan = self.stage.plan.episodes[self.stage.next_episode]
        self._play = Play(plan, self.stage.world(plan.world, plan.options), picture_px=self.stage.picture_px)
        self._play.picture()  # a world's first picture may have to be compiled: not after the key that starts play
        self.coming = self._play

    def _start_episode(self) -> None:
        play, now_ns = self._current, self.stage.now_ns
        self.play, self.coming = play, None
        if self.stage.key_map != play.plan.key_map:
            self.stage.key_map = play.plan.key_map
            self.stage.say(KeyMapDrawn(now_ns, play.plan.episode, play.plan.key_map))
        self.stage.say(play.start(now_ns), *play.stored(now_ns))
        self._limits.begin(now_ns)
        self._episode_started()

    def _episode_started(self) -> None:
        """Something to do when an episode has begun, for kinds that add to play."""

    def _between_episodes(self) -> None:
        """Something to do when an episode is over, for kinds that add to play."""

    def _stepped(self, stepped: Stepped) -> None:
        play, now_ns = self._current, self.stage.now_ns
        self.stage.say(*play.stored(now_ns), *play.clauses_done(now_ns), stepped)
        if self._current.outcome is not None:
            self._episode_ended("")

    def _episode_ended(self, cause: EndCause) -> None:
        play, stage = self._current, self.stage
        self.play = None
        self._limits.stop(stage.now_ns)
        stage.say(play.end(stage.now_ns, cause))
        scored = self._tally.take(play)
        if scored is not None:
            stage.points += scored
            stage.say(Scored(stage.now_ns, play.plan.episode, scored, stage.points))
        stage.next_episode += 1
        stage.completed += 1
        self._decide()
        self._between_episodes()
        self._move(Cause.EPISODE_ENDED)

    def _decide(self) -> None:
        self._tally.decide(time_is_up=self._limits.block_is_over(self.stage.now_ns))

    def _end(self) -> None:
        self.phase = Phase.OVER
        stage, past, skip = self.stage, self.plan.first + self.plan.count, self._tally.skip
        if skip is not None and stage.next_episode < past:
            stage.say(EpisodesSkipped(stage.now_ns, stage.next_episode, past - stage.next_episode, skip))
            stage.next_episode = past
        if self._tally.failed:
            self.ended = Ended("failed", reason="screened_out", detail=f"{self.part.name}: criterion not reached")
        else:
            self.ended = Ended()

    # Small things

    @property
    def _look(self) -> object:
        """What else the screen depends on, for kinds that add to play."""
        return None

    @property
    def _current(self) -> Play:
        assert self._play is not None
        return self._play

    @property
    def _rest_left_s(self) -> int:
        return self._timer.left_s(self.stage.now_ns)


def _always(_: Playing) -> bool:
    return True


PLAY = Kind("play", PlayPlan, Playing)
