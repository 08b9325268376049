"""An episode as a page computes it, in Python: from the states that the server sends, with the page's digests."""

import numpy as np

from minihuman.web.computed import PageWorld
from minihuman.web.messages import EpisodeRules, GridState


class PageSteps:
    """Where keys lead.

    Args:
        world_id: of the episode's world.
        rules: that the server sent, with the first state.
    """

    def __init__(self, world_id: str, rules: EpisodeRules) -> None:
        assert rules.computed is not None
        self.rules = rules
        self.start = rules.computed  # where the server said last that it was
        self._world = PageWorld(world_id)
        self._world.reset(0)
        self.place(rules.computed)

    def place(self, state: GridState) -> None:
        """Go where the server is."""
        env, runs = self._world.unwrapped, np.array(state.row)
        row = np.repeat(runs[::2], runs[1::2]).astype(np.int32)
        words = np.array([int(word) for word in state.rng_state], np.uint64)
        env.restore(env.save()._replace(row=row, rng_state=words))
        self.start, self.step, self.ended = state, state.step, False

    def press(self, key: str) -> str:
        """Make a key's step; its digest, "" if it makes none."""
        action = self.rules.actions.get(key)
        return "" if action is None else self.act(action)

    def act(self, action: int) -> str:
        """Make a step; its digest, "" if the episode is over."""
        if self.ended:
            return ""
        made = self._world.step(action)
        self.step += 1
        truncated = made.truncated or (self.step >= self.rules.most_steps and not made.terminated)
        self.ended = made.terminated or truncated
        return self._world.digest(made.reward, terminated=made.terminated, truncated=truncated)
