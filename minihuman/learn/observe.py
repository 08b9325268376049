"""What an agent sees: a picture or the grid's codes, channels first, and the mission as one-hot numbers."""

from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import LearnError

Observation = dict[str, NDArray[Any]]
Scaling = Literal["spread", "raw"]

COLOURS = ("red", "green", "blue", "purple", "yellow", "grey")
OBJECTS = ("ball", "box", "key")

# The largest object, colour and state codes of a grid cell are 10, 5 and 2: spread over 0 to 255 they are as far apart
# as a picture's colours. "raw" leaves them in the darkest 4 %, where the published agent saw them.
_SPREAD = np.array([25, 51, 127], dtype=np.uint8)


def mission_numbers(mission: str) -> NDArray[np.float32]:
    """One-hot float32[9] of a mission such as "go to the red ball": six colours, then three objects.

    Raises:
        LearnError: if the words name no colour or no object of the pair of worlds.
    """
    words = mission.lower().split()
    numbers = np.zeros(len(COLOURS) + len(OBJECTS), dtype=np.float32)
    for offset, known in ((0, COLOURS), (len(COLOURS), OBJECTS)):
        named = [known.index(word) for word in words if word in known]
        if len(named) != 1:
            raise LearnError(f"the mission {mission!r} names {len(named)} of {', '.join(known)}; it has to name one")
        numbers[offset + named[0]] = 1
    return numbers


class Eyesight:
    """How a world's own observations become an agent's: frozen once made, no state between steps."""

    def __init__(self, world: gymnasium.Env[Any, Any], *, missions: bool, scaling: Scaling = "spread") -> None:
        """Look at a world's observation space.

        Args:
            world: A grid world (observation {"image": uint8[w, h, 3], ...}) or a 3D one (uint8[h, w, 3]).
            missions: Whether the mission differs between episodes and is part of the observation.
            scaling: What becomes of grid codes; a picture is left as it is.

        Raises:
            LearnError: if the world shows neither.
        """
        inner = world.observation_space
        picture = inner["image"] if isinstance(inner, spaces.Dict) and "image" in inner.spaces else inner
        if not isinstance(picture, spaces.Box) or len(picture.shape) != 3 or picture.shape[-1] != 3:
            raise LearnError(f"{world} shows {inner}; an agent here needs an image of three channels")
        self.codes = picture is not inner  # the grid's cells, not a picture
        self.missions = missions
        self.scaling = scaling
        height, width = picture.shape[:2]
        self.image_shape = (3, height, width)
        image = spaces.Box(0, 255, self.image_shape, np.uint8)
        self.space = spaces.Dict({"image": image})
        if missions:
            self.space = spaces.Dict({"image": image, "mission": spaces.Box(0, 1, (9,), np.float32)})

    def see(self, raw: Any, mission: str) -> Observation:
        """One observation, ready for the network."""
        image = raw["image"] if self.codes else raw
        if self.codes and self.scaling == "spread":
            image = image * _SPREAD
        seen: Observation = {"image": np.ascontiguousarray(np.moveaxis(image, -1, 0))}
        if self.missions:
            seen["mission"] = mission_numbers(mission)
        return seen
