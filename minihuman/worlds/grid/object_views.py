"""The objects and cells of a grid in the form of Minigrid's objects: views of a world's state.

A view shows the current state until the world is reset or restored, and the last state of its episode afterwards.
Setting an object's colour, a door's state or a box's contents changes the world's state.
"""

import builtins
import sys
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core.cells import (
    BOX,
    CLOSED,
    DOOR,
    EMPTY,
    GREY_WALL,
    LOCKED,
    OPEN,
    colour_of,
    colours_of,
    identities_of,
    identity_of,
    in_colour,
    in_state,
    kind_of,
    kinds_of,
    pack,
    state_of,
    states_of,
)
from minihuman.worlds.grid.core.state import CARRYING, FAILED, FIRST_OWN_KIND, OBJECTS, State, contents_index, make, put
from minihuman.worlds.grid.object_kinds import ObjectKind, kind_name
from minihuman.worlds.options import check_bool, check_one_of
from minihuman.worlds.upstream_names import WorldAttributeError

Place = tuple[int, int]  # column, row
_MINIGRID_MODULE = "minigrid.core.world_object"
_INSTEAD = {
    "render": "draw with env.unwrapped.get_frame()",
    "init_pos": "read cur_pos right after reset()",
    "decode": "set a cell with env.unwrapped.grid.set()",
}


class ObjectViews:
    """The views of an episode's objects. The same object has the same view each time."""

    def __init__(self, state: State, kinds: Sequence[ObjectKind]) -> None:
        self.state = state
        self.kinds = kinds
        self.instructions: Any = None  # the view of the episode's instruction, once it was asked for
        self._by_identity: dict[int, ObjectView] = {}

    def freeze(self) -> None:
        """Make every view show the current state from now on, whatever happens in the world."""
        self.state = State(self.state.row.copy())

    def of(self, code: int, place: Place | None) -> "ObjectView | None":
        """Return the view of the object with a code, or None for EMPTY; ``place`` is its cell if it is scenery."""
        if code == EMPTY:
            return None
        identity = identity_of(code)
        if identity == 0:
            return ObjectView(self, code, place)
        view = self._by_identity.setdefault(identity, ObjectView(self, code, None))
        view._code = code
        return view

    def of_identity(self, identity: int) -> "ObjectView":
        """Return the view of the object with an identity.

        Raises:
            WorldError: if the object no longer exists.
        """
        view = self._by_identity.get(identity) or self.of(self.code_of(identity), None)
        if view is None:
            raise WorldError(f"thing {identity} is gone; read it right after reset()")
        return view

    def make(self, kind: int, colour: int) -> "ObjectView":
        """Make a new object of a kind and colour, given by number, that lies in no cell yet, and return its view.

        Raises:
            WorldError: if the grid has no room for another object.
        """
        view = self.of(_make_object(self.state, kind, colour, 0), None)
        assert view is not None
        return view

    def code_of(self, identity: int) -> int:
        """Return the code of an object, wherever it is; EMPTY if it no longer exists."""
        state = self.state
        place = state.find(identity)
        if place is not None:
            return int(state.cells[place])
        if identity_of(state.carrying) == identity:
            return state.carrying
        matching_contents = state.contents[identities_of(state.contents) == identity]
        return int(matching_contents[0]) if len(matching_contents) else EMPTY

    def replace(self, old: int, new: int, place: Place | None) -> None:
        """Replace the code ``old`` of an object by ``new``, wherever it is; scenery is replaced at ``place``."""
        state = self.state
        identity = identity_of(old)
        cell = state.find(identity) if identity else place
        if cell is not None:
            if int(state.cells[cell]) == old:
                state.cells[cell] = new
        elif identity and identity_of(state.carrying) == identity:
            state.row[CARRYING] = new
        elif identity:
            state.contents[identities_of(state.contents) == identity] = new


def _make_object(state: State, kind: int, colour: int, door: int) -> int:
    """Make a new object that lies in no cell yet, and return its code. ``door`` is the state of a door, or 0.

    Raises:
        WorldError: if the grid has no room for another object.
    """
    row = state.row
    code = int(make(row, kind, colour, door))
    if code == EMPTY:
        row[FAILED] = 0
        raise WorldError(
            f"{row[OBJECTS]} things were made in this episode, the maximum for this grid; reuse those that "
            "grid.get returns"
        )
    return code


class ObjectView:
    """The object in a cell or in the agent's hand: ``type`` and ``color``; for a door, ``is_open`` and ``is_locked``.

    If Minigrid is imported, the view is an instance of Minigrid's class of its kind: ``isinstance(cell, Goal)``.
    """

    __slots__ = ("_code", "_place", "_views")

    def __init__(self, views: ObjectViews, code: int, place: Place | None) -> None:
        self._views = views
        self._code = code
        self._place = place  # of scenery; for other objects, the state has the cell

    @property  # type: ignore[misc]  # isinstance reads it, nothing writes it
    def __class__(self) -> builtins.type:
        return getattr(sys.modules.get(_MINIGRID_MODULE), self.type.capitalize(), ObjectView)

    @property
    def views(self) -> ObjectViews:
        """Return the views of the episode to which this one belongs."""
        return self._views

    @property
    def code(self) -> int:
        """Return the code of the object's kind, colour, state and identity; the last one if it no longer exists."""
        identity = identity_of(self._code)
        if identity:
            present = self._views.code_of(identity)
        else:
            present = EMPTY
        if present != EMPTY:
            self._code = present
        return self._code

    @property
    def own(self) -> ObjectKind | None:
        """Return the world's own kind of this object, or None if it is one of Minigrid's."""
        number = kind_of(self._code)
        if number >= FIRST_OWN_KIND:
            return self._views.kinds[number - FIRST_OWN_KIND]
        return None

    @property
    def type(self) -> str:
        """Return the name of the object's kind."""
        return kind_name(kind_of(self._code), self._views.kinds)

    @property
    def color(self) -> str:
        """Return the name of the object's colour. Setting it changes the colour."""
        return COLOURS[colour_of(self.code)]

    @color.setter
    def color(self, colour: str) -> None:
        number = COLOURS.index(check_one_of("color", colour, COLOURS))
        self._write(in_colour(self.code, number))

    @property
    def is_open(self) -> bool:
        """Return whether this is a door, or an object that opens, and is open. Setting it opens or closes it."""
        return self._opens and state_of(self.code) == OPEN

    @is_open.setter
    def is_open(self, is_open: bool) -> None:
        self._check_opens("is_open")
        if self.is_locked and check_bool("is_open", is_open):
            raise WorldError(f"this {self.type} is locked, so it cannot be open; set is_locked = False first")
        if not self.is_locked:
            self._write(in_state(self.code, OPEN if is_open else CLOSED))

    @property
    def is_locked(self) -> bool:
        """Return whether this is a door, or an object that opens, and is locked. Setting it locks or unlocks it."""
        return self._opens and state_of(self.code) == LOCKED

    @is_locked.setter
    def is_locked(self, is_locked: bool) -> None:
        self._check_opens("is_locked")
        if self.is_open and check_bool("is_locked", is_locked):
            raise WorldError(f"this {self.type} is open, so it cannot be locked; set is_open = False first")
        if not self.is_open:
            self._write(in_state(self.code, LOCKED if is_locked else CLOSED))

    @property
    def contains(self) -> "ObjectView | None":
        """Return the contents of a box, or None if it is empty. Setting it replaces the contents."""
        return self._views.of(self._contents_code, None)

    @contains.setter
    def contains(self, thing: Any) -> None:
        if kind_of(self._code) != BOX or not identity_of(self._code):
            raise WorldAttributeError(f"a {self.type} contains nothing; put a Box into the cell and set its contains")
        grid = GridView(self._views)
        self._views.state.row[self._contents_index] = 0 if thing is None else grid.code_for(thing)

    @property
    def cur_pos(self) -> Place | None:
        """Return the object's column and row; None if it is carried, in a box, or a wall outside the grid."""
        identity = identity_of(self._code)
        if identity:
            return self._views.state.find(identity)
        return self._place

    @cur_pos.setter
    def cur_pos(self, place: Any) -> None:
        raise WorldAttributeError("cur_pos cannot be set; move it with env.unwrapped.put_obj(thing, column, row)")

    def can_pickup(self) -> bool:
        """Return whether the agent can carry the object."""
        if self.own:
            return self.own.carried
        return self.type in ("key", "ball", "box")

    def can_overlap(self) -> bool:
        """Return whether the agent can stand on the object."""
        if self.own:
            return self.is_open or self.own.stepped_on
        return self.is_open or self.type in ("floor", "goal", "lava")

    def can_contain(self) -> bool:
        """Return False, because no action puts an object into another."""
        return False

    def see_behind(self) -> bool:
        """Return whether the agent sees what is behind the object."""
        if self.own:
            return self.is_open or not self.own.hides
        return self.is_open or self.type not in ("wall", "door")

    def encode(self) -> tuple[int, int, int]:
        """Return the numbers of the object's kind, colour and state, as observations show them."""
        return kind_of(self.code), colour_of(self.code), state_of(self.code)

    def toggle(self, env: Any, pos: Sequence[int]) -> bool:
        """Apply the action "toggle" to the object in the cell ``pos`` of ``env``; return whether it had an effect."""
        if kind_of(self._code) == BOX:
            env.unwrapped.grid.set(*pos, self.contains)
            return True
        if not self._opens:
            return False
        key = env.unwrapped.carrying
        if self.is_locked and (key is None or key.type != "key" or key.color != self.color):
            return False
        self._write(in_state(self.code, CLOSED if self.is_open else OPEN))
        return True

    def __getattr__(self, name: str) -> Any:
        if name in _INSTEAD:
            advice = f"; {_INSTEAD[name]}"
        else:
            advice = ""
        raise WorldAttributeError(f"a thing in a grid has no attribute {name!r}{advice}")

    def __eq__(self, other: object) -> bool:
        own_parts = self.code, self.cur_pos, self.contains
        return builtins.type(other) is ObjectView and own_parts == (other.code, other.cur_pos, other.contains)

    def __hash__(self) -> int:
        return hash((identity_of(self._code), self._place))

    def __reduce__(self) -> tuple[Any, ...]:
        return ObjectView, (self._views, self._code, self._place)

    @property
    def _opens(self) -> bool:
        if self.own:
            return self.own.opens
        return kind_of(self._code) == DOOR

    @property
    def _contents_index(self) -> int:
        return int(contents_index(self._views.state.row, identity_of(self._code)))

    @property
    def _contents_code(self) -> int:
        is_box = kind_of(self._code) == BOX and identity_of(self._code) > 0
        if is_box:
            return int(self._views.state.row[self._contents_index]) or EMPTY
        return EMPTY

    def _check_opens(self, name: str) -> None:
        if not self._opens:
            raise WorldAttributeError(f"a {self.type} has no {name} to set; only doors open")

    def _write(self, code: int) -> None:
        self._views.replace(self.code, code, self._place)
        self._code = code


class GridView:
    """A view of a grid's cells: ``grid.get(x, y)`` is an `ObjectView`, or None for an empty cell.

    Args:
        views: the views of the world's objects.
        codes: cells other than the world's, indexed [x, y]; None for the world's.
        places: the place of each cell in the world, x * height + y; -1 outside it.
    """

    def __init__(
        self,
        views: ObjectViews,
        codes: NDArray[np.int32] | None = None,
        places: NDArray[np.int64] | None = None,
    ) -> None:
        cells = views.state.cells
        self.views = views
        self._codes = codes
        if places is None:
            self.places = np.arange(cells.size).reshape(cells.shape)
        else:
            self.places = places
        self.width, self.height = self.codes.shape

    @property
    def codes(self) -> NDArray[np.int32]:
        """Return the codes of the cells, indexed [x, y]. For the world's own grid, the array is a view of its state."""
        if self._codes is None:
            return self.views.state.cells
        return self._codes

    @property
    def grid(self) -> list[ObjectView | None]:
        """Return all cells, row by row."""
        cells = zip(self.codes.T.ravel().tolist(), self.places.T.ravel().tolist(), strict=True)
        return [None if code == EMPTY else self._view(code, place) for code, place in cells]

    def get(self, i: int, j: int) -> ObjectView | None:
        """Return the object in the cell (i, j), or None if the cell is empty.

        Raises:
            IndexError: if there is no such cell.
        """
        self._check(i, j)
        return self._view(int(self.codes[i, j]), int(self.places[i, j]))

    def set(self, i: int, j: int, v: Any) -> None:
        """Put an object of this world, or of Minigrid's classes, into a cell of the world; None empties the cell.

        Raises:
            IndexError: if there is no such cell.
            WorldError: if this grid is only a part of the world's, or the world has no room for another object.
        """
        self._check(i, j)
        if self._codes is not None:
            raise WorldError("this grid is a part of another; set cells of env.unwrapped.grid instead")
        put(self.views.state.row, i, j, self.code_for(v))

    def horz_wall(self, x: int, y: int, length: int | None = None, obj_type: Callable[[], Any] | None = None) -> None:
        """Put a row of walls, or of another class of objects, from (x, y) to the right; by default, to the edge."""
        for i in range(self.width - x if length is None else length):
            self._put_new(x + i, y, obj_type)

    def vert_wall(self, x: int, y: int, length: int | None = None, obj_type: Callable[[], Any] | None = None) -> None:
        """Put a column of walls, or of another class of objects, from (x, y) down; by default, to the edge."""
        for j in range(self.height - y if length is None else length):
            self._put_new(x, y + j, obj_type)

    def wall_rect(self, x: int, y: int, w: int, h: int) -> None:
        """Put the four walls of a room with the top left cell (x, y) and ``w`` x ``h`` cells, including the walls."""
        for row in (y, y + h - 1):
            self.horz_wall(x, row, w)
        for column in (x, x + w - 1):
            self.vert_wall(column, y, h)

    def slice(self, x: int, y: int, width: int, height: int) -> "GridView":
        """Return a rectangular part of the grid, given its top left cell and size. Cells outside the grid are walls."""
        codes = np.full((width, height), GREY_WALL, np.int32)
        places = np.full((width, height), -1, np.int64)
        left = max(x, 0)
        top = max(y, 0)
        right = max(min(x + width, self.width), left)
        bottom = max(min(y + height, self.height), top)
        inside = slice(left - x, right - x), slice(top - y, bottom - y)
        codes[inside] = self.codes[left:right, top:bottom]
        places[inside] = self.places[left:right, top:bottom]
        return GridView(self.views, codes, places)

    def rotate_left(self) -> "GridView":
        """Return the cells turned counter-clockwise."""
        return GridView(self.views, np.rot90(self.codes, -1).copy(), np.rot90(self.places, -1))

    def copy(self) -> "GridView":
        """Return a copy of the current cells. No step changes the copy, and setting its cells changes no world."""
        views = ObjectViews(State(self.views.state.row.copy()), self.views.kinds)
        return GridView(views, None if self._codes is None else self._codes.copy(), self.places)

    def encode(self, vis_mask: NDArray[np.bool_] | None = None) -> NDArray[np.uint8]:
        """Return kind, colour and state of every cell, uint8[width, height, 3]; zeros where ``vis_mask`` is False."""
        codes = self.codes
        image = np.stack([kinds_of(codes), colours_of(codes), states_of(codes)], axis=-1).astype(np.uint8)
        if vis_mask is None:
            return image
        return image * vis_mask[..., None]

    def code_for(self, thing: Any) -> int:
        """Return the code of an object that is about to be put into a cell; EMPTY for None.

        An object of this world is removed from its present cell; any other object is copied into this world.

        Raises:
            WorldError: if the world has no room for another object.
        """
        row = self.views.state.row
        if thing is None:
            return EMPTY
        if type(thing) is ObjectView and thing.views is self.views:
            place = thing.cur_pos if identity_of(thing.code) else None  # scenery can lie in many cells
            if place is not None:
                put(row, *place, EMPTY)  # it cannot lie in two cells
            return thing.code
        kind, colour, state = thing.encode()
        if not thing.can_pickup() and kind != DOOR:
            return pack(kind, colour, state, 0)
        code = _make_object(self.views.state, kind, colour, state)
        if thing.contains is not None:
            row[contents_index(row, identity_of(code))] = self.code_for(thing.contains)
        return code

    def __contains__(self, key: Any) -> bool:
        """Return whether the grid has an object: an `ObjectView`, or any of a type or a (colour, type)."""
        if type(key) is ObjectView:
            return bool((self.codes == key.code).any())
        colour, kind = key if isinstance(key, tuple) else (None, key)
        return any(cell is not None and cell.type == kind and colour in (None, cell.color) for cell in self.grid)

    def __eq__(self, other: object) -> bool:
        """Return whether another grid, a `GridView` or one of Minigrid's, has the same encoding."""
        return hasattr(other, "encode") and np.array_equal(self.encode(), other.encode())

    __hash__ = None  # type: ignore[assignment]  # the cells change

    def __getattr__(self, name: str) -> Any:
        advice = ""
        if name in ("render", "render_tile", "tile_cache"):
            advice = "; draw with env.unwrapped.get_frame()"
        elif name == "process_vis":
            advice = "; gen_obs_grid() says what is seen"
        raise WorldAttributeError(f"a grid has no attribute {name!r}{advice}")

    def _put_new(self, x: int, y: int, obj_type: Callable[[], Any] | None) -> None:
        if obj_type is not None:
            self.set(x, y, obj_type())
            return
        self._check(x, y)
        self.set(x, y, ObjectView(self.views, GREY_WALL, (x, y)))

    def _check(self, i: int, j: int) -> None:
        if not (0 <= i < self.width and 0 <= j < self.height):
            raise IndexError(f"cell ({i}, {j}) is outside the grid of {self.width} x {self.height} cells")

    def _view(self, code: int, place: int) -> ObjectView | None:
        cell = None if place < 0 else divmod(place, self.views.state.height)
        return self.views.of(code, cell)
