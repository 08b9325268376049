"""Miniworld's names for what a first-person world is, to read: code written for Miniworld's worlds keeps running.

They are views of the present state; setting one changes nothing in the world. Positions are tuples, not arrays:
``np.subtract(agent.pos, box.pos)``.
"""

import math
from collections.abc import Sequence
from enum import IntEnum
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import ReadOnlyName
from minihuman.worlds.first_person.entities import Entity, Length
from minihuman.worlds.first_person.rooms import Room
from minihuman.worlds.first_person.state import WALL


@lru_cache
def _actions(names: tuple[str, ...]) -> type[IntEnum]:
    return IntEnum("Actions", names, start=0)  # type: ignore[return-value]  # mypy reads only written-out names


class MiniworldCompat:
    """Mixed into every first-person world."""

    @ReadOnlyName
    def actions(self: Any) -> type[IntEnum]:
        """The world's actions by name; those that it does not take are not among them."""
        return _actions(self.action_names)

    @ReadOnlyName
    def rooms(self: Any) -> list[Room]:
        """The rooms in the order they were added, passages between them included."""
        return list(self.stage.rooms)

    @ReadOnlyName
    def wall_segs(self: Any) -> NDArray[np.float64]:
        """Walls that stop a body, float64[n, 2, 3]: where each starts and ends, x, 0, z."""
        ends = self.stage.floor.walls.reshape(-1, 2, 2)
        return np.insert(ends, 1, 0.0, axis=2)

    @ReadOnlyName
    def min_x(self: Any) -> float:
        """Where the rooms begin along x, metres."""
        return float(self.stage.floor.bounds[0])

    @ReadOnlyName
    def min_z(self: Any) -> float:
        """Where the rooms begin along z, metres."""
        return float(self.stage.floor.bounds[1])

    @ReadOnlyName
    def max_x(self: Any) -> float:
        """Where the rooms end along x, metres."""
        return float(self.stage.floor.bounds[2])

    @ReadOnlyName
    def max_z(self: Any) -> float:
        """Where the rooms end along z, metres."""
        return float(self.stage.floor.bounds[3])

    @ReadOnlyName
    def max_episode_steps(self: Any) -> float:
        """Steps after which an episode is truncated; infinity for never."""
        return math.inf if self.max_steps is None else float(self.max_steps)

    @ReadOnlyName
    def max_forward_step(self: Any) -> float:
        """The longest step, metres."""
        return float(self.stage.reach)

    def intersect(self: Any, ent: Entity, pos: Sequence[float], radius: Length) -> Entity | Literal[True] | None:
        """What a thing of this radius would touch at a place (x, y, z): True for a wall, another thing, or None."""
        found: Entity | str | None = self.stage.blocker(ent, float(pos[0]), float(pos[2]), radius)
        return found if isinstance(found, Entity) else True if found == WALL else None

    def render_obs(self: Any) -> NDArray[np.uint8]:
        """What the agent sees: `see`."""
        return np.asarray(self.see())

    def render_top_view(self: Any) -> NDArray[np.uint8]:
        """The world from above, of the size that `render` draws."""
        return np.asarray(self.picture(view="full", size_px=self.window_px))

    def render_depth(self: Any) -> NDArray[np.float32]:
        """How far away what the agent sees is, metres, float32[obs_height, obs_width, 1]: `depth`."""
        height, width, _ = self.see().shape
        return np.asarray(self.depth(size_px=(width, height)))[..., None]

    def get_visible_ents(self: Any) -> set[Entity]:
        """The things of which some part is in the agent's view: `visible_entities`."""
        return set(self.visible_entities())
