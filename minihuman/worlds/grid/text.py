"""Text: a grid as lines of characters, two a cell, for diagrams and tests; and back.

The first character is the kind, the second the colour (r g b p y, and - for grey). ``WW`` is a grey wall, two spaces
an empty cell, the agent ``>>`` ``vv`` ``<<`` ``^^``. A door is ``D`` closed, ``L`` locked, ``O`` open. What the agent
stands on, what it carries and what boxes contain is not shown. Kinds of a world's own have letters of their own.
"""

from collections.abc import Sequence

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import (
    COLOURS,
    DOOR_STATES,
    EMPTY,
    GREY_WALL,
    KINDS,
    OPEN,
    colour_of,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.own import OWN
from minihuman.worlds.grid.core.state import State
from minihuman.worlds.grid.items import Item
from minihuman.worlds.grid.kinds import Kind
from minihuman.worlds.grid.layout import Layout

AGENT = (">>", "vv", "<<", "^^")  # by direction
COLOUR_LETTERS = "rgbpy-"  # by colour number
KIND_LETTERS = {"wall": "W", "floor": "F", "key": "K", "ball": "A", "box": "B", "goal": "G", "lava": "V"}
DOOR_LETTERS = {"open": "O", "closed": "D", "locked": "L"}


def to_text(state: State, kinds: Sequence[Kind] = ()) -> str:
    """A diagram of the grid."""
    lines = []
    for y in range(state.height):
        cells = [_cell(int(state.cells[x, y]), kinds) for x in range(state.width)]
        if state.position[1] == y:
            cells[state.position[0]] = AGENT[state.direction]
        lines.append("".join(cells))
    return "\n".join(lines)


def from_text(diagram: str, grid: Layout) -> None:
    """Lay a diagram out: one line a row, from the top left cell. Call it in a world's ``layout``.

    Raises:
        WorldError: if a cell's two characters mean nothing, naming its column and row, or the diagram is too large.
    """
    for y, line in enumerate(diagram.splitlines()):
        for x in range(0, len(line), 2):
            cell = line[x : x + 2].ljust(2)
            if cell in AGENT:
                grid.put_agent(x // 2, y, AGENT.index(cell))
            elif cell != "  ":
                grid.put(_item(cell, x // 2, y, grid.kinds), x // 2, y)


def _cell(code: int, kinds: Sequence[Kind]) -> str:
    if kind_of(code) == EMPTY:
        return "  "
    if code == GREY_WALL:
        return "WW"
    colour = COLOUR_LETTERS[colour_of(code)]
    if kind_of(code) >= OWN:
        own = kinds[kind_of(code) - OWN]
        return (own.letter.lower() if own.opens and state_of(code) == OPEN else own.letter) + colour
    kind = KINDS[kind_of(code)]
    letter = DOOR_LETTERS[DOOR_STATES[state_of(code)]] if kind == "door" else KIND_LETTERS[kind]
    return letter + colour


def _item(cell: str, x: int, y: int, kinds: Sequence[Kind]) -> Item:
    if cell == "WW":
        return Item("wall", "grey")
    letter, colour = cell[0], cell[1]
    if colour in COLOUR_LETTERS:
        name = COLOURS[COLOUR_LETTERS.index(colour)]
        for state, door in DOOR_LETTERS.items():
            if letter == door:
                return Item("door", name, state)
        for kind, other in KIND_LETTERS.items():
            if letter == other:
                return Item(kind, name)
        for own in kinds:
            if letter == own.letter or (own.opens and letter == own.letter.lower()):
                return own(name, is_open=letter.islower())
    raise WorldError(
        f"{cell!r} in column {x}, row {y} of the diagram means nothing; docs/grid-worlds.md lists the cells"
    )
