"""Preferences: two stretches of episodes side by side, made again from seed and actions; which one is better?

Which stretches come is told from outside; which one is on the left is drawn here, so that each side has half of the
first ones. They are seen as often as the person likes, step by step, from the first picture again after the last.
"""

import json
from typing import Any

import msgspec

from minihuman.study import texts
from minihuman.study.activities.film import Film
from minihuman.study.activities.pair_events import (
    NothingToCompare,
    Offered,
    Pairing,
    PairSeen,
    Preferred,
    Side,
    Stretch,
    StretchShown,
    Verdict,
    WantsStretch,
)
from minihuman.study.activities.port import Activity, Ended, Kind, Want
from minihuman.study.chance import permutation
from minihuman.study.events import KindEvent, Noted, PauseReason
from minihuman.study.inputs import Input, KeyDown, Shown
from minihuman.study.phases import Phase
from minihuman.study.play import world_calls
from minihuman.study.screens import PairScreen, Screen
from minihuman.worlds.contract import Palette, View

NS_PER_MS = 1_000_000


class PreferencesPlan(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """``plan`` of an activity of kind "preferences"."""

    source: str  # the block of this session whose episodes are compared
    pairs: int = 20
    steps: int = 12  # of a stretch
    step_ms: float = 200.0  # each picture is seen so long
    pairing: Pairing = "random"
    wait_s: float = 15.0  # for a pair that is disagreed on; then any pair comes
    left: str = "f"
    right: str = "j"
    equal: str = "b"
    cannot_tell: str = "n"
    again: str = "r"
    view: View = "partial"
    palette: Palette = "classic"


class Preferences(Activity):
    """Asks for pair after pair."""

    def begin(self) -> None:
        """Wait for the first pair."""
        self._plan: PreferencesPlan = self.part.plan
        self._pair = 0
        self._drawn: tuple[object, Screen] | None = None
        plan, session = self.stage.plan, self.stage.plan.session
        purpose = f"pair-sides-{self.part.name}-session-{session}"
        order = permutation(self._plan.pairs, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        self._first_is_right = [place % 2 == 1 for place in order]
        self._wait()

    def _wait(self) -> None:
        self.phase = Phase.PREPARING
        self._offered: list[Stretch] = []
        self._films: dict[Side, Film] = {}
        self._step = self._replays = self._shown_ns = 0
        self._seen_whole = False
        self._until_ns: int | None = None  # the present pictures are seen until then
        if self._pair == self._plan.pairs:
            self.ended = Ended()
            return
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))

    @property
    def wants(self) -> Want | None:  # type: ignore[override]
        """The next stretch."""
        if self.ended or self.phase is not Phase.PREPARING:
            return None
        first = self._offered[0] if self._offered else None
        plan, place = self._plan, len(self._offered)
        drawn = plan.pairing, plan.wait_s
        return WantsStretch(self.number, plan.source, self._pair, place, plan.steps, first, *drawn)

    @staticmethod
    def input_of(event: KindEvent) -> Input | None:
        """The stretches that came from outside, and when their pictures were seen."""
        match event:
            case PairSeen():
                return Shown(event.t_ns, event.submit_ns, event.flip_ns)
            case StretchShown():
                return Offered(event.t_ns, event.stretch)
            case NothingToCompare():
                return Offered(event.t_ns, None)
        return None

    def receive(self, happened: Input) -> None:
        """Take an input."""
        self._let_time_pass()
        match happened:
            case Offered() if self.wants is not None:
                self._offer(happened.stretch)
            case KeyDown():
                self._key(happened)
            case Shown() if self.phase is Phase.COMPARING:
                place = (self.number, self._pair, min(self._step, self.length - 1))
                self.stage.say(PairSeen(happened.t_ns, *place, happened.submit_ns, happened.flip_ns))
                self._shown_ns = self._shown_ns or happened.flip_ns
                if self._until_ns is None:
                    self._until_ns = happened.flip_ns + round(self._plan.step_ms * NS_PER_MS)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """The next pictures."""
        return self._until_ns

    def suspend(self, reason: PauseReason) -> None:
        """Let the pictures stand."""
        self._until_ns = None

    # Pairs

    def _offer(self, stretch: Stretch | None) -> None:
        now_ns = self.stage.now_ns
        if stretch is None:
            self.stage.say(NothingToCompare(now_ns, self.number, self._pair))
            self.ended = Ended("failed")
            return
        side: Side = "right" if self._first_is_right[self._pair] != bool(self._offered) else "left"
        film = self._films[side] = self._film_of(stretch)
        self._offered.append(stretch)
        fields = (stretch.world, stretch.options, stretch.seed, stretch.actions)
        place = (self._pair, side, stretch.episode, stretch.attempt, stretch.first)
        self.stage.say(StretchShown(now_ns, self.number, *place, *fields, film.first_hash, film.last_hash))
        if len(self._offered) == 2:
            self.phase = Phase.COMPARING
            self.stage.say(Noted(now_ns, "phase", self.phase))

    def _film_of(self, stretch: Stretch) -> Film:
        with world_calls():
            options: dict[str, Any] = json.loads(stretch.options)
        plan = self._plan
        return Film(
            self.stage.world(stretch.world, options),
            stretch.seed,
            stretch.actions,
            view=plan.view,
            palette=plan.palette,
            picture_px=self.stage.picture_px,
            first=stretch.first,
        )

    @property
    def pair(self) -> tuple[Stretch, Stretch] | None:
        """What is on the left and on the right, for whoever answers without looking; None where nothing is."""
        if self.phase is not Phase.COMPARING:
            return None
        first, second = self._offered
        return (second, first) if self._first_is_right[self._pair] else (first, second)

    @property
    def number_of_pair(self) -> tuple[int, int]:
        """The part, and the pair in it."""
        return self.number, self._pair

    @property
    def length(self) -> int:
        """How many pictures the longer stretch of the pair has."""
        return max(map(len, self._films.values()))

    def _let_time_pass(self) -> None:
        """Go on to the next picture; both stand for one more period at the end."""
        if self._until_ns is None or self.stage.now_ns < self._until_ns:
            return
        self._until_ns = None
        self._step += 1
        if self._step > self.length:
            self._step, self._seen_whole = 0, True

    def _key(self, press: KeyDown) -> None:
        plan, say_key = self._plan, self.stage.say_key
        answers: dict[str, Verdict] = {
            plan.left: "left",
            plan.right: "right",
            plan.equal: "equal",
            plan.cannot_tell: "cannot_tell",
        }
        if press.repeat:
            say_key(press, "repeat", self.phase)
        elif self.phase is not Phase.COMPARING:
            say_key(press, "not_playing" if press.key in answers else "unmapped", self.phase)
        elif press.key == plan.again:
            say_key(press, "accepted", self.phase)
            self._step, self._until_ns = 0, None
            self._replays += 1
        elif press.key in answers and (self._seen_whole or self._step >= self.length):
            say_key(press, "accepted", self.phase)
            answer = (answers[press.key], self._shown_ns, self._replays, press.t_ns)
            self.stage.say(Preferred(self.stage.now_ns, self.number, self._pair, *answer))
            self._pair += 1
            self._wait()
        else:  # both are to be seen to their ends first
            say_key(press, "not_playing" if press.key in answers else "unmapped", self.phase)

    # What is seen

    def screen(self) -> Screen:
        """Both stretches at the same step, or that they are being made."""
        if self.phase is not Phase.COMPARING:
            return texts.getting_ready(self.stage.words)
        now = (self._pair, self._step, self._replays)
        if self._drawn is None or self._drawn[0] != now:
            self._drawn = (now, self._screen())
        return self._drawn[1]

    def _screen(self) -> PairScreen:
        words, plan = self.stage.words, self._plan
        keys = ("left", "right", "equal", "cannot_tell", "again")
        caps = words.labels(tuple(getattr(plan, key) for key in keys))
        return PairScreen(
            lefts=self._films["left"],
            rights=self._films["right"],
            step=self._step,
            title=words["pair.title"],
            prompt=words.fill("pair.prompt", **{key: cap for key, (_, cap, _) in zip(keys, caps, strict=True)}),
            progress=words.fill("pair.progress", number=self._pair + 1, count=plan.pairs),
            period_ns=round(plan.step_ms * NS_PER_MS),
            again=plan.again,
            pair=(self.number, self._pair),
            script=words.script,
        )


PREFERENCES = Kind(
    "preferences",
    PreferencesPlan,
    Preferences,
    messages="minihuman.log.pairs:PREFERENCES",
    block_field="source",
    drawings="minihuman.windows.draw_pair:DRAWINGS",
)
