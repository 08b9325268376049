"""A policy file beside a person: what it thinks of each of the world's actions."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.agent.policy_file import load_policy
from minihuman.players.agent import Agent
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World


class PolicyAgent(Agent):
    """Says what the policy in a file says.

    Raises:
        LearnError: if the file is none.
    """

    def __init__(self, argument: str) -> None:
        super().__init__(argument)
        self._path = Path(argument)
        torch.set_num_threads(1)  # one observation at a time: more threads only wait for each other
        self._policy, self._card = load_policy(self._path)
        self._places: list[int] = []  # the world's action for each of the policy's
        self._looker = self._card.eyesight.looker()

    def begin(self, plan: EpisodePlan, world: World) -> None:
        """Find the policy's actions in the world.

        Raises:
            LearnError: if it was trained in another world, or with other eyes or actions.
        """
        card = self._card
        if plan.world != card.world:
            raise LearnError(f"{self._path} was trained for {card.world}; block {plan.block_name!r} plays {plan.world}")
        if card.eyesight.space(world.unwrapped) != card.observation_space:
            raise LearnError(
                f"{self._path} was trained with {card.world_options or 'the default options'}; "
                f"block {plan.block_name!r} shows something else with {plan.options}"
            )
        missing = [name for name in card.action_names if name not in world.action_names]
        if missing:
            raise LearnError(f"{self._path} has the action {missing[0]!r}, which {plan.world} lacks")
        self._looker = card.eyesight.looker()
        self._places = [world.action_names.index(name) for name in card.action_names]

    def advise(self, world: World) -> NDArray[np.float32]:
        """The policy's probabilities; 0 for actions that it does not have."""
        chances = np.zeros(len(world.action_names), np.float32)
        seen = self._looker.see(world.unwrapped, world.observation)
        chances[self._places] = self._policy.probabilities(seen).numpy()[: len(self._places)]
        return chances
