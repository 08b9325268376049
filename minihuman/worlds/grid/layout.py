"""Layout: the object on which a world written in Python lays out its episodes; and the recipe of a compiled layout.

The module also converts a grid to lines of characters and back, for diagrams and tests. A cell is two characters: the
first is the kind, the second the colour (r g b p y, and - for grey). `WW` is a grey wall, two spaces an empty cell, and
`>>` `vv` `<<` `^^` the agent. A door is `D` closed, `L` locked, `O` open. A diagram does not show what the agent stands
on or carries, nor what boxes contain. A world's own kinds have further letters.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.babyai.language import Instruction
from minihuman.worlds.grid.core import placement
from minihuman.worlds.grid.core import state as fields
from minihuman.worlds.grid.core.bodies import body_index
from minihuman.worlds.grid.core.cells import (
    DOOR_STATES,
    EMPTY,
    GREY_WALL,
    KINDS,
    OPEN,
    UNSEEN,
    colour_of,
    identities_of,
    kind_of,
    pack,
    state_of,
)
from minihuman.worlds.grid.core.state import Row, State, contents_index, make, put
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.object_kinds import Item, ObjectKind, wall
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state

LayoutFunction = Callable[..., None]  # (row, rng_state, *numbers)


@dataclass(frozen=True, slots=True)
class Recipe:
    """A layout function with its numeric arguments, the size of the grid, the mission and the default settings.

    Attributes:
        layout: the compiled function that lays out an episode in a cleared row.
        numbers: what the function takes after the row and the random stream.
    """

    layout: LayoutFunction
    numbers: tuple[int, ...]
    width: int
    height: int
    max_steps: int
    mission: MissionSpace | InstructionSpace
    see_through_walls: bool = False
    actions: int = 7  # how many of the seven actions the world has: the first ones
    room_size: int = 0  # cells on a side of each room of a grid of equal rooms, walls included; 0 for other layouts

    def lay_out(self, row: Row, rng_state: RngState) -> None:
        """Lay out an episode in a cleared row."""
        self.layout(row, rng_state, *self.numbers)

    def limited(self, max_steps: int) -> "Recipe":
        """Return the recipe of the same world with the step limit ``max_steps`` for every episode."""
        return replace(self, max_steps=max_steps)

    def about(self, mission: str) -> "Recipe":
        """Return the recipe of the same world with a given mission.

        Raises:
            WorldError: always, because only worlds with instructions accept a mission.
        """
        raise WorldError(
            f"mission {mission!r} cannot be set; only worlds with instructions (BabyAI-...) take a mission"
        )


MOST_TRIES = 10_000  # cells that are drawn for an item before its layout fails
T = TypeVar("T")
Place = tuple[int, int]  # column, row


class PlacedItem(NamedTuple):
    """An item that was put into a cell: its number among the world's objects (0 for scenery), column and row."""

    identity: int
    x: int
    y: int


class Layout:
    """The layout of one episode while it is made.

    Args:
        row: the world's row of state, which has been cleared.
        np_random: the world's generator, from which random numbers are drawn.
        mission: the mission of the episode unless the layout sets another.
        kinds: the world's own kinds of objects.
        bodies: the number of bodies.
    """

    def __init__(
        self,
        row: Row,
        np_random: np.random.Generator,
        mission: str,
        kinds: Sequence[ObjectKind] = (),
        bodies: int = 1,
    ) -> None:
        self.width = int(row[fields.WIDTH])
        self.height = int(row[fields.HEIGHT])
        self.mission = mission  # a layout can set another for the episode
        self.instruction: Instruction | None = None  # a layout sets it if the mission is an `InstructionSpace`
        self.kinds = tuple(kinds)  # the world's own kinds
        self.bodies = bodies
        self._row = row
        self._np_random = np_random
        self._rng_state: RngState = np.zeros(6, np.uint64)

    def wall_rect(self, x: int = 0, y: int = 0, width: int | None = None, height: int | None = None) -> None:
        """Put the four walls of a room, or of the whole grid without arguments. The size includes the walls.

        Raises:
            WorldError: if a wall is outside the grid.
        """
        width = self.width - x if width is None else width
        height = self.height - y if height is None else height
        self._check_inside(x, y)
        self._check_inside(x + width - 1, y + height - 1)
        placement.wall_rect(self._row, x, y, width, height)

    def across(self, x: int, y: int, length: int | None = None, item: Item | None = None) -> None:
        """Put a horizontal line of an item, by default walls, from (x, y); without a length, to the right edge."""
        for i in range(self.width - x if length is None else length):
            self.put(item or wall(), x + i, y)

    def down(self, x: int, y: int, length: int | None = None, item: Item | None = None) -> None:
        """Put a vertical line of an item, by default walls, from (x, y); without a length, to the bottom edge."""
        for j in range(self.height - y if length is None else length):
            self.put(item or wall(), x, y + j)

    def put(self, item: Item, x: int, y: int) -> PlacedItem:
        """Put an item into the cell (x, y), replacing whatever is there; return its identity and the cell.

        Raises:
            WorldError: if the cell is outside the grid, or the item is of a kind that the world does not have.
        """
        self._check_inside(x, y)
        code = self._make(item)
        put(self._row, x, y, code)
        return PlacedItem(identities_of(code), x, y)

    def clear(self, x: int, y: int) -> None:
        """Make the cell (x, y) empty; raise a WorldError if it is outside the grid."""
        self._check_inside(x, y)
        put(self._row, x, y, EMPTY)

    def place(
        self,
        item: Item,
        *,
        top: Place = (0, 0),
        size: Place | None = None,
        reject: Callable[[int, int], bool] | None = None,
        tries: int = MOST_TRIES,
    ) -> PlacedItem:
        """Put an item into a random free cell of a rectangle in which no body stands; return its identity and the cell.

        Args:
            item: the item to put.
            top: the top left cell of the rectangle.
            size: the columns and rows of the rectangle; by default, those of the grid.
            reject: a function that says whether to reject a free cell (column, row) and draw again.
            tries: the maximum number of free cells to draw.

        Raises:
            WorldError: if no cell is free, or all cells that were drawn were rejected.
        """
        x, y = self._draw_free_cell(item.kind, top, size, reject, tries)
        return self.put(item, x, y)

    def put_agent(self, x: int, y: int, direction: int = 0, *, body: int = 0) -> None:
        """Put the agent, or a body of a team, into the cell (x, y), facing right (0), down (1), left (2) or up (3)."""
        self._check_inside(x, y)
        self._stand(body, x, y, direction)

    def place_agent(
        self, *, top: Place = (0, 0), size: Place | None = None, direction: int | None = None, body: int = 0
    ) -> Place:
        """Put the agent, or one body of a team, into a random free cell of a rectangle; return the cell.

        It looks in a random direction unless one is given.
        """
        self._stand(body, -1, -1, -1)
        x, y = self._draw_free_cell("agent", top, size, None, 1 if self.bodies == 1 else MOST_TRIES)
        self._stand(body, x, y, self.integer(0, 4) if direction is None else direction)
        return x, y

    def _stand(self, body: int, x: int, y: int, direction: int) -> None:
        if not 0 <= body < self.bodies:
            raise WorldError(
                f"body {body} cannot be placed, as the world has {self.bodies} bodies; set `bodies` in its class"
            )
        at = body_index(self._row, body)
        self._row[at : at + 3] = x, y, direction

    def integer(self, low: int, high: int) -> int:
        """Return a random whole number in [low, high)."""
        return int(self._np_random.integers(low, high))

    def choice(self, options: Sequence[T]) -> T:
        """Return one of the options, drawn at random."""
        return options[self.integer(0, len(options))]

    def task(self, task: int, *target: int) -> None:
        """Set what else than reaching a goal counts as success: one of the tasks in `core.rewards`, and its numbers."""
        self._row[fields.TASK] = task
        self._row[fields.TARGET : fields.TARGET + len(target)] = target

    def _make(self, item: Item) -> int:
        """Return the code of an item: of scenery, or of a new object, with its contents, that lies in no cell yet."""
        kind = self._kind_number(item)
        colour = COLOURS.index(item.colour)
        state = DOOR_STATES.index(item.state)
        if not item.has_identity:
            return pack(kind, colour, 0, 0)
        code = make(self._row, kind, colour, state)
        if item.contains is not None:
            self._row[contents_index(self._row, identities_of(code))] = self._make(item.contains)
        return int(code)

    def _kind_number(self, item: Item) -> int:
        if item.own is None:
            return KINDS.index(item.kind)
        if item.own not in self.kinds:
            raise WorldError(f"unknown kind {item.kind!r}; add it to the world's kinds = (...)")
        return fields.FIRST_OWN_KIND + self.kinds.index(item.own)

    def _draw_free_cell(
        self, noun: str, top: Place, size: Place | None, reject: Callable[[int, int], bool] | None, tries: int
    ) -> Place:
        """Return a random free cell for what ``noun`` names; the other arguments and the error are those of `place`."""
        size = size or (self.width, self.height)
        read_rng_state(self._np_random, self._rng_state)
        for _ in range(tries):
            x, y = placement.draw_place(self._row, self._rng_state, *top, *size, placement.UNLIMITED_TRIES)
            if x < 0 or not (self._is_taken(x, y) or (reject is not None and reject(x, y))):
                break
        else:
            x = -1
        write_rng_state(self._rng_state, self._np_random)
        if x < 0:
            self._row[fields.FAILED] = 0
            raise WorldError(
                f"no free cell for the {noun} in the {size[0]} x {size[1]} cells from {top}; give it a larger rectangle"
            )
        return x, y

    def _is_taken(self, x: int, y: int) -> bool:
        """Return whether a body other than the first stands in the cell (x, y); draws avoid the first body anyway."""
        starts = (body_index(self._row, body) for body in range(1, self.bodies))
        return any(self._row[at] == x and self._row[at + 1] == y for at in starts)

    def _check_inside(self, x: int, y: int) -> None:
        if not (0 <= x < self.width and 0 <= y < self.height):
            raise WorldError(f"cell ({x}, {y}) is outside the grid of {self.width} x {self.height} cells")


AGENT = (">>", "vv", "<<", "^^")  # by direction
COLOUR_LETTERS = "rgbpy-"  # by colour number
KIND_LETTERS = {"wall": "W", "floor": "F", "key": "K", "ball": "A", "box": "B", "goal": "G", "lava": "V"}
DOOR_LETTERS = {"open": "O", "closed": "D", "locked": "L"}


def to_text(state: State, kinds: Sequence[ObjectKind] = ()) -> str:
    """Return a state's grid as a diagram of characters, with a line per row; ``kinds`` are the world's own kinds."""
    lines = []
    for y in range(state.height):
        cells = [_format_cell(int(state.cells[x, y]), kinds) for x in range(state.width)]
        if state.position[1] == y:
            cells[state.position[0]] = AGENT[state.direction]
        lines.append("".join(cells))
    return "\n".join(lines)


def observation_to_text(
    observation: Mapping[str, Any] | NDArray[np.integer[Any]], kinds: Sequence[ObjectKind] = ()
) -> str:
    """Return an observation of a grid world's agent as a diagram, in the characters of `to_text`.

    Two dots are a cell that the agent does not see. The agent stands in the middle of the bottom row and looks up
    (``^^``); the last line shows what it carries, such as "carries Ky". In an image of the whole grid
    (`wrappers.FullyObserved`), the agent is in its cell.

    Args:
        observation: the observation of one step, with an "image"; or the image, [columns, rows, 3], with kind, colour
            and state.
        kinds: the world's own kinds.

    Raises:
        WorldError: if the image has another shape, or an unknown kind.
    """
    image = np.asarray(observation["image"] if isinstance(observation, Mapping) else observation)
    if image.ndim != 3 or image.shape[2] != 3:
        raise WorldError(f"the image has the shape {image.shape}; use [columns, rows, 3], with kind, colour and state")
    if (highest := int(image[..., 0].max())) >= fields.FIRST_OWN_KIND + len(kinds):
        raise WorldError(f"the image has the unknown kind {highest}; pass the world's own kinds with kinds=(...)")
    numbers, colours, states = np.moveaxis(image.astype(np.int64), 2, 0)
    cells = [
        [_format_observed_cell(*cell, kinds) for cell in zip(*line, strict=True)]
        for line in zip(numbers.T.tolist(), colours.T.tolist(), states.T.tolist(), strict=True)
    ]
    carried = ""
    shows_whole_grid = (numbers == KINDS.index("agent")).any()
    if not shows_whole_grid:
        nearest_row = cells[-1]
        middle = len(nearest_row) // 2
        carried = nearest_row[middle]  # the agent's own cell shows what it carries
        nearest_row[middle] = AGENT[3]
    lines = ["".join(row) for row in cells]
    if carried.strip():
        lines.append(f"carries {carried}")
    return "\n".join(lines)


def _format_observed_cell(kind: int, colour: int, state: int, kinds: Sequence[ObjectKind]) -> str:
    """Return the two characters of a cell of an observation, given its kind, colour and state.

    The cell can be unseen, or have the agent, whose state is its direction.
    """
    if kind == UNSEEN:
        return ".."
    if kind == KINDS.index("agent"):
        return AGENT[state]
    return _format_cell(pack(kind, colour, state, 0), kinds)


def from_text(diagram: str, grid: Layout) -> None:
    """Lay out a diagram, one line per row, from the top left cell. Call this function in a world's ``layout``.

    Raises:
        WorldError: if the two characters of a cell are not valid, or the diagram is too large; the message names the
            cell.
    """
    for y, line in enumerate(diagram.splitlines()):
        for x in range(0, len(line), 2):
            cell = line[x : x + 2].ljust(2)
            if cell in AGENT:
                grid.put_agent(x // 2, y, AGENT.index(cell))
            elif cell != "  ":
                grid.put(_parse_cell(cell, x // 2, y, grid.kinds), x // 2, y)


def _format_cell(code: int, kinds: Sequence[ObjectKind]) -> str:
    """Return the two characters of a cell's code: the letter of its kind and that of its colour."""
    if kind_of(code) == EMPTY:
        return "  "
    if code == GREY_WALL:
        return "WW"
    colour = COLOUR_LETTERS[colour_of(code)]
    if kind_of(code) >= fields.FIRST_OWN_KIND:
        own = kinds[kind_of(code) - fields.FIRST_OWN_KIND]
        is_open = own.opens and state_of(code) == OPEN
        return (own.letter.lower() if is_open else own.letter) + colour
    kind = KINDS[kind_of(code)]
    if kind == "door":
        letter = DOOR_LETTERS[DOOR_STATES[state_of(code)]]
    else:
        letter = KIND_LETTERS[kind]
    return letter + colour


def _parse_cell(cell: str, x: int, y: int, kinds: Sequence[ObjectKind]) -> Item:
    """Return the item that the two characters of a cell stand for.

    Raises:
        WorldError: if they stand for none; the message names the cell's column x and row y.
    """
    if cell == "WW":
        return Item("wall", "grey")
    letter = cell[0]
    colour = cell[1]
    if colour in COLOUR_LETTERS:
        name = COLOURS[COLOUR_LETTERS.index(colour)]
        for state, door_letter in DOOR_LETTERS.items():
            if letter == door_letter:
                return Item("door", name, state)
        for kind, kind_letter in KIND_LETTERS.items():
            if letter == kind_letter:
                return Item(kind, name)
        for own in kinds:
            if letter == own.letter or (own.opens and letter == own.letter.lower()):
                return own(name, is_open=letter.islower())
    raise WorldError(
        f"unknown cell {cell!r} in column {x}, row {y} of the diagram; docs/grid-worlds.md lists the cells"
    )
