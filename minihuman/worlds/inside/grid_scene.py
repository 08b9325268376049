"""A grid world's state as a scene: walls between cells, doors, things on the floor. A cell is a metre wide."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person.render.scene import BoxLook, Look, MeshLook, SceneRoom, Surface
from minihuman.worlds.grid.art.palettes import colour_rgb
from minihuman.worlds.grid.core import cells
from minihuman.worlds.grid.core.own import OWN
from minihuman.worlds.grid.core.state import State
from minihuman.worlds.grid.kinds import Block, Kind, Shape

WALL_HEIGHT_M = 1.1
_DOOR_M = 0.08  # how thick a door is
_KNOB_M = 0.36  # from the middle of a door
_TILE_M = 0.02  # how thick what lies flat on the floor is
_ZOOM = 1.6  # of bricks: they are made for walls of full height
_CARRIED_AHEAD_M = 0.3  # of the agent's eye
_CARRIED_LOW_M = 0.18

Place = tuple[float, float, float, float]  # x, y, z, yaw_rad


@dataclass(frozen=True, slots=True)
class Seen:
    """One look and where it stands."""

    look: Look
    place: Place


def walled(state: State) -> NDArray[np.bool_]:
    """Which cells are wall, [x, z]."""
    return np.array([[cells.kind_of(code) == cells.WALL for code in column] for column in state.cells.tolist()])


def rooms(state: State) -> tuple[SceneRoom, ...]:
    """The whole grid as one room, with the walls as surfaces in it; a run of walls is one surface."""
    wall = walled(state)
    width, height = wall.shape
    x0, x1, z0, z1 = -0.5, width - 0.5, -0.5, height - 0.5
    outline = np.array(((x1, z1), (x1, z0), (x0, z0), (x0, z1)))
    surfaces = [_level(outline, 0.0, "floor_tiles_bw_1"), _level(outline[::-1], WALL_HEIGHT_M, "concrete_tiles_1")]
    for z in range(height + 1):
        above, below = _row(wall, z - 1), _row(wall, z)
        surfaces += [_upright((end, z - 0.5), (start, z - 0.5)) for start, end in _runs(above & ~below)]
        surfaces += [_upright((start, z - 0.5), (end, z - 0.5)) for start, end in _runs(below & ~above)]
    for x in range(width + 1):
        left, right = _row(wall.T, x - 1), _row(wall.T, x)
        surfaces += [_upright((x - 0.5, start), (x - 0.5, end)) for start, end in _runs(left & ~right)]
        surfaces += [_upright((x - 0.5, end), (x - 0.5, start)) for start, end in _runs(right & ~left)]
    return (SceneRoom(outline, surfaces),)


def things(state: State, palette: Palette, kinds: Sequence[Kind] = ()) -> list[Seen]:
    """Everything but walls, sorted by look and then by place: the looks stay the same while a thing moves."""
    found = []
    for x, z in zip(*np.nonzero(state.cells != cells.EMPTY), strict=True):
        found += _in_cell(state, int(state.cells[x, z]), int(x), int(z), palette, kinds)
    return sorted(found, key=repr)


def carried(
    code: int, eye: tuple[float, float, float], yaw_rad: float, palette: Palette, kinds: Sequence[Kind] = ()
) -> list[Seen]:
    """The thing in the agent's hand, low in the picture."""
    x, y, z = eye
    ahead = _CARRIED_AHEAD_M
    place = x + ahead * np.cos(yaw_rad), y - _CARRIED_LOW_M, z - ahead * np.sin(yaw_rad), yaw_rad
    if cells.kind_of(code) >= OWN:
        return _own(kinds[cells.kind_of(code) - OWN], code, place, palette, height_m=0.08)
    match cells.KINDS[cells.kind_of(code)]:
        case "key" | "ball" as kind:
            return [Seen(MeshLook(f"{kind}_white", 0.08, _rgb(code, palette)), place)]
        case "box":
            return [Seen(BoxLook((0.08, 0.08, 0.08), _rgb(code, palette)), place)]
        case _:
            return []


def _own(kind: Kind, code: int, place: Place, palette: Palette, *, height_m: float | None = None) -> list[Seen]:
    """A thing of a world's own, as large as it is, or as high as it may be in the hand."""
    is_open = kind.opens and cells.state_of(code) == cells.OPEN
    match kind.inside_open if is_open else kind.inside:
        case Block((along, up, deep)):
            scale = 1.0 if height_m is None else height_m / max(along, up, deep)
            return [Seen(BoxLook((along * scale, up * scale, deep * scale), _rgb(code, palette)), place)]
        case Shape(mesh, up):
            return [Seen(MeshLook(mesh, up if height_m is None else height_m, _rgb(code, palette)), place)]
        case _:
            return []


def _in_cell(state: State, code: int, x: int, z: int, palette: Palette, kinds: Sequence[Kind]) -> list[Seen]:
    middle = (float(x), 0.0, float(z), 0.0)
    if cells.kind_of(code) >= OWN:
        return _own(kinds[cells.kind_of(code) - OWN], code, middle, palette)
    match cells.KINDS[cells.kind_of(code)]:
        case "door":
            return _door(state, code, x, z, palette)
        case "key" | "ball" as kind:
            return [Seen(MeshLook(f"{kind}_white", 0.4, _rgb(code, palette)), (*middle[:3], 0.8))]
        case "box":
            return [Seen(BoxLook((0.45, 0.45, 0.45), _rgb(code, palette)), (*middle[:3], 0.4))]
        case "goal" | "lava" | "floor":
            return [Seen(BoxLook((0.98, _TILE_M, 0.98), _rgb(code, palette)), middle)]
        case _:
            return []


def _door(state: State, code: int, x: int, z: int, palette: Palette) -> list[Seen]:
    """A leaf across the way, or turned aside where the door is open; a closed one has a knob, a locked one a bar."""
    colour = _rgb(code, palette)
    yaw = 0.0 if x > 0 and cells.kind_of(int(state.cells[x - 1, z])) == cells.WALL else np.pi / 2
    leaf = BoxLook((1.0, 0.95 * WALL_HEIGHT_M, _DOOR_M), colour)
    match cells.state_of(code):
        case cells.OPEN:
            aside = 0.5 - _DOOR_M / 2
            right, down = (-aside, 0.0) if yaw == 0.0 else (0.0, -aside)
            return [Seen(leaf, (x + right, 0.0, z + down, yaw + np.pi / 2))]
        case cells.LOCKED:
            bar = BoxLook((1.0, 0.12, 1.6 * _DOOR_M), (0.12, 0.12, 0.12))
            return [Seen(leaf, (x, 0.0, z, yaw)), Seen(bar, (x, 0.45 * WALL_HEIGHT_M, z, yaw))]
        case _:
            along, down = (_KNOB_M, 0.0) if yaw == 0.0 else (0.0, _KNOB_M)
            knob = BoxLook((0.08, 0.08, 3 * _DOOR_M), (0.12, 0.12, 0.12))
            return [Seen(leaf, (x, 0.0, z, yaw)), Seen(knob, (x + along, 0.45 * WALL_HEIGHT_M, z + down, yaw))]


def _rgb(code: int, palette: Palette) -> tuple[float, float, float]:
    red, green, blue = colour_rgb(code, palette)
    return red / 255, green / 255, blue / 255


def _row(wall: NDArray[np.bool_], z: int) -> NDArray[np.bool_]:
    """Which cells of a row are wall; outside the grid everything is."""
    return wall[:, z] if 0 <= z < wall.shape[1] else np.ones(wall.shape[0], np.bool_)


def _runs(marked: NDArray[np.bool_]) -> list[tuple[float, float]]:
    """Where each unbroken run of marked cells begins and ends."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], marked, [False])).astype(np.int8)))
    return [(start - 0.5, end - 0.5) for start, end in edges.reshape(-1, 2).tolist()]


def _level(outline: NDArray[np.float64], y: float, texture: str) -> Surface:
    corners = np.column_stack((outline[:, 0], np.full(len(outline), y), outline[:, 1]))
    return Surface(corners, outline + 0.5, texture)


def _upright(start: tuple[float, float], end: tuple[float, float]) -> Surface:
    """A wall from one (x, z) to another, seen from its left."""
    (ax, az), (bx, bz) = start, end
    length, top = abs(bx - ax) + abs(bz - az), WALL_HEIGHT_M
    corners = np.array(((ax, 0.0, az), (ax, top, az), (bx, top, bz), (bx, 0.0, bz)))
    across = np.array(((0.0, 0.0), (0.0, top), (length, top), (length, 0.0)))
    return Surface(corners, across * _ZOOM, "brick_wall_1")
