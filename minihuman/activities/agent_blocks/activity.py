"""Takeover and rating: blocks that an agent plays at a fixed pace while a person takes over or rates it.

The policy runs elsewhere: its action probabilities arrive as an input, and the action is drawn here. A log therefore
holds everything that the agent did, and a replay draws the same actions. Steps count from 0, which is the reset. A
rating also counts while the last image is held, because people rate what they saw about 0.6 s earlier: a rated block
needs a longer `final_frame_ms`. Assigning credit is left to the learner.
"""

from dataclasses import replace

import numpy as np

from minihuman.activities.agent_blocks.events import (
    Advised,
    ControlChanged,
    Controller,
    ControlReason,
    LearnerAsked,
    PolicyGiven,
)
from minihuman.activities.agent_blocks.plan import AgentPlan, AgentPlayPlan
from minihuman.activities.agent_blocks.requests import Advice, AdviceRequest, NewPolicy, PolicyRequest
from minihuman.activities.play.activity import PlayActivity
from minihuman.experiment.machine.activity import ActivityRequest, SessionContext, Steering, SteeringRules
from minihuman.experiment.machine.events import ActivityEvent, PauseReason
from minihuman.experiment.machine.inputs import ActivityInput, Input, ScreenShown
from minihuman.experiment.machine.running_episode import NS_PER_MS, RunningEpisode
from minihuman.experiment.machine.screens import PlayScreen
from minihuman.experiment.machine.transitions import Phase, TransitionCause
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.experiment.plan.session_plan import PlannedPart

AGENT_RULES = "2"  # the session's fact "agent_rules": since 2, an agent's failure is logged and ends a rated episode
FLASH_NS = 150_000_000  # how long a rating is seen
REPEAT_INTERVAL_NS = 100_000_000  # a rating key that is held down counts once per interval


class AgentPlayActivity(PlayActivity):
    """An activity in which an agent plays a block's episodes by a policy's action probabilities."""

    can_copy = False
    agent_plays = True
    acts_without_policy = False  # whether the agent acts before it has a policy, because the person cannot act
    takes_over = False  # whether a key that has an action takes over from it

    def __init__(self, number: int, part: PlannedPart, context: SessionContext) -> None:
        super().__init__(number, part, context)
        self.plan: AgentPlayPlan = part.plan
        self.controller: Controller = "agent"  # who is in control
        self.policy = ""  # the policy that plays the present episode; "" for none
        self.advised: Advised | None = None  # the latest advice; None before the present state has any
        self._has_first_policy = False  # whether the first policy was given, or failed
        self._failed = False  # whether there is no policy because a learner or an agent failed
        self._next_policy = ""
        self._learning = False
        self._asked_at = 0  # the first episode that the learner cannot know of
        self._due_ns: int | None = None  # the agent's next step; None until its picture has been seen

    @property
    def agent(self) -> AgentPlan:
        """Return the protocol's ``[blocks.agent]`` table."""
        return self.plan.agent

    @property
    def hand_back_key(self) -> str:
        """Return the key that returns control to the agent; "" where takeovers are not possible."""
        return ""

    @property
    def rating_keys(self) -> tuple[str, str]:
        """Return the two keys that rate a step as good and as bad; both are "" if steps are not rated."""
        return "", ""

    @property
    def rated_episode(self) -> RunningEpisode | None:
        """Return the finished episode that can still be rated; None in every other phase."""
        return None

    @property
    def _logs_agent_failures(self) -> bool:
        """Return whether an agent's failure is logged as ``agent_failed``, as the present agent rules demand."""
        return self.context.facts.get("agent_rules", "1") == AGENT_RULES

    # From outside

    @property
    def request(self) -> ActivityRequest | None:  # type: ignore[override]
        """Return the request for a policy, or for advice in the present state; None if neither is due."""
        if not self.playing:
            if self._has_first_policy and not self._learning:
                return None
            part = self.part.name
            agent = self.agent
            first_unknown = self._asked_at
            return PolicyRequest(
                self.number, part, agent, self._learning, first_unknown, self._next_policy or self._first_policy
            )
        is_advised = self.advised is not None and self.advised.step == self._current.steps
        if is_advised or not self.policy:
            return None
        return AdviceRequest(self.policy, self._current.steps)

    def receive(self, happened: Input) -> None:
        """Handle an input, including new policies and advice."""
        match happened:
            case NewPolicy():
                self._take_policy(happened)
            case Advice() if self.playing:
                self._take_advice(happened)
            case ActivityInput():
                pass
            case _:
                super().receive(happened)

    @staticmethod
    def input_of(event: ActivityEvent) -> Input | None:
        """Return the input that caused an event: a new policy or advice; None for other events."""
        match event:
            case PolicyGiven():
                return NewPolicy(event.t_ns, event.policy, event.failure)
            case Advised():
                return Advice(event.t_ns, event.step, event.probabilities)
        return None

    def _take_policy(self, received_policy: NewPolicy) -> None:
        """Accept and log a new policy, or the failure of a learner or agent.

        Then leave the screen that waits for a learner; or, if the playing agent failed, end the episode or give control
        to the person.
        """
        if not received_policy.failure:
            self._next_policy = received_policy.policy
        if self.playing:  # the agent that plays has failed
            self.policy = ""
        else:
            self._has_first_policy = True
            self._learning = False
            self._failed = bool(received_policy.failure) and not self._next_policy
        now_ns = self.context.now_ns
        episode = self.context.next_episode
        self.context.emit(PolicyGiven(now_ns, self.number, episode, self._next_policy, received_policy.failure))
        if self.phase is Phase.LEARNING:
            self._move(TransitionCause.DONE)
        elif self.playing and self.acts_without_policy and self._logs_agent_failures:
            self._episode_ended("agent_failed")
        elif self.playing and self.controller == "agent" and not self.acts_without_policy:
            self._steer("person", "agent_failed" if self._logs_agent_failures else "no_policy")

    def _take_advice(self, advice: Advice) -> None:
        """Choose the agent's next action by a policy's advice and log it; ignore advice on any but the present state.

        Advice without a usable probability counts as a failure of the policy.
        """
        play = self._current
        now_ns = self.context.now_ns
        if advice.step != play.steps:
            return
        action = self._draw_action(advice)
        if action is None:
            failure = "the policy gives no chance to any action that has a key"
            self._take_policy(NewPolicy(now_ns, self._next_policy, failure))
            return
        self.advised = Advised(now_ns, play.plan.episode, play.steps, action, advice.probabilities)
        self.context.emit(self.advised)

    def _draw_action(self, advice: Advice) -> int | None:
        """Return the number of an action that has a key: drawn by the policy's probabilities, or the likeliest.

        The protocol says which of the two; actions without a key do not count. None means that the probabilities are
        not usable: there is not one for each of the world's actions, or those of the actions with a key are not finite,
        negative, or all 0.
        """
        if len(advice.probabilities) != len(self._current.world.action_names):
            return None
        play = self._current
        playable = self._playable
        chances = np.array([advice.probabilities[action] for action in playable], np.float64)
        is_usable = np.isfinite(chances).all() and (chances >= 0).all() and chances.sum() > 0
        if not is_usable:
            return None
        if self.agent.acts == "likeliest":
            return playable[int(chances.argmax())]
        plan = self.context.plan
        purpose = f"advice-session-{plan.session}-episode-{play.plan.episode}-step-{advice.step}"
        (word,) = draw_words(1, seed=plan.study_seed, purpose=purpose, index=plan.participant.index)
        share = (int(word) >> 11) / 2**53  # the upper 53 bits, as many as a float has
        sums = np.cumsum(chances)
        index = int(np.searchsorted(sums, share * sums[-1], side="right"))
        return playable[min(index, len(playable) - 1)]  # by rounding, the index can be one too high

    @property
    def _playable(self) -> list[int]:
        """Return the numbers of the world's actions that have a key."""
        play = self._current
        actions = {play.action_of(key) for key in play.plan.key_map.keys}
        return sorted(action for action in actions if action is not None)

    @property
    def _first_policy(self) -> str:
        """Return the policy that plays first, as the protocol names it; "" if there is none yet."""
        return self.agent.policy

    # Time

    @property
    def real_time(self) -> bool:  # type: ignore[override]
        """Return whether steps happen by the clock now, made by the agent or by the world."""
        return self.playing and (self.controller == "agent" or self._current.real_time)

    @property
    def next_tick_ns(self) -> int | None:  # type: ignore[override]
        """Return the time in nanoseconds of the agent's next step or of the block's next tick, whichever is first.

        None means that neither is due.
        """
        block_due_ns = super().next_tick_ns
        agent_due_ns = self._due_ns if self._agent_can_step else None
        return min((t_ns for t_ns in (block_due_ns, agent_due_ns) if t_ns is not None), default=None)

    @property
    def _agent_can_step(self) -> bool:
        """Return whether the agent is in control and its next action is known."""
        return self.playing and self.controller == "agent" and self.advised is not None

    def _let_time_pass(self) -> None:
        """Process what is due by now in the block, and then the agent's next step if that is due."""
        super()._let_time_pass()
        if self._agent_can_step and self._due_ns is not None and self.context.now_ns >= self._due_ns:
            assert self.advised is not None
            now_ns = self.context.now_ns
            action = self.advised.action
            self._step(action, key="", key_t_ns=now_ns)

    def _step(self, action: int, *, key: str, key_t_ns: int) -> None:
        """Make a step of the running episode, log it, and discard the agent's planned action.

        Args:
            action: the number of the world's action.
            key: the key that the person pressed; "" for a step of the agent.
            key_t_ns: the session time of the key press, or of the agent's step.
        """
        stepped = self._current.step(self.context.now_ns, action, key=key, key_t_ns=key_t_ns)
        self._due_ns = None
        self.advised = None
        self._stepped(stepped)

    def _shown(self, screen_shown: ScreenShown) -> None:
        """Handle a picture that reached the display; the agent's next step is due one period after the latest one."""
        super()._shown(screen_shown)
        if not self.playing or self._due_ns is not None:
            return
        is_latest_picture = screen_shown.step is None or screen_shown.step >= self._current.steps
        if is_latest_picture:
            self._due_ns = screen_shown.flip_ns + self.period_ns

    def suspend(self, reason: PauseReason) -> None:
        """Stop the block's clocks and the agent's; the next picture shown restarts the agent's."""
        super().suspend(reason)
        self._due_ns = None

    # Episodes

    def _episode_started(self) -> None:
        """Begin to use the newest policy, and give control to the agent.

        Without a policy, the person gets control, unless the agent acts without a policy in this kind of block.
        """
        self.policy = self._next_policy
        self._due_ns = None
        self.advised = None
        if self.policy:
            self._steer("agent", "start")
        elif self.acts_without_policy:
            self._steer("agent", "no_policy")
        else:
            self._steer("person", "no_policy")

    def _steer(self, controller: Controller, reason: ControlReason, pressed_ns: int | None = None) -> None:
        """Give control to the agent or the person, and log it with its reason.

        ``pressed_ns`` is the session time of the key press that caused it; None if no key did.
        """
        play = self._current
        now_ns = self.context.now_ns
        self.controller = controller
        self._due_ns = None
        if pressed_ns is None:
            pressed_ns = now_ns
        self.context.emit(ControlChanged(now_ns, play.plan.episode, play.steps, controller, reason, pressed_ns))

    def _between_episodes(self) -> None:
        """Request a new policy from the learner after every ``update_every`` episodes, unless it is still learning."""
        agent = self.agent
        n_played = self.context.next_episode - self.plan.first
        is_due = n_played % agent.update_every == 0 and self.has_next_episode
        if agent.learner and is_due and not self._learning:
            self._learning = True
            self._asked_at = self.context.next_episode
            self.context.emit(LearnerAsked(self.context.now_ns, self.number, self.context.next_episode))

    @property
    def learning_s(self) -> float:  # type: ignore[override]
        """Return the longest time that the next episode waits for the learner, in seconds; 0 if none is learning."""
        if self._learning:
            return self.agent.wait_s
        return 0.0

    # What is seen

    @property
    def period_ns(self) -> int:
        """Return the time from the display of one of the agent's steps to its next step, in nanoseconds."""
        return round(self.agent.step_ms * NS_PER_MS)

    def describe_steering(self, play: RunningEpisode) -> Steering:
        """Return who controls a running episode, the agent's next action, and what the keys do meanwhile."""
        rules = SteeringRules(
            period_ns=self.period_ns,
            person_acts=self.takes_over,
            hand_back_key=self.hand_back_key,
            rating_keys=self.rating_keys,
            flash_ns=FLASH_NS,
            repeat_interval_ns=REPEAT_INTERVAL_NS,
            controller_texts={"agent": self.control_text("agent"), "person": self.control_text("person")},
        )
        action = None
        if self.advised is not None and self.advised.step == play.steps:
            action = self.advised.action
        return Steering(self.controller, action, self.limit_ns, rules)

    def control_text(self, controller: Controller) -> str:
        """Return the text below the picture that says who is in control."""
        return self.context.words[f"steers.{controller}"]

    @property
    def _look(self) -> object:
        """Return further state on which the screen depends: who is in control."""
        return self.controller

    def _play_screen(self) -> PlayScreen:
        """Build the screen of a running episode, with the text that says who is in control."""
        text = self.control_text(self.controller)
        return replace(super()._play_screen(), controller=self.controller, controller_text=text)
