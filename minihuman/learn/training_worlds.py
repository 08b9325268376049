"""The worlds of a training run: several are stepped together, and each episode is one level, a world and a seed.

A world of minihuman has a batch in compiled code. Different worlds, and worlds of other packages, are stepped one after
the other. The caller chooses the level of each episode, except in team worlds, which begin the next episode themselves.
"""

import abc
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.policy.action_distributions import clip_actions
from minihuman.learn.policy.observation import SPREAD, encode_mission
from minihuman.learn.training_settings import WorldChoice
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.team import TeamWorld


class TrainingLevel(NamedTuple):
    """The start of an episode: the number of a world among those that are trained in, and a reset seed."""

    world: int
    seed: int


class BatchStep(NamedTuple):
    """The rewards and the ends of one step of all worlds, each of shape (n,)."""

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]


class TrainingWorlds(abc.ABC):
    """Some worlds that are stepped together, each in a separate episode.

    Attributes:
        num_envs: the number of worlds.
        images: the present image of each world, uint8[n, height, width, channels]; vectors are float32[n, 1, 1,
            components].
        missions: each world's mission; "" if it has none.
        begins_by_itself: whether the step that ends an episode also begins the next one, so that the caller cannot
            choose its level.
    """

    num_envs: int
    images: NDArray[Any]
    missions: Sequence[str]
    begins_by_itself: bool = False

    @abc.abstractmethod
    def begin(self, numbers: Sequence[int], levels: Sequence[TrainingLevel]) -> None:
        """Begin an episode in some of the worlds.

        Args:
            numbers: the numbers of these worlds, from 0.
            levels: the level of each of these worlds, in the same order.
        """

    @abc.abstractmethod
    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Take one action in every world, int64[n] or float32[n, components].

        A world whose episode has ended must be begun before its next step.
        """

    def replay(self, levels: Sequence[TrainingLevel], actions: Sequence[Sequence[Any]]) -> None:
        """Begin each world's level and take its recorded actions; all worlds take their last action in the same step.

        Since all worlds are stepped together, a world with fewer actions than the longest episode first takes idle
        actions. Its level is begun again when its own actions follow, and when an idle action has ended an episode.

        Args:
            levels: the level of each world.
            actions: the actions of each world's episode so far, as numbers or as lists of components.
        """
        longest = max(map(len, actions))
        everywhere = range(self.num_envs)
        first = next((episode[0] for episode in actions if episode), 0)
        idle_action: Any = [0.0] * len(first) if isinstance(first, list) else 0
        dtype = np.float32 if isinstance(first, list) else np.int64
        self.begin(everywhere, levels)
        for t in range(longest):
            own_steps = [t - (longest - len(episode)) for episode in actions]  # negative while a world is idle
            joint_action = [
                episode[own_step] if own_step >= 0 else idle_action
                for episode, own_step in zip(actions, own_steps, strict=True)
            ]
            joint_step = self.step(np.array(joint_action, dtype))
            over = joint_step.terminated | joint_step.truncated
            begins_next = [own_step == -1 for own_step in own_steps]
            idled_to_end = [own_step < -1 and over[i] for i, own_step in enumerate(own_steps)]
            starting = [i for i in everywhere if begins_next[i] or idled_to_end[i]]
            if starting:
                self.begin(starting, [levels[number] for number in starting])


Batch = dict[str, torch.Tensor]  # "image" uint8 or float32[n, channels, height, width], and "mission" float32[n, 9]


@dataclass(frozen=True, slots=True)
class BatchEncoder:
    """An encoder of the observations of many worlds at once, with the same result as `ObservationEncoder` for each."""

    missions: bool  # whether missions are observed
    spreads: bool  # whether images are grid codes that are spread over the range of a byte
    device: str = "cpu"

    def encode(self, worlds: TrainingWorlds) -> Batch:
        """Return the present observations of all worlds, as tensors on the device."""
        image = worlds.images
        if self.spreads:
            image = image * np.array(SPREAD, np.uint8)
        # a copy, because a batch of teams writes its next observations into the same array
        observations = {"image": torch.from_numpy(np.array(np.moveaxis(image, -1, 1), order="C"))}
        if self.missions:
            observations["mission"] = torch.from_numpy(np.stack([_encode_mission(text) for text in worlds.missions]))
        return {name: part.to(self.device) for name, part in observations.items()}


_encode_mission = lru_cache(maxsize=1024)(encode_mission)


def as_images(observations: NDArray[Any]) -> NDArray[Any]:
    """Return observations, one per row, as images; vectors [n, components] become images [n, 1, 1, components]."""
    if observations.ndim == 2:
        return observations[:, None, None, :]
    return observations


class BatchWorlds(TrainingWorlds):
    """Worlds of one id with the same options, which a vector environment of minihuman steps in compiled code."""

    def __init__(self, batch: Any) -> None:
        self._batch = batch
        self.num_envs = batch.num_envs
        self.missions = [""] * batch.num_envs

    def begin(self, numbers: Sequence[int], levels: Sequence[TrainingLevel]) -> None:
        """Begin an episode in the worlds with these numbers, each at its level."""
        mask = np.zeros(self.num_envs, np.bool_)
        mask[list(numbers)] = True
        seeds: list[int | None] = [None] * self.num_envs
        for number, level in zip(numbers, levels, strict=True):
            seeds[number] = level.seed
        options = None if mask.all() else {"reset_mask": mask}
        self._store_observations(self._batch.reset(seed=seeds, options=options)[0])

    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Take one action in every world, and return the rewards and ends."""
        within_bounds = clip_actions(self._batch.single_action_space, actions)
        observation, rewards, terminated, truncated, _ = self._batch.step(within_bounds)
        self._store_observations(observation)
        return BatchStep(rewards, terminated, truncated)

    def _store_observations(self, observation: Any) -> None:
        """Set ``images``, and ``missions`` if there are any, from the batch's observations."""
        if isinstance(observation, dict):
            self.images = observation["image"]
            self.missions = observation.get("mission", self.missions)
        else:
            self.images = as_images(observation)


class WorldsInTurn(TrainingWorlds):
    """Worlds of several ids or options with equal observation and action spaces, stepped one after the other."""

    def __init__(self, choices: Sequence[WorldChoice], num_envs: int) -> None:
        self.num_envs = num_envs
        self._choices = choices
        # each world's environments by the number of the choice; made when they are first needed
        self._worlds: list[dict[int, Any]] = [{} for _ in range(num_envs)]
        self._current: list[Any] = [None] * num_envs
        self._observations: list[Any] = [None] * num_envs

    def begin(self, numbers: Sequence[int], levels: Sequence[TrainingLevel]) -> None:
        """Begin an episode in the worlds with these numbers, each at its level."""
        for number, level in zip(numbers, levels, strict=True):
            envs = self._worlds[number]
            if level.world not in envs:
                choice = self._choices[level.world]
                envs[level.world] = World(choice.id, choice.options, trusted=True).env
            self._current[number] = envs[level.world]
            self._observations[number], _ = self._current[number].reset(seed=level.seed)
        self._stack_observations()

    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Take one action in every world, and return the rewards and ends."""
        rewards = np.zeros(self.num_envs)
        terminated = np.zeros(self.num_envs, np.bool_)
        truncated = np.zeros(self.num_envs, np.bool_)
        for number, (env, action) in enumerate(zip(self._current, actions, strict=True)):
            if actions.ndim == 1:
                env_action: Any = int(env.action_space.start) + int(action)
            else:
                env_action = clip_actions(env.action_space, action)
            self._observations[number], rewards[number], terminated[number], truncated[number], _ = env.step(env_action)
        self._stack_observations()
        return BatchStep(rewards, terminated, truncated)

    def _stack_observations(self) -> None:
        """Set ``images`` and ``missions`` from the observations of all worlds."""
        if isinstance(self._observations[0], dict):
            self.images = np.stack([observation["image"] for observation in self._observations])
            self.missions = [str(observation.get("mission", "")) for observation in self._observations]
        else:
            self.images = as_images(np.stack(self._observations))
            self.missions = [""] * self.num_envs


class SeatWorlds(TrainingWorlds):
    """A batch of team worlds in which each seat counts as a separate world, so that one policy plays with itself.

    Shaping rewards for useful steps (`TeamBatch.shaping`, where a world has them) decrease to 0 after
    ``shaped_steps``, as in Carroll et al., "On the Utility of Learning about Humans for Human-AI Coordination" (2019).
    """

    begins_by_itself = True

    def __init__(self, team: TeamWorld, num_envs: int, shaped_steps: float) -> None:
        self._batch = team.batch(max(1, num_envs // team.bodies))
        self._bodies = team.bodies
        self._steps = 0
        self._shaped_steps = shaped_steps
        self.num_envs = self._batch.num_worlds * team.bodies
        self.missions = [""] * self.num_envs

    def begin(self, numbers: Sequence[int], levels: Sequence[TrainingLevel]) -> None:
        """Begin the first episodes of all worlds, whose seeds are drawn from the first level's seed.

        The numbers and the other levels are ignored.
        """
        self._batch.reset(levels[0].seed)
        self._stack_observations()

    def step(self, actions: NDArray[Any]) -> BatchStep:
        """Take one action in every seat; where an episode ends, the next one begins."""
        _, rewards, ends = self._batch.step(actions.reshape(-1, self._bodies))
        shaping_weight = max(0.0, 1 - self._steps / self._shaped_steps)
        rewards = rewards + shaping_weight * getattr(self._batch, "shaping", 0.0)
        self._steps += self.num_envs
        self._stack_observations()
        over = np.repeat(ends, self._bodies)
        return BatchStep(rewards.ravel(), over, np.zeros_like(over))

    def _stack_observations(self) -> None:
        """Set ``images`` from the observations of all seats."""
        self.images = self._batch.observations.reshape(self.num_envs, *self._batch.observations.shape[2:])


def make_worlds(choices: Sequence[WorldChoice], num_envs: int, shaped_steps: float) -> TrainingWorlds:
    """Make the worlds of a training run, of the class that steps them fastest.

    Args:
        choices: the worlds to train in.
        num_envs: the number of worlds that are stepped together.
        shaped_steps: the number of steps over which the shaping rewards of a team world decrease to 0.

    Raises:
        LearnError: if a team world is named with another world, or the observations or actions of two worlds differ.
    """
    examples = [World(choice.id, choice.options, trusted=True) for choice in choices]
    teams = [choice.id for choice, world in zip(choices, examples, strict=True) if hasattr(world.unwrapped, "team")]
    if teams and len(choices) > 1:
        raise LearnError(f"{teams[0]} is a team world, which is trained in alone; name no other world beside it")
    if teams:
        return SeatWorlds(examples[0].unwrapped.team, num_envs, shaped_steps)
    for choice, world in zip(choices, examples, strict=True):
        _require_alike(choices[0], examples[0].unwrapped, choice, world.unwrapped)
    batch = _make_batch(choices[0], examples[0], num_envs) if len(choices) == 1 else None
    if batch is None:
        return WorldsInTurn(choices, num_envs)
    return BatchWorlds(batch)


def _require_alike(first_choice: WorldChoice, first: Any, choice: WorldChoice, world: Any) -> None:
    """Check that a world has the same shape of images and the same actions as the first world.

    Args:
        first_choice: the id and options of the first world.
        first: the first world.
        choice: the id and options of the other world.
        world: the other world.

    Raises:
        LearnError: if they differ.
    """
    for name, first_space, world_space in (
        ("images", _get_image_space(first).shape, _get_image_space(world).shape),
        ("actions", first.action_space, world.action_space),
    ):
        if first_space != world_space:
            raise LearnError(
                f"{choice.id} has the {name} {world_space}, and {first_choice.id} has {first_space}; train in worlds "
                "whose observations and actions are equal, such as one family's with the same agent_view_size"
            )


def _get_image_space(world: Any) -> Any:
    """Return the space of a world's image or, if its observations have no image, the space of its observations."""
    space = world.observation_space
    if isinstance(space, gymnasium.spaces.Dict) and "image" in space.spaces:
        return space["image"]
    return space


def _make_batch(choice: WorldChoice, world: World, num_envs: int) -> Any:
    """Return the vector environment that steps a world in compiled code; None if the world has no such environment.

    Args:
        choice: the id and options of the world.
        world: a world of this id and these options.
        num_envs: the number of worlds in the environment.
    """
    native = world.unwrapped
    spec = world.env.spec
    if not isinstance(native, NativeWorld) or spec is None:
        return None
    if spec.vector_entry_point is not None:
        return gymnasium.make_vec(
            choice.id,
            num_envs=num_envs,
            vectorization_mode="vector_entry_point",
            autoreset_mode=AutoresetMode.DISABLED,
            **choice.options,
        )
    if isinstance(native, GridWorld) and spec.max_episode_steps is None:
        options = {**spec.kwargs, **choice.options}
        return type(native).vector(num_envs, autoreset_mode=AutoresetMode.DISABLED, **options)
    return None
