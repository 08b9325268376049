"""Kinds: things of a world's own in the grid, beside walls, doors, keys, balls and boxes. One row of properties each.

A world names its kinds, and puts items of them where it likes:

    MUD = Kind("mud", "M", stepped_on=True)

    class Bog(GridWorld):
        kinds = (MUD,)

        def layout(self, grid):
            grid.put(MUD("yellow"), 3, 3)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from minihuman.errors import WorldError
from minihuman.worlds.grid.art.shapes import Canvas
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.core.own import CARRIED, HIDES, MOST_OWN, OPENS, OWN, STEPPED_ON
from minihuman.worlds.grid.items import Item

RGB = tuple[int, int, int]
Draw = Callable[[Canvas, RGB, str], None]  # a tile to paint on, the thing's colour, "open", "closed" or "locked"

TAKEN_LETTERS = frozenset("WFDLOKABGV")  # by what there is already


@dataclass(frozen=True, slots=True)
class Block:
    """A plain block seen from inside: its sides in metres (along x, up, along z). A cell is a metre wide."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Shape:
    """A mesh of our own seen from inside, in the thing's colour: "cone", "potion", "tree", ... so many metres high."""

    mesh: str
    height_m: float


def plain(canvas: Canvas, colour: RGB, state: str) -> None:
    """How a kind is drawn that says nothing of it: a rounded square, hollow while it is open."""
    canvas.fill(canvas.box(0.12, 0.12, 0.88, 0.88, 0.12), colour)
    if state != "open":
        return
    dark = tuple(part * 0.6 for part in colour)
    canvas.fill(canvas.box(0.24, 0.24, 0.76, 0.76, 0.08), (dark[0], dark[1], dark[2]))


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of thing. Calling it makes an item of it: ``MUD("yellow")``, ``GATE("red", locked=True)``.

    Args:
        name: A noun, lower case; on maps and in errors.
        letter: One capital letter for diagrams; a thing that opens has the small one while it is open.
        stepped_on: The agent can stand on it.
        carried: It can be picked up, put down and lie in a box.
        hides: What is behind it is not seen.
        opens: "toggle" opens and closes it, and a key of its colour unlocks it; while open it lets pass and see.
        draw: Paints it on a tile seen from above, over the floor; `plain` shows the colour.
        inside: What it is seen from inside, while it is closed if it opens.
        inside_open: What it is seen from inside while it is open; None for nothing.
    """

    name: str
    letter: str
    stepped_on: bool = False
    carried: bool = False
    hides: bool = False
    opens: bool = False
    draw: Draw = plain
    inside: Block | Shape | None = Block((0.6, 0.6, 0.6))
    inside_open: Block | Shape | None = None

    def __post_init__(self) -> None:
        """Refuse what another kind is called already."""
        if not self.name or self.name in KINDS:
            raise WorldError(f"a kind cannot be called {self.name!r}; {', '.join(KINDS)} are taken")
        if len(self.letter) != 1 or not "A" <= self.letter <= "Z" or self.letter in TAKEN_LETTERS:
            taken = "".join(sorted(TAKEN_LETTERS))
            raise WorldError(f"the letter of {self.name!r} is {self.letter!r}; it is one from A to Z but {taken}")

    def __call__(self, colour: str, *, locked: bool = False, is_open: bool = False) -> Item:
        """An item of this kind.

        Raises:
            WorldError: if it is to be locked or open and is of no kind that opens.
        """
        if (locked or is_open) and not self.opens:
            raise WorldError(f"{self.name!r} does not open, so none is locked or open; say opens=True where it is made")
        closed = "locked" if locked else "closed"
        return Item(self.name, colour, closed if self.opens and not is_open else "open", own=self)

    @property
    def bits(self) -> int:
        """What it lets happen, as kernels read it."""
        said = (self.stepped_on, STEPPED_ON), (self.carried, CARRIED), (self.hides, HIDES), (self.opens, OPENS)
        return sum(bit for does, bit in said if does)

    @property
    def has_identity(self) -> bool:
        """Whether each one put is an object of its own: what is carried or opens."""
        return self.carried or self.opens


def check_kinds(kinds: Sequence[Kind]) -> int:
    """A world's kinds as the number that its row holds.

    Raises:
        WorldError: if there are too many, or two share a name or a letter.
    """
    if len(kinds) > MOST_OWN:
        raise WorldError(f"{len(kinds)} kinds of its own; a world has room for {MOST_OWN}")
    for what in ("name", "letter"):
        said = [getattr(kind, what) for kind in kinds]
        if len(set(said)) < len(said):
            raise WorldError(f"two kinds of a world share a {what}: {', '.join(said)}")
    return sum(kind.bits << 1 + 4 * place for place, kind in enumerate(kinds))


def kind_name(number: int, kinds: Sequence[Kind]) -> str:
    """What the kind of a number is called in a world with these kinds of its own."""
    return KINDS[number] if number < OWN else kinds[number - OWN].name
