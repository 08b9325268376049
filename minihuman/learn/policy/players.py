"""Policy files as players: the simulated participant `policy:FILE`, and an agent that advises or plays with a person.

`policy:FOLDER` plays each world with the folder's policy that was trained in it.
"""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from minihuman.agents.agent import BaseAgent
from minihuman.errors import LearnError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.learn.policy.file import PolicyCard, load_policy
from minihuman.learn.policy.network import Policy
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from minihuman.worlds.adapters.world import World

DELAY_MS = 250.0  # from a picture to the press of a simulated participant


class PolicyPlayer(SimulatedParticipant):
    """A simulated participant that draws actions from a policy's probabilities, among the actions that have a key."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        """Load the policy file that the argument names, or all policy files in a folder.

        Raises:
            LearnError: if no policy file can be loaded.
        """
        if not argument:
            raise LearnError("player 'policy' needs a policy file; add it after a colon, as in policy:clone.pt")
        torch.set_num_threads(1)  # one observation at a time: more threads only wait for each other
        paths = sorted(Path(argument).glob("*.pt")) or [Path(argument)]
        self._files = [(path, *load_policy(path)) for path in paths]
        self._rng = rng
        self._keys: list[tuple[int, str]] = []  # action of the policy, key

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Begin an episode: choose the policy for its world and find the keys of the policy's actions.

        Args:
            plan: the episode's plan, which assigns actions to keys.
            pool: not used.
            world: the episode's world.

        Raises:
            LearnError: if the policy was trained in another world, or none of its actions has a key.
        """
        path, self._policy, card = self._find_file(plan.world)
        _require_world(path, card, plan, world)
        self._encoder = card.eyesight.episode_encoder()
        self._policy.forget()
        key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}  # the first key of each action
        self._keys = [(n, key_of[name]) for n, name in enumerate(card.action_names) if name in key_of]
        if not self._keys:
            raise LearnError(
                f"{path}: none of its actions has a key; assign a key to one of {', '.join(card.action_names)}"
            )

    def _find_file(self, world_id: str) -> tuple[Path, Policy, PolicyCard]:
        """Return the first loaded file that was trained in a world, or else the first of all: path, policy, card."""
        for path, policy, card in self._files:
            if world_id in card.worlds:
                return path, policy, card
        return self._files[0]

    def press(self, world: World) -> KeyPress:
        """Return a press of the key of an action that is drawn from the policy."""
        observation = self._encoder.encode(world.unwrapped, world.observation)
        key_weights = self._policy.probabilities(observation).double().numpy()[[action for action, _ in self._keys]]
        _, key = self._keys[self._rng.choice(len(self._keys), p=key_weights / key_weights.sum())]
        return KeyPress(key, DELAY_MS)


class PolicyAgent(BaseAgent):
    """An agent that acts by the policy in a file.

    Raises:
        LearnError: if the file is not a policy file.
    """

    def __init__(self, argument: str) -> None:
        super().__init__(argument)
        self._path = Path(argument)
        torch.set_num_threads(1)  # one observation at a time: more threads only wait for each other
        self._policy, self._card = load_policy(self._path)
        self._world_actions: list[int] = []  # the world's number of each action of the policy
        self._encoder = self._card.eyesight.episode_encoder()

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Begin an episode: find the world's number of each of the policy's actions.

        Raises:
            LearnError: if the policy was trained in another world, or with other observations or actions.
        """
        card = self._card
        _require_world(self._path, card, plan, world)
        missing = [name for name in card.action_names if name not in world.action_names]
        if missing:
            raise LearnError(
                f"{self._path} takes action {missing[0]!r}, which {plan.world} does not have; use another policy"
            )
        self._encoder = card.eyesight.episode_encoder()
        self._policy.forget()
        self._world_actions = [world.action_names.index(name) for name in card.action_names]

    def action_probabilities(self, world: World) -> NDArray[np.float32]:
        """Return the policy's probability of each of the world's actions; 0 for actions that the policy lacks."""
        probabilities = np.zeros(len(world.action_names), np.float32)
        observation = self._encoder.encode(world.unwrapped, world.observation)
        probabilities[self._world_actions] = self._policy.probabilities(observation).numpy()[: len(self._world_actions)]
        return probabilities


def _require_world(path: Path, card: PolicyCard, plan: EpisodePlan, world: World) -> None:
    """Check that a policy can play the world of an episode.

    Args:
        path: the policy's file, for the error.
        card: the policy's card.
        plan: the episode's plan.
        world: the episode's world.

    Raises:
        LearnError: if the policy was trained in another world, or with continuous actions or other observations.
    """
    if card.is_continuous:
        raise LearnError(
            f"{path} has continuous actions; agents and simulated participants of a study choose numbered actions: "
            "train a policy in the world with control = 'discrete', or measure this one by `minihuman learn ppo`"
        )
    if plan.world not in card.worlds:
        raise LearnError(
            f"{path} was trained in {', '.join(card.worlds)}, but block {plan.block_name!r} plays {plan.world}; use "
            "another policy"
        )
    if card.eyesight.space(world.unwrapped) != card.observation_space:
        trained_options = card.world_options or "default options"
        block_options = plan.options or "default options"
        raise LearnError(
            f"{path} was trained with {trained_options}, but block {plan.block_name!r} has {block_options} and other "
            "observations; use the same options"
        )
