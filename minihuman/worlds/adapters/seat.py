"""A seat: one body of a team world as a Gymnasium environment, so that any player of one body can play in a team.

`joint` is the joint action of the next step, if a session knows it; `script` holds the joint actions of a recorded
episode. A body in neither of them takes the world's idle action.
"""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.team import TeamWorld, find_team

# options of a seat's environment, besides those of its team world
SEAT_OPTION = "seat"
SCRIPT_OPTION = "script"


class SeatEnv(gymnasium.Env[Any, Any], NativeWorld):
    """An environment that plays one body of a team world.

    Args:
        team: the team world
        seat: the body's number, 0 for the first
        script: the joint action of each step, with one action per body

    Raises:
        WorldError: if the world has no such body.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - Gymnasium's own shape

    def __init__(self, team: TeamWorld, seat: int = 0, script: Sequence[Sequence[int]] = ()) -> None:
        if not 0 <= seat < team.bodies:
            raise WorldError(f"seat {seat} does not exist; the world has seats 0 to {team.bodies - 1}")
        self.team = team
        self.seat = seat
        self.script = script
        self.joint: Sequence[int] | None = None  # the joint action of the next step
        self.rewards: tuple[float, ...] = ()  # the last step's rewards, by body
        self.steps = 0
        self.action_names = team.action_names
        self.mission = team.mission
        self.action_space = gymnasium.spaces.Discrete(len(team.action_names))
        self.observation_space = team.observation_space
        self.render_mode = "rgb_array"

    @property
    def max_steps(self) -> int:
        """Return the world's step limit per episode."""
        return self.team.max_steps

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode from a seed, or without one from a seed that the environment draws.

        Return this body's observation and an empty info.
        """
        super().reset(seed=seed)
        self.team.reset(int(self.np_random.integers(2**31)) if seed is None else seed)
        self.joint = None
        self.rewards = ()
        self.steps = 0
        self.mission = self.team.mission
        return self.team.observation(self.seat), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Make a joint step in which this body takes ``action``, and return Gymnasium's five values for this body."""
        reward, terminated, truncated, info = self._step_team(action)
        return self.team.observation(self.seat), reward, terminated, truncated, info

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Make a step without computing an observation; return reward, terminated and truncated."""
        return self._step_team(action)[:3]

    def _step_team(self, action: int) -> tuple[float, bool, bool, dict[str, Any]]:
        """Make a joint step with this body's action; return its reward, terminated, truncated and its info."""
        if self.steps < len(self.script):
            planned = self.script[self.steps]
        else:
            planned = [self.team.idle_action] * self.team.bodies
        joint = list(planned if self.joint is None else self.joint)
        joint[self.seat] = int(action)
        joint_step = self.team.step(joint)
        self.joint = None
        self.rewards = joint_step.rewards
        self.steps += 1
        info = {**joint_step.info}
        if joint_step.infos:
            info |= joint_step.infos[self.seat]
        return joint_step.rewards[self.seat], joint_step.terminated, joint_step.truncated, info

    def render(self) -> Any:
        """Return the picture for the person in this body, uint8[H, W, 3]."""
        return self.picture()

    def pose(self) -> Pose:
        """Return this body's pose."""
        return self.team.pose(self.seat)

    def poses(self) -> tuple[Pose, ...]:
        """Return the pose of each body by seat, without unknown poses."""
        poses = map(self.team.pose, range(self.team.bodies))
        return tuple(pose for pose in poses if not math.isnan(pose.x))

    def map(self) -> Map:
        """Return the floor plan."""
        return self.team.map()

    def state_hash(self) -> int:
        """Return the hash of the team's state, which is the same for each seat."""
        return self.team.state_hash()

    def scene_hash(self) -> int:
        """Return the hash of the team's state without the step count, which is the same for each seat."""
        return self.team.scene_hash()

    def save(self) -> Any:
        """Return a copy of the team's state and of the seat's own state."""
        return self.team.save(), self.steps, self.rewards

    def restore(self, saved: Any) -> None:
        """Restore a saved state."""
        state, self.steps, self.rewards = saved
        self.team.restore(state)
        self.joint = None

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the picture for the person in this body, uint8[H, W, 3], in the view if the world supports it."""
        if hasattr(self.team, "view"):
            self.team.view = view
        return self.team.frame(self.seat, *size_px, palette=palette)


def make_seat(world_id: str, options: dict[str, Any]) -> SeatEnv | None:
    """Make a team world and return a seat of it; None if the id is not that of a team world.

    Args:
        world_id: the id of the world
        options: the options of the team world, with those of the seat: "seat" and "script"

    Raises:
        WorldError: if the world cannot be made with the options.
    """
    make_world = find_team(world_id)
    if make_world is None:
        return None
    team_options = {name: value for name, value in options.items() if name not in (SEAT_OPTION, SCRIPT_OPTION)}
    return SeatEnv(make_world(**team_options), options.get(SEAT_OPTION, 0), options.get(SCRIPT_OPTION, ()))
