"""Tokens: a mission as numbers of words, for libraries that know no text."""

from collections.abc import Iterable
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import COLOURS, DOOR_STATES
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.sentences import Sentences, words_in

MOST_KINDS = 16  # what a cell's number has room for
PADDING = 0  # the token after a mission's last word


class Tokens(gymnasium.ObservationWrapper[dict[str, Any], int, dict[str, Any]]):
    """The mission as one number a word, int64[length], zeros behind it; word ``words[i]`` is number ``i + 1``.

    Cells in the observation's image are declared as what they are, numbers of kinds, colours and states, so that nobody
    takes them for pixels. ``PPO("MultiInputPolicy", Tokens(env))`` of Stable-Baselines3 learns on it.

    Args:
        env: An environment that observes a ``mission``.
        words: The words that have numbers; None for those of the world's own missions. Give the same words to worlds
            that one agent is to play.
        length: Words of the longest mission; None for the longest that the world's missions may be.
    """

    def __init__(
        self,
        env: gymnasium.Env[dict[str, Any], int],
        *,
        words: Iterable[str] | None = None,
        length: int | None = None,
    ) -> None:
        super().__init__(env)
        seen = env.observation_space
        mission = seen.get("mission") if isinstance(seen, spaces.Dict) else None
        if not isinstance(seen, spaces.Dict) or not isinstance(mission, Sentences):
            raise WorldError(f"{env} observes {seen}, which holds no mission to turn into tokens")
        self.words = mission.words if words is None else tuple(dict.fromkeys(words))
        self._number = {word: number for number, word in enumerate(self.words, 1)}
        self.length = max(1, mission.most_words if length is None else length)
        tokens = spaces.Box(PADDING, max(1, len(self.words)), (self.length,), np.int64)
        others: dict[str, spaces.Space[Any]] = {**seen.spaces, "mission": tokens}
        world = env.unwrapped
        if isinstance(world, GridEngine) and seen["image"] is dict(world.observation_space)["image"]:  # type: ignore[call-overload]
            highest = np.empty(world.image_shape, np.uint8)
            highest[...] = MOST_KINDS - 1, len(COLOURS) - 1, max(len(DOOR_STATES), 4) - 1
            others["image"] = spaces.Box(np.zeros_like(highest), highest, dtype=np.uint8)
        self.observation_space = spaces.Dict(others)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The observation with the mission in tokens."""
        return {**observation, "mission": self.tokens(observation["mission"])}

    def tokens(self, mission: str) -> NDArray[np.int64]:
        """A sentence in tokens.

        Raises:
            WorldError: if it has a word without a number, or too many words.
        """
        said = words_in(mission)
        if len(said) > self.length:
            raise WorldError(f"mission {mission!r} has {len(said)} words; make Tokens(env, length={len(said)})")
        tokens = np.full(self.length, PADDING, np.int64)
        for place, word in enumerate(said):
            if word not in self._number:
                raise WorldError(
                    f"mission {mission!r} has the word {word!r}; Tokens has numbers for {', '.join(self.words)}"
                )
            tokens[place] = self._number[word]
        return tokens
