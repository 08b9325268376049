"""A grid world seen from inside: the same state, rules, actions and rewards, another picture."""

import math
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Bounds, NativeWorld, Palette, View
from minihuman.worlds.first_person.compile_apart import colours, faces
from minihuman.worlds.first_person.library import library, library_lock
from minihuman.worlds.first_person.render.draw import render
from minihuman.worlds.first_person.render.layout import lay_out
from minihuman.worlds.first_person.render.scene import Camera, Look, Scene, SceneRoom
from minihuman.worlds.grid.compile_apart import moves, steps
from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.state import State
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.kinds import Kind
from minihuman.worlds.inside.grid_scene import Seen, carried, rooms, things, walled
from minihuman.worlds.options import MOST_PIXELS, whole
from minihuman.worlds.pose import Map, Pose

_EYE_M = 0.6  # above the floor
_BACK_M = 0.4  # the eye stands so far behind the middle of its cell, so that a wall ahead is not a blur
_FOV_Y_DEG = 60.0


class GridFromInside(gymnasium.Env[dict[str, Any], int], NativeWorld):
    """A grid world whose observation's "image" is what the agent would see, uint8[obs_height, obs_width, 3].

    Args:
        grid: the world; it keeps the state.
        obs_width: width of the observation's picture in pixels.
        obs_height: height of the observation's picture in pixels.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own way to declare it
    compile_apart = moves, colours, steps, faces

    def __init__(self, grid: GridEngine, *, obs_width: int = 80, obs_height: int = 60) -> None:
        whole("obs_width", obs_width, 1, MOST_PIXELS)
        whole("obs_height", obs_height, 1, MOST_PIXELS)
        self.grid = grid
        self.size_px = (obs_width, obs_height)
        if grid.render_mode == "ansi":
            raise WorldError("render_mode is 'ansi'; a grid seen from inside renders as 'rgb_array'")
        self.render_mode = grid.render_mode
        self.action_names = grid.action_names
        self.action_space = grid.action_space
        spaces = dict(grid.observation_space.spaces)  # type: ignore[attr-defined]
        spaces["image"] = gymnasium.spaces.Box(0, 255, (obs_height, obs_width, 3), np.uint8)
        self.observation_space = gymnasium.spaces.Dict(spaces)
        self._drawn = _Drawn(grid.kinds)

    @property
    def mission(self) -> str:
        """What to do, in words."""
        return self.grid.mission

    @property
    def max_steps(self) -> int:
        """The grid's."""
        return self.grid.max_steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode, the grid's own for that seed."""
        super().reset(seed=seed)
        observation, info = self.grid.reset(seed=seed, options=options)
        return self._seen(observation), info

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act as in the grid."""
        observation, reward, terminated, truncated, info = self.grid.step(action)
        return self._seen(observation), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """What the agent sees, 800 x 600; None without a render mode."""
        return None if self.render_mode is None else self.picture(size_px=(800, 600))

    def pose(self) -> Pose:
        """The agent's cell and direction."""
        return self.grid.pose()

    def map(self) -> Map:
        """The grid's floor plan."""
        return self.grid.map()

    def clauses(self) -> tuple[tuple[str, int], ...]:
        """The grid's."""
        return self.grid.clauses()

    def state_hash(self) -> int:
        """The grid's."""
        return self.grid.state_hash()

    def scene_hash(self) -> int:
        """The grid's."""
        return self.grid.scene_hash()

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """The grid's step without an observation."""
        return self.grid.advance(action)

    def way(self) -> Sequence[int] | None:
        """The grid's."""
        return self.grid.way()

    def bounds(self) -> Bounds:
        """The grid's."""
        return self.grid.bounds()

    def save(self) -> Any:
        """The grid's exact state."""
        return self.grid.save()

    def restore(self, saved: Any) -> None:
        """Go back to a saved state of the grid, however it was seen."""
        self.grid.restore(saved)

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """What the agent sees, exactly ``size_px`` (width, height); ``full`` is the grid's own plan from above."""
        if view == "full":
            return self.grid.picture(view=view, size_px=size_px, palette=palette)
        return self._draw(self.grid.pose(), size_px, palette)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_drawn": _Drawn(self.grid.kinds)}

    def _seen(self, observation: dict[str, Any]) -> dict[str, Any]:
        return observation | {"image": self._draw(self.grid.pose(), self.size_px, "classic")}

    def _draw(self, pose: Pose, size_px: tuple[int, int], palette: Palette) -> NDArray[np.uint8]:
        back_x, back_z = _BACK_M * math.cos(pose.yaw_rad), _BACK_M * math.sin(pose.yaw_rad)
        eye = (pose.x - back_x, _EYE_M, pose.z + back_z)
        scene = self._drawn.scene(self.grid.state, eye, pose.yaw_rad, palette)
        return render(scene, Camera(eye, pose.yaw_rad, fov_y_deg=_FOV_Y_DEG), *size_px)


class _Drawn:
    """What was laid out for the last picture, to be used again as far as nothing has changed."""

    def __init__(self, kinds: tuple[Kind, ...]) -> None:
        self._kinds = kinds
        self._rooms: tuple[bytes, tuple[SceneRoom, ...]] = (b"", ())
        self._things: tuple[bytes, Palette, list[Seen]] = (b"", "classic", [])
        self._scene: tuple[list[Look], Scene] | None = None

    def scene(self, state: State, eye: tuple[float, float, float], yaw_rad: float, palette: Palette) -> Scene:
        """The scene of a state, with what is carried before the eye."""
        if (state.cells.tobytes(), palette) != self._things[:2]:
            self._things = state.cells.tobytes(), palette, things(state, palette, self._kinds)
            walls = walled(state).tobytes()
            if walls != self._rooms[0]:
                self._rooms, self._scene = (walls, rooms(state)), None
        seen = self._things[2]
        if state.carrying != cells.EMPTY:
            seen = seen + carried(state.carrying, eye, yaw_rad, palette, self._kinds)
        looks = [thing.look for thing in seen]
        if self._scene is None or self._scene[0] != looks:
            with library_lock:
                self._scene = looks, lay_out(self._rooms[1], looks, library=library(None))
        return self._scene[1].at(np.array([thing.place for thing in seen], dtype=np.float64).reshape(-1, 4))


def first_person(grid: GridEngine, view: str, **options: Any) -> GridFromInside:
    """The grid seen from inside, for ``gymnasium.make(..., view="first_person")``.

    Raises:
        WorldError: if the view is another one.
    """
    if view != "first_person":
        raise WorldError(f"view is {view!r}; a grid world is seen from above ('grid') or from inside ('first_person')")
    return GridFromInside(grid, **options)
