"""Layout: the drawing board a world written in Python lays its episodes out on."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.grid.core import place as verbs
from minihuman.worlds.grid.core.cells import COLOURS, DOOR_STATES, EMPTY, KINDS, pack
from minihuman.worlds.grid.core.chance import Words, read_words, write_words
from minihuman.worlds.grid.core.own import OWN
from minihuman.worlds.grid.core.state import FAILED, HEIGHT, TARGET, TASK, WIDTH, Row, contents_index, make, put
from minihuman.worlds.grid.instructions.language import Instruction
from minihuman.worlds.grid.items import Item, wall
from minihuman.worlds.grid.kinds import Kind

T = TypeVar("T")
Place = tuple[int, int]  # column, row


class Lying(NamedTuple):
    """Something that was put down: its number among the world's objects (0 for scenery), column and row."""

    identity: int
    x: int
    y: int


class Layout:
    """One episode's layout in the making. Draws come from the world's ``np_random``, one draw order a layout."""

    def __init__(self, row: Row, np_random: np.random.Generator, mission: str, kinds: Sequence[Kind] = ()) -> None:
        self.width, self.height = int(row[WIDTH]), int(row[HEIGHT])
        self.mission = mission  # set it to give this episode another
        self.instruction: Instruction | None = None  # set it where the mission is an `InstructionSpace`
        self.kinds = tuple(kinds)  # of the world's own
        self._row = row
        self._np_random = np_random
        self._words: Words = np.zeros(6, np.uint64)

    def wall_rect(self, x: int = 0, y: int = 0, width: int | None = None, height: int | None = None) -> None:
        """The four walls of a room, walls included in its size; the whole grid without arguments."""
        width = self.width - x if width is None else width
        height = self.height - y if height is None else height
        self._check(x, y)
        self._check(x + width - 1, y + height - 1)
        verbs.wall_rect(self._row, x, y, width, height)

    def across(self, x: int, y: int, length: int | None = None, item: Item | None = None) -> None:
        """A horizontal line of an item (walls) from (x, y), to the right edge without a length."""
        for i in range(self.width - x if length is None else length):
            self.put(item or wall(), x + i, y)

    def down(self, x: int, y: int, length: int | None = None, item: Item | None = None) -> None:
        """A vertical line of an item (walls) from (x, y), to the bottom edge without a length."""
        for j in range(self.height - y if length is None else length):
            self.put(item or wall(), x, y + j)

    def put(self, item: Item, x: int, y: int) -> Lying:
        """Put an item into a cell, over whatever is there."""
        self._check(x, y)
        code = self._make(item)
        put(self._row, x, y, code)
        return Lying(code >> 9, x, y)

    def clear(self, x: int, y: int) -> None:
        """Make a cell empty."""
        self._check(x, y)
        put(self._row, x, y, EMPTY)

    def place(
        self,
        item: Item,
        *,
        top: Place = (0, 0),
        size: Place | None = None,
        reject: Callable[[int, int], bool] | None = None,
        tries: int = 10_000,
    ) -> Lying:
        """Put an item into a drawn free cell of a rectangle (the grid), where the agent is not.

        Args:
            item: What to put.
            top: The rectangle's top left cell.
            size: Its columns and rows.
            reject: Says of a free cell (column, row) whether to draw again.
            tries: Free cells that are drawn before giving up.

        Raises:
            WorldError: if no cell is free, or all that were drawn were rejected.
        """
        x, y = self._draw(item.kind, top, size, reject, tries)
        return self.put(item, x, y)

    def put_agent(self, x: int, y: int, direction: int = 0) -> None:
        """Put the agent into a cell: it looks right (0), down (1), left (2) or up (3)."""
        self._check(x, y)
        verbs.stand(self._row, x, y, direction)

    def place_agent(self, *, top: Place = (0, 0), size: Place | None = None, direction: int | None = None) -> Place:
        """Put the agent into a drawn free cell of a rectangle; it looks in a drawn direction unless told."""
        verbs.stand(self._row, -1, -1, -1)
        x, y = self._draw("agent", top, size, None, 1)
        verbs.stand(self._row, x, y, self.integer(0, 4) if direction is None else direction)
        return x, y

    def integer(self, low: int, high: int) -> int:
        """Draw a whole number in [low, high)."""
        return int(self._np_random.integers(low, high))

    def choice(self, options: Sequence[T]) -> T:
        """Draw one of the options."""
        return options[self.integer(0, len(options))]

    def task(self, task: int, *target: int) -> None:
        """Say what success is, beside reaching a goal: one of ``tasks`` and the numbers it is about."""
        self._row[TASK] = task
        self._row[TARGET : TARGET + len(target)] = target

    def _make(self, item: Item) -> int:
        kind, colour, state = self._number(item), COLOURS.index(item.colour), DOOR_STATES.index(item.state)
        if not item.has_identity:
            return pack(kind, colour, 0, 0)
        code = make(self._row, kind, colour, state)
        if item.contains is not None:
            self._row[contents_index(self._row, code >> 9)] = self._make(item.contains)
        return int(code)

    def _number(self, item: Item) -> int:
        if item.own is None:
            return KINDS.index(item.kind)
        if item.own not in self.kinds:
            raise WorldError(f"{item.kind!r} is no kind of this world; name it in its kinds = (...)")
        return OWN + self.kinds.index(item.own)

    def _draw(
        self, what: str, top: Place, size: Place | None, reject: Callable[[int, int], bool] | None, tries: int
    ) -> Place:
        size = size or (self.width, self.height)
        read_words(self._np_random, self._words)
        for _ in range(tries):
            x, y = verbs.draw_place(self._row, self._words, *top, *size, verbs.FOR_EVER)
            if x < 0 or reject is None or not reject(x, y):
                break
        else:
            x = -1
        write_words(self._words, self._np_random)
        if x < 0:
            self._row[FAILED] = 0
            raise WorldError(
                f"no free cell for the {what} in the {size[0]} x {size[1]} cells from {top}; give it a larger rectangle"
            )
        return x, y

    def _check(self, x: int, y: int) -> None:
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise WorldError(f"cell ({x}, {y}) is outside the grid of {self.width} x {self.height} cells")
