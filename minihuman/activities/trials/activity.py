"""Trials: short episodes that follow each other by the clock, without progress lines or notices between them.

A trial is a single picture until its response or deadline, or has a time course: then the block's timeline is resolved
as the trial begins, and the response is the one step of the trial's world.
"""

from typing import Any

import msgspec

from minihuman.activities.play.activity import PlayActivity
from minihuman.activities.trials.block_check import check_timeline
from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown, TrialResolved
from minihuman.activities.trials.plan import TimelineSpec, TrialsPlan
from minihuman.activities.trials.schedule import (
    CUE_TRIALS_PER_PART,
    CUES_PER_TRIAL,
    DRAWS_PER_STIMULUS,
    NS_PER_MS,
    resolve_trial,
)
from minihuman.activities.trials.screens import TrialScreen, build_trial_screen
from minihuman.activities.trials.server_needs import find_server_needs
from minihuman.activities.trials.trial_run import ResponseRecord, TrialRun
from minihuman.experiment.machine.activity import ActivityKind, SessionContext
from minihuman.experiment.machine.events import ActivityEvent, Paused, PauseReason, Resumed
from minihuman.experiment.machine.inputs import TRIAL_RULES, Input, KeyDown, ScreenShown, SoundStarted
from minihuman.experiment.machine.running_episode import RunningEpisode, catch_world_errors
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.plan.session_plan import PlannedPart
from minihuman.experiment.sounds import SoundContent, SoundCue

FEEDBACK = "feedback"  # the name of a sound that follows a trial, in the log


class TrialsActivity(PlayActivity):
    """An activity that plays a block of trials; each trial's own world is created between two pictures."""

    shows_progress = False
    plan: TrialsPlan

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        super().__init__(number, part, context)
        self.run: TrialRun | None = None  # the trial with a time course that is played
        self._is_pause_logged = False  # whether the log has a pause whose end it does not have yet
        self._n_runs = 0  # trials with a time course that began, in this segment
        self._feedback_sounds: dict[str, SoundContent] = {}  # of the latest such trial, by outcome
        self._finished_ns = 0  # when the latest such trial ended
        self.can_copy = not self.plan.timeline
        self._rhythm_start: tuple[int, int] | None = None  # a trial's place in the block, and its first flip
        self._latest_trial_screen: tuple[object, TrialScreen] | None = None

    @property
    def needs_new_world(self) -> bool:
        """Return whether a notice is shown while the next world is created; only before the block's first trial."""
        return super().needs_new_world and not self.has_begun

    @property
    def history(self) -> tuple[object, ...]:
        """Return ("without ready",) if a repeated trial begins without Enter, which no screen shows; () otherwise."""
        ready = self.plan.trial.ready if self.plan.trial else "each"
        is_first = self.context.next_episode == self.plan.first
        is_ready_skipped = {"each": not self.shows_ready_screen, "first": self.has_begun and is_first, "none": False}
        return ("without ready",) if is_ready_skipped[ready] else ()

    @property
    def running_trial(self) -> RunningEpisode | None:
        """Return the episode of the running trial with a time course, for simulated participants; None if none runs."""
        return None if self.run is None else self._play

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that caused an event: a picture shown or a sound begun; None for other events."""
        match event:
            case StimuliShown():
                return ScreenShown(event.t_ns, event.submit_ns, event.flip_ns, event.frame)
            case SoundPlayed():
                uncertainty_ns = round(event.uncertainty_ms * NS_PER_MS)
                return SoundStarted(event.t_ns, event.cue, event.scheduled_ns, event.onset_ns, uncertainty_ns)
        return None

    def receive(self, happened: Input) -> None:
        """Handle an input; first process everything that was due before it."""
        match happened:
            case ScreenShown() if self.run is not None:
                self._record_flip(self.run, happened)
            case SoundStarted():
                self._record_sound(happened)
            case _:
                super().receive(happened)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the time of the next change by the clock; None if nothing is due."""
        if self.run is not None:
            return self.run.next_tick_ns
        return super().next_tick_ns

    @property
    def sound_cues(self) -> tuple[SoundCue, ...]:  # type: ignore[override]
        """Return the sounds of the running trial that are due now or soon; between trials, that of the feedback."""
        if self.run is None:
            content = self._feedback_sound
            return () if content is None else (SoundCue(self._feedback_cue, content, self._finished_ns),)
        due_sounds = self.run.list_due_sounds().items()
        return tuple(SoundCue(self._first_cue + index, sound.content, due_ns) for index, (sound, due_ns) in due_sounds)

    @property
    def _first_cue(self) -> int:
        """Return the number of the running trial's first sound, which no other sound of the segment has.

        Sounds are numbered by part, then by trial within the part, then within the trial.
        """
        return (self.number * CUE_TRIALS_PER_PART + self._n_runs) * CUES_PER_TRIAL

    @property
    def _feedback_cue(self) -> int:
        """Return the number of the sound of the latest trial's feedback: the last of those reserved for a trial."""
        return self._first_cue + CUES_PER_TRIAL - 1

    @property
    def _feedback_sound(self) -> SoundContent | None:
        """Return the sound of the feedback that is shown now; None if there is no feedback or it has no sound."""
        if self.phase is not Phase.FEEDBACK or self._play is None:
            return None
        return self._feedback_sounds.get(self._play.outcome or "")

    def screen(self) -> Screen:
        """Build the present screen, or return the last one if nothing has changed."""
        run = self.run
        if run is None:
            return super().screen()
        state = (run, run.frame, run.has_response)
        if self._latest_trial_screen is None or self._latest_trial_screen[0] != state:
            photodiode = self.plan.timeline.photodiode if self.plan.timeline else msgspec.UNSET
            screen = build_trial_screen(
                self.context, self._current, run, first_cue=self._first_cue, photodiode=photodiode
            )
            self._latest_trial_screen = (state, screen)
        return self._latest_trial_screen[1]

    def suspend(self, reason: PauseReason) -> None:
        """Stop the clocks; a trial with a time course is void and will be repeated."""
        if self.run is None:
            super().suspend(reason)
            return
        if self.context.facts.get("trial_rules", "1") == TRIAL_RULES:
            self.context.emit(Paused(self.context.now_ns, reason))
            self._is_pause_logged = True
        self.context.emit(self._current.end(self.context.now_ns))
        self._limits.stop(self.context.now_ns)
        self.run = None
        self._play = None
        self._rhythm_start = None
        self.phase = Phase.PREPARING

    def resume(self) -> None:
        """Restart the clocks; the trial that a pause made void is repeated."""
        if self._is_pause_logged:
            self._is_pause_logged = False
            self.context.emit(Resumed(self.context.now_ns))
        super().resume()

    # A trial with a time course

    def _start_episode(self) -> None:
        """Start the prepared episode, and its timeline if the block has one."""
        super()._start_episode()
        if self.plan.timeline:
            self.play = None  # the pictures come from the timeline, not from the trial's world
            self._start_trial(self.plan.timeline)

    def _start_trial(self, timeline: TimelineSpec) -> None:
        """Resolve the schedule of the trial that begins, start the trial, and log it.

        In a block with a rhythm, the trial's first picture is due a whole number of periods after the first flip of the
        trial with which the rhythm began.
        """
        plan = self._current.plan
        cells: dict[str, Any] = plan.labels | plan.options
        session = self.context.plan
        purpose = f"timeline-{self.part.name}-session-{session.session}-{plan.episode_in_block}"
        index = session.participant.index
        n_draws = DRAWS_PER_STIMULUS * len(timeline.stimuli)
        words = draw_words(n_draws, seed=session.study_seed, purpose=purpose, index=index)
        shares = [float(word) / 2.0**64 for word in words]  # 64-bit integers as shares from 0 to 1
        with catch_world_errors():
            schedule = resolve_trial(timeline, cells, plan.response_deadline_ms, shares.__getitem__)
        start_ns = None
        if timeline.soa_ms and self._rhythm_start is not None:
            first_trial, flip_ns = self._rhythm_start
            start_ns = flip_ns + (plan.episode_in_block - first_trial) * round(timeline.soa_ms * NS_PER_MS)
        self.run = TrialRun(schedule, start_ns)
        self._feedback_sounds = schedule.feedback or {}
        self._n_runs += 1
        self.run.pass_time(self.context.now_ns)
        self.context.emit(
            TrialResolved(
                t_ns=self.context.now_ns,
                part=self.number,
                episode=plan.episode,
                schedule=msgspec.json.encode(schedule).decode(),
                start_ns=start_ns or 0,
            )
        )

    def _record_flip(self, run: TrialRun, screen_shown: ScreenShown) -> None:
        """Record and log a picture's flip; the empty picture is logged only if early sounds wait for it."""
        due_ns = run.record_flip(screen_shown.flip_ns, screen_shown.step)
        if run.frame < 0 and not run.has_lead:
            return
        episode = self._current.plan
        if self._rhythm_start is None and run.frame >= 0:
            self._rhythm_start = (episode.episode_in_block, screen_shown.flip_ns)
        if run.target_onset_ns is not None:
            self._current.note_onset(run.target_onset_ns)
        self.context.emit(
            StimuliShown(
                t_ns=screen_shown.t_ns,
                part=self.number,
                episode=episode.episode,
                frame=run.frame,
                stimuli=tuple(stimulus.name for stimulus in run.visible),
                due_ns=due_ns or 0,
                submit_ns=screen_shown.submit_ns,
                flip_ns=screen_shown.flip_ns,
            )
        )

    def _record_sound(self, started: SoundStarted) -> None:
        """Record and log that a sound of the running trial or the feedback began; ignore a sound of another trial."""
        if self._feedback_sound is not None and started.cue == self._feedback_cue:
            self._emit_sound(started, FEEDBACK, self._finished_ns)
            return
        run = self.run
        sound_index = started.cue - self._first_cue
        started_sound = None if run is None else run.record_sound(sound_index, started.onset_ns)
        if run is None or started_sound is None:
            return
        if run.target_onset_ns is not None:
            self._current.note_onset(run.target_onset_ns)
        sound, due_ns = started_sound
        self._emit_sound(started, sound.name, due_ns)

    def _emit_sound(self, started: SoundStarted, name: str, due_ns: int) -> None:
        """Log that a sound began which the schedule intended for ``due_ns``."""
        self.context.emit(
            SoundPlayed(
                t_ns=self.context.now_ns,
                part=self.number,
                episode=self._current.plan.episode,
                sound=name,
                cue=started.cue,
                due_ns=due_ns,
                scheduled_ns=started.scheduled_ns,
                onset_ns=started.onset_ns,
                uncertainty_ms=started.uncertainty_ns / NS_PER_MS,
            )
        )

    def _let_time_pass(self) -> None:
        """Process what is due by now: a picture or the end of a running trial, or else what is due between trials."""
        run = self.run
        if run is None:
            super()._let_time_pass()
            return
        run.pass_time(self.context.now_ns)
        if run.is_over(self.context.now_ns):
            self._finish_trial(run)

    def _key_in_play(self, press: KeyDown) -> None:
        """Handle a key press during a trial; in a trial with a time course it is a response or without effect."""
        run = self.run
        if run is None:
            super()._key_in_play(press)
            return
        play = self._current
        emit_key = self.context.emit_key
        action = play.action_of(press.key)
        if press.repeat:
            emit_key(press, "repeat", self.phase, action)
        elif action is None:
            emit_key(press, play.plan.key_map.judge_idle_key(press.key), self.phase)
        elif not run.is_open(press.t_ns):
            emit_key(press, "not_playing", self.phase, action)
        else:
            emit_key(press, "accepted", self.phase, action)
            self._take_response(run, ResponseRecord(press.key, action, press.t_ns))

    def _take_response(self, run: TrialRun, response: ResponseRecord) -> None:
        """Record and log a response, and finish the trial if it was the last one."""
        run.responses.append(response)
        assert run.target_onset_ns is not None  # responses are taken from then on
        self.context.emit(
            ResponseTaken(
                t_ns=self.context.now_ns,
                part=self.number,
                episode=self._current.plan.episode,
                number=len(run.responses),
                key=response.key,
                action=response.action,
                pressed_ns=response.pressed_ns,
                target_ns=run.target_onset_ns,
            )
        )
        if run.is_over(self.context.now_ns):
            self._finish_trial(run)

    def _finish_trial(self, run: TrialRun) -> None:
        """End the trial with the one step of its world: the last response's action, or the no-op without a response."""
        play = self._current
        now_ns = self.context.now_ns
        self.run = None
        self._finished_ns = now_ns
        if run.responses:
            response = run.responses[-1]
            stepped = play.step(now_ns, response.action, key=response.key, key_t_ns=response.pressed_ns)
        else:
            stepped = play.step_without_key(now_ns)
        self._stepped(stepped)


TRIAL_BLOCK = ActivityKind(
    "trials",
    TrialsPlan,
    TrialsActivity,
    messages="minihuman.activities.trials.rows:TRIAL_ROWS",
    tables="minihuman.activities.trials.tables:TRIAL_TABLES",
    presentations="minihuman.activities.trials.presentations:list_presentations",
    measures="minihuman.activities.trials.trial_measures:MEASURES",
    report="minihuman.activities.trials.report:build_section",
    screens=(TrialScreen,),
    simulator="minihuman.activities.trials.simulation:TrialSimulator",
    page_run="minihuman.activities.trials.trial_page_run:build_trial_page_run",
    check_block=check_timeline,
    find_server_needs=find_server_needs,
    is_played_alone=True,
    has_trials=True,
)
