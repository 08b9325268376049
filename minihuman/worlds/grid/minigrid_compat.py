"""Minigrid's names for what a grid world is, to read: code written for Minigrid's worlds keeps running.

They are views of the present state; setting one changes nothing in the world.
"""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core.cells import (
    EMPTY,
    KINDS,
    LOCKED,
    OPEN,
    STEPS,
    colour_of,
    colours_of,
    kind_of,
    kinds_of,
    state_of,
    states_of,
)
from minihuman.worlds.grid.core.state import FIRST_OWN_KIND, State
from minihuman.worlds.grid.core.view import see_all
from minihuman.worlds.grid.object_kinds import ObjectKind, kind_name


@dataclass(frozen=True, slots=True)
class ObjectView:
    """What lies in a cell or in the hand: ``type`` and ``color``, of a door ``is_open`` and ``is_locked``."""

    type: str
    color: str
    is_open: bool
    is_locked: bool
    cur_pos: tuple[int, int] | None  # None in the hand
    own: ObjectKind | None  # where it is of a kind of the world's own
    codes: tuple[int, int, int]

    def can_pickup(self) -> bool:
        """Whether it can be carried."""
        return self.own.carried if self.own else self.type in ("key", "ball", "box")

    def can_overlap(self) -> bool:
        """Whether the agent can stand on it."""
        return self.is_open or (self.own.stepped_on if self.own else self.type in ("floor", "goal", "lava"))

    def encode(self) -> tuple[int, int, int]:
        """Kind, colour and state as numbers."""
        return self.codes


class GridView:
    """The cells: ``grid.get(x, y)`` is an `ObjectView`, or None for an empty cell."""

    def __init__(self, state: State, kinds: Sequence[ObjectKind] = ()) -> None:
        self._state, self._kinds = state, kinds
        self.width, self.height = state.width, state.height

    def get(self, x: int, y: int) -> ObjectView | None:
        """What lies in a cell.

        Raises:
            IndexError: if there is no such cell.
        """
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise IndexError(f"cell ({x}, {y}) is outside the grid of {self.width} x {self.height} cells")
        return _object(int(self._state.cells[x, y]), (int(x), int(y)), self._kinds)

    def encode(self) -> NDArray[np.uint8]:
        """Kind, colour and state of every cell, uint8[width, height, 3]."""
        cells = self._state.cells
        return np.stack([kinds_of(cells), colours_of(cells), states_of(cells)], axis=-1).astype(np.uint8)

    def __contains__(self, key: Any) -> bool:
        """Whether a thing of a type, or of a (colour, type), lies in the grid."""
        colour, kind = key if isinstance(key, tuple) else (None, key)
        lying = (self.get(x, y) for x in range(self.width) for y in range(self.height))
        return any(one is not None and one.type == kind and colour in (None, one.color) for one in lying)


class _Read:
    """A read-only name; a subclass or an instance may define its own under the same name."""

    def __init__(self, read: Callable[[Any], Any]) -> None:
        self._read = read
        self.__doc__ = read.__doc__

    def __get__(self, world: Any, owner: Any = None) -> Any:
        return self if world is None else self._read(world)


class MinigridCompat(abc.ABC):
    """Mixed into every grid world: reads its ``state``."""

    kinds: ClassVar[tuple[ObjectKind, ...]]

    @property
    @abc.abstractmethod
    def state(self) -> State:
        """The state, readable by name: the world's own."""

    @_Read
    def agent_pos(self) -> tuple[int, int]:
        """The agent's column and row."""
        return self.state.position

    @_Read
    def agent_dir(self) -> int:
        """Where the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return self.state.direction

    @_Read
    def dir_vec(self) -> NDArray[np.int64]:
        """One step ahead, as (columns, rows)."""
        return np.array(STEPS[self.state.direction])

    @_Read
    def front_pos(self) -> NDArray[np.int64]:
        """The cell in front of the agent."""
        return np.add(self.state.position, STEPS[self.state.direction])

    @_Read
    def carrying(self) -> ObjectView | None:
        """What is in the agent's hand; None for nothing."""
        return _object(self.state.carrying, None, self.kinds)

    @_Read
    def step_count(self) -> int:
        """Steps taken in this episode."""
        return self.state.step

    @_Read
    def steps_remaining(self) -> int:
        """Steps left before the episode is truncated."""
        return self.state.max_steps - self.state.step

    @_Read
    def width(self) -> int:
        """Columns."""
        return self.state.width

    @_Read
    def height(self) -> int:
        """Rows."""
        return self.state.height

    @_Read
    def agent_view_size(self) -> int:
        """Cells on a side of the agent's view."""
        return int(self.image_shape[0])  # type: ignore[attr-defined]  # every grid world has one

    @_Read
    def grid(self) -> GridView:
        """The cells."""
        return GridView(self.state, self.kinds)

    def relative_coords(self, x: int, y: int) -> tuple[int, int] | None:
        """Where a cell is in the agent's view, column and row of the image; None outside it."""
        (right, down), (dx, dy) = np.subtract((x, y), self.state.position), STEPS[self.state.direction]
        size = int(self.agent_view_size)
        column, row = size // 2 + int(down * dx - right * dy), size - 1 - int(right * dx + down * dy)
        return (column, row) if 0 <= column < size and 0 <= row < size else None

    def in_view(self, x: int, y: int) -> bool:
        """Whether a cell is in the rectangle that the agent sees, hidden or not."""
        return self.relative_coords(x, y) is not None

    def agent_sees(self, x: int, y: int) -> bool:
        """Whether the agent sees what lies in a cell; an empty one shows nothing."""
        place = self.relative_coords(x, y)
        if place is None:
            return False
        lies = self.state.cells[x, y]
        seen = self.look(int(self.agent_view_size))[place]  # type: ignore[attr-defined]
        return bool(lies != EMPTY and seen[0] == kind_of(int(lies)))

    def get_frame(self, highlight: bool = True, tile_size: int = 32, agent_pov: bool = False) -> NDArray[np.uint8]:
        """A picture of the world from above, or of what the agent sees."""
        return self.frame(lit=highlight, tile_px=tile_size, view="partial" if agent_pov else "full")  # type: ignore[attr-defined]

    def pprint_grid(self) -> str:
        """The grid in characters: `text`."""
        return str(self.text())  # type: ignore[attr-defined]

    def full_image(self) -> NDArray[np.uint8]:
        """The whole grid with the agent in it, uint8[width, height, 3]."""
        image = np.empty((self.state.width, self.state.height, 3), np.uint8)
        see_all(self.state.row, image)
        return image


def _object(code: int, place: tuple[int, int] | None, kinds: Sequence[ObjectKind]) -> ObjectView | None:
    if code == EMPTY:
        return None
    codes = number, colour, state = kind_of(code), colour_of(code), state_of(code)
    own = kinds[number - FIRST_OWN_KIND] if number >= FIRST_OWN_KIND else None
    opens = own.opens if own else KINDS[number] == "door"
    name = kind_name(number, kinds)
    return ObjectView(name, COLOURS[colour], opens and state == OPEN, opens and state == LOCKED, place, own, codes)
