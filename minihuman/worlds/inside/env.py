"""A grid world seen from inside: the same state, rules, actions and rewards, drawn in first person.

The grid's state becomes a scene of walls between cells, doors, and objects on the floor; a cell is one metre wide.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.first_person.render.asset_files import asset_library, library_lock
from minihuman.worlds.first_person.render.drawing import render
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    Camera,
    Look,
    MeshLook,
    Scene,
    SceneRoom,
    Surface,
    build_scene,
)
from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.state import FIRST_OWN_KIND, State
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.object_kinds import BlockShape, MeshShape, ObjectKind
from minihuman.worlds.grid.pictures.tiles import colour_rgb
from minihuman.worlds.human_window import ShowsItself
from minihuman.worlds.options import MAX_PIXELS, check_whole
from minihuman.worlds.pose import Pose

WALL_HEIGHT_M = 1.1
_DOOR_M = 0.08  # the thickness of a door
_KNOB_M = 0.36  # the distance of a knob from the middle of its door
_TILE_M = 0.02  # the thickness of goals, lava and coloured floor
_ZOOM = 1.6  # of the brick texture, which is made for walls of full height
_CARRIED_AHEAD_M = 0.3  # how far ahead of the agent's eye a carried object is
_CARRIED_LOW_M = 0.18  # how far below the eye it is
_CARRIED_SIZE_M = 0.08  # its height

Place = tuple[float, float, float, float]  # x, y, z, yaw_rad


@dataclass(frozen=True, slots=True)
class PlacedLook:
    """The look of one thing and its place."""

    look: Look
    place: Place


def find_walls(state: State) -> NDArray[np.bool_]:
    """Return which cells are walls, bool[x, z]."""
    return np.array([[cells.kind_of(code) == cells.WALL for code in column] for column in state.cells.tolist()])


def build_rooms(state: State) -> tuple[SceneRoom, ...]:
    """Return the whole grid as one room with the walls as surfaces; adjoining walls are one surface."""
    wall = find_walls(state)
    width, height = wall.shape
    x0 = -0.5
    x1 = width - 0.5
    z0 = -0.5
    z1 = height - 0.5
    outline = np.array(((x1, z1), (x1, z0), (x0, z0), (x0, z1)))
    surfaces = [
        _level_surface(outline, 0.0, "floor_tiles_bw_1"),
        _level_surface(outline[::-1], WALL_HEIGHT_M, "concrete_tiles_1"),
    ]
    # each wall has a surface where it borders on a free cell, drawn in the direction that makes it visible from there
    for z in range(height + 1):
        above = _wall_row(wall, z - 1)
        below = _wall_row(wall, z)
        surfaces += [_wall_surface((end, z - 0.5), (start, z - 0.5)) for start, end in _find_runs(above & ~below)]
        surfaces += [_wall_surface((start, z - 0.5), (end, z - 0.5)) for start, end in _find_runs(below & ~above)]
    for x in range(width + 1):
        left = _wall_row(wall.T, x - 1)
        right = _wall_row(wall.T, x)
        surfaces += [_wall_surface((x - 0.5, start), (x - 0.5, end)) for start, end in _find_runs(left & ~right)]
        surfaces += [_wall_surface((x - 0.5, end), (x - 0.5, start)) for start, end in _find_runs(right & ~left)]
    return (SceneRoom(outline, surfaces),)


def build_things(state: State, palette: Palette, kinds: Sequence[ObjectKind] = ()) -> list[PlacedLook]:
    """Return everything but walls, sorted by look and then by place; looks stay the same while a thing moves."""
    things = []
    for x, z in zip(*np.nonzero(state.cells != cells.EMPTY), strict=True):
        things += _build_cell(state, int(state.cells[x, z]), int(x), int(z), palette, kinds)
    return sorted(things, key=repr)


def build_carried(
    code: int, eye: tuple[float, float, float], yaw_rad: float, palette: Palette, kinds: Sequence[ObjectKind] = ()
) -> list[PlacedLook]:
    """Return the look of the object in the agent's hand, placed low in the picture; [] for one without a look.

    Args:
        code: the object's code in the grid's state.
        eye: x, y and z of the agent's eye in metres.
        yaw_rad: the direction of view.
        palette: the palette of the object's colour.
        kinds: the world's own object kinds.
    """
    x, y, z = eye
    ahead = _CARRIED_AHEAD_M
    size_m = _CARRIED_SIZE_M
    place = x + ahead * np.cos(yaw_rad), y - _CARRIED_LOW_M, z - ahead * np.sin(yaw_rad), yaw_rad
    if cells.kind_of(code) >= FIRST_OWN_KIND:
        return _look_of_own_kind(kinds[cells.kind_of(code) - FIRST_OWN_KIND], code, place, palette, height_m=size_m)
    match cells.KINDS[cells.kind_of(code)]:
        case "key" | "ball" as kind:
            return [PlacedLook(MeshLook(f"{kind}_white", size_m, _rgb(code, palette)), place)]
        case "box":
            return [PlacedLook(BoxLook((size_m, size_m, size_m), _rgb(code, palette)), place)]
        case _:
            return []


def _look_of_own_kind(
    kind: ObjectKind, code: int, place: Place, palette: Palette, *, height_m: float | None = None
) -> list[PlacedLook]:
    """Return the look of a custom object kind at a place; [] if the kind has no look from inside.

    The look has its own size, or is scaled to ``height_m``, the height of a carried object in metres.
    """
    is_open = kind.opens and cells.state_of(code) == cells.OPEN
    match kind.inside_open if is_open else kind.inside:
        case BlockShape((along, up, deep)):
            if height_m is None:
                scale = 1.0
            else:
                scale = height_m / max(along, up, deep)
            return [PlacedLook(BoxLook((along * scale, up * scale, deep * scale), _rgb(code, palette)), place)]
        case MeshShape(mesh, up):
            return [PlacedLook(MeshLook(mesh, up if height_m is None else height_m, _rgb(code, palette)), place)]
        case _:
            return []


def _build_cell(
    state: State, code: int, x: int, z: int, palette: Palette, kinds: Sequence[ObjectKind]
) -> list[PlacedLook]:
    """Return the looks of the object in a cell, with their places."""
    middle = (float(x), 0.0, float(z), 0.0)
    if cells.kind_of(code) >= FIRST_OWN_KIND:
        return _look_of_own_kind(kinds[cells.kind_of(code) - FIRST_OWN_KIND], code, middle, palette)
    match cells.KINDS[cells.kind_of(code)]:
        case "door":
            return _build_door(state, code, x, z, palette)
        case "key" | "ball" as kind:
            return [PlacedLook(MeshLook(f"{kind}_white", 0.4, _rgb(code, palette)), (*middle[:3], 0.8))]
        case "box":
            return [PlacedLook(BoxLook((0.45, 0.45, 0.45), _rgb(code, palette)), (*middle[:3], 0.4))]
        case "goal" | "lava" | "floor":
            return [PlacedLook(BoxLook((0.98, _TILE_M, 0.98), _rgb(code, palette)), middle)]
        case _:
            return []


def _build_door(state: State, code: int, x: int, z: int, palette: Palette) -> list[PlacedLook]:
    """Return the parts of a door: a leaf, turned aside if it is open, with a knob if closed and a bar if locked."""
    colour = _rgb(code, palette)
    # a closed leaf spans the gap in its wall: along x beside a wall cell, otherwise along z
    if x > 0 and cells.kind_of(int(state.cells[x - 1, z])) == cells.WALL:
        yaw = 0.0
    else:
        yaw = np.pi / 2
    leaf = BoxLook((1.0, 0.95 * WALL_HEIGHT_M, _DOOR_M), colour)
    match cells.state_of(code):
        case cells.OPEN:
            aside = 0.5 - _DOOR_M / 2
            right, down = (-aside, 0.0) if yaw == 0.0 else (0.0, -aside)
            return [PlacedLook(leaf, (x + right, 0.0, z + down, yaw + np.pi / 2))]
        case cells.LOCKED:
            # a dark bar across the door, thicker than the leaf, below half its height
            bar = BoxLook((1.0, 0.12, 1.6 * _DOOR_M), (0.12, 0.12, 0.12))
            return [PlacedLook(leaf, (x, 0.0, z, yaw)), PlacedLook(bar, (x, 0.45 * WALL_HEIGHT_M, z, yaw))]
        case _:
            along, down = (_KNOB_M, 0.0) if yaw == 0.0 else (0.0, _KNOB_M)
            # a dark knob that stands out on both sides of the leaf
            knob = BoxLook((0.08, 0.08, 3 * _DOOR_M), (0.12, 0.12, 0.12))
            return [
                PlacedLook(leaf, (x, 0.0, z, yaw)),
                PlacedLook(knob, (x + along, 0.45 * WALL_HEIGHT_M, z + down, yaw)),
            ]


def _rgb(code: int, palette: Palette) -> tuple[float, float, float]:
    red, green, blue = colour_rgb(code, palette)
    return red / 255, green / 255, blue / 255


def _wall_row(wall: NDArray[np.bool_], z: int) -> NDArray[np.bool_]:
    """Return which cells of a row are walls; outside the grid, all are."""
    if 0 <= z < wall.shape[1]:
        return wall[:, z]
    return np.ones(wall.shape[0], np.bool_)


def _find_runs(marked: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Return the start and end of each unbroken run of marked cells; cell i reaches from i - 0.5 to i + 0.5."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    return [(start - 0.5, end - 0.5) for start, end in edges.reshape(-1, 2).tolist()]


def _level_surface(outline: NDArray[np.float64], y: float, texture: str) -> Surface:
    corners = np.column_stack((outline[:, 0], np.full(len(outline), y), outline[:, 1]))
    return Surface(corners, outline + 0.5, texture)


def _wall_surface(start: tuple[float, float], end: tuple[float, float]) -> Surface:
    """Return a wall from one point (x, z) to another, visible from its left side."""
    ax, az = start
    bx, bz = end
    length = abs(bx - ax) + abs(bz - az)
    top = WALL_HEIGHT_M
    corners = np.array(((ax, 0.0, az), (ax, top, az), (bx, top, bz), (bx, 0.0, bz)))
    across = np.array(((0.0, 0.0), (0.0, top), (length, top), (length, 0.0)))
    return Surface(corners, across * _ZOOM, "brick_wall_1")


_EYE_M = 0.6  # above the floor
_BACK_M = 0.4  # how far the eye is behind the middle of its cell, so that a wall ahead is not a blur
_FOV_Y_DEG = 60.0


def _delegate_to_grid(name: str) -> Any:
    """Return a method that calls the grid's method of the same name."""

    @wraps(getattr(GridEngine, name))
    def answer(self: "GridFromInside", *args: Any) -> Any:
        return getattr(self.grid, name)(*args)

    return answer


class GridFromInside(ShowsItself, gymnasium.Env[dict[str, Any], int], NativeWorld):
    """A grid world whose observation's "image" is the agent's first-person view, uint8[obs_height, obs_width, 3].

    Args:
        grid: the grid world, which keeps the state
        obs_width: the width of the observed picture in pixels
        obs_height: the height of the observed picture in pixels
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's own way to declare it

    def __init__(self, grid: GridEngine, *, obs_width: int = 80, obs_height: int = 60) -> None:
        check_whole("obs_width", obs_width, 1, MAX_PIXELS)
        check_whole("obs_height", obs_height, 1, MAX_PIXELS)
        self.grid = grid
        self.size_px = (obs_width, obs_height)
        if grid.render_mode == "ansi":
            raise WorldError("a first-person grid cannot be rendered as 'ansi'; use render_mode='rgb_array'")
        self.render_mode = grid.render_mode
        self.action_names = grid.action_names
        self.action_space = grid.action_space
        spaces = dict(grid.observation_space.spaces)  # type: ignore[attr-defined]
        spaces["image"] = gymnasium.spaces.Box(0, 255, (obs_height, obs_width, 3), np.uint8)
        self.observation_space = gymnasium.spaces.Dict(spaces)
        self._renderer = _SceneRenderer(grid.kinds)

    @property
    def mission(self) -> str:
        """Return the episode's task in words."""
        return self.grid.mission

    @property
    def max_steps(self) -> int:
        """Return the grid's step limit per episode."""
        return self.grid.max_steps

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin a new episode of the grid from the seed; return the observation with the first-person picture."""
        super().reset(seed=seed)
        observation, info = self.grid.reset(seed=seed, options=options)
        return self._show(self._with_view(observation)), info

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Step the grid world; return its results with the first-person picture."""
        observation, reward, terminated, truncated, info = self.grid.step(action)
        return self._show(self._with_view(observation)), reward, terminated, truncated, info

    def render(self) -> NDArray[np.uint8] | None:
        """Return the agent's view at 800 x 600; None without a render mode, or after showing it in a window."""
        if self.render_mode == "human":
            self.show_in_window(self._rendered)
            return None
        if self.render_mode is None:
            return None
        return self._rendered()

    def _rendered(self) -> NDArray[np.uint8]:
        return self.picture(size_px=(800, 600))

    def _show(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Show the view in a window if the render mode is "human"; return the observation unchanged."""
        if self.render_mode == "human":
            self.render()
        return observation

    pose, map, subgoals, advance = (_delegate_to_grid(name) for name in ("pose", "map", "subgoals", "advance"))
    state_hash, scene_hash = (_delegate_to_grid(name) for name in ("state_hash", "scene_hash"))
    shortest_path, path_length_bounds = (_delegate_to_grid(name) for name in ("shortest_path", "path_length_bounds"))
    save, restore = (_delegate_to_grid(name) for name in ("save", "restore"))

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the agent's view in exactly ``size_px`` (width, height); "full" is the grid's plan from above."""
        if view == "full":
            return self.grid.picture(view=view, size_px=size_px, palette=palette)
        return self._draw(self.grid.pose(), size_px, palette)

    def __getstate__(self) -> dict[str, Any]:
        return vars(self) | {"_renderer": _SceneRenderer(self.grid.kinds)}

    def _with_view(self, observation: dict[str, Any]) -> dict[str, Any]:
        """Return the grid's observation with the view from inside as its image."""
        return observation | {"image": self._draw(self.grid.pose(), self.size_px, "classic")}

    def _draw(self, pose: Pose, size_px: tuple[int, int], palette: Palette) -> NDArray[np.uint8]:
        """Draw the view from a pose, with the eye slightly behind the cell's centre."""
        back_x = _BACK_M * math.cos(pose.yaw_rad)
        back_z = _BACK_M * math.sin(pose.yaw_rad)
        eye = (pose.x - back_x, _EYE_M, pose.z + back_z)
        scene = self._renderer.scene(self.grid.state, eye, pose.yaw_rad, palette)
        return render(scene, Camera(eye, pose.yaw_rad, fov_y_deg=_FOV_Y_DEG), *size_px)


class _SceneRenderer:
    """A cache of the last picture's scene, of which the parts that have not changed are used again."""

    def __init__(self, kinds: tuple[ObjectKind, ...]) -> None:
        self._kinds = kinds
        self._rooms: tuple[bytes, tuple[SceneRoom, ...]] = (b"", ())
        self._things: tuple[bytes, Palette, list[PlacedLook]] = (b"", "classic", [])
        self._scene: tuple[list[Look], Scene] | None = None

    def scene(self, state: State, eye: tuple[float, float, float], yaw_rad: float, palette: Palette) -> Scene:
        """Return the scene of a state, with the carried object in front of the eye."""
        if (state.cells.tobytes(), palette) != self._things[:2]:
            self._things = state.cells.tobytes(), palette, build_things(state, palette, self._kinds)
            walls = find_walls(state).tobytes()
            if walls != self._rooms[0]:
                self._rooms = (walls, build_rooms(state))
                self._scene = None
        things = self._things[2]
        if state.carrying != cells.EMPTY:
            things = things + build_carried(state.carrying, eye, yaw_rad, palette, self._kinds)
        looks = [thing.look for thing in things]
        if self._scene is None or self._scene[0] != looks:
            with library_lock:
                self._scene = looks, build_scene(self._rooms[1], looks, library=asset_library(None))
        return self._scene[1].at(np.array([thing.place for thing in things], dtype=np.float64).reshape(-1, 4))


def view_first_person(grid: GridEngine, view: str, **options: Any) -> GridFromInside:
    """Return a grid seen from inside, for ``gymnasium.make(..., view="first_person")``.

    Raises:
        WorldError: if the view is another one.
    """
    if view != "first_person":
        raise WorldError(f"view is {view!r}; use 'grid' (from above) or 'first_person' (from inside)")
    return GridFromInside(grid, **options)
