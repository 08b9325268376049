"""Play: the episodes of one block, with instructions, fixation, feedback and rest.

The module holds the block's transition table and drives the block's components: the sequence of episodes, their limits
of playing time (pauses excluded), the timed screens, the keys of texts, and the screens.
"""

from collections.abc import Callable, Mapping
from typing import Any

from minihuman.activities.pages.page_reader import PageReader, build_page_shown
from minihuman.activities.play.clocks import BlockTimeLimits, PhaseTimer
from minihuman.activities.play.early_plans import find_early_blocks
from minihuman.activities.play.episode_sequence import EpisodeSequence
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.play.screens import BlockScreens
from minihuman.activities.play.server_needs import find_server_needs
from minihuman.activities.play.text_keys import TextKeys
from minihuman.experiment.machine.activity import ENTER_KEYS, Activity, ActivityKind, SessionContext
from minihuman.experiment.machine.events import (
    EndCause,
    KeyMapDrawn,
    Noted,
    Paused,
    PauseReason,
    Resumed,
    Stepped,
)
from minihuman.experiment.machine.inputs import Input, KeyDown, PointerPressed, ScreenShown
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.experiment.machine.transitions import Phase, PhaseTransition, TransitionCause, TransitionTable
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart


def _another_episode_follows(play: "PlayActivity") -> bool:
    return play.has_next_episode


PLAY_TRANSITIONS: "TransitionTable[PlayActivity]" = TransitionTable(
    [
        PhaseTransition(Phase.START, TransitionCause.BEGAN, Phase.INSTRUCTIONS),
        PhaseTransition(Phase.INSTRUCTIONS, TransitionCause.DONE, Phase.PREPARING),
        PhaseTransition(Phase.PREPARING, TransitionCause.DONE, Phase.READY),
        PhaseTransition(Phase.READY, TransitionCause.DONE, Phase.INTERVAL),
        PhaseTransition(Phase.INTERVAL, TransitionCause.DONE, Phase.FIXATION),
        PhaseTransition(Phase.FIXATION, TransitionCause.DONE, Phase.PLAYING),
        PhaseTransition(Phase.PLAYING, TransitionCause.EPISODE_ENDED, Phase.HOLD),
        PhaseTransition(Phase.HOLD, TransitionCause.DONE, Phase.FEEDBACK),
        PhaseTransition(Phase.FEEDBACK, TransitionCause.DONE, Phase.LEARNING, _another_episode_follows),
        PhaseTransition(Phase.LEARNING, TransitionCause.DONE, Phase.PREPARING),
        PhaseTransition(Phase.FEEDBACK, TransitionCause.DONE, Phase.REST),
        PhaseTransition(Phase.REST, TransitionCause.DONE, Phase.OVER),
    ]
)


PHASE_CONDITIONS: "Mapping[Phase, Callable[[PlayActivity], bool]]" = {
    Phase.INSTRUCTIONS: lambda play: bool(play.plan.instruction),
    Phase.LEARNING: lambda play: play.learning_s > 0,
    Phase.PREPARING: lambda play: play.needs_new_world,
    Phase.READY: lambda play: play.shows_ready_screen and play.waits_for_ready,
    Phase.INTERVAL: lambda play: play.sequence.interval_ms > 0,
    Phase.FIXATION: lambda play: play.plan.fixation_ms > 0,
    Phase.HOLD: lambda play: play.plan.hold_ms > 0,
    Phase.FEEDBACK: lambda play: bool(play.feedback_text),
    Phase.REST: lambda play: bool(play.plan.rest) or play.plan.rest_s > 0,
}


POINTER = "pointer"  # logged as the key of a step that a click made


class PlayActivity(Activity):
    """An activity that plays a block's episodes, from the first that the session has not completed."""

    plan: PlayPlan
    can_copy = True
    transitions: "TransitionTable[Any]" = PLAY_TRANSITIONS
    phase_conditions: "Mapping[Phase, Callable[[Any], bool]]" = PHASE_CONDITIONS
    sequence: EpisodeSequence
    play: RunningEpisode | None = None
    learning_s = 0.0  # how long the next episode may wait for an agent that learns
    shows_progress = True  # whether a line shows which episode of how many it is
    has_begun = False  # whether an episode of the block has begun in this segment

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        super().__init__(number, part, context)
        self.plan = part.plan
        self.phase = Phase.START
        self.shows_ready_screen: bool = True
        self._play: RunningEpisode | None = None  # from the ready screen to the end of the feedback
        self.sequence = EpisodeSequence(number, part, context)
        self._timer = PhaseTimer(self.plan, self.sequence, lambda: self.learning_s)
        self._limits = BlockTimeLimits(self.plan.max_s, self.plan.block_max_s)
        self._reader = PageReader(len(self.plan.instruction))
        self._text_keys = TextKeys(self._reader, self._timer)
        self._view = BlockScreens(self.plan, context, shows_progress=self.shows_progress)
        self._flip_ns: int | None = None  # when the present text reached the display
        self._latest_screen: tuple[object, Screen] | None = None  # a world's picture is drawn once

    # State that the conditions of phases depend on

    @property
    def has_next_episode(self) -> bool:
        """Return whether another episode of the block follows."""
        return self.sequence.has_next

    @property
    def needs_new_world(self) -> bool:
        """Return whether the world of the next episode must still be made, which takes time."""
        plan = self.next_plan
        return not self.context.has_world(plan.world, plan.options)

    @property
    def next_plan(self) -> EpisodePlan:
        """Return the plan of the next episode; a subclass whose blocks resolve their episodes late overrides it."""
        return self.sequence.next_plan

    @property
    def waits_for_ready(self) -> bool:
        """Return whether the next episode starts only when the participant presses Enter."""
        if not self.plan.trial or self.plan.trial.ready == "each":
            return True
        return self.plan.trial.ready == "first" and not self.has_begun

    @property
    def feedback_text(self) -> str:
        """Return the text of the feedback on the last episode; "" if there is none."""
        if self._play:
            return self.plan.feedback.get(self._play.outcome or "", "")
        return ""

    # The port

    def begin(self) -> None:
        """Begin the block, or resume it."""
        self.sequence.resume()
        self.sequence.decide(time_is_up=self._limits.is_block_over(self.context.now_ns))
        if not self.has_next_episode:
            self._end()
            return
        self._move(TransitionCause.BEGAN)

    def receive(self, happened: Input) -> None:
        """Process everything that was due before an input, and then handle the input."""
        if isinstance(happened, ScreenShown):
            self._shown(happened)
            return
        self._let_time_pass()
        if self.ended:
            if isinstance(happened, KeyDown):
                self.context.emit_key(happened, "not_playing", self.phase)
            return
        match happened:
            case KeyDown() if self.phase is Phase.PLAYING:
                self._key_in_play(happened)
            case KeyDown(repeat=True):
                self.context.emit_key(happened, "repeat", self.phase)
            case KeyDown():
                self._key_outside_play(happened)
            case PointerPressed(target="picture") if self.phase is Phase.PLAYING and self._current.takes_clicks:
                self._click_in_play(happened)
            case PointerPressed(target="go_on" | "back" as target) if self.phase is Phase.INSTRUCTIONS:
                self._turn(1 if target == "go_on" else -1, by_enter=True)

    def suspend(self, reason: PauseReason) -> None:
        """Stop the clocks, and log the pause of a running episode."""
        self._timer.suspend(self.phase)
        if self.phase is Phase.PLAYING:
            self._current.suspend()
            self._limits.stop(self.context.now_ns)
            self.context.emit(Paused(self.context.now_ns, reason))

    def resume(self) -> None:
        """Restart the clocks, and log that a running episode resumes."""
        super().resume()
        if self.phase is Phase.PLAYING:
            self._limits.resume(self.context.now_ns)
            self.context.emit(Resumed(self.context.now_ns))
        else:
            self._timer.resume(self.phase, self.context.now_ns)

    def stop(self) -> None:
        """End a running episode as abandoned."""
        if self._play and self._play.started and self._play.outcome is None:
            self.context.emit(self._play.end(self.context.now_ns))

    @property
    def playing(self) -> bool:  # type: ignore[override]
        """Return whether an episode is running."""
        return self.phase is Phase.PLAYING

    @property
    def real_time(self) -> bool:  # type: ignore[override]
        """Return whether the running episode's steps happen by the clock, without waiting for keys."""
        return self.playing and self._current.real_time

    @property
    def limit_ns(self) -> int | None:  # type: ignore[override]
        """Return the time at which the next time limit is reached; None between episodes or without a limit."""
        if self.playing:
            return self._limits.due_ns
        return None

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the time of the next change by the clock; None if nothing is due.

        A change is a real-time step, a time limit, the end of a timed screen, or the next second of a rest.
        """
        if self.phase is Phase.PLAYING:
            self.play = self._current
            times_ns = (self._current.next_tick_ns, self._limits.due_ns)
            return min((t_ns for t_ns in times_ns if t_ns is not None), default=None)
        if self.phase is Phase.PREPARING:
            return self.context.now_ns
        return self._timer.find_due_ns(self.phase, self.context.now_ns)

    def screen(self) -> Screen:
        """Build the screen of the present phase, or return the last one if nothing has changed."""
        steps = None if self._play is None else self._play.steps
        rest_s = self._timer.find_remaining_s(self.context.now_ns)
        state = (self.phase, self._reader.page, self._play, steps, rest_s, self._look)
        if self._latest_screen is None or self._latest_screen[0] != state:
            self._latest_screen = (state, self._screen())
        return self._latest_screen[1]

    def _screen(self) -> Screen:
        """Build the screen of the present phase."""
        screen_without_episode = self._view.build_without_episode(self.phase, self._reader)
        if screen_without_episode is not None:
            return screen_without_episode
        match self.phase:
            case Phase.READY:
                return self._view.build_ready(self._current)
            case Phase.FEEDBACK:
                return self._view.build_feedback(self._current, self.sequence.last_points)
            case Phase.REST:
                return self._view.build_rest(self._timer.find_remaining_s(self.context.now_ns))
        return self._play_screen()

    def _play_screen(self) -> PlayScreen:
        return self._view.build_play(self._current, is_last=self.phase is Phase.HOLD, points=self.sequence.last_points)

    # Inputs

    def _shown(self, screen_shown: ScreenShown) -> None:
        """Log what reached the display, and start the phase's time from the flip."""
        if self.phase in (Phase.PLAYING, Phase.HOLD):
            self.context.emit(self._current.record_shown(screen_shown))
            if screen_shown.step is not None and screen_shown.step < self._current.steps:
                return
        elif screen_shown.step is not None:  # a picture that is reported after its episode has ended
            if self._play is not None and self._play.started:
                self.context.emit(self._play.record_shown(screen_shown))
            return
        elif self.phase is Phase.INSTRUCTIONS:
            self.context.emit(build_page_shown(self.number, self._reader, screen_shown))
        self._flip_ns = screen_shown.flip_ns
        self._timer.note_seen(self.phase, screen_shown.flip_ns)

    def _let_time_pass(self) -> None:
        """Process what is due by now: a time limit, a real-time step, or the end of a phase that time ends."""
        now_ns = self.context.now_ns
        if self.phase is Phase.PLAYING:
            cause = self._limits.find_reached_limit(now_ns)
            if cause:
                self._episode_ended(cause)
            elif stepped := self._current.tick(now_ns):
                self._stepped(stepped)
        elif self.phase is Phase.PREPARING or self._timer.is_over(self.phase, now_ns):
            self._move(TransitionCause.DONE)

    def _key_in_play(self, press: KeyDown) -> None:
        """Handle a key press during an episode: make a step, or queue the action in real time."""
        play = self._current
        emit_key = self.context.emit_key
        action = play.action_of(press.key)
        repeats_step = play.plan.auto_repeat and not play.real_time and action is not None
        if press.repeat and not repeats_step:
            emit_key(press, "repeat", self.phase, action)
        elif action is None:
            emit_key(press, play.plan.key_map.judge_idle_key(press.key), self.phase)
        elif play.real_time:
            play.queue(press.t_ns, press.key, action)
            emit_key(press, "queued", self.phase, action)
        else:
            emit_key(press, "accepted", self.phase, action)
            self._stepped(play.step(self.context.now_ns, action, key=press.key, key_t_ns=press.t_ns))

    def _click_in_play(self, press: PointerPressed) -> None:
        """Handle a click into the picture during an episode: make a step, or queue the action in real time."""
        play = self._current
        action = play.find_click_action(press.x, press.y)
        if play.real_time:
            play.queue(press.t_ns, POINTER, action)
        else:
            self._stepped(play.step(self.context.now_ns, action, key=POINTER, key_t_ns=press.t_ns))

    def _key_outside_play(self, press: KeyDown) -> None:
        """Handle a key press on one of the block's text screens."""
        effect = self._text_keys.judge(
            press, self.phase, now_ns=self.context.now_ns, flip_ns=self._flip_ns, play=self._play
        )
        self.context.emit_key(press, effect.verdict, self.phase)
        if effect.turns:
            self._turn(effect.turns, by_enter=press.key in ENTER_KEYS)
        elif effect.goes_on:
            self._move(TransitionCause.DONE)

    def _turn(self, n_pages: int, *, by_enter: bool) -> None:
        """Turn the instruction by a number of pages, forward above 0 and back below.

        On the last page a turn forward ends the instruction if ``by_enter`` is true: by Enter or by the button.
        """
        if not self._reader.turn(n_pages) and n_pages > 0 and by_enter:
            self._move(TransitionCause.DONE)

    # Moving on

    def _move(self, cause: TransitionCause) -> None:
        """Enter the next phase by the transition table, and skip phases that have nothing to show.

        If the table has no transition for the cause, nothing changes.
        """
        transition = self.transitions.find(self.phase, cause, self)
        if transition is None:
            return
        assert isinstance(transition.end, Phase)
        previous_phase = self.phase
        self.phase = transition.end
        if self.phase is Phase.OVER:
            self._end()
            return
        if previous_phase is Phase.FEEDBACK:
            self.shows_ready_screen = not self.feedback_text  # a participant who has just left the feedback is ready
        elif self.phase is Phase.READY:
            self._prepare()
        self._flip_ns = None
        if not self.phase_conditions.get(self.phase, lambda _: True)(self):
            self._move(TransitionCause.DONE)
            return
        self._timer.begin(self.phase, self.context.now_ns)
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))
        if self.phase is Phase.PLAYING:
            self._start_episode()

    def _prepare(self) -> None:
        """Reset the next episode's world while a text is shown, so that play starts without delay."""
        self._play = self._make_episode(self.next_plan)
        if self.context.renders_steps:
            self._play.picture()  # a world's first picture takes longer, so draw it before the key that starts play
        self.next_play = self._play

    def _make_episode(self, plan: EpisodePlan) -> RunningEpisode:
        """Return a new running episode of a plan, in a world of the session; a hook for subclasses."""
        world = self.context.world(plan.world, plan.options)
        context = self.context
        return RunningEpisode(
            plan,
            world,
            picture_px=context.picture_px,
            keys_down=context.keys_down,
            bindings=self.plan.bindings,
            axes=context.axes,
        )

    def _start_episode(self) -> None:
        """Start the prepared episode and its time limits, and log it, with the key map if that has changed."""
        play = self._current
        now_ns = self.context.now_ns
        self.play = play
        self.next_play = None
        self.has_begun = True
        if self.context.key_map != play.plan.key_map:
            self.context.key_map = play.plan.key_map
            self.context.emit(KeyMapDrawn(now_ns, play.plan.episode, play.plan.key_map))
        self.context.emit(play.start(now_ns), *play.stored_observations(now_ns))
        self._limits.begin(now_ns)
        self._episode_started()

    def _episode_started(self) -> None:
        """React to the start of an episode; a hook for subclasses."""

    def _between_episodes(self) -> None:
        """React to the end of an episode; a hook for subclasses."""

    def _stepped(self, stepped: Stepped) -> None:
        """Log a step with its observation and completed clauses, and end the episode if the step ended it."""
        play = self._current
        now_ns = self.context.now_ns
        self.context.emit(*play.stored_observations(now_ns), *play.clauses_done(now_ns), stepped)
        if self._current.outcome is not None:
            self._episode_ended("")

    def _episode_ended(self, cause: EndCause) -> None:
        """Log and count the episode's end, decide whether another follows, and enter the next phase.

        ``cause`` says what ended the episode other than its world; "" if a step in the world ended it.
        """
        play = self._current
        context = self.context
        self.play = None
        self._limits.stop(context.now_ns)
        context.emit(play.end(context.now_ns, cause))
        self.sequence.add_episode(play)
        self.sequence.decide(time_is_up=self._limits.is_block_over(context.now_ns))
        self._between_episodes()
        self._move(TransitionCause.EPISODE_ENDED)

    def _end(self) -> None:
        """End the block and log the episodes that were skipped."""
        self.phase = Phase.OVER
        self.ended = self.sequence.end()

    # Small things

    @property
    def _look(self) -> object:
        """Return further state on which the screen depends; a hook for subclasses."""
        return None

    @property
    def _current(self) -> RunningEpisode:
        assert self._play is not None
        return self._play


PLAY = ActivityKind(
    "play",
    PlayPlan,
    PlayActivity,
    tables="minihuman.activities.play.tables:PLAY_TABLES",
    find_early_parts=find_early_blocks,
    find_server_needs=find_server_needs,
    is_played_alone=True,
    is_plain_play=True,
    is_for_players=True,
)
