"""A team world of a lab: two bodies on a line of cells; both on the goal at once succeed together."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.team import TeamStep, TeamWorld


class Duet(TeamWorld):
    """Each body walks on its own line; the reward is shared."""

    bodies = 2
    action_names = ("left", "right", "stay")
    idle_action = 2
    mission = "meet at the end"
    max_steps = 40
    observation_space: ClassVar = spaces.Box(-1, 99, (4,), np.int64)

    def __init__(self, length: int = 4) -> None:
        self.length = length

    def reset(self, seed: int) -> None:
        self.cells = [seed % 2, (seed // 2) % 2]
        self.steps = 0

    def step(self, actions: Any) -> TeamStep:
        self.check_actions(actions)
        moves = {0: -1, 1: 1, 2: 0}
        self.cells = [
            min(max(cell + moves[act], 0), self.length) for cell, act in zip(self.cells, actions, strict=True)
        ]
        self.steps += 1
        done = self.cells == [self.length] * 2
        return TeamStep((float(done),) * 2, done, self.steps >= self.max_steps)

    def observation(self, body: int) -> NDArray[Any]:
        return np.array([*self.cells, body, self.steps])

    def frame(self, body: int, width: int, height: int, *, palette: str = "classic") -> NDArray[np.uint8]:
        side = max(1, min(width // (self.length + 1), height // 2))
        picture = np.full((2 * side, (self.length + 1) * side, 3), 60, np.uint8)
        picture[:, self.length * side :] = (20, 140, 60)
        for line, cell in enumerate(self.cells):
            colour = (240, 60, 60) if line == 0 else (60, 90, 240)
            picture[line * side + 2 : (line + 1) * side - 2, cell * side + 2 : (cell + 1) * side - 2] = colour
            if line == body:
                picture[line * side : line * side + 2, cell * side : (cell + 1) * side] = 255
        return picture

    def pose(self, body: int) -> Pose:
        return Pose(float(self.cells[body]), 0.0, float(body), 0.0)

    def map(self) -> Map:
        return Map("cell", (0.0, 0.0, self.length + 1.0, 2.0), (), ())

    def state_hash(self) -> int:
        return hash64([*self.cells, self.steps])

    def save(self) -> Any:
        return list(self.cells), self.steps

    def restore(self, saved: Any) -> None:
        self.cells, self.steps = list(saved[0]), saved[1]


gymnasium.register("Duet-v0", entry_point="tests.worlds.duet:Duet")
