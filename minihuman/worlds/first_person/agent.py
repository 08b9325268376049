"""The agent: a body that moves and a camera on top of it."""

import numpy as np

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.parameters import Parameters


class Agent(Entity):
    """The one who acts. Lengths are metres, camera angles degrees."""

    name = "agent"
    looks = ("cam_height", "cam_fwd_disp", "cam_pitch", "cam_fov_y")

    def __init__(self) -> None:
        super().__init__()
        self.radius = 0.4
        self.height = 1.6
        self.cam_height = 1.5  # above the floor
        self.cam_fwd_disp = 0.0  # in front of the body's middle
        self.cam_pitch = 0.0  # upwards
        self.cam_fov_y = 60.0  # how much is seen from top to bottom
        self.carrying: Entity | None = None

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw where the camera sits and how it looks."""
        self.cam_height = parameters.number("cam_height", rng)
        self.cam_fwd_disp = parameters.number("cam_fwd_disp", rng)
        self.cam_pitch = parameters.number("cam_pitch", rng)
        self.cam_fov_y = parameters.number("cam_fov_y", rng)
