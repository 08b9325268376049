"""Four rooms in first person for several bodies, which see each other and cannot walk through each other.

The state has one agent, and a figure for each body: a coloured block with a grey face in front. When the agent acts or
sees for a body, it takes the place of the body's figure, which is removed meanwhile.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.first_person import rules
from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.layouts.connected_rooms import FourRooms
from minihuman.worlds.first_person.rules import MOVES
from minihuman.worlds.first_person.snapshot import FirstPersonSnapshot
from minihuman.worlds.options import check_one_of, check_whole
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.team import TeamStep, TeamWorld

FIGURE_COLOURS = ("blue", "yellow", "purple", "green", "grey", "blue", "yellow", "purple")  # by body
_NOWHERE = (math.nan, math.nan, math.nan)
_FACE_AHEAD_M = 0.2  # of the figure's middle
_FACE_HEIGHT_M = 0.9


class _SharedRooms(FourRooms):
    """FourRooms with a figure for each body; between steps, the agent is in the place of the first body."""

    def __init__(self, bodies: int, **options: Any) -> None:
        self.colours = FIGURE_COLOURS[:bodies]
        super().__init__(trig=1, **options)  # the same on every machine

    def build(self) -> None:
        """Build the rooms, and place the agent and the figures."""
        super().build()
        self.inside = 0  # the body in whose place the agent is
        # widths, heights and depths in metres
        self.figures = [Box(colour, (0.56, 1.25, 0.56)) for colour in self.colours]
        self.faces = [Box("grey", (0.2, 0.3, 0.36)) for _ in self.colours]
        for body, (figure, face) in enumerate(zip(self.figures, self.faces, strict=True)):
            if body == self.inside:
                self.place_entity(figure, pos=_NOWHERE, dir=0.0)
            else:
                self.place_entity(figure)
            self.place_entity(face, pos=_NOWHERE, dir=0.0)
            self._place_face(body)

    def enter(self, body: int) -> None:
        """Move the agent to a body's place, and put a figure where the agent was."""
        agent = self.agent
        vacated_figure = self.figures[self.inside]
        entered_figure = self.figures[body]
        vacated_figure.pos = agent.pos
        vacated_figure.dir = agent.dir
        self._place_face(self.inside)
        agent.pos = entered_figure.pos
        agent.dir = entered_figure.dir
        entered_figure.pos = _NOWHERE
        self.faces[body].pos = _NOWHERE
        self.inside = body

    def _place_face(self, body: int) -> None:
        """Place a face in front of a body's figure, at eye height."""
        figure = self.figures[body]
        face = self.faces[body]
        figure.trig = 1
        x, _, z = figure.pos
        ahead_x, ahead_z = figure.forward
        face.pos = (x + _FACE_AHEAD_M * ahead_x, _FACE_HEIGHT_M, z + _FACE_AHEAD_M * ahead_z)
        face.dir = figure.dir

    def act_together(self, actions: Sequence[int]) -> tuple[list[float], bool, bool]:
        """Make one joint step in which bodies act one after another; return rewards by body, terminated and truncated.

        The body that acts first changes with every step.

        Raises:
            WorldError: if no episode is running.
        """
        if self._stage is None or self._over:
            raise WorldError("no episode is running; call reset() before step(), and again after each episode")
        rewards = [0.0] * len(actions)
        first = self.step_count % len(actions)
        self.step_count += 1
        for turn in range(len(actions)):
            body = (first + turn) % len(actions)
            self.enter(body)
            if actions[body] < len(self.action_names):
                self.flat_state().step(self, actions[body], rules.ACT)
            if self.near(self.box):
                rewards[body] = self.success_reward()
        self.enter(0)
        terminated = any(rewards)
        truncated = self.max_steps is not None and self.step_count >= self.max_steps
        self._over = terminated or truncated
        return rewards, terminated, truncated


class TeamRooms(TeamWorld):
    """Four rooms and a red box in first person: all bodies search, and all earn a reward when one finds the box.

    Args:
        bodies: the number of bodies, 1 to 8
        max_steps: the number of joint steps after which an episode is truncated
        obs_width: the width of an observation in pixels
        obs_height: the height of an observation in pixels
        view: what a person sees: the body's view ("partial"), or the world from above ("full")
    """

    action_names = (*MOVES, "stay")
    idle_action = len(MOVES)
    mission = "find the red box: when one of you reaches it, all of you have won"

    def __init__(
        self,
        *,
        bodies: int = 2,
        max_steps: int = 250,
        obs_width: int = 80,
        obs_height: int = 60,
        view: View = "partial",
    ) -> None:
        self.bodies = check_whole("bodies", bodies, 1, len(FIGURE_COLOURS))
        self.max_steps = max_steps
        self.view: View = check_one_of("view", view, ("partial", "full"))
        self._env = _SharedRooms(bodies, max_steps=max_steps, obs_width=obs_width, obs_height=obs_height)
        self.observation_space = spaces.Box(0, 255, (obs_height, obs_width, 3), np.uint8)

    def reset(self, seed: int | None = None) -> None:
        """Begin a new episode."""
        self._env.begin(seed=self.choose_seed(seed))

    def step(self, actions: Sequence[int]) -> TeamStep:
        """Make one joint step; bodies act one after another, and the number of steps so far determines who is first."""
        self.check_actions(actions)
        rewards, terminated, truncated = self._env.act_together(actions)
        return TeamStep((sum(rewards),) * self.bodies, terminated, truncated)

    def observation(self, body: int) -> NDArray[np.uint8]:
        """Return a body's view, uint8[obs_height, obs_width, 3]."""
        return self._draw_from_body(body, self._env.see)

    def frame(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> NDArray[np.uint8]:
        """Return what the person in a body sees, uint8[height, width, 3]."""
        return self._draw_from_body(
            body, lambda: self._env.picture(view=self.view, size_px=(width, height), palette=palette)
        )

    def _draw_from_body(self, body: int, draw: Callable[[], NDArray[np.uint8]]) -> NDArray[np.uint8]:
        """Return the picture that ``draw`` draws while the agent is in a body's place."""
        self._env.enter(check_whole("body", body, 0, self.bodies - 1))
        picture = draw()
        self._env.enter(0)
        return picture

    def pose(self, body: int) -> Pose:
        """Return the position of a body's feet in metres, and its heading."""
        check_whole("body", body, 0, self.bodies - 1)
        standing = self._env.figures[body] if body else self._env.agent
        return Pose(*standing.pos, standing.dir)

    def map(self) -> Map:
        """Return the floor plan: the walls and the box."""
        plan = self._env.map()
        return Map(plan.unit, plan.bounds, plan.walls, plan.things[:1])  # the box was placed before all figures

    def state_hash(self) -> int:
        """Return a uint64 hash of the rooms, bodies, step count and random stream."""
        return self._env.state_hash()

    def save(self) -> FirstPersonSnapshot:
        """Return an exact copy of the state."""
        return self._env.save()

    def restore(self, saved: FirstPersonSnapshot) -> None:
        """Restore a saved state."""
        self._env.restore(saved)
