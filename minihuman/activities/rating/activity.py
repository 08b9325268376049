"""Rating: an agent plays a block alone, and the person rates its behaviour as good or bad by key presses."""

from dataclasses import replace

import numpy as np

from minihuman.activities.agent_blocks.activity import FLASH_NS, REPEAT_INTERVAL_NS, AgentPlayActivity
from minihuman.activities.agent_blocks.events import Controller
from minihuman.activities.agent_blocks.plan import AgentPlayPlan
from minihuman.activities.agent_blocks.requests import Advice
from minihuman.activities.agent_blocks.rules import check_block
from minihuman.activities.rating.events import Rated
from minihuman.experiment.machine.activity import ActivityKind, SessionContext
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import OutcomeMark, PlayScreen
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import PlannedPart


class RatingActivity(AgentPlayActivity):
    """An activity in which the person rates an agent and only the agent acts.

    If the agent fails, its episode ends; where there is no policy yet, all actions are equally likely.
    """

    acts_without_policy = True

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        super().__init__(number, part, context)
        self._flash = 0.0  # the rating that is flashed on the screen; 0 for none
        self._flash_until_ns: int | None = None
        self._last_ns: int | None = None  # when the last press that counted was made

    def receive(self, happened: Input) -> None:
        """Handle an input, including rating keys."""
        self._end_flash()
        can_rate = self.phase in (Phase.PLAYING, Phase.HOLD) and self._current.started
        if can_rate and isinstance(happened, KeyDown) and happened.key in self._values:
            self._let_time_pass()
            self._rate(happened)
        else:
            super().receive(happened)

    @property
    def _values(self) -> dict[str, float]:
        """Return the ratings by their keys: 1 for the good key and -1 for the bad key."""
        return {self.agent.good: 1.0, self.agent.bad: -1.0}

    def _rate(self, press: KeyDown) -> None:
        """Log a rating and flash it on the screen; auto-repeats that come too soon are logged without effect."""
        if press.repeat and self._last_ns is not None:
            since_last_ns = press.t_ns - self._last_ns
            if since_last_ns < REPEAT_INTERVAL_NS:
                self.context.emit_key(press, "repeat", self.phase)
                return
        now_ns = self.context.now_ns
        play = self._current
        rating = self._values[press.key]
        self.context.emit_key(press, "accepted", self.phase)
        self.context.emit(Rated(now_ns, play.plan.episode, play.steps, rating, press.t_ns))
        self._last_ns = press.t_ns
        self._flash = rating
        self._flash_until_ns = now_ns + FLASH_NS

    def _key_in_play(self, press: KeyDown) -> None:
        """Log the key without any effect, since only the agent acts."""
        self.context.emit_key(press, "repeat" if press.repeat else "unmapped", self.phase)

    @property
    def _first_policy(self) -> str:
        """Return the name of the first policy; "random" without one, as an agent must act before it can be rated."""
        return self.agent.policy or "random"

    def _shown(self, screen_shown: ScreenShown) -> None:
        """Handle a picture that reached the display; without a policy, draw the agent's next action at random.

        If the agent has failed and the session records failures, the episode ends instead.
        """
        super()._shown(screen_shown)
        if not self.playing or self.policy or self.advised is not None:
            return
        if self._failed and self._logs_agent_failures:
            self._episode_ended("agent_failed")
        else:
            self._take_advice(Advice(self.context.now_ns, self._current.steps, self._compute_equal_chances()))

    def _compute_equal_chances(self) -> tuple[float, ...]:
        """Return equal probabilities of the actions that have keys, and 0 for the others, in the log's precision."""
        playable = self._playable
        chance = float(np.float32(1 / len(playable)))
        chances = [0.0] * len(self._current.world.action_names)
        for action in playable:
            chances[action] = chance
        return tuple(chances)

    def _end_flash(self) -> None:
        """Stop flashing the latest rating if its time is over."""
        if self._flash_until_ns is not None and self.context.now_ns >= self._flash_until_ns:
            self._flash = 0.0
            self._flash_until_ns = None

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the time of the next tick or of the end of a rating's flash, whichever is first; None if neither is.

        The time is in nanoseconds.
        """
        times_ns = (super().next_tick_ns, self._flash_until_ns)
        return min((t_ns for t_ns in times_ns if t_ns is not None), default=None)

    @property
    def rated_episode(self) -> RunningEpisode | None:
        """Return the finished episode whose last picture is still shown and can be rated; None in every other phase."""
        if self.phase is Phase.HOLD:
            return self._current
        return None

    @property
    def rating_keys(self) -> tuple[str, str]:
        """Return the two keys that rate a step: the key for good and the key for bad."""
        return self.agent.good, self.agent.bad

    @property
    def _look(self) -> object:
        """Return further state on which the screen depends: who acts, and the rating that is flashed."""
        return self.controller, self._flash

    def _play_screen(self) -> PlayScreen:
        return replace(super()._play_screen(), flash=_find_mark(self._flash))

    def control_text(self, controller: Controller) -> str:
        """Return the text below the picture, which names the rating keys; ``controller`` makes no difference."""
        words = self.context.words
        good_label, bad_label = (label for _, label, _ in words.labels(self.rating_keys))
        return words.fill("rating.prompt", good=good_label, bad=bad_label)


def _find_mark(rating: float) -> OutcomeMark:
    """Return the mark that flashes a rating: "good" above 0, "bad" below 0, and none for 0."""
    if not rating:
        return ""
    if rating > 0:
        return "good"
    return "bad"


RATING = ActivityKind(
    "rating",
    AgentPlayPlan,
    RatingActivity,
    messages="minihuman.activities.rating.rows:RATING_ROWS",
    tables="minihuman.activities.rating.tables:RATING_TABLES",
    check_block=check_block,
    report="minihuman.activities.agent_blocks.report:build_section",
    simulator="minihuman.activities.agent_blocks.simulation:AgentBlockSimulator",
)
