"""A block that an agent plays, a step a period, while a person looks on. What the person may do is a kind's own.

The policy is not here: what it makes of a state comes as an input, and the action is drawn here, so that a log holds
everything the agent did and a session played again draws the same.
"""

from dataclasses import replace

import numpy as np

from minihuman.study.activities.agent_events import (
    Advice,
    Advised,
    ControlChanged,
    ControlReason,
    LearnerAsked,
    NewPolicy,
    PolicyGiven,
    WantsAdvice,
    WantsPolicy,
    Who,
)
from minihuman.study.activities.agent_plan import AgentPlan, AgentPlayPlan
from minihuman.study.activities.play import Playing
from minihuman.study.activities.play_timer import NS_PER_MS
from minihuman.study.activities.port import Want
from minihuman.study.chance import words
from minihuman.study.events import KindEvent, PauseReason
from minihuman.study.inputs import ForPart, Input, Shown
from minihuman.study.phases import Cause, Phase
from minihuman.study.plan import Part
from minihuman.study.screens import PlayScreen
from minihuman.study.stage import Stage


class AgentPlaying(Playing):
    """Plays a block's episodes by a policy's advice."""

    alone = False  # whether the agent steers even where it has no policy, since nobody else can
    takes_over = False  # whether a key that has an action takes over from it

    def __init__(self, number: int, part: Part, stage: Stage) -> None:
        super().__init__(number, part, stage)
        self.plan: AgentPlayPlan = part.plan
        self.who: Who = "agent"  # steers
        self.policy = ""  # in force
        self.advised: Advised | None = None  # of the present state
        self._given = False  # the first policy, or that there is none
        self._next_policy = ""
        self._learning = False
        self._asked_at = 0  # the first episode that the learner cannot know of
        self._due_ns: int | None = None  # the agent's next step; None until its picture has been seen

    @property
    def agent(self) -> AgentPlan:
        """What the protocol says of the agent."""
        return self.plan.agent

    @property
    def hand_back_key(self) -> str:
        """The key that gives the agent control back; "" where nobody can take it."""
        return ""

    @property
    def rating_keys(self) -> tuple[str, str]:
        """The keys that say good and bad; "" where no rating is asked for."""
        return "", ""

    # From outside

    @property
    def wants(self) -> Want | None:  # type: ignore[override]
        """A policy between episodes, its advice in each state."""
        if not self.playing:
            if self._given and not self._learning:
                return None
            part, agent, asked = self.part.name, self.agent, self._asked_at
            return WantsPolicy(self.number, part, agent, self._learning, asked, self._next_policy or self._first_policy)
        seen = self.advised is not None and self.advised.step == self._current.steps
        return None if seen or not self.policy else WantsAdvice(self.policy, self._current.steps)

    def receive(self, happened: Input) -> None:
        """Take an input."""
        match happened:
            case NewPolicy():
                self._take_policy(happened)
            case Advice() if self.playing:
                self._take_advice(happened)
            case ForPart():
                pass
            case _:
                super().receive(happened)

    @staticmethod
    def input_of(event: KindEvent) -> Input | None:
        """The policy and the advice that came from outside."""
        match event:
            case PolicyGiven():
                return NewPolicy(event.t_ns, event.policy, event.failure)
            case Advised():
                return Advice(event.t_ns, event.step, event.probabilities)
        return None

    def _take_policy(self, new: NewPolicy) -> None:
        if not new.failure:
            self._next_policy = new.policy
        if self.playing:  # the agent that plays has failed
            self.policy = ""
        else:
            self._given, self._learning = True, False
        now_ns, episode = self.stage.now_ns, self.stage.next_episode
        self.stage.say(PolicyGiven(now_ns, self.number, episode, self._next_policy, new.failure))
        if self.phase is Phase.LEARNING:
            self._move(Cause.DONE)
        elif self.playing and self.who == "agent" and not self.alone:
            self._steer("person", "no_policy")

    def _take_advice(self, advice: Advice) -> None:
        play, now_ns = self._current, self.stage.now_ns
        if advice.step != play.steps:
            return  # of a state that is gone
        action = self._choose(advice)
        if action is None:
            failure = "the policy gives no chance to any action that has a key"
            self._take_policy(NewPolicy(now_ns, self._next_policy, failure))
            return
        self.advised = Advised(now_ns, play.plan.episode, play.steps, action, advice.probabilities)
        self.stage.say(self.advised)

    def _choose(self, advice: Advice) -> int | None:
        """One of the actions that have a key, by the policy's probabilities; None where it gives them no chance."""
        if len(advice.probabilities) != len(self._current.world.action_names):
            return None
        play, playable = self._current, self._playable
        chances = np.array([advice.probabilities[action] for action in playable], np.float64)
        if not np.isfinite(chances).all() or (chances < 0).any() or not chances.sum() > 0:
            return None
        if self.agent.acts == "likeliest":
            return playable[int(chances.argmax())]
        plan, session = self.stage.plan, self.stage.plan.session
        purpose = f"advice-session-{session}-episode-{play.plan.episode}-step-{advice.step}"
        word = int(words(1, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)[0])
        sums = np.cumsum(chances)
        place = int(np.searchsorted(sums, (word >> 11) / 2**53 * sums[-1], side="right"))
        return playable[min(place, len(playable) - 1)]

    @property
    def _playable(self) -> list[int]:
        """The world's actions that have a key."""
        play = self._current
        return sorted({a for key in play.plan.key_map.keys if (a := play.action_of(key)) is not None})

    @property
    def _first_policy(self) -> str:
        return self.agent.policy

    # Time

    @property
    def real_time(self) -> bool:  # type: ignore[override]
        """Whether the agent makes steps now."""
        return self.playing and (self.who == "agent" or self._current.real_time)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """The agent's next step, beside what every block waits for."""
        others = super().next_tick_ns
        mine = self._due_ns if self._agent_can_step else None
        return min((t for t in (others, mine) if t is not None), default=None)

    @property
    def _agent_can_step(self) -> bool:
        return self.playing and self.who == "agent" and self.advised is not None

    def _let_time_pass(self) -> None:
        super()._let_time_pass()
        if self._agent_can_step and self._due_ns is not None and self.stage.now_ns >= self._due_ns:
            assert self.advised is not None
            now_ns, action = self.stage.now_ns, self.advised.action
            self._step(action, key="", key_t_ns=now_ns)

    def _step(self, action: int, *, key: str, key_t_ns: int) -> None:
        stepped = self._current.step(self.stage.now_ns, action, key=key, key_t_ns=key_t_ns)
        self._due_ns = self.advised = None
        self._stepped(stepped)

    def _shown(self, shown: Shown) -> None:
        super()._shown(shown)
        if self.playing and self._due_ns is None and (shown.step is None or shown.step >= self._current.steps):
            self._due_ns = shown.flip_ns + self.period_ns

    def suspend(self, reason: PauseReason) -> None:
        """Stop the agent's clock too; the next picture shown starts it anew."""
        super().suspend(reason)
        self._due_ns = None

    # Episodes

    def _episode_started(self) -> None:
        self.policy = self._next_policy
        self._due_ns = self.advised = None
        self._steer("agent" if self.policy or self.alone else "person", "start" if self.policy else "no_policy")

    def _steer(self, who: Who, reason: ControlReason, pressed_ns: int | None = None) -> None:
        play, now_ns = self._current, self.stage.now_ns
        self.who, self._due_ns = who, None
        pressed_ns = now_ns if pressed_ns is None else pressed_ns
        self.stage.say(ControlChanged(now_ns, play.plan.episode, play.steps, who, reason, pressed_ns))

    def _between_episodes(self) -> None:
        """Ask the learner, where it is its turn."""
        agent, played = self.agent, self.stage.next_episode - self.plan.first
        if agent.learner and not self._learning and self.another_episode and played % agent.update_every == 0:
            self._learning, self._asked_at = True, self.stage.next_episode
            self.stage.say(LearnerAsked(self.stage.now_ns, self.number, self.stage.next_episode))

    @property
    def learning_s(self) -> float:  # type: ignore[override]
        """How long the next episode waits for the learner."""
        return self.agent.wait_s if self._learning else 0.0

    # What is seen

    @property
    def period_ns(self) -> int:
        """From the picture of one of the agent's steps to the next step."""
        return round(self.agent.step_ms * NS_PER_MS)

    def said_of(self, who: Who) -> str:
        """What is said below the picture while somebody steers."""
        return self.stage.words[f"steers.{who}"]

    @property
    def _look(self) -> object:
        return self.who

    def _play_screen(self) -> PlayScreen:
        return replace(super()._play_screen(), steers=self.who, steers_said=self.said_of(self.who))
