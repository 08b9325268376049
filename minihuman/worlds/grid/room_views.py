"""Rooms of a grid of equal rooms, in the form of Minigrid's rooms: views of a world's state."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from minihuman.errors import WorldError
from minihuman.worlds.grid.object_views import GridView, ObjectView, Place
from minihuman.worlds.upstream_names import WorldAttributeError


@dataclass(frozen=True, slots=True)
class RoomView:
    """A room of a grid of equal rooms, with its top left cell, its size in cells (walls included) and its doors."""

    top: Place  # its top left cell
    size: Place
    doors: tuple[ObjectView | bool | None, ...]  # right, down, left, up; True for no wall, None for no door
    rooms: "RoomGridView" = field(compare=False, repr=False)

    @property
    def neighbors(self) -> list["RoomView | None"]:
        """Return the rooms to the right, below, to the left and above; None at the edge."""
        column, row = (coordinate // (self.rooms.size - 1) for coordinate in self.top)
        places = ((column + 1, row), (column, row + 1), (column - 1, row), (column, row - 1))
        return [self.rooms.room(*place) if self.rooms.has(*place) else None for place in places]

    def pos_inside(self, x: int, y: int) -> bool:
        """Return whether the cell (x, y) is in the room, including its walls."""
        left, top = self.top
        width, height = self.size
        return left <= x < left + width and top <= y < top + height

    def __getattr__(self, name: str) -> Any:
        advice = {
            "objs": "read its cells with grid.get()",
            "door_pos": "a door of its doors knows its cur_pos",
            "locked": "a door of its doors knows whether it is_locked",
            "rand_pos": "draw with env.unwrapped.np_random",
        }
        if name in advice:
            raise WorldAttributeError(f"a room has no attribute {name!r}; {advice[name]}")
        raise WorldAttributeError(f"a room has no attribute {name!r}")


class RoomGridView:
    """The rooms of a grid of equal rooms, by column and row; iteration yields a list of rooms for each row."""

    def __init__(self, grid: GridView, size: int) -> None:
        self._grid = grid
        self.size = size  # cells on a side of a room, walls included
        self.columns, self.rows = ((cells - 1) // (size - 1) for cells in (grid.width, grid.height))

    def has(self, column: int, row: int) -> bool:
        """Return whether there is a room at a column and a row."""
        return 0 <= column < self.columns and 0 <= row < self.rows

    def room(self, column: int, row: int) -> RoomView:
        """Return the room at a column and a row.

        Raises:
            WorldError: if there is no such room.
        """
        if not self.has(column, row):
            raise WorldError(
                f"there is no room ({column}, {row}); columns are 0 to {self.columns - 1}, rows 0 to {self.rows - 1}"
            )
        left = column * (self.size - 1)
        top = row * (self.size - 1)
        part = self._grid.slice(left, top, self.size, self.size)
        doors = tuple(self._door(part, wall) for wall in range(4))
        return RoomView((left, top), (self.size, self.size), doors, self)

    def __iter__(self) -> Iterator[list[RoomView]]:
        return ([self.room(column, row) for column in range(self.columns)] for row in range(self.rows))

    def _door(self, part: GridView, wall: int) -> ObjectView | bool | None:
        """Return the door in a wall of a room (0 right, 1 down, 2 left, 3 up); None for no door, True for no wall."""
        last = self.size - 1
        along = range(1, self.size - 1)
        right = [(last, k) for k in along]
        down = [(k, last) for k in along]
        left = [(0, k) for k in along]
        up = [(k, 0) for k in along]
        wall_things = [part.get(*cell) for cell in (right, down, left, up)[wall]]
        for thing in wall_things:
            if thing is not None and thing.type == "door":
                return thing
        has_wall = any(thing is not None and thing.type == "wall" for thing in wall_things)
        return None if has_wall else True
