"""Worlds that a web page can compute, too: the digest of each step, and the verification of a page's episodes.

A digest covers the state after a step, the agent's observation, the reward and the end: 64 bits by which two sides can
see whether they computed the same. It is not a signature, since anyone who has the rules can compute it.
"""

import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.adapters.spaces import Action
from minihuman.worlds.adapters.transition import StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.first_person.page_scene import copy_state
from minihuman.worlds.first_person.state_digest import digest_state
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.step_digest import digest_step

# an episode's end, as a digest covers it; 0 while it goes on
TERMINATED = 1
TRUNCATED = 2
_OUTCOME = struct.Struct("<dQ")


class PageWorld(World):
    """A world that a page can compute, too, and that keeps its last step's state for a digest if asked to."""

    def __init__(self, world_id: str, options: dict[str, Any] | None = None) -> None:
        super().__init__(world_id, options)
        self._keeps_steps = False
        self._is_grid = isinstance(self.unwrapped, GridEngine)
        self._stepped: tuple[NDArray[Any], ...] = ()

    def keep_steps(self) -> None:
        """Keep the state after each step from now on, for ``digest``. The world must be compiled."""
        self._keeps_steps = True

    def step(self, action: Action) -> StepResult:
        """Step the world, as `World.step`, and keep the state that the step led to, if that was asked for."""
        result = super().step(action)
        if self._keeps_steps:  # a copy, since the next episode changes the same arrays
            env = self.unwrapped
            if self._is_grid:
                self._stepped = (env.state.row.copy(), self._observation["image"])
            else:
                self._stepped = copy_state(env)
        return result

    def digest(self, reward: float, *, terminated: bool, truncated: bool) -> str:
        """Return the digest of the last step, after ``keep_steps``, and of its outcome as 16 hexadecimal digits."""
        digest: Any = digest_step if self._is_grid else digest_state
        end = 0
        if terminated:
            end = TERMINATED
        elif truncated:
            end = TRUNCATED
        outcome = bytearray(_OUTCOME.pack(reward, end))
        return f"{int(digest(*self._stepped, np.frombuffer(outcome, np.uint64))):016x}"


@dataclass(frozen=True, slots=True)
class ActionsVerification:
    """The result of replaying a page's actions.

    ``difference`` describes the first difference, or is "" if there is none; the other fields cover the steps up to it.
    """

    steps: int
    difference: str
    reward: float
    terminated: bool
    truncated: bool
    action_names: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Return whether the replayed actions gave the page's digests and rewards under the rules installed here."""
        return not self.difference


def verify_actions(
    world: str,
    seed: int,
    actions: Sequence[int],
    digests: Sequence[str],
    *,
    rewards: Sequence[float] | None = None,
    options: dict[str, Any] | None = None,
) -> ActionsVerification:
    """Replay a page's actions from the seed, and compare each step's digest.

    This shows that the actions lead to the digests by the rules installed here, not who pressed the keys or when.

    Args:
        world: a Gymnasium id; the prefix ``minihuman/`` is optional
        seed: the seed of the episode
        actions: the numbers of the actions, in order
        digests: the digest of each step, 16 hexadecimal digits
        rewards: the reward of each step; None if rewards are not to be compared
        options: the keyword arguments of ``gymnasium.make`` on the page

    Raises:
        ValueError: if the number of digests or rewards differs from that of actions, or the seed is negative.
        WorldError: if the world cannot be made, or no page computes it.
    """
    n_actions = len(actions)
    n_rewards = n_actions if rewards is None else len(rewards)
    if len(digests) != n_actions or n_rewards != n_actions:
        counts = f"{n_actions} actions, {len(digests)} digests and {n_rewards} rewards"
        raise ValueError(f"{world} seed {seed} has {counts}; each action has one of both")
    if seed < 0:
        raise ValueError(f"seed is {seed}; a seed is 0 or more")
    if "/" in world or ":" in world:
        world_id = world
    else:
        world_id = f"minihuman/{world}"
    with closing(PageWorld(world_id, options)) as page_world:
        if not page_world.is_compiled:
            raise WorldError(
                f"{world_id}: no page computes it, so there are no digests to compare; choose another world"
            )
        page_world.reset(seed)
        return _compare_steps(page_world, actions, digests, rewards)


def _compare_steps(
    world: PageWorld, actions: Sequence[int], digests: Sequence[str], rewards: Sequence[float] | None
) -> ActionsVerification:
    """Replay actions in a world that was just reset; return the verification up to the first difference."""
    world.keep_steps()
    verified = ActionsVerification(
        0, "", 0.0, terminated=False, truncated=False, action_names=tuple(world.action_names)
    )
    for index, action in enumerate(actions):
        if verified.terminated or verified.truncated:
            return replace(verified, difference=f"step {index + 1}: the episode ended at step {index}")
        if not 0 <= action < len(world.action_names):
            mismatch = f"action {action} is none of the {len(world.action_names)} of {world.id}"
            return replace(verified, difference=f"step {index + 1}: {mismatch}")
        step = world.step(action)
        digest = world.digest(step.reward, terminated=step.terminated, truncated=step.truncated)
        if digest != digests[index]:
            mismatch = f"digest {digests[index]!r}, played again {digest!r}"
            return replace(verified, difference=f"step {index + 1}: {mismatch}")
        if rewards is not None and rewards[index] != step.reward:
            mismatch = f"reward {rewards[index]!r}, played again {step.reward!r}"
            return replace(verified, difference=f"step {index + 1}: {mismatch}")
        verified = replace(
            verified,
            steps=index + 1,
            reward=verified.reward + step.reward,
            terminated=step.terminated,
            truncated=step.truncated,
        )
    return verified
