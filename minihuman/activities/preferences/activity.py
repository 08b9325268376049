"""Preferences: compare two clips of episodes side by side, recreated from seeds and actions.

The session host chooses the clips. The side of each clip is drawn here, so that half of the first clips appear on
either side. Clips repeat until the participant answers.
"""

import json
from typing import Any

from minihuman.activities.clip_requests import ClipRequest
from minihuman.activities.episode_clips import ClipOffered, EpisodeClip, EpisodeFilm
from minihuman.activities.preferences.events import (
    NothingToCompare,
    PairAnswer,
    PairSeen,
    Preferred,
    Side,
    StretchShown,
)
from minihuman.activities.preferences.plan import PreferencesPlan
from minihuman.activities.preferences.screens import PairScreen
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.activity import Activity, ActivityKind, ActivityRequest, PartEnding
from minihuman.experiment.machine.events import ActivityEvent, KeyVerdict, Noted, PauseReason
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown
from minihuman.experiment.machine.running_episode import NS_PER_MS, catch_world_errors
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.random_streams import draw_permutation


class PreferencesActivity(Activity):
    """An activity in which the participant compares one pair of clips after another."""

    def begin(self) -> None:
        """Draw the sides of all pairs' first clips, half of them on the right, and wait for the first pair."""
        self._plan: PreferencesPlan = self.part.plan
        self._pair = 0
        self._cached_screen: tuple[object, Screen] | None = None
        plan = self.context.plan
        purpose = f"pair-sides-{self.part.name}-session-{plan.session}"
        order = draw_permutation(self._plan.pairs, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        self._first_is_right = [position % 2 == 1 for position in order]  # a random half of the pairs
        self._await_pair()

    def _await_pair(self) -> None:
        """Wait for the next pair, or end the part if all pairs have been answered."""
        self.phase = Phase.PREPARING
        self._offered: list[EpisodeClip] = []
        self._films: dict[Side, EpisodeFilm] = {}
        self._step = self._replays = self._shown_ns = 0
        self._seen_whole = False
        self._until_ns: int | None = None  # the present pictures are seen until then
        if self._pair == self._plan.pairs:
            self.ended = PartEnding()
            return
        self.context.emit(Noted(self.context.now_ns, "phase", self.phase))

    @property
    def request(self) -> ActivityRequest | None:  # type: ignore[override]
        """Return the request for the next clip; None if none is due."""
        if self.ended or self.phase is not Phase.PREPARING:
            return None
        first = self._offered[0] if self._offered else None
        plan = self._plan
        return ClipRequest(
            part=self.number,
            source=plan.source,
            pair=self._pair,
            place=len(self._offered),
            steps=plan.steps,
            again=first,
            pairing=plan.pairing,
            wait_s=plan.wait_s,
        )

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that caused an event: an offered clip or a shown picture; None for other events."""
        match event:
            case PairSeen():
                return ScreenShown(event.t_ns, event.submit_ns, event.flip_ns)
            case StretchShown():
                return ClipOffered(event.t_ns, event.stretch)
            case NothingToCompare():
                return ClipOffered(event.t_ns, None)
        return None

    def receive(self, happened: Input) -> None:
        """Process everything that was due before an input, and then handle the input."""
        self._let_time_pass()
        match happened:
            case ClipOffered() if self.request is not None:
                self._assign_clip(happened.stretch)
            case KeyDown():
                self._press_key(happened)
            case ScreenShown() if self.phase is Phase.COMPARING:
                self.context.emit(
                    PairSeen(
                        t_ns=happened.t_ns,
                        part=self.number,
                        pair=self._pair,
                        step=min(self._step, self.length - 1),
                        submit_ns=happened.submit_ns,
                        flip_ns=happened.flip_ns,
                    )
                )
                self._shown_ns = self._shown_ns or happened.flip_ns
                if self._until_ns is None:
                    self._until_ns = happened.flip_ns + round(self._plan.step_ms * NS_PER_MS)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the time at which the next pictures are due; None while the present ones are not on the display."""
        return self._until_ns

    def suspend(self, reason: PauseReason) -> None:
        """Pause the clips until their pictures are shown again."""
        self._until_ns = None

    # Pairs

    def _assign_clip(self, clip: EpisodeClip | None) -> None:
        """Assign an offered clip to the next side and log it; end the part if there is no clip."""
        now_ns = self.context.now_ns
        if clip is None:
            self.context.emit(NothingToCompare(now_ns, self.number, self._pair))
            self.ended = PartEnding("failed")
            return
        side = self._find_next_side()
        film = self._make_film(clip)
        self._films[side] = film
        self._offered.append(clip)
        self.context.emit(
            StretchShown(
                t_ns=now_ns,
                part=self.number,
                pair=self._pair,
                side=side,
                episode=clip.episode,
                attempt=clip.attempt,
                first=clip.first,
                world=clip.world,
                options=clip.options,
                seed=clip.seed,
                actions=clip.actions,
                first_hash=film.first_hash,
                last_hash=film.last_hash,
            )
        )
        if len(self._offered) == 2:
            self.phase = Phase.COMPARING
            self.context.emit(Noted(now_ns, "phase", self.phase))

    def _find_next_side(self) -> Side:
        """Return the side of the next clip, by the order that was drawn for the pairs."""
        is_on_right = self._first_is_right[self._pair]
        if self._offered:  # the second clip takes the opposite side
            is_on_right = not is_on_right
        return "right" if is_on_right else "left"

    def _make_film(self, clip: EpisodeClip) -> EpisodeFilm:
        """Make the film of a clip's pictures, in a world with the clip's options."""
        with catch_world_errors():
            options: dict[str, Any] = json.loads(clip.options)
        plan = self._plan
        return EpisodeFilm(
            self.context.world(clip.world, options),
            clip.seed,
            clip.actions,
            view=plan.view,
            palette=plan.palette,
            picture_px=self.context.picture_px,
            first=clip.first,
        )

    @property
    def pair(self) -> tuple[EpisodeClip, EpisodeClip] | None:
        """Return the left and the right clip, for simulated participants; None if no pair is shown."""
        if self.phase is not Phase.COMPARING:
            return None
        first, second = self._offered
        if self._first_is_right[self._pair]:
            return (second, first)
        return (first, second)

    @property
    def pair_id(self) -> tuple[int, int]:
        """Return the part's index in the plan, and the index of the pair within the part."""
        return self.number, self._pair

    @property
    def length(self) -> int:
        """Return the number of pictures of the longer clip."""
        return max(map(len, self._films.values()))

    def _let_time_pass(self) -> None:
        """Advance to the next pictures when they are due; at the end the last pictures stay for one more period."""
        if self._until_ns is None or self.context.now_ns < self._until_ns:
            return
        self._until_ns = None
        self._step += 1
        if self._step > self.length:
            self._step = 0
            self._seen_whole = True

    def _press_key(self, press: KeyDown) -> None:
        """Log a key press, and replay the pair or record the answer; an answer counts once the pair was seen whole."""
        plan = self._plan
        emit_key = self.context.emit_key
        answers: dict[str, PairAnswer] = {
            plan.left: "left",
            plan.right: "right",
            plan.equal: "equal",
            plan.cannot_tell: "cannot_tell",
        }
        early_verdict: KeyVerdict = "not_playing" if press.key in answers else "unmapped"
        if press.repeat:
            emit_key(press, "repeat", self.phase)
        elif self.phase is not Phase.COMPARING:
            emit_key(press, early_verdict, self.phase)
        elif press.key == plan.again:
            emit_key(press, "accepted", self.phase)
            self._step = 0
            self._until_ns = None
            self._replays += 1
        elif press.key in answers and (self._seen_whole or self._step >= self.length):
            emit_key(press, "accepted", self.phase)
            self.context.emit(
                Preferred(
                    t_ns=self.context.now_ns,
                    part=self.number,
                    pair=self._pair,
                    answer=answers[press.key],
                    shown_ns=self._shown_ns,
                    replays=self._replays,
                    pressed_ns=press.t_ns,
                )
            )
            self._pair += 1
            self._await_pair()
        else:  # an answer before both clips were seen to their ends, or a key without a meaning
            emit_key(press, early_verdict, self.phase)

    # What is seen

    def screen(self) -> Screen:
        """Build the screen of both clips at the same step, or the waiting screen."""
        if self.phase is not Phase.COMPARING:
            return screen_texts.build_wait_screen(self.context.words)
        state = (self._pair, self._step, self._replays)
        if self._cached_screen is None or self._cached_screen[0] != state:
            self._cached_screen = (state, self._screen())
        return self._cached_screen[1]

    def _screen(self) -> PairScreen:
        """Build the screen of both clips side by side, with the keys that answer and replay the pair."""
        words = self.context.words
        plan = self._plan
        fields = ("left", "right", "equal", "cannot_tell", "again")
        labels = words.labels(tuple(getattr(plan, field) for field in fields))
        key_labels = {field: label for field, (_, label, _) in zip(fields, labels, strict=True)}
        return PairScreen(
            lefts=self._films["left"],
            rights=self._films["right"],
            step=self._step,
            title=words["pair.title"],
            prompt=words.fill("pair.prompt", **key_labels),
            progress=words.fill("pair.progress", number=self._pair + 1, count=plan.pairs),
            period_ns=round(plan.step_ms * NS_PER_MS),
            replay_key=plan.again,
            pair=(self.number, self._pair),
            locale=words.locale,
        )


PREFERENCES = ActivityKind(
    "preferences",
    PreferencesPlan,
    PreferencesActivity,
    messages="minihuman.activities.preferences.rows:PREFERENCE_ROWS",
    tables="minihuman.activities.preferences.tables:PREFERENCE_TABLES",
    report="minihuman.activities.preferences.report:build_section",
    screens=(PairScreen,),
    block_field="source",
    simulator="minihuman.activities.preferences.simulation:PreferencesSimulator",
)
