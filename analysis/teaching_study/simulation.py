"""A simulated teaching session: a policy plays, a simulated teacher watches, the record becomes lessons; and the
policy's evaluation.

The same rules as a session's takeover, without session machine, windows or log. Evaluation plays held-out episodes
side by side, so that the policy decides for all of them at once.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
import torch

from minihuman.learn.behaviour_cloning import Evaluation, held_out_seed
from minihuman.learn.policy.network import Policy, make_forward
from minihuman.learn.policy.observation import EpisodeEncoder, Observation, ObservationEncoder, ViewMode
from minihuman.learn.teaching.dataset import NO_QUERY, Dataset, Lesson
from minihuman.simulation.supervisor import Supervisor
from minihuman.worlds.adapters.world import World


def evaluate_taught_policy(policy: Policy, dataset: Dataset, *, episodes: int, seed: int) -> Evaluation:
    """Play the world of a dataset; actions are drawn from the policy's probabilities.

    Every policy meets the same episodes, those of ``learn.agent.evaluate``, with the same draws.
    """
    generator = torch.Generator().manual_seed(seed)
    envs: list[Any] = [
        gymnasium.make(dataset.world, disable_env_checker=True, **dataset.options) for _ in range(episodes)
    ]
    encoders = [dataset.eyesight.episode_encoder() for _ in envs]
    raws = [env.reset(seed=held_out_seed(seed, number))[0] for number, env in enumerate(envs)]
    playing = list(range(episodes))
    returns, lengths, successes = np.zeros(episodes), np.zeros(episodes), 0
    for step in range(1, dataset.most_steps + 1):
        seen = [encoders[place].encode(envs[place].unwrapped, raws[place]) for place in playing]
        batch = {name: torch.as_tensor(np.stack([each[name] for each in seen])) for name in seen[0]}
        with torch.no_grad():
            chances = policy.log_probabilities(batch).exp()
        actions = torch.multinomial(chances, 1, generator=generator)[:, 0].tolist()
        going = []
        for place, action in zip(playing, actions, strict=True):
            raws[place], reward, terminated, truncated, _ = envs[place].step(action)
            returns[place] += reward
            lengths[place] = step
            successes += terminated and reward > 0
            if not (terminated or truncated):
                going.append(place)
        playing = going
        if not playing:
            break
    return Evaluation(episodes, successes, float(returns.mean()), float(lengths.mean()))


STEERING_STEP_MS = 450.0  # that a person takes for a step of their own
AGENT_STEP_MS = 600.0  # that the agent takes for a step, so that it can be watched
REPLAY_STEP_MS = 200.0  # that a step takes when an episode is watched again
BETWEEN_EPISODES_MS = 2000.0


@dataclass(slots=True)
class TeachingSimulation:
    """One world, one person, one policy after the other; the person's time goes on from episode to episode."""

    world: World
    eyesight: ObservationEncoder
    most_steps: int
    rng: np.random.Generator
    name: str = "sub-01_ses-01"
    t_ms: float = 0.0  # of the person's time so far
    episodes: int = 0
    reached: bool = False  # whether the last step was a success
    encoder: EpisodeEncoder = field(init=False)
    _steps: list["_Step"] = field(default_factory=list)

    def watch(self, policy: Policy | None, seed: int, supervisor: Supervisor | None) -> Lesson:
        """One episode: the policy plays, the supervisor takes over and hands back.

        Without a policy the supervisor demonstrates; without a supervisor the policy is left alone.
        """
        assert policy is not None or supervisor is not None, "somebody has to play"
        think = None if policy is None else _chooser(policy, self.rng)
        self.begin(seed)
        path: list[str] = []
        if supervisor is not None:
            supervisor.begin(self.world)
            path = supervisor.plan(self.world)
        steering = think is None
        while True:
            seen = self.encoder.encode(self.world.unwrapped, self.world.observation)
            wanted, probabilities = (NO_QUERY, None) if think is None else think(seen)
            if not steering and supervisor is not None and supervisor.takes_over(self.t_ms):
                steering = True
            if steering and not path:
                break  # it would not know what to do either
            action = self.world.action_names.index(path[0]) if steering else wanted
            ended = self.step(seen, action, steering, wanted, probabilities)
            if ended:
                break
            if supervisor is None:
                continue
            path = supervisor.plan(self.world)
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
        path = supervisor.plan(self.world)
        for action in shown.actions[:since]:
            self.encoder.encode(self.world.unwrapped, self.world.observation)
            self.world.step(int(action))
            path = supervisor.plan(self.world)
        ended = False
        while path and not ended and since + len(self._steps) < self.most_steps:
            seen = self.encoder.encode(self.world.unwrapped, self.world.observation)
            ended = self.step(seen, self.world.action_names.index(path[0]), True, NO_QUERY, None)
            path = [] if ended else supervisor.plan(self.world)
        return self.lesson(shown.seed, (shown.name, since)) if self._steps else None

    def _stopped_at(self, shown: Lesson, supervisor: Supervisor) -> tuple[int, int]:
        """The step at which a supervisor would stop a replay, or its length; and the one from which it went wrong."""
        self.world.reset(shown.seed)
        supervisor.begin(self.world)
        supervisor.plan(self.world)
        since = 0
        for step, action in enumerate(shown.actions):
            if supervisor.exceeds_patience:
                return step, since
            self.world.step(int(action))
            supervisor.plan(self.world)
            since = step + 1 if supervisor.excess_steps == 0 else since
        return len(shown.actions), since

    def begin(self, seed: int) -> None:
        """Reset the world for the next episode."""
        self.world.reset(seed)
        self.encoder = self.eyesight.episode_encoder()
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


def begin_teaching(
    world_id: str,
    options: dict[str, Any],
    *,
    actions: int,
    most_steps: int,
    rng: np.random.Generator,
    sight: ViewMode = "view",
) -> tuple[Dataset, TeachingSimulation]:
    """A dataset with nothing in it yet, of the world's first ``actions`` actions, and the session that fills it."""
    world, eyesight = World(world_id, options), ObservationEncoder(missions=False, sight=sight)
    world.reset(0)
    dataset = Dataset(
        world_id, options, world.action_names[:actions], most_steps, eyesight, eyesight.space(world.unwrapped)
    )
    return dataset, TeachingSimulation(world, eyesight, most_steps, rng)


@dataclass(frozen=True, slots=True)
class _Step:
    seen: Observation
    action: int
    steering: bool
    wanted: int
    probabilities: np.ndarray | None
    shown_ns: int
    reward: float


ActionChooser = Callable[[Observation], tuple[int, np.ndarray]]


def _chooser(policy: Policy, rng: np.random.Generator) -> ActionChooser:
    """Draws actions from a policy's probabilities."""
    think = make_forward(policy)

    def choose(seen: Observation) -> tuple[int, np.ndarray]:
        probabilities = torch.softmax(think(seen)[0].double(), 0).numpy()
        return int(rng.choice(len(probabilities), p=probabilities / probabilities.sum())), probabilities

    return choose
