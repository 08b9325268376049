"""What we can tell about a world built the way Miniworld's are, without importing Miniworld.

A world counts as one if it has an ``agent`` with ``pos`` and ``dir``, ``rooms`` and ``entities``.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.first_person.colours import COLOURS, hex_colour
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose, Thing

_COLOURS = {name: hex_colour(rgb) for name, rgb in COLOURS.items()}


def is_miniworld_like(env: Any) -> bool:
    """Whether an unwrapped environment keeps its state the way Miniworld's do."""
    return all(hasattr(env, name) for name in ("agent", "rooms", "entities", "render_obs", "render_top_view"))


class MiniworldLike(NativeWorld):
    """A Miniworld-like environment seen through our contract; the environment keeps the state."""

    def __init__(self, env: Any) -> None:
        self._env = env

    def pose(self) -> Pose:
        """The agent's own position and direction, digit for digit."""
        x, y, z = self._env.agent.pos
        return Pose(float(x), float(y), float(z), float(self._env.agent.dir))

    def map(self) -> Map:
        """The walls that stop the agent, and everything that stands in the rooms but the agent."""
        env = self._env
        walls = tuple((float(a[0]), float(a[2]), float(b[0]), float(b[2])) for a, b in env.wall_segs)
        things = tuple(_thing(entity) for entity in env.entities if entity is not env.agent)
        return Map("m", (float(env.min_x), float(env.min_z), float(env.max_x), float(env.max_z)), walls, things)

    def state_hash(self) -> int:
        """Agent, entities, walls, load, step count and the random stream."""
        return hash64(self._scene() | {"steps": int(self._env.step_count)})

    def scene_hash(self) -> int:
        """The same without the step count."""
        return hash64(self._scene())

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step; the environment knows none without an observation."""
        _, reward, terminated, truncated, _ = self._env.step(action)
        return float(reward), bool(terminated), bool(truncated)

    def _scene(self) -> dict[str, Any]:
        env = self._env
        carrying = env.agent.carrying
        return {
            "entities": [_state(entity) for entity in env.entities],
            "walls": np.asarray(env.wall_segs, dtype=np.float64),
            "carrying": -1 if carrying is None else env.entities.index(carrying),
            "random": env.np_random.bit_generator.state,
        }

    def save(self) -> Any:
        """Its state is tied to an OpenGL context and cannot be copied."""
        raise WorldError(
            f"{type(self._env).__name__} cannot be saved in mid-episode; the minihuman/ world of that name can"
        )

    def restore(self, saved: Any) -> None:
        """Nothing can have been saved."""
        self.save()

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """The environment's own drawing, of the size it was made with; only the classic palette."""
        draw = self._env.render_obs if view == "partial" else self._env.render_top_view
        return np.asarray(draw(self._env.vis_fb), dtype=np.uint8)


def _state(entity: Any) -> list[Any]:
    place = [float(value) for value in entity.pos]
    return [type(entity).__name__, place, float(entity.dir), float(entity.radius), float(entity.height)]


def _thing(entity: Any) -> Thing:
    colour = getattr(entity, "color", "grey")
    kind = type(entity).__name__.lower()
    name = f"{colour} {kind}" if hasattr(entity, "color") else kind
    x, _, z = entity.pos
    return Thing(name, float(x), float(z), float(entity.radius), _COLOURS.get(colour, "#636363"))
