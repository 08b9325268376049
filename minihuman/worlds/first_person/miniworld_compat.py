"""Miniworld's names for the properties of a first-person world, so that code written for Miniworld's worlds works.

The names are views of the present state. Setting one changes the state if that is possible, and is an error otherwise;
a name of Miniworld that has no meaning here is an error that says what to use. Positions are tuples, not arrays: use
``np.subtract(agent.pos, box.pos)``.
"""

import math
from collections.abc import Mapping, Sequence
from enum import IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Entity, Length, Position, note_change
from minihuman.worlds.first_person.parameter_names import ParameterNames, read_parameters
from minihuman.worlds.first_person.parameters import Parameters
from minihuman.worlds.first_person.rooms import Room
from minihuman.worlds.first_person.rules import ACTIONS
from minihuman.worlds.first_person.state import WALL
from minihuman.worlds.options import check_bool, check_number
from minihuman.worlds.step_limit import check_max_steps
from minihuman.worlds.upstream_names import (
    UpstreamName,
    define_names,
    missing_name,
    refuse_replaced_method,
    refuse_unknown_attribute,
    set_instead,
)

_BUILD = "write build() of a FirstPersonEnv of your own"
_OPENGL = "nothing here is drawn by OpenGL"
INSTEAD: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(("_gen_world", "_gen_static_data"), _BUILD),
        **dict.fromkeys(("shadow_window", "text_label", "_render_static", "_render_world", "_load_tex"), _OPENGL),
        "Actions": "read actions",
        "room_probs": "rooms are drawn by their area",
        "find_facing_edges": "call connect_rooms() in build()",
    }
)


class FrameSize(NamedTuple):
    """A stand-in for a frame buffer of Miniworld: the size of the pictures drawn into it."""

    width: int
    height: int


@lru_cache
def _make_action_enum(names: tuple[str, ...]) -> type[IntEnum]:
    """Return an enumeration of actions, numbered from 0; the same class for the same names."""
    return IntEnum("Actions", names, start=0)  # type: ignore[return-value]  # mypy reads only written-out names


def _read_triple(name: str, value: ArrayLike, low: float, high: float) -> tuple[float, float, float]:
    """Return three numbers, a colour or a position, as floats; raise a WorldError if one is outside the bounds."""
    first, second, third = np.asarray(value, np.float64).tolist()
    for number in (first, second, third):
        check_number(name, number, low, high)
    return first, second, third


class MiniworldCompat:
    """A mixin of every first-person world that adds Miniworld's names."""

    reward_range: tuple[float, float] = (-math.inf, math.inf)  # as in Miniworld; nothing here reads it
    obs_disp_width = 256  # the width of the small picture in Miniworld's window

    _is_made = False  # whether `make_world` has finished the world, so that only build() may add attributes
    _stage: Any
    _flat: Any
    _window: Any

    def __setattr__(self, name: str, value: Any) -> None:
        if self._is_made:
            refuse_unknown_attribute(self, name, INSTEAD)
            refuse_replaced_method(self, name, vars(MiniworldCompat))
        super().__setattr__(name, value)

    @property
    def max_steps(self) -> int | None:
        """Return the number of steps after which an episode is truncated; None for never."""
        return self._max_steps

    @max_steps.setter
    def max_steps(self, steps: int | None) -> None:
        if steps is None:
            self._max_steps = None
        else:
            self._max_steps = check_max_steps(steps)
        self.forget_flat_state()

    @property
    def domain_rand(self) -> bool:
        """Return whether parameters are drawn from their ranges."""
        return self._domain_rand

    @domain_rand.setter
    def domain_rand(self, is_drawn: bool) -> None:
        self._domain_rand = check_bool("domain_rand", is_drawn)
        if self._stage is not None:
            self._stage.randomised = is_drawn
            self.forget_flat_state()

    @UpstreamName
    def obs_disp_height(self: Any) -> float:
        """Return the height of the small picture in Miniworld's window."""
        frame = self.obs_fb
        return float(frame.height * (self.obs_disp_width / frame.width))

    @UpstreamName
    def actions(self: Any) -> type[IntEnum]:
        """Return the actions by name: Miniworld's eight if the world has the first of them, or else the world's own."""
        names = tuple(self.action_names)
        return _make_action_enum(ACTIONS if names == ACTIONS[: len(names)] else names)

    @set_instead("make the world with render_mode='human'")
    def window(self: Any) -> Any:
        """Return the window of ``render_mode="human"``; None if there is none."""
        return self._window

    @set_instead(_BUILD)
    def rooms(self: Any) -> list[Room]:
        """Return the rooms in the order in which they were added, including passages between them."""
        return list(self.stage.rooms)

    @set_instead(_BUILD)
    def wall_segs(self: Any) -> NDArray[np.float64]:
        """Return the start and end (x, 0, z) of the walls that stop a body, float64[n, 2, 3]."""
        ends = self.stage.floor.walls.reshape(-1, 2, 2)
        return np.insert(ends, 1, 0.0, axis=2)

    @set_instead(_BUILD)
    def min_x(self: Any) -> float:
        """Return the smallest x of the rooms in metres."""
        return float(self.stage.floor.bounds[0])

    @set_instead(_BUILD)
    def min_z(self: Any) -> float:
        """Return the smallest z of the rooms in metres."""
        return float(self.stage.floor.bounds[1])

    @set_instead(_BUILD)
    def max_x(self: Any) -> float:
        """Return the largest x of the rooms in metres."""
        return float(self.stage.floor.bounds[2])

    @set_instead(_BUILD)
    def max_z(self: Any) -> float:
        """Return the largest z of the rooms in metres."""
        return float(self.stage.floor.bounds[3])

    @UpstreamName
    def max_episode_steps(self: Any) -> float:
        """Return the number of steps after which an episode is truncated; infinity for never."""
        if self.max_steps is None:
            return math.inf
        return float(self.max_steps)

    @max_episode_steps.setter
    def max_episode_steps(self: Any, steps: float) -> None:
        self.max_steps = None if steps == math.inf else steps

    @UpstreamName
    def max_forward_step(self: Any) -> float:
        """Return the length of the longest step in metres."""
        return float(self.stage.reach)

    @max_forward_step.setter
    def max_forward_step(self: Any, metres: float) -> None:
        self.stage.reach = float(check_number("max_forward_step", metres, 0.001, 1000))
        self.forget_flat_state()

    @UpstreamName
    def params(self: Any) -> ParameterNames:
        """Return the world's parameters; a parameter that is set takes effect from the next step on."""
        return ParameterNames(self.parameters, self._take_parameters)

    @params.setter
    def params(self: Any, params: Any) -> None:
        self._take_parameters(read_parameters(params))

    @UpstreamName
    def sky_color(self: Any) -> NDArray[np.float64]:
        """Return the colour of the sky in this episode, float64[3] in 0 to 1."""
        return np.array(self.stage.sky_colour)

    @sky_color.setter
    def sky_color(self: Any, colour: ArrayLike) -> None:
        self.stage.sky_colour = _read_triple("sky_color", colour, 0, 10)
        self.forget_pictures()

    @UpstreamName
    def light_pos(self: Any) -> NDArray[np.float64]:
        """Return the position of the light in this episode, float64[3] in metres."""
        return np.array(self.stage.light_pos)

    @light_pos.setter
    def light_pos(self: Any, place: ArrayLike) -> None:
        self.stage.light_pos = _read_triple("light_pos", place, -1e6, 1e6)
        self.forget_pictures()

    @UpstreamName
    def light_color(self: Any) -> NDArray[np.float64]:
        """Return the colour of the light in this episode, float64[3] in 0 to 1."""
        return np.array(self.stage.light_colour)

    @light_color.setter
    def light_color(self: Any, colour: ArrayLike) -> None:
        self.stage.light_colour = _read_triple("light_color", colour, 0, 10)
        self.forget_pictures()

    @UpstreamName
    def light_ambient(self: Any) -> NDArray[np.float64]:
        """Return the colour of the ambient light, float64[3] in 0 to 1."""
        return np.array(self.stage.light_ambient)

    @light_ambient.setter
    def light_ambient(self: Any, colour: ArrayLike) -> None:
        self.stage.light_ambient = _read_triple("light_ambient", colour, 0, 10)
        self.forget_pictures()

    @set_instead("give obs_width and obs_height when the world is made")
    def obs_fb(self: Any) -> FrameSize:
        """Return the size of an observation."""
        return FrameSize(*self._pictures.size_px)

    @set_instead("give window_width and window_height when the world is made")
    def vis_fb(self: Any) -> FrameSize:
        """Return the size of the pictures that `render` draws."""
        return FrameSize(*self.window_px)

    def move_agent(self: Any, fwd_dist: float, fwd_drift: float) -> bool:
        """Move the agent, with what it carries, some metres ahead and to the right; return whether the way was free."""
        agent = self.agent
        x, _, z = np.add(agent.pos, agent.dir_vec * fwd_dist + agent.right_vec * fwd_drift).tolist()
        position: Position = (x, agent.pos[1], z)
        carried = agent.carrying
        if self.intersect(agent, position, agent.radius) is not None:
            return False
        if carried is not None:
            carried_position = self.stage.carrying_position(position, carried)
            if self.intersect(carried, carried_position, carried.radius) is not None:
                return False
            carried.pos = carried_position
        agent.pos = position
        return True

    def turn_agent(self: Any, turn_angle: float) -> bool:
        """Turn the agent, with what it carries, some degrees to the left; return whether nothing was in the way."""
        agent = self.agent
        heading = self.agent.dir
        carried = agent.carrying
        agent.dir = heading + turn_angle * (math.pi / 180)
        if carried is None:
            return True
        carried_position = self.stage.carrying_position(agent.pos, carried)
        if self.intersect(carried, carried_position, carried.radius) is not None:
            agent.dir = heading
            return False
        carried.pos = carried_position
        carried.dir = agent.dir
        return True

    def intersect(self: Any, ent: Entity, pos: Sequence[float], radius: Length) -> Entity | Literal[True] | None:
        """Return what an entity of a radius would touch at (x, y, z): True for a wall, another entity, or None."""
        touched: Entity | str | None = self.stage.blocker(ent, float(pos[0]), float(pos[2]), radius)
        if isinstance(touched, Entity):
            return touched
        return True if touched == WALL else None

    def near(self: Any, a: Entity, b: Entity | None = None) -> bool:
        """Return whether an entity is within a step of touching another one, or the agent."""
        return bool(self.stage.near(a, b or self.agent))

    def depth(self: Any, *, size_px: tuple[int, int] = (80, 60)) -> NDArray[np.float32]:
        """Return the depth of the agent's view in metres along its axis, float32[H, W]."""
        return np.asarray(self._pictures.depth(self.stage, size_px=size_px))

    def visible_entities(self: Any) -> list[Entity]:
        """Return the entities that are at least partly in the agent's view, in the order in which they were placed."""
        return list(self._pictures.visible(self.stage))

    def own_attributes(self: Any) -> frozenset[str]:
        """Return the names of the attributes that belong to the world's state and do not begin with an underscore."""
        return frozenset(name for name in self._state() if not name.startswith("_"))

    def render_obs(self: Any, frame_buffer: FrameSize | None = None) -> NDArray[np.uint8]:
        """Return the agent's view in the size of an observation, or in the size of ``frame_buffer`` if given."""
        if frame_buffer is None:
            return np.asarray(self.see())
        return np.asarray(self.picture(size_px=(frame_buffer.width, frame_buffer.height)))

    def render_top_view(
        self: Any, frame_buffer: FrameSize | None = None, render_agent: bool = True, return_scale: bool = False
    ) -> NDArray[np.uint8]:
        """Return the world from above in the size of an observation, or in the size of ``frame_buffer`` if given.

        Raises:
            WorldError: if the agent is not to be drawn, or Miniworld's scale is requested.
        """
        if not render_agent or return_scale:
            raise WorldError("render_top_view draws the agent and returns the picture alone; map() has the coordinates")
        if frame_buffer is None:
            frame = self.obs_fb
        else:
            frame = frame_buffer
        return np.asarray(self.picture(view="full", size_px=(frame.width, frame.height)))

    def render_depth(self: Any, frame_buffer: FrameSize | None = None) -> NDArray[np.float32]:
        """Return the depth of the agent's view in metres, float32[height, width, 1], as `depth` does."""
        if frame_buffer is None:
            frame = self.obs_fb
        else:
            frame = frame_buffer
        return np.asarray(self.depth(size_px=(frame.width, frame.height)))[..., None]

    def get_visible_ents(self: Any) -> set[Entity]:
        """Return the entities that are at least partly in the agent's view, as `visible_entities` does."""
        return set(self.visible_entities())

    def _get_carry_pos(self: Any, agent_pos: Position, ent: Entity) -> NDArray[np.float64]:
        """Return the position of a carried entity when the agent is at a position."""
        return np.array(self.stage.carrying_position(agent_pos, ent))

    def _reward(self: Any) -> float:
        """Return the reward that success would earn now."""
        return float(self.success_reward())

    def _take_parameters(self: Any, parameters: Parameters) -> None:
        """Replace the world's parameters and those of the present episode."""
        self.parameters = parameters
        if self._stage is not None:
            self._stage.parameters = parameters
            self.forget_flat_state()

    def forget_flat_state(self: Any) -> None:
        """Discard the kernels' arrays, so that the next step reads the whole state again."""
        self._flat = None
        note_change()

    def forget_pictures(self: Any) -> None:
        """Discard the scene, so that the next picture shows the whole state as it then is."""
        self._pictures.forget()
        note_change()


def _refuse_name(world: Any, name: str) -> Any:
    raise missing_name(world, name, INSTEAD)


define_names(MiniworldCompat, INSTEAD, _refuse_name)
