"""Correction after the fact: an episode is looked at once more, and shown how it should have gone from a step on.

Which episodes come is told from outside. A correction begins in the very state that the episode had after the step, and
its steps are events of their own: it is no episode of the session.
"""

import json
from typing import TYPE_CHECKING

import msgspec

from minihuman.study import texts
from minihuman.study.activities.correction_events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionOutcome,
    CorrectionSeen,
    CorrectionStepped,
    EpisodeLookedAt,
    NothingToCorrect,
    WantsEpisode,
)
from minihuman.study.activities.film import Film
from minihuman.study.activities.pair_events import Offered, Stretch
from minihuman.study.activities.port import Activity, Ended, Kind, Want
from minihuman.study.events import KindEvent, Noted, PauseReason
from minihuman.study.inputs import Input, KeyDown, Shown
from minihuman.study.phases import Phase
from minihuman.study.play import NO_PICTURE, Play, world_calls
from minihuman.study.screens import FilmScreen, PlayScreen, Screen
from minihuman.study.stage import ENTER

if TYPE_CHECKING:
    from minihuman.worlds.adapt.world import World


class CorrectionPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``plan`` of an activity of kind "correction"."""

    source: str  # the block of this session whose episodes are looked at
    episodes: int = 3  # the latest of them
    steps: int = 20  # that a correction has at most
    back: str = "comma"
    forward: str = "period"
    begin: str = "space"  # begins a correction at the step that is seen, and ends it


class Correction(Activity):
    """Looks at one episode after the other."""

    def begin(self) -> None:
        """Wait for the first episode."""
        self._plan: CorrectionPlan = self.part.plan
        self._number = 0
        self._corrections = 0
        self._drawn: tuple[object, Screen] | None = None
        self._wait()

    def _wait(self) -> None:
        self.phase = Phase.PREPARING
        self._episode: Stretch | None = None
        self._film: Film | None = None
        self._step = 0
        if self._number == self._plan.episodes:
            self.ended = Ended()
            return
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))

    @property
    def wants(self) -> Want | None:  # type: ignore[override]
        """The next episode."""
        if self.ended or self.phase is not Phase.PREPARING:
            return None
        return WantsEpisode(self.number, self._plan.source, self._number, self._plan.episodes)

    @staticmethod
    def input_of(event: KindEvent) -> Input | None:
        """The episodes that came from outside, and when pictures were seen."""
        match event:
            case EpisodeLookedAt():
                return Offered(event.t_ns, event.stretch)
            case NothingToCorrect():
                return Offered(event.t_ns, None)
            case CorrectionSeen():
                return Shown(event.t_ns, event.submit_ns, event.flip_ns, event.step)
        return None

    def receive(self, happened: Input) -> None:
        """Take an input."""
        match happened:
            case Offered() if self.wants is not None:
                self._offer(happened.stretch)
            case KeyDown() if self.phase is Phase.SHOWING:
                self._show_key(happened)
            case KeyDown():
                self._look_key(happened)
            case Shown() if self._episode is not None:
                self._seen(happened)

    @property
    def playing(self) -> bool:  # type: ignore[override]
        """Whether somebody shows what should have been done."""
        return self.phase is Phase.SHOWING

    @property
    def looked_at(self) -> tuple[Stretch, int] | None:
        """The episode and the step that are seen, for whoever answers without looking; None where none is."""
        return None if self._episode is None or self.phase is not Phase.LOOKING else (self._episode, self._step)

    @property
    def number_of_look(self) -> tuple[int, int]:
        """The part, and the episode in it."""
        return self.number, self._number

    def suspend(self, reason: PauseReason) -> None:
        """Let the picture stand."""
        if self.play is not None:
            self.play.suspend()

    def stop(self) -> None:
        """Break off what is shown."""
        if self.phase is Phase.SHOWING:
            self._end_correction("stopped")

    # Looking

    def _offer(self, episode: Stretch | None) -> None:
        now_ns = self.stage.now_ns
        if episode is None or not 0 <= episode.episode < len(self.stage.plan.episodes):
            self.stage.say(NothingToCorrect(now_ns, self.number, self._number))
            self.ended = Ended()
            return
        plan = self.stage.plan.episodes[episode.episode]
        world = self._world_of(episode)
        self._film = Film(
            world,
            episode.seed,
            episode.actions,
            view=plan.view,
            palette=plan.palette,
            picture_px=self.stage.picture_px,
        )
        self._episode, self._step = episode, 0
        self.stage.say(
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

    def _world_of(self, episode: Stretch) -> "World":
        with world_calls():
            options = json.loads(episode.options)
        return self.stage.world(episode.world, options)

    def _look_key(self, press: KeyDown) -> None:
        plan, say_key = self._plan, self.stage.say_key
        if self.phase is not Phase.LOOKING or self._film is None:
            say_key(press, "not_playing" if press.key in ENTER else "unmapped", self.phase)
        elif press.key in (plan.back, plan.forward):
            say_key(press, "accepted", self.phase)
            by = 1 if press.key == plan.forward else -1
            self._step = min(max(0, self._step + by), len(self._film) - 1)
        elif press.repeat:
            say_key(press, "repeat", self.phase)
        elif press.key in ENTER:
            say_key(press, "accepted", self.phase)
            self._number += 1
            self._wait()
        elif press.key == plan.begin:
            say_key(press, "accepted", self.phase)
            self._begin_correction(press)
        else:
            say_key(press, "unmapped", self.phase)

    def _seen(self, shown: Shown) -> None:
        now = self._step if self.play is None else self.play.steps
        step = now if shown.step is None or self.play is None else min(shown.step, now)
        place = (self.number, self._number, step)
        self.stage.say(CorrectionSeen(self.stage.now_ns, *place, shown.submit_ns, shown.flip_ns))

    # Showing

    def _begin_correction(self, press: KeyDown) -> None:
        assert self._episode is not None
        episode, stage = self._episode, self.stage
        plan = msgspec.structs.replace(
            stage.plan.episodes[episode.episode],
            seed=episode.seed,
            max_steps=self._step + self._plan.steps,
            pace="on_key",
            record_observations=False,
        )
        world = self._world_of(episode)
        play = Play(plan, world, picture_px=stage.picture_px)
        play.start(stage.now_ns)
        for action in episode.actions[: self._step]:
            play.step(stage.now_ns, action, key="", key_t_ns=stage.now_ns)
        if play.outcome is not None:  # nothing can be done after its end
            return
        self.play = play
        place = (self.number, self._corrections, episode.episode, episode.attempt, self._step)
        stage.say(CorrectionBegun(stage.now_ns, *place, world.state_hash(), press.t_ns))
        self._move(Phase.SHOWING)

    def _show_key(self, press: KeyDown) -> None:
        assert self.play is not None
        play, say_key, stage = self.play, self.stage.say_key, self.stage
        action = play.action_of(press.key)
        if press.key == self._plan.begin and not press.repeat:
            say_key(press, "accepted", self.phase)
            self._end_correction("stopped")
        elif press.repeat and (action is None or not play.plan.auto_repeat):
            say_key(press, "repeat", self.phase, action)
        elif action is None:
            say_key(press, "spare" if press.key in play.plan.key_map.spare_keys else "unmapped", self.phase)
        else:
            say_key(press, "accepted", self.phase, action)
            stepped = play.step(stage.now_ns, action, key=press.key, key_t_ns=press.t_ns)
            stage.say(
                CorrectionStepped(
                    t_ns=stage.now_ns,
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
                self._end_correction(play.outcome)

    def _end_correction(self, outcome: CorrectionOutcome) -> None:
        assert self.play is not None
        place = (self.number, self._corrections, self.play.plan.episode)
        self.stage.say(CorrectionEnded(self.stage.now_ns, *place, outcome))
        self._corrections += 1
        self.play = None
        self._move(Phase.LOOKING)

    def _move(self, phase: Phase) -> None:
        self.phase = phase
        self.stage.say(Noted(self.stage.now_ns, "phase", phase))

    # What is seen

    def screen(self) -> Screen:
        """The episode's picture and the keys, or the world as it would have been."""
        if self._film is None:
            return texts.getting_ready(self.stage.words)
        steps = self.play.steps if self.play is not None else self._step
        now = (self.phase, self._number, self._corrections, steps)
        if self._drawn is None or self._drawn[0] != now:
            self._drawn = (now, self._film_screen(self._film) if self.play is None else self._play_screen(self.play))
        return self._drawn[1]

    def _film_screen(self, film: Film) -> FilmScreen:
        words, plan = self.stage.words, self._plan
        names = {"back": plan.back, "forward": plan.forward, "begin": plan.begin, "go_on": ENTER[0]}
        caps = words.labels(tuple(names.values()))
        prompt = {name: cap or key for name, (key, cap, _) in zip(names, caps, strict=True)}
        return FilmScreen(
            pictures=film,
            step=self._step,
            prompt=words.fill("correction.look", **prompt),
            progress=words.fill("progress.of_one", episode=self._number + 1, episodes=plan.episodes),
            back=plan.back,
            forward=plan.forward,
            film=(self.number, self._number),
            script=words.script,
        )

    def _play_screen(self, play: Play) -> PlayScreen:
        words = self.stage.words
        legend = sorted(play.plan.key_map.keys.items()) if play.plan.show_keys else []
        end = words.labels((self._plan.begin,))[0][1] or self._plan.begin
        return PlayScreen(
            picture=play.picture() if self.stage.draws_steps else NO_PICTURE,
            mission=words.fill("correction.show", end=end),
            progress=words.fill("progress.of_one", episode=self._number + 1, episodes=self._plan.episodes),
            legend=tuple((key, words.action(action)) for key, action in legend),
            episode=play.plan.episode,
            step=play.steps,
            script=words.script,
            labels=words.labels(tuple(key for key, _ in legend)),
        )


CORRECTION = Kind(
    "correction",
    CorrectionPlan,
    Correction,
    messages="minihuman.log.corrections:CORRECTIONS",
    block_field="source",
    drawings="minihuman.windows.draw_film:DRAWINGS",
)
