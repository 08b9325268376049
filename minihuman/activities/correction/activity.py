"""Correction: review an episode after it was played and demonstrate what should have been done.

The session host decides which episodes are reviewed. A correction begins in the exact state after the chosen step; its
steps are separate events and continue the episode's count. It is not an episode of the session.
"""

import json
from typing import TYPE_CHECKING

import msgspec

from minihuman.activities.clip_requests import EpisodeRequest
from minihuman.activities.correction.events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionOutcome,
    CorrectionSeen,
    CorrectionStepped,
    EpisodeLookedAt,
    NothingToCorrect,
)
from minihuman.activities.correction.plan import CorrectionPlan
from minihuman.activities.correction.screens import FilmScreen
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip, EpisodeFilm
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import ENTER_KEYS, Activity, ActivityKind, ActivityRequest, PartEnding
from minihuman.experiment.machine.events import ActivityEvent, Noted, PauseReason
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown
from minihuman.experiment.machine.running_episode import EMPTY_IMAGE, RunningEpisode, catch_world_errors
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.experiment.machine.transitions import Phase

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


class CorrectionActivity(Activity):
    """An activity in which the participant reviews one episode after another."""

    def begin(self) -> None:
        """Wait for the first episode to review."""
        self._plan: CorrectionPlan = self.part.plan
        self._number = 0
        self._corrections = 0
        self._cached_screen: tuple[object, Screen] | None = None
        self._await_episode()

    def _await_episode(self) -> None:
        """Wait for the next episode to review, or end the part if all have been reviewed."""
        self.phase = Phase.PREPARING
        self._episode: EpisodeClip | None = None
        self._film: EpisodeFilm | None = None
        self._step = 0
        if self._number == self._plan.episodes:
            self.ended = PartEnding()
            return
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    @property
    def request(self) -> ActivityRequest | None:  # type: ignore[override]
        """Return the request for the next episode to review; None if none is due."""
        if self.ended or self.phase is not Phase.PREPARING:
            return None
        return EpisodeRequest(self.number, self._plan.source, self._number, self._plan.episodes)

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that caused an event: an offered episode or a shown picture; None for other events."""
        match event:
            case EpisodeLookedAt():
                return ClipOffered(event.t_ns, event.stretch)
            case NothingToCorrect():
                return ClipOffered(event.t_ns, None)
            case CorrectionSeen():
                return ScreenShown(event.t_ns, event.submit_ns, event.flip_ns, event.step)
        return None

    def receive(self, happened: Input) -> None:
        """Handle an input: an offered episode, a key press, or a picture that reached the display."""
        match happened:
            case ClipOffered() if self.request is not None:
                self._begin_review(happened.stretch)
            case KeyDown() if self.phase is Phase.SHOWING:
                self._press_during_correction(happened)
            case KeyDown():
                self._press_during_review(happened)
            case ScreenShown() if self._episode is not None:
                self._log_picture(happened)

    @property
    def playing(self) -> bool:  # type: ignore[override]
        """Return whether a correction is in progress."""
        return self.phase is Phase.SHOWING

    @property
    def reviewed_episode(self) -> tuple[EpisodeClip, int] | None:
        """Return the episode and the step under review, for simulated participants; None if there is none."""
        if self._episode is None or self.phase is not Phase.LOOKING:
            return None
        return (self._episode, self._step)

    @property
    def review_id(self) -> tuple[int, int]:
        """Return the part's index in the plan, and the index of the reviewed episode within the part."""
        return self.number, self._number

    def suspend(self, reason: PauseReason) -> None:
        """Stop the clock of a running correction."""
        if self.play is not None:
            self.play.suspend()

    def stop(self) -> None:
        """End a correction that is in progress."""
        if self.phase is Phase.SHOWING:
            self._end_correction("stopped")

    # Looking

    def _begin_review(self, episode: EpisodeClip | None) -> None:
        """Show an episode for review and log it; end the part if there is none, or if the session's plan lacks it."""
        now_ns = self.context.now_ns
        if episode is None or not 0 <= episode.episode < len(self.context.plan.episodes):
            self.context.emit(NothingToCorrect(now_ns, self.number, self._number))
            self.ended = PartEnding()
            return
        plan = self.context.plan.episodes[episode.episode]
        world = self._make_world(episode)
        self._film = EpisodeFilm(
            world,
            episode.seed,
            episode.actions,
            view=plan.view,
            palette=plan.palette,
            picture_px=self.context.picture_px,
        )
        self._episode = episode
        self._step = 0
        self.context.emit(
            EpisodeLookedAt(
                t_ns=now_ns,
                part=self.number,
                number=self._number,
                episode=episode.episode,
                attempt=episode.attempt,
                world=episode.world,
                options=episode.options,
                seed=episode.seed,
                actions=episode.actions,
                last_hash=self._film.last_hash,
            )
        )
        self._move(Phase.LOOKING)

    def _make_world(self, episode: EpisodeClip) -> "World":
        """Return a world of the same id and options as the world in which an episode was played."""
        with catch_world_errors():
            options = json.loads(episode.options)
        return self.context.world(episode.world, options)

    def _press_during_review(self, press: KeyDown) -> None:
        """Handle a key press during the review: step through the episode, correct it or go to the next one."""
        plan = self._plan
        emit_key = self.context.emit_key
        if self.phase is not Phase.LOOKING or self._film is None:
            emit_key(press, "not_playing" if press.key in ENTER_KEYS else "unmapped", self.phase)
        elif press.key in (plan.back, plan.forward):
            emit_key(press, "accepted", self.phase)
            direction = 1 if press.key == plan.forward else -1
            self._step = min(max(0, self._step + direction), len(self._film) - 1)
        elif press.repeat:
            emit_key(press, "repeat", self.phase)
        elif press.key in ENTER_KEYS:
            emit_key(press, "accepted", self.phase)
            self._number += 1
            self._await_episode()
        elif press.key == plan.begin:
            emit_key(press, "accepted", self.phase)
            self._begin_correction(press)
        else:
            emit_key(press, "unmapped", self.phase)

    def _log_picture(self, screen_shown: ScreenShown) -> None:
        """Log that a picture of the reviewed episode, or of its correction, reached the display."""
        step = self._current_step
        if self.play is not None and screen_shown.step is not None:
            step = min(screen_shown.step, step)
        self.context.emit(
            CorrectionSeen(
                t_ns=self.context.now_ns,
                part=self.number,
                number=self._number,
                step=step,
                submit_ns=screen_shown.submit_ns,
                flip_ns=screen_shown.flip_ns,
            )
        )

    # Showing

    def _begin_correction(self, press: KeyDown) -> None:
        """Recreate the episode up to the step that is shown, and let the participant continue from there.

        Nothing happens at the episode's end, where no further step is possible.
        """
        assert self._episode is not None
        episode = self._episode
        context = self.context
        plan = msgspec.structs.replace(
            context.plan.episodes[episode.episode],
            seed=episode.seed,
            max_steps=self._step + self._plan.steps,
            pace="on_key",
            record_observations=False,
        )
        world = self._make_world(episode)
        play = RunningEpisode(plan, world, picture_px=context.picture_px)
        play.start(context.now_ns)
        for action in episode.actions[: self._step]:
            play.step(context.now_ns, action, key="", key_t_ns=context.now_ns)
        if play.outcome is not None:
            return
        self.play = play
        context.emit(
            CorrectionBegun(
                t_ns=context.now_ns,
                part=self.number,
                correction=self._corrections,
                episode=episode.episode,
                attempt=episode.attempt,
                step=self._step,
                state_hash=world.state_hash(),
                pressed_ns=press.t_ns,
            )
        )
        self._move(Phase.SHOWING)

    def _press_during_correction(self, press: KeyDown) -> None:
        """Handle a key press during a correction: make a step or stop."""
        assert self.play is not None
        play = self.play
        emit_key = self.context.emit_key
        context = self.context
        action = play.action_of(press.key)
        if press.key == self._plan.begin and not press.repeat:
            emit_key(press, "accepted", self.phase)
            self._end_correction("stopped")
        elif press.repeat and (action is None or not play.plan.auto_repeat):
            emit_key(press, "repeat", self.phase, action)
        elif action is None:
            emit_key(press, play.plan.key_map.judge_idle_key(press.key), self.phase)
        else:
            emit_key(press, "accepted", self.phase, action)
            stepped = play.step(context.now_ns, action, key=press.key, key_t_ns=press.t_ns)
            context.emit(
                CorrectionStepped(
                    t_ns=context.now_ns,
                    part=self.number,
                    correction=self._corrections,
                    episode=play.plan.episode,
                    step=stepped.step,
                    action=action,
                    key=press.key,
                    key_t_ns=press.t_ns,
                    reward=stepped.reward,
                    terminated=stepped.terminated,
                    truncated=stepped.truncated,
                    state_hash=stepped.state_hash,
                )
            )
            if play.outcome is not None:
                assert play.outcome != "abandoned"
                assert play.outcome != "agent_failed"
                self._end_correction(play.outcome)

    def _end_correction(self, outcome: CorrectionOutcome) -> None:
        """Log how the running correction ended, and return to the review."""
        assert self.play is not None
        self.context.emit(
            CorrectionEnded(self.context.now_ns, self.number, self._corrections, self.play.plan.episode, outcome)
        )
        self._corrections += 1
        self.play = None
        self._move(Phase.LOOKING)

    def _move(self, phase: Phase) -> None:
        self.phase = phase
        self.context.emit(Noted(self.context.now_ns, "phase", phase))

    # What is seen

    @property
    def _current_step(self) -> int:
        """Return the step of the running correction, or otherwise of the episode under review."""
        if self.play is None:
            return self._step
        return self.play.steps

    def screen(self) -> Screen:
        """Build the screen of the running correction, or of the episode under review."""
        if self._film is None:
            return screen_texts.build_wait_screen(self.context.words)
        state = (self.phase, self._number, self._corrections, self._current_step)
        if self._cached_screen is None or self._cached_screen[0] != state:
            self._cached_screen = (state, self._build_screen(self._film))
        return self._cached_screen[1]

    def _build_screen(self, film: EpisodeFilm) -> Screen:
        if self.play is None:
            return self._film_screen(film)
        return self._play_screen(self.play)

    def _film_screen(self, film: EpisodeFilm) -> FilmScreen:
        """Build the screen of the episode under review, with the keys that step through it and correct it."""
        words = self.context.words
        plan = self._plan
        keys = {"back": plan.back, "forward": plan.forward, "begin": plan.begin, "go_on": ENTER_KEYS[0]}
        labels = words.labels(tuple(keys.values()))
        key_labels = {field: label or key for field, (key, label, _) in zip(keys, labels, strict=True)}
        return FilmScreen(
            pictures=film,
            step=self._step,
            prompt=words.fill("correction.look", **key_labels),
            progress=words.fill("progress.of_one", episode=self._number + 1, episodes=plan.episodes),
            back=plan.back,
            forward=plan.forward,
            film=(self.number, self._number),
            locale=words.locale,
        )

    def _play_screen(self, play: RunningEpisode) -> PlayScreen:
        """Build the screen of the running correction, with the key that ends it."""
        words = self.context.words
        legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
        end_key_label = words.labels((self._plan.begin,))[0][1] or self._plan.begin
        return PlayScreen(
            picture=play.picture() if self.context.renders_steps else EMPTY_IMAGE,
            mission=words.fill("correction.show", end=end_key_label),
            progress=words.fill("progress.of_one", episode=self._number + 1, episodes=self._plan.episodes),
            legend=tuple((key, words.action(action)) for key, action in legend),
            episode=play.plan.episode,
            step=play.steps,
            locale=words.locale,
            labels=words.labels(tuple(key for key, _ in legend)),
        )


CORRECTION = ActivityKind(
    "correction",
    CorrectionPlan,
    CorrectionActivity,
    messages="minihuman.activities.correction.rows:CORRECTION_ROWS",
    tables="minihuman.activities.correction.tables:CORRECTION_TABLES",
    report="minihuman.activities.correction.report:build_section",
    screens=(FilmScreen,),
    block_field="source",
    simulator="minihuman.activities.correction.simulation:CorrectionSimulator",
)
