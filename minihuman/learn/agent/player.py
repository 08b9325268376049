"""A trained policy at the keys of a session: ``minihuman simulate PROTOCOL --player policy:FILE``."""

from pathlib import Path

import numpy as np
import torch

from minihuman.errors import LearnError
from minihuman.learn.agent.policy_file import load_policy
from minihuman.players.port import Player, Press
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World

DELAY_MS = 250.0


class PolicyPlayer(Player):
    """Draws each action from the policy's probabilities, among the actions that have a key."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        """Load the policy file that the argument names.

        Raises:
            LearnError: if there is none.
        """
        if not argument:
            raise LearnError("player policy needs a file; name it after a colon, as in policy:clone.pt")
        self._path = Path(argument)
        torch.set_num_threads(1)  # one observation at a time: more threads only wait for each other
        self._policy, self._card = load_policy(self._path)
        self._rng = rng
        self._looker = self._card.eyesight.looker()
        self._keys: list[tuple[int, str]] = []  # action of the policy, key

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Find the keys of the policy's actions.

        Raises:
            LearnError: if the policy was trained for another world, or none of its actions has a key.
        """
        if plan.world != self._card.world:
            raise LearnError(
                f"{self._path} was trained for {self._card.world}; block {plan.block_name!r} plays {plan.world}"
            )
        if self._card.eyesight.space(world.unwrapped) != self._card.observation_space:
            raise LearnError(
                f"{self._path} was trained with {self._card.world_options or 'the default options'}; "
                f"block {plan.block_name!r} shows something else with {plan.options}"
            )
        key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._keys = [(n, key_of[name]) for n, name in enumerate(self._card.action_names) if name in key_of]
        if not self._keys:
            raise LearnError(
                f"{self._path}: none of its actions has a key; it has {', '.join(self._card.action_names)}"
            )

    def press(self, world: World) -> Press:
        """The key of an action, drawn from the policy."""
        seen = self._looker.see(world.unwrapped, world.observation)
        wanted = self._policy.probabilities(seen).double().numpy()[[action for action, _ in self._keys]]
        _, key = self._keys[self._rng.choice(len(self._keys), p=wanted / wanted.sum())]
        return Press(key, DELAY_MS)
