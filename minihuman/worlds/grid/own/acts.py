"""What the worlds of a user's own have in common, with one body or several.

That are the ways in which their rules can change a grid (draw random numbers; put, remove and move objects), which
translated rules do in compiled code (`runtime`), and where a world finds its compiled rules.
"""

from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from minihuman.worlds.grid.core import state as fields
from minihuman.worlds.grid.core.bodies import body_index
from minihuman.worlds.grid.core.cells import EMPTY
from minihuman.worlds.grid.core.state import Row, State, cell_at, lift, move
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.object_kinds import Item


class OwnRules:
    """Mixin with the methods by which `reward_and_done` changes a grid, and the world's compiled rules."""

    bodies: int = 1
    is_translated: ClassVar[bool] = True  # False: run `layout` and `reward_and_done` as plain Python
    kinds: ClassVar[Any]
    np_random: np.random.Generator
    _row: Row
    _compiled_rules: Any = None  # compiled `layout` and `reward_and_done` of this world, once they are loaded

    def _load_rules(self) -> Any:
        """Return the compiled rules of the world as it is now; None if it runs as plain Python."""
        rules = self._compiled_rules
        if self.is_translated and (rules is None or not rules.refresh_for(self)):
            # imported by name: no kernel depends on the translation, so none is compiled anew when it changes
            rules = self._compiled_rules = import_module("minihuman.worlds.grid.own.programs").load_rules(self)
        return rules

    def draw(self, low: int, high: int) -> int:
        """Draw a whole number in [low, high) from the world's random stream."""
        return int(self.np_random.integers(low, high))

    def code_at(self, x: int, y: int) -> int:
        """Return the code of the cell (x, y). All cells outside the grid are walls."""
        return int(cell_at(self._row, int(x), int(y)))

    def put(self, item: Item, x: int, y: int) -> int:
        """Put a new object into the cell (x, y), replacing whatever is there; return its identity, 0 for scenery.

        Raises:
            WorldError: if the cell is outside the grid.
        """
        return Layout(self._row, self.np_random, "", self.kinds, self.bodies).put(item, int(x), int(y)).identity

    def remove(self, x: int, y: int) -> int:
        """Empty the cell (x, y) and return the code that was in it; EMPTY for a cell outside the grid."""
        if not self._is_inside(x, y):
            return EMPTY
        return int(lift(self._row, int(x), int(y)))

    def move(self, identity: int, x: int, y: int) -> bool:
        """Move an object into the cell (x, y) if it is empty and no body stands there; return whether it was moved.

        An object that lies in no cell, because it is carried, in a box or gone, is not moved.
        """
        row = self._row
        if not 1 <= identity <= row[fields.OBJECTS] or not self._is_inside(x, y) or self._is_body_at(x, y):
            return False
        if State(row).find(int(identity)) is None or cell_at(row, int(x), int(y)) != EMPTY:
            return False
        move(row, int(identity), int(x * row[fields.HEIGHT] + y))
        return True

    def _is_inside(self, x: int, y: int) -> bool:
        return bool(0 <= x < self._row[fields.WIDTH] and 0 <= y < self._row[fields.HEIGHT])

    def _is_body_at(self, x: int, y: int) -> bool:
        starts = (body_index(self._row, body) for body in range(self.bodies))
        return any(self._row[at] == x and self._row[at + 1] == y for at in starts)
