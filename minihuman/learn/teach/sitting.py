"""A simulated sitting: a policy plays, a simulated teacher watches, and what would be logged becomes lessons.

The same rules as a session's takeover, without its machine, windows or log: for finding out what learners are worth.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch

from minihuman.learn.agent.acting import thinker
from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Eyesight, Looker, Observation
from minihuman.learn.teach.dataset import NOBODY_ASKED, Lesson
from minihuman.players.supervisor import Supervisor
from minihuman.worlds.adapt.world import World

STEERING_STEP_MS = 450.0  # that a person takes for a step of their own
AGENT_STEP_MS = 600.0  # that the agent takes for a step, so that it can be watched
REPLAY_STEP_MS = 200.0  # that a step takes when an episode is watched again
BETWEEN_EPISODES_MS = 2000.0


@dataclass(slots=True)
class Sitting:
    """One world, one person, one policy after the other; the person's time goes on from episode to episode."""

    world: World
    eyesight: Eyesight
    most_steps: int
    rng: np.random.Generator
    name: str = "sub-01_ses-01"
    t_ms: float = 0.0  # of the person's time so far
    episodes: int = 0
    reached: bool = False  # whether the last step was a success
    looker: Looker = field(init=False)
    _steps: list["_Step"] = field(default_factory=list)

    def watch(self, policy: Policy | None, seed: int, supervisor: Supervisor | None) -> Lesson:
        """One episode: the policy plays, the supervisor takes over and hands back.

        Without a policy the supervisor demonstrates; without a supervisor the policy is left alone.
        """
        assert policy is not None or supervisor is not None, "somebody has to play"
        think = None if policy is None else _chooser(policy, self.rng)
        self.begin(seed)
        way: list[str] = []
        if supervisor is not None:
            supervisor.begin(self.world)
            way = supervisor.way(self.world)
        steering = think is None
        while True:
            seen = self.looker.see(self.world.unwrapped, self.world.observation)
            wanted, probabilities = (NOBODY_ASKED, None) if think is None else think(seen)
            if not steering and supervisor is not None and supervisor.takes_over(self.t_ms):
                steering = True
            if steering and not way:
                break  # it would not know what to do either
            action = self.world.action_names.index(way[0]) if steering else wanted
            ended = self.step(seen, action, steering, wanted, probabilities)
            if ended:
                break
            if supervisor is None:
                continue
            way = supervisor.way(self.world)
            if steering and think is not None and supervisor.hands_back():
                steering = False
        return self.lesson(seed)

    def correct(self, shown: Lesson, supervisor: Supervisor) -> Lesson | None:
        """The person watches an episode again, stops where the agent was worse, and shows it better to the end.

        Returns:
            What was shown from there; None where the agent was never that much worse.
        """
        stop, since = self._stopped_at(shown, supervisor)
        self.t_ms += REPLAY_STEP_MS * stop
        if stop == len(shown.actions):
            return None
        self.begin(shown.seed)
        supervisor.begin(self.world)
        way = supervisor.way(self.world)
        for action in shown.actions[:since]:
            self.looker.see(self.world.unwrapped, self.world.observation)
            self.world.step(int(action))
            way = supervisor.way(self.world)
        ended = False
        while way and not ended and since + len(self._steps) < self.most_steps:
            seen = self.looker.see(self.world.unwrapped, self.world.observation)
            ended = self.step(seen, self.world.action_names.index(way[0]), True, NOBODY_ASKED, None)
            way = [] if ended else supervisor.way(self.world)
        return self.lesson(shown.seed, (shown.name, since)) if self._steps else None

    def _stopped_at(self, shown: Lesson, supervisor: Supervisor) -> tuple[int, int]:
        """The step at which a supervisor would stop a replay, or its length; and the one from which it went wrong."""
        self.world.reset(shown.seed)
        supervisor.begin(self.world)
        supervisor.way(self.world)
        since = 0
        for step, action in enumerate(shown.actions):
            if supervisor.has_seen_enough:
                return step, since
            self.world.step(int(action))
            supervisor.way(self.world)
            since = step + 1 if supervisor.worse_steps == 0 else since
        return len(shown.actions), since

    def begin(self, seed: int) -> None:
        """Reset the world for the next episode."""
        self.world.reset(seed)
        self.looker = self.eyesight.looker()
        self.episodes += 1
        self.t_ms += BETWEEN_EPISODES_MS
        self._steps = []

    def step(
        self, seen: Observation, action: int, steering: bool, wanted: int, probabilities: np.ndarray | None
    ) -> bool:
        """Make a step; whether the episode is over."""
        shown_ns = int(self.t_ms * 1e6)
        self.t_ms += STEERING_STEP_MS if steering else AGENT_STEP_MS
        came = self.world.step(action)
        self._steps.append(_Step(seen, action, steering, wanted, probabilities, shown_ns, came.reward))
        self.reached = came.terminated and came.reward > 0
        return came.terminated or came.truncated or len(self._steps) >= self.most_steps

    def lesson(self, seed: int, corrects: tuple[str, int] | None = None) -> Lesson:
        """What was shown since the last reset."""
        steps = self._steps
        said = [step.probabilities for step in steps]
        return Lesson(
            name=f"{self.name}:{self.episodes}",
            participant=self.name.partition("_")[0],
            seed=seed,
            observations={part: np.stack([step.seen[part] for step in steps]) for part in steps[0].seen},
            actions=np.array([step.action for step in steps], np.int64),
            by_person=np.array([step.steering for step in steps]),
            policy_actions=np.array([step.wanted for step in steps], np.int64),
            shown_ns=np.array([step.shown_ns for step in steps], np.int64),
            rewards=np.array([step.reward for step in steps]),
            policy_probabilities=None if said[0] is None else np.array(said, np.float32),
            corrects=corrects,
        )


@dataclass(frozen=True, slots=True)
class _Step:
    seen: Observation
    action: int
    steering: bool
    wanted: int
    probabilities: np.ndarray | None
    shown_ns: int
    reward: float


Choose = Callable[[Observation], tuple[int, np.ndarray]]


def _chooser(policy: Policy, rng: np.random.Generator) -> Choose:
    """Draws actions from a policy's probabilities."""
    think = thinker(policy)

    def choose(seen: Observation) -> tuple[int, np.ndarray]:
        probabilities = torch.softmax(think(seen)[0].double(), 0).numpy()
        return int(rng.choice(len(probabilities), p=probabilities / probabilities.sum())), probabilities

    return choose
