"""Adapters for worlds built like Minigrid's or Miniworld's, without importing either package.

They give pose, map, hashes, save and restore. A world is Minigrid-like if it has a `grid` of cells, an `agent_pos` and
an `agent_dir`; it is Miniworld-like if it has an `agent` with `pos` and `dir`, `rooms` and `entities`.
"""

import abc
import copy
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import RGB_BY_COLOUR, hex_colour
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose, Thing, wall_outlines

_YAW_RAD = (0.0, -math.pi / 2, math.pi, math.pi / 2)  # right, down, left, up
_MINIGRID_COLOURS = {
    "red": "#ff0000",
    "green": "#00ff00",
    "blue": "#0000ff",
    "purple": "#7027c3",
    "yellow": "#ffff00",
    "grey": "#646464",
}


def is_minigrid_like(env: Any) -> bool:
    """Return whether an unwrapped environment stores its state as Minigrid's environments do."""
    has_attributes = all(hasattr(env, name) for name in ("grid", "agent_pos", "agent_dir", "get_frame"))
    return has_attributes and hasattr(env.grid, "encode")


class _Adapter(NativeWorld):
    """An environment with the interface of native worlds; the environment keeps the state."""

    def __init__(self, env: Any) -> None:
        self._env = env

    def state_hash(self) -> int:
        """Return a hash of everything that determines the environment's future, including its random stream."""
        return hash64(self._scene() | {"steps": int(self._env.step_count)})

    def scene_hash(self) -> int:
        """Return the hash of the state without the step count."""
        return hash64(self._scene())

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Make a step and return reward, terminated and truncated; the environment also computes an observation."""
        _, reward, terminated, truncated, _ = self._env.step(action)
        return float(reward), bool(terminated), bool(truncated)

    @abc.abstractmethod
    def _scene(self) -> dict[str, Any]:
        """Return the parts of the state to hash, apart from the step count."""


class MinigridAdapter(_Adapter):
    """A Minigrid-like environment.

    Its hash covers cells, box contents, pose, carried object, mission, random stream and steps.
    """

    def pose(self) -> Pose:
        """Return the agent's pose: column, 0, row and heading."""
        column, row = self._env.agent_pos
        return Pose(x=float(column), y=0.0, z=float(row), yaw_rad=_YAW_RAD[int(self._env.agent_dir)])

    def map(self) -> Map:
        """Return the floor plan: walls are the outlines of wall cells, and the contents of other cells are things."""
        grid = self._env.grid
        is_wall = np.zeros((grid.width, grid.height), dtype=np.bool_)
        things: list[Thing] = []
        for row in range(grid.height):
            for column in range(grid.width):
                cell = grid.get(column, row)
                if cell is None:
                    continue
                if cell.type == "wall":
                    is_wall[column, row] = True
                else:
                    colour = _MINIGRID_COLOURS.get(cell.color, "#646464")
                    things.append(Thing(f"{cell.color} {cell.type}", float(column), float(row), 0.5, colour))
        return Map("cell", (-0.5, -0.5, grid.width - 0.5, grid.height - 0.5), wall_outlines(is_wall), tuple(things))

    def _scene(self) -> dict[str, Any]:
        """Return the parts of the state that determine the future, apart from the step count."""
        env = self._env
        containers = (cell for cell in env.grid.grid if cell is not None and cell.contains is not None)
        contents = [_encode_with_contents(container) for container in containers]
        return {
            "cells": env.grid.encode(),
            "contents": contents,
            "agent": [int(env.agent_pos[0]), int(env.agent_pos[1]), int(env.agent_dir)],
            "carrying": _encode_with_contents(env.carrying),
            "mission": str(env.mission),
            "random": env.np_random.bit_generator.state,
        }

    def save(self) -> Any:
        """Return a deep copy of the environment's attributes."""
        return copy.deepcopy(vars(self._env))

    def restore(self, saved: Any) -> None:
        """Restore the environment's attributes from a copy of the saved ones."""
        if not isinstance(saved, dict):
            raise WorldError(f"{saved!r} was not saved by this world; pass what save() returned")
        vars(self._env).clear()
        vars(self._env).update(copy.deepcopy(saved))

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the environment's own picture, uint8[H, W, 3], with the largest tiles that fit into ``size_px``.

        It has only the classic palette.
        """
        env = self._env
        if view == "partial":
            columns, rows = env.agent_view_size, env.agent_view_size
        else:
            columns, rows = env.width, env.height
        tile_px = max(1, min(size_px[0] // columns, size_px[1] // rows))
        return np.asarray(env.get_frame(env.highlight, tile_px, view == "partial"), dtype=np.uint8)


def _encode_with_contents(thing: Any) -> list[Any] | None:
    """Return an object's code and, recursively, those of its contents; None for no object."""
    if thing is None:
        return None
    return [[int(code) for code in thing.encode()], _encode_with_contents(thing.contains)]


_MINIWORLD_COLOURS = {name: hex_colour(rgb) for name, rgb in RGB_BY_COLOUR.items()}


def is_miniworld_like(env: Any) -> bool:
    """Return whether an unwrapped environment stores its state as Miniworld's environments do."""
    return all(hasattr(env, name) for name in ("agent", "rooms", "entities", "render_obs", "render_top_view"))


class MiniworldAdapter(_Adapter):
    """A Miniworld-like environment.

    Its hash covers the entities, the agent among them, walls, the carried object, the random stream and steps.
    """

    def pose(self) -> Pose:
        """Return the agent's position and direction, exactly as the environment has them."""
        x, y, z = self._env.agent.pos
        return Pose(float(x), float(y), float(z), float(self._env.agent.dir))

    def map(self) -> Map:
        """Return the floor plan, with the walls that stop the agent and all entities but the agent."""
        env = self._env
        walls = tuple((float(a[0]), float(a[2]), float(b[0]), float(b[2])) for a, b in env.wall_segs)
        things = tuple(_describe_entity(entity) for entity in env.entities if entity is not env.agent)
        return Map("m", (float(env.min_x), float(env.min_z), float(env.max_x), float(env.max_z)), walls, things)

    def _scene(self) -> dict[str, Any]:
        """Return the parts of the state that determine the future, apart from the step count."""
        env = self._env
        carrying = env.agent.carrying
        return {
            "entities": [_entity_state(entity) for entity in env.entities],
            "walls": np.asarray(env.wall_segs, dtype=np.float64),
            "carrying": -1 if carrying is None else env.entities.index(carrying),
            "random": env.np_random.bit_generator.state,
        }

    def save(self) -> Any:
        """Raise WorldError, since the state is tied to an OpenGL context and cannot be copied."""
        raise WorldError(
            f"{type(self._env).__name__} cannot be saved in the middle of an episode; use the minihuman/ world of the "
            "same name"
        )

    def restore(self, saved: Any) -> None:
        """Raise WorldError, since no state can have been saved."""
        self.save()

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the environment's own picture, uint8[H, W, 3], in the size and palette with which it was made."""
        if view == "partial":
            draw = self._env.render_obs
        else:
            draw = self._env.render_top_view
        return np.asarray(draw(self._env.vis_fb), dtype=np.uint8)


def _entity_state(entity: Any) -> list[Any]:
    """Return the class, position, direction, radius and height of a Miniworld entity, for a hash."""
    position = [float(coordinate) for coordinate in entity.pos]
    return [type(entity).__name__, position, float(entity.dir), float(entity.radius), float(entity.height)]


def _describe_entity(entity: Any) -> Thing:
    """Return a Miniworld entity as a thing on the floor plan."""
    colour = getattr(entity, "color", "grey")
    kind = type(entity).__name__.lower()
    if hasattr(entity, "color"):
        name = f"{colour} {kind}"
    else:
        name = kind
    x, _, z = entity.pos
    return Thing(name, float(x), float(z), float(entity.radius), _MINIWORLD_COLOURS.get(colour, "#636363"))
