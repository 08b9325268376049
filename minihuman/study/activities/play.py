"""Play: the episodes of one block, with what is read before, between and after them."""

from enum import StrEnum

from minihuman.study import texts
from minihuman.study.activities.pages import BACK, FORWARD, Reader, page_shown
from minihuman.study.activities.play_limits import Limits
from minihuman.study.activities.play_moves import MOVES, SHOWN_IF
from minihuman.study.activities.play_plan import PlayPlan
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
    SkipReason,
    Stepped,
)
from minihuman.study.inputs import Input, KeyDown, PointerPressed, Shown
from minihuman.study.phases import Cause, Phase
from minihuman.study.plan import Part
from minihuman.study.play import Play
from minihuman.study.screens import BlankScreen, PlayScreen, Screen
from minihuman.study.stage import ENTER, Stage

NS_PER_MS = 1_000_000
NS_PER_S = 1_000_000_000
_TIMED = (Phase.INTERVAL, Phase.FIXATION, Phase.HOLD)
_READ = (Phase.READY, Phase.FEEDBACK)


class Playing(Activity):
    """Plays a block's episodes from the next one that the session has not completed."""

    plan: PlayPlan
    play: Play | None = None

    def __init__(self, number: int, part: Part, stage: Stage) -> None:
        super().__init__(number, part, stage)
        self.plan = part.plan
        self.phase = Phase.START
        self.outcomes: list[str] = []  # of this block's episodes, in order
        self.skip: SkipReason | None = None  # why no other episode is played
        self.wants_ready: bool = True
        self._play: Play | None = None  # from the ready screen to the end of the feedback
        self._until_ns: int | None = None  # interval, fixation, hold and rest last until then
        self._limits = Limits(self.plan.max_s, self.plan.block_max_s)
        self._reader = Reader(len(self.plan.instruction))
        self._scored = 0.0
        self._flip_ns: int | None = None  # when the present text reached the display
        self._drawn: tuple[object, Screen] | None = None  # a world's picture is drawn once

    # What the conditions beside the table ask

    @property
    def another_episode(self) -> bool:
        """Whether the block goes on."""
        return self.skip is None and self.stage.next_episode < self.plan.first + self.plan.count

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
            self.outcomes = list(self.stage.plan.standing.outcomes)
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
        self._until_ns = None if self.phase in _TIMED else self._until_ns
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
        elif self.phase in _TIMED:
            self._until_ns = self.stage.now_ns + self._lasts_ns

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
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """The next step of real time, a limit, the end of a timed screen, or a rest's next second."""
        if self.phase is Phase.PLAYING:
            self.play = self._current
            due = [t for t in (self._current.next_tick_ns, self._limits.due_ns) if t is not None]
            return min(due, default=None)
        if self.phase is Phase.PREPARING:
            return self.stage.now_ns
        if self._until_ns is not None and self.stage.now_ns < self._until_ns:
            if self.phase is Phase.REST:
                return self._until_ns - (self._rest_left_s - 1) * NS_PER_S
            return self._until_ns
        return None

    def screen(self) -> Screen:
        """What belongs to the phase."""
        now = (self.phase, self._reader.page, self._play, self._play and self._play.steps, self._rest_left_s)
        if self._drawn is None or self._drawn[0] != now:
            self._drawn = (now, self._screen())
        return self._drawn[1]

    def _screen(self) -> Screen:
        words = self.stage.words
        match self.phase:
            case Phase.INSTRUCTIONS:
                return texts.page(
                    words,
                    title=self.plan.title or words["instructions.title"],
                    body=self.plan.instruction[self._reader.page],
                    page=self._reader.page,
                    pages=self._reader.pages,
                    last=words["go_on"],
                    button=words["button.go_on"],
                )
            case Phase.PREPARING:
                return texts.getting_ready(words)
            case Phase.READY:
                return texts.ready(words, self._mission, self._progress)
            case Phase.INTERVAL | Phase.FIXATION:
                return BlankScreen(cross=self.phase is Phase.FIXATION)
            case Phase.FEEDBACK:
                return texts.feedback(words, self.plan, self._current, self._progress, self._scored, self.stage.points)
            case Phase.REST:
                return texts.rest(words, texts.with_score(self.stage, self.plan.rest), self._rest_left_s)
        return self._play_screen()

    # Inputs

    def _shown(self, shown: Shown) -> None:
        if self.phase in (Phase.PLAYING, Phase.HOLD):
            self.stage.say(self._current.shown(shown))
        elif self.phase is Phase.INSTRUCTIONS:
            self.stage.say(page_shown(self.number, self._reader, shown))
        self._flip_ns = shown.flip_ns
        if self.phase in _TIMED and self._until_ns is not None:
            self._until_ns = shown.flip_ns + self._lasts_ns

    def _let_time_pass(self) -> None:
        """Do what was due by now, before anything that came later is looked at."""
        now_ns = self.stage.now_ns
        if self.phase is Phase.PLAYING:
            cause = self._limits.over(now_ns)
            if cause:
                self._episode_ended(cause)
            elif stepped := self._current.tick(now_ns):
                self._stepped(stepped)
        elif self.phase is Phase.PREPARING or (
            self.phase in _TIMED and self._until_ns is not None and now_ns >= self._until_ns
        ):
            self._move(Cause.DONE)

    @property
    def _timed_out(self) -> bool:
        return self.phase in _TIMED and self._until_ns is not None and self.stage.now_ns >= self._until_ns

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
        if self.phase in _TIMED:
            self._until_ns = self.stage.now_ns + self._lasts_ns
        elif self.phase is Phase.REST:
            self._until_ns = self.stage.now_ns + round(self.plan.rest_s * NS_PER_S)
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))
        if self.phase is Phase.PLAYING:
            self._start_episode()

    def _prepare(self) -> None:
        """Reset the world while a text is on the screen, so that play starts at once."""
        plan = self.stage.plan.episodes[self.stage.next_episode]
        self._play = Play(plan, self.stage.world(plan.world, plan.options), picture_px=self.stage.picture_px)
        self._play.picture()  # a world's first picture may have to be compiled: not after the key that starts play

    def _start_episode(self) -> None:
        play, now_ns = self._current, self.stage.now_ns
        self.play = play
        if self.stage.key_map != play.plan.key_map:
            self.stage.key_map = play.plan.key_map
            self.stage.say(KeyMapDrawn(now_ns, play.plan.episode, play.plan.key_map))
        self.stage.say(play.start(now_ns), *play.stored(now_ns))
        self._limits.begin(now_ns)

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
        assert play.outcome is not None
        self.outcomes.append(play.outcome)
        if self.plan.points is not None:
            self._scored = self.plan.points.of(play.outcome, play.steps, play.return_)
            stage.points += self._scored
            stage.say(Scored(stage.now_ns, play.plan.episode, self._scored, stage.points))
        stage.next_episode += 1
        stage.completed += 1
        self._decide()
        self._move(Cause.EPISODE_ENDED)

    def _decide(self) -> None:
        """Whether the block is over before its last episode."""
        until = self.plan.until
        if until is not None and until.met(self.outcomes):
            self.skip = "criterion"
        elif self._limits.block_is_over(self.stage.now_ns):
            self.skip = "time"

    def _end(self) -> None:
        self.phase = Phase.OVER
        stage, past = self.stage, self.plan.first + self.plan.count
        if self.skip is not None and stage.next_episode < past:
            stage.say(EpisodesSkipped(stage.now_ns, stage.next_episode, past - stage.next_episode, self.skip))
            stage.next_episode = past
        until = self.plan.until
        if until is not None and not until.met(self.outcomes) and until.otherwise == "end":
            self.ended = Ended("failed", reason="screened_out", detail=f"{self.part.name}: criterion not reached")
        else:
            self.ended = Ended()

    # What is seen

    def _play_screen(self) -> PlayScreen:
        play, words = self._current, self.stage.words
        legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
        held = self.phase is Phase.HOLD
        return PlayScreen(
            picture=play.picture(),
            mission=self._mission,
            progress=self._progress,
            legend=tuple((key, words.action(action)) for key, action in legend),
            episode=play.plan.episode,
            step=play.steps,
            script=words.script,
            mark=texts.mark(play.outcome) if held and self.plan.marks else "",
            said=texts.score(words, self._scored) if held and self.plan.points is not None else "",
            labels=words.labels(tuple(key for key, _ in legend)),
        )

    @property
    def _mission(self) -> str:
        return self.plan.mission or self.stage.words.mission(self._current.mission)

    @property
    def _progress(self) -> str:
        total = self.stage.points if self.plan.show_points else None
        return texts.progress(self.stage, self.plan, self._current.plan, total)

    # Small things

    @property
    def _current(self) -> Play:
        assert self._play is not None
        return self._play

    @property
    def _lasts_ns(self) -> int:
        ms: dict[StrEnum, float] = {
            Phase.INTERVAL: self.plan.interval_ms,
            Phase.FIXATION: self.plan.fixation_ms,
            Phase.HOLD: self.plan.hold_ms,
        }
        return round(ms[self.phase] * NS_PER_MS)

    @property
    def _rest_left_s(self) -> int:
        return max(0, -(-((self._until_ns or 0) - self.stage.now_ns) // NS_PER_S))


def _always(_: Playing) -> bool:
    return True


PLAY = Kind("play", PlayPlan, Playing)
