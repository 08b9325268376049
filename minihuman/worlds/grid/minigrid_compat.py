"""Minigrid's names for what a grid world is: code written for Minigrid's worlds keeps running.

They are views of the present state, made when they are asked for; there is no second state. `agent_pos`, `agent_dir`,
`carrying`, `grid.set` and `put_obj` write into it; setting any other name changes nothing in the world.
"""

import abc
import builtins
import hashlib
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.contract import ReadOnlyName
from minihuman.worlds.grid.core.cells import (
    DOOR,
    EMPTY,
    GOAL,
    GREY_WALL,
    KINDS,
    LOCKED,
    OPEN,
    STEPS,
    UNSEEN,
    colour_of,
    colours_of,
    identity_of,
    kind_of,
    kinds_of,
    pack,
    state_of,
    states_of,
)
from minihuman.worlds.grid.core.rules import ACTION_NAMES
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    FAILED,
    FIRST_OWN_KIND,
    OBJECTS,
    SEE_THROUGH,
    State,
    X,
    Y,
    contents_index,
    make,
    put,
)
from minihuman.worlds.grid.core.view import see_all, see_size
from minihuman.worlds.grid.object_kinds import ObjectKind, kind_name
from minihuman.worlds.grid.pictures.drawing import draw_grid

Actions = IntEnum("Actions", ACTION_NAMES, start=0)  # type: ignore[misc]  # mypy reads only names that are written out
Place = tuple[int, int]  # column, row
_OF_MINIGRID = "minigrid.core.world_object"


@dataclass(frozen=True, slots=True, eq=False)
class ObjectView:
    """What lies in a cell or in the hand: ``type`` and ``color``, of a door ``is_open`` and ``is_locked``.

    Where Minigrid is imported, it is an instance of Minigrid's class of its kind: ``isinstance(cell, Goal)``.
    """

    type: str
    color: str
    is_open: bool
    is_locked: bool
    cur_pos: Place | None  # None in the hand, in a box, and for the wall outside the grid
    contains: "ObjectView | None"  # of a box
    own: ObjectKind | None  # where it is of a kind of the world's own
    code: int

    @property  # type: ignore[misc]  # isinstance reads it, nothing writes it
    def __class__(self) -> builtins.type:
        return getattr(sys.modules.get(_OF_MINIGRID), self.type.capitalize(), ObjectView)

    def __eq__(self, other: object) -> bool:
        mine = self.code, self.cur_pos, self.contains
        return builtins.type(other) is ObjectView and mine == (other.code, other.cur_pos, other.contains)

    def __hash__(self) -> int:
        return hash((self.code, self.cur_pos))

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectView, tuple(getattr(self, name) for name in ObjectView.__slots__)

    def can_pickup(self) -> bool:
        """Whether it can be carried."""
        return self.own.carried if self.own else self.type in ("key", "ball", "box")

    def can_overlap(self) -> bool:
        """Whether the agent can stand on it."""
        return self.is_open or (self.own.stepped_on if self.own else self.type in ("floor", "goal", "lava"))

    def see_behind(self) -> bool:
        """Whether the agent sees what is behind it."""
        return self.is_open or not (self.own.hides if self.own else self.type in ("wall", "door"))

    def encode(self) -> tuple[int, int, int]:
        """Kind, colour and state as numbers."""
        return kind_of(self.code), colour_of(self.code), state_of(self.code)


class GridView:
    """The cells: ``grid.get(x, y)`` is an `ObjectView`, or None for an empty cell.

    Args:
        state: The world's.
        kinds: The world's own kinds.
        codes: Other cells than the world's, indexed [x, y].
        places: Where each of them lies in the world, x * height + y; -1 outside it.
    """

    def __init__(
        self,
        state: State,
        kinds: Sequence[ObjectKind] = (),
        codes: NDArray[np.int32] | None = None,
        places: NDArray[np.int64] | None = None,
    ) -> None:
        self._state, self._kinds = state, kinds
        self.codes = state.cells if codes is None else codes
        self.places = np.arange(state.cells.size).reshape(state.cells.shape) if places is None else places
        self.width, self.height = self.codes.shape

    @property
    def grid(self) -> list[ObjectView | None]:
        """Every cell, row by row."""
        cells = zip(self.codes.T.ravel().tolist(), self.places.T.ravel().tolist(), strict=True)
        return [None if code == EMPTY else self._view(code, place) for code, place in cells]

    def get(self, i: int, j: int) -> ObjectView | None:
        """What lies in a cell, column and row.

        Raises:
            IndexError: if there is no such cell.
        """
        self._check(i, j)
        return self._view(int(self.codes[i, j]), int(self.places[i, j]))

    def set(self, i: int, j: int, v: Any) -> None:
        """Lay a thing into a cell of the world, one from this world or of Minigrid's classes; None empties it.

        Raises:
            IndexError: if there is no such cell.
            WorldError: if this is not the world's grid but a copy or a part of it, or too many things were made.
        """
        self._check(i, j)
        if not np.shares_memory(self.codes, self._state.row):
            raise WorldError("this grid is a copy; set cells of env.unwrapped.grid instead")
        put(self._state.row, i, j, self._code(v))

    def slice(self, x: int, y: int, width: int, height: int) -> "GridView":
        """A copy of a rectangle, from its top left cell; outside the grid is wall."""
        codes, places = np.full((width, height), GREY_WALL, np.int32), np.full((width, height), -1, np.int64)
        left, top = max(x, 0), max(y, 0)
        right, bottom = max(min(x + width, self.width), left), max(min(y + height, self.height), top)
        inside = slice(left - x, right - x), slice(top - y, bottom - y)
        codes[inside] = self.codes[left:right, top:bottom]
        places[inside] = self.places[left:right, top:bottom]
        return GridView(self._state, self._kinds, codes, places)

    def rotate_left(self) -> "GridView":
        """A copy turned counter-clockwise."""
        return GridView(self._state, self._kinds, np.rot90(self.codes, -1).copy(), np.rot90(self.places, -1))

    def copy(self) -> "GridView":
        """A copy of the cells as they are now."""
        return self.slice(0, 0, self.width, self.height)

    def encode(self, vis_mask: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
        """Kind, colour and state of every cell, uint8[width, height, 3]; zeros where ``vis_mask`` is False."""
        codes = self.codes
        image = np.stack([kinds_of(codes), colours_of(codes), states_of(codes)], axis=-1).astype(np.uint8)
        return image if vis_mask is None else image * vis_mask[..., None]

    def __contains__(self, key: Any) -> bool:
        """Whether a thing of a type, of a (colour, type), or this very thing lies in the grid."""
        if type(key) is ObjectView:
            return bool((self.codes == key.code).any())
        colour, kind = key if isinstance(key, tuple) else (None, key)
        return any(one is not None and one.type == kind and colour in (None, one.color) for one in self.grid)

    def __eq__(self, other: object) -> bool:
        """Whether another grid, ours or Minigrid's, looks the same."""
        return hasattr(other, "encode") and np.array_equal(self.encode(), other.encode())

    __hash__ = None  # type: ignore[assignment]  # it changes

    def _check(self, i: int, j: int) -> None:
        if not (0 <= i < self.width and 0 <= j < self.height):
            raise IndexError(f"cell ({i}, {j}) is outside the grid of {self.width} x {self.height} cells")

    def _view(self, code: int, place: int) -> ObjectView | None:
        where = None if place < 0 else divmod(place, self._state.height)
        return _object(code, where, self._state, self._kinds)

    def _code(self, thing: Any) -> int:
        row = self._state.row
        if thing is None:
            return EMPTY
        if type(thing) is ObjectView:
            place = self._state.find(identity_of(thing.code)) if identity_of(thing.code) else None
            if place is not None:
                put(row, *place, EMPTY)  # it cannot lie in two cells
            return thing.code
        kind, colour, state = thing.encode()
        if not thing.can_pickup() and kind != DOOR:
            return pack(kind, colour, state, 0)
        code = int(make(row, kind, colour, state))
        if code == EMPTY:
            row[FAILED] = 0
            raise WorldError(
                f"{row[OBJECTS]} things were made in this episode, the maximum for this grid; reuse those that "
                "grid.get returns"
            )
        if thing.contains is not None:
            row[contents_index(row, identity_of(code))] = self._code(thing.contains)
        return code


@dataclass(frozen=True, slots=True)
class RoomView:
    """A room of a grid of equal rooms."""

    top: Place  # its top left cell
    size: Place
    doors: tuple[ObjectView | None, ...]  # right, down, left, up


class MinigridCompat(abc.ABC):
    """Mixed into every grid world: reads its ``state``."""

    kinds: ClassVar[tuple[ObjectKind, ...]]

    @property
    @abc.abstractmethod
    def state(self) -> State:
        """The state, readable by name: the world's own."""

    @property
    def agent_pos(self) -> Place:
        """The agent's column and row."""
        return self.state.position

    @agent_pos.setter
    def agent_pos(self, place: Sequence[int]) -> None:
        column, row = place
        if not (0 <= column < self.state.width and 0 <= row < self.state.height):
            raise WorldError(
                f"agent_pos is {place!r}; use a cell from (0, 0) to {self.state.width - 1, self.state.height - 1}"
            )
        self.state.row[[X, Y]] = column, row

    @property
    def agent_dir(self) -> int:
        """Where the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return self.state.direction

    @agent_dir.setter
    def agent_dir(self, direction: int) -> None:
        if direction not in range(4):
            raise WorldError(f"agent_dir is {direction!r}; use 0 for right, 1 for down, 2 for left or 3 for up")
        self.state.row[DIRECTION] = direction

    @property
    def carrying(self) -> ObjectView | None:
        """What is in the agent's hand; None for nothing."""
        return _object(self.state.carrying, None, self.state, self.kinds)

    @carrying.setter
    def carrying(self, thing: Any) -> None:
        self.state.row[CARRYING] = self.grid._code(thing)

    @ReadOnlyName
    def actions(self) -> type[IntEnum]:
        """The seven actions by name; a world may take fewer."""
        return Actions

    @ReadOnlyName
    def dir_vec(self) -> NDArray[np.int64]:
        """One step ahead, as (columns, rows)."""
        return np.array(STEPS[self.state.direction])

    @ReadOnlyName
    def front_pos(self) -> NDArray[np.int64]:
        """The cell in front of the agent."""
        return np.add(self.state.position, STEPS[self.state.direction])

    @ReadOnlyName
    def right_vec(self) -> NDArray[np.int64]:
        """One step to the right, as (columns, rows)."""
        right, down = STEPS[self.state.direction]
        return np.array((-down, right))

    @ReadOnlyName
    def see_through_walls(self) -> bool:
        """Whether walls hide nothing."""
        return bool(self.state.row[SEE_THROUGH] & 1)

    @ReadOnlyName
    def goal_pos(self) -> Place | None:
        """The first goal's column and row, counted row by row; None without one."""
        goals = np.argwhere(self.state.kinds.T == GOAL)
        return (int(goals[0, 1]), int(goals[0, 0])) if len(goals) else None

    @ReadOnlyName
    def goal_position(self) -> Place | None:
        """`goal_pos`."""
        return self.goal_pos

    @ReadOnlyName
    def step_count(self) -> int:
        """Steps taken in this episode."""
        return self.state.step

    @ReadOnlyName
    def steps_remaining(self) -> int:
        """Steps left before the episode is truncated."""
        return self.state.max_steps - self.state.step

    @ReadOnlyName
    def width(self) -> int:
        """Columns."""
        return self.state.width

    @ReadOnlyName
    def height(self) -> int:
        """Rows."""
        return self.state.height

    @ReadOnlyName
    def agent_view_size(self) -> int:
        """Cells on a side of the agent's view."""
        return int(self.image_shape[0])  # type: ignore[attr-defined]  # every grid world has one

    @ReadOnlyName
    def grid(self) -> GridView:
        """The cells."""
        return GridView(self.state, self.kinds)

    def get_view_coords(self, i: int, j: int) -> Place:
        """Where a cell is in the agent's view, column and row of the image, inside the image or not."""
        (right, down), (dx, dy) = np.subtract((i, j), self.state.position).tolist(), STEPS[self.state.direction]
        size = int(self.agent_view_size)
        return size // 2 + down * dx - right * dy, size - 1 - (right * dx + down * dy)

    def relative_coords(self, x: int, y: int) -> Place | None:
        """Where a cell is in the agent's view, column and row of the image; None outside it."""
        size, place = int(self.agent_view_size), self.get_view_coords(x, y)
        return place if min(place) >= 0 and max(place) < size else None

    def get_view_exts(self, agent_view_size: int | None = None) -> tuple[int, int, int, int]:
        """The rectangle that the agent sees: left, top, right, bottom; the last two are the first cells outside."""
        size, (x, y) = agent_view_size or int(self.agent_view_size), self.state.position
        left = (x, x - size // 2, x - size + 1, x - size // 2)[self.state.direction]
        top = (y - size // 2, y, y - size // 2, y - size + 1)[self.state.direction]
        return left, top, left + size, top + size

    def in_view(self, x: int, y: int) -> bool:
        """Whether a cell is in the rectangle that the agent sees, hidden or not."""
        return self.relative_coords(x, y) is not None

    def gen_obs_grid(self, agent_view_size: int | None = None) -> tuple[GridView, NDArray[np.bool_]]:
        """What the agent sees, looking up, as a grid of so many cells on a side, and which of them it sees.

        Cells that it does not see are empty; its own has what it carries.
        """
        size = see_size(agent_view_size or int(self.agent_view_size))
        left, top, _, _ = self.get_view_exts(size)
        grid = self.grid.slice(left, top, size, size)
        for _ in range(self.state.direction + 1):
            grid = grid.rotate_left()
        seen = self.look(size)[..., 0] != UNSEEN  # type: ignore[attr-defined]  # every grid world has it
        codes = np.where(seen, grid.codes, EMPTY)
        codes[size // 2, size - 1], grid.places[size // 2, size - 1] = self.state.carrying, -1
        return GridView(self.state, self.kinds, codes, grid.places), seen

    def gen_obs(self) -> dict[str, Any]:
        """What the agent observes now."""
        return dict(self.observation())  # type: ignore[attr-defined]

    def agent_sees(self, x: int, y: int) -> bool:
        """Whether the agent sees what lies in a cell; an empty one shows nothing."""
        place = self.relative_coords(x, y)
        if place is None:
            return False
        lies = self.state.cells[x, y]
        seen = self.look(int(self.agent_view_size))[place]  # type: ignore[attr-defined]
        return bool(lies != EMPTY and seen[0] == kind_of(int(lies)))

    def get_frame(self, highlight: bool = True, tile_size: int = 32, agent_pov: bool = False) -> NDArray[np.uint8]:
        """A picture from above or of what the agent sees, in Minigrid's own tiles whatever the palette.

        So Minigrid's wrappers give the pixels that they give around Minigrid's worlds. `frame` has our palettes.
        """
        return draw_grid(
            self.state.row,
            view="partial" if agent_pov else "full",
            view_size=int(self.agent_view_size),
            tile_px=tile_size,
            palette="minigrid",
            kinds=self.kinds,
            lit=highlight,
        )

    def get_pov_render(self, tile_size: int) -> NDArray[np.uint8]:
        """`get_frame` of what the agent sees."""
        return self.get_frame(tile_size=tile_size, agent_pov=True)

    def get_full_render(self, highlight: bool, tile_size: int) -> NDArray[np.uint8]:
        """`get_frame` from above."""
        return self.get_frame(highlight, tile_size)

    def hash(self, size: int = 16) -> str:
        """A text of so many characters for the cells and the agent's place; `state_hash` covers all of the state."""
        seen = self.grid.encode().tolist(), self.state.position, self.state.direction
        return hashlib.sha256("".join(map(str, seen)).encode()).hexdigest()[:size]

    def put_obj(self, obj: Any, i: int, j: int) -> None:
        """Lay a thing into a cell: `GridView.set`."""
        self.grid.set(i, j, obj)

    def room_from_pos(self, x: int, y: int) -> RoomView:
        """The room of a cell, where the world is a grid of equal rooms.

        Raises:
            WorldError: if it is not.
        """
        size = getattr(getattr(self, "recipe", None), "room_size", 0)
        if not size:
            raise WorldError(f"{self} is not a grid of equal rooms, so no cell has a room; compare columns and rows")
        left, top = (min(at, count - 2) // (size - 1) * (size - 1) for at, count in ((x, self.width), (y, self.height)))
        grid = self.grid.slice(left, top, size, size)
        last, along = size - 1, range(size)
        walls = [(last, k) for k in along], [(k, last) for k in along], [(0, k) for k in along], [(k, 0) for k in along]
        lying = ([one for one in (grid.get(*cell) for cell in wall) if one is not None] for wall in walls)
        doors = (next((one for one in wall if one.type == "door"), None) for wall in lying)
        return RoomView((left, top), (size, size), tuple(doors))

    def pprint_grid(self) -> str:
        """The grid in characters: `text`."""
        return str(self.text())  # type: ignore[attr-defined]

    def full_image(self) -> NDArray[np.uint8]:
        """The whole grid with the agent in it, uint8[width, height, 3]."""
        image = np.empty((self.state.width, self.state.height, 3), np.uint8)
        see_all(self.state.row, image)
        return image


def _object(code: int, place: Place | None, state: State, kinds: Sequence[ObjectKind]) -> ObjectView | None:
    if code == EMPTY:
        return None
    number, door = kind_of(code), state_of(code)
    own = kinds[number - FIRST_OWN_KIND] if number >= FIRST_OWN_KIND else None
    opens = own.opens if own else number == DOOR
    inside = int(state.contents[identity_of(code) - 1]) if KINDS[number : number + 1] == ("box",) else 0
    contains = _object(inside, None, state, kinds) if inside else None
    name, colour = kind_name(number, kinds), COLOURS[colour_of(code)]
    return ObjectView(name, colour, opens and door == OPEN, opens and door == LOCKED, place, contains, own, code)
