"""A room whose agent observes numbers and no picture: its own place and heading, and where the box is.

`OneRoomPose-v0` is `minihuman/MiniWorld-OneRoom-v0` with the observation float32[6]: x and z of the agent in shares of
the room, cosine and sine of its heading, and x and z of the box in shares of the room.
"""

import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.layouts.one_room import OneRoom


class OneRoomPose(OneRoom):
    """A square room with a red box, observed as numbers."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (6,), np.float32)

    def observe(self) -> NDArray[np.float32]:
        """Return the agent's place and heading and the box's place, float32[6]."""
        x, _, z = self.agent.pos
        box_x, _, box_z = self.box.pos
        shares = x / self.size, z / self.size, math.cos(self.agent.dir), math.sin(self.agent.dir)
        return np.array((*shares, box_x / self.size, box_z / self.size), np.float32)


gymnasium.register("OneRoomPose-v0", OneRoomPose)
