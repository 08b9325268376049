"""Rating: the agent plays, and two keys say good and bad. Credit is nobody's business here.

A press counts also while the last picture is held: people answer what they saw, some 0.6 s after it came. So a block
that is rated wants a longer ``hold_ms`` than others.
"""

from dataclasses import replace

import numpy as np

from minihuman.study.activities.agent_events import Advice, Rated, Who
from minihuman.study.activities.agent_plan import AgentPlayPlan
from minihuman.study.activities.agent_play import AgentPlaying
from minihuman.study.activities.port import Kind
from minihuman.study.inputs import Input, KeyDown, Shown
from minihuman.study.phases import Phase
from minihuman.study.play import Play
from minihuman.study.screens import Mark, PlayScreen

FLASH_NS = 150_000_000  # how long a press is seen
APART_NS = 100_000_000  # a held key counts once in so long


class Rating(AgentPlaying):
    """The agent steers always; nobody else can. Without a policy any action is as likely as another."""

    alone = True

    def __init__(self, *arguments: object) -> None:
        super().__init__(*arguments)  # type: ignore[arg-type]
        self._flash = 0.0  # the value of the press that is seen
        self._flash_until_ns: int | None = None
        self._last_ns: int | None = None  # of the last press that counted

    def receive(self, happened: Input) -> None:
        """Take an input."""
        self._end_flash()
        held = self.phase in (Phase.PLAYING, Phase.HOLD) and self._current.started
        if held and isinstance(happened, KeyDown) and happened.key in self._values:
            self._let_time_pass()
            self._rate(happened)
        else:
            super().receive(happened)

    @property
    def _values(self) -> dict[str, float]:
        return {self.agent.good: 1.0, self.agent.bad: -1.0}

    def _rate(self, press: KeyDown) -> None:
        if press.repeat and self._last_ns is not None and press.t_ns < self._last_ns + APART_NS:
            self.stage.say_key(press, "repeat", self.phase)
            return
        now_ns, play, value = self.stage.now_ns, self._current, self._values[press.key]
        self.stage.say_key(press, "accepted", self.phase)
        self.stage.say(Rated(now_ns, play.plan.episode, play.steps, value, press.t_ns))
        self._last_ns = press.t_ns
        self._flash, self._flash_until_ns = value, now_ns + FLASH_NS

    def _key_in_play(self, press: KeyDown) -> None:
        """The keys of actions do nothing: only the agent acts."""
        self.stage.say_key(press, "repeat" if press.repeat else "unmapped", self.phase)

    @property
    def _first_policy(self) -> str:
        return self.agent.policy or "random"  # somebody has to act before anything can be said of it

    def _shown(self, shown: Shown) -> None:
        super()._shown(shown)
        if self.playing and not self.policy and self.advised is None:
            playable, count = self._playable, len(self._current.world.action_names)
            share = float(np.float32(1 / len(playable)))
            chances = tuple(share if action in playable else 0.0 for action in range(count))
            self._take_advice(Advice(self.stage.now_ns, self._current.steps, chances))

    def _end_flash(self) -> None:
        if self._flash_until_ns is not None and self.stage.now_ns >= self._flash_until_ns:
            self._flash, self._flash_until_ns = 0.0, None

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """The end of a flash, beside what every agent waits for."""
        due = (super().next_tick_ns, self._flash_until_ns)
        return min((t for t in due if t is not None), default=None)

    @property
    def held(self) -> Play | None:
        """The episode whose last picture is held, for players who rate it; None in every other phase."""
        return self._current if self.phase is Phase.HOLD else None

    @property
    def rating_keys(self) -> tuple[str, str]:
        """The keys that say good and bad."""
        return self.agent.good, self.agent.bad

    @property
    def _look(self) -> object:
        return self.who, self._flash

    def _play_screen(self) -> PlayScreen:
        flash: Mark = "" if not self._flash else "good" if self._flash > 0 else "bad"
        return replace(super()._play_screen(), flash=flash)

    def said_of(self, who: Who) -> str:
        """What is said below the picture: the keys."""
        words = self.stage.words
        good, bad = (cap for _, cap, _ in words.labels(self.rating_keys))
        return words.fill("rating.prompt", good=good, bad=bad)


RATING = Kind("rating", AgentPlayPlan, Rating, messages="minihuman.log.agent:RATING")
