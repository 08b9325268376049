"""Object kinds: the items that a layout puts into cells (`goal()`, `door("red", locked=True)`), and kinds of your own.

A world names its own kinds, one row of properties each, and puts items of them where it likes:

    MUD = ObjectKind("mud", "M", stepped_on=True)

    class Bog(GridWorld):
        kinds = (MUD,)

        def layout(self, grid):
            grid.put(MUD("yellow"), 3, 3)
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS, Colour
from minihuman.worlds.grid.core.cells import DOOR_STATES, KINDS
from minihuman.worlds.grid.core.state import CARRIED, FIRST_OWN_KIND, HIDES, MAX_OWN_KINDS, OPENS, STEPPED_ON
from minihuman.worlds.grid.pictures.tiles import Canvas


@dataclass(frozen=True, slots=True)
class Item:
    """A kind of thing in a colour. Putting it into a grid makes the thing; one item can be put many times."""

    kind: str
    colour: str
    state: str = "open"  # doors: open, closed or locked
    contains: "Item | None" = None  # boxes
    own: "ObjectKind | None" = None  # what made it, where it is of no kind of ours

    def __post_init__(self) -> None:
        """Refuse what there is not."""
        if self.own is None and self.kind not in KINDS[2:10]:
            raise WorldError(f"unknown kind {self.kind!r} of item; use one of {', '.join(KINDS[2:10])}")
        if self.colour not in COLOURS:
            raise WorldError(f"unknown colour {self.colour!r}; use one of {', '.join(COLOURS)}")
        if self.state not in DOOR_STATES:
            raise WorldError(f"unknown door state {self.state!r}; use one of {', '.join(DOOR_STATES)}")
        if self.contains is not None and (self.kind != "box" or not self.contains.is_carried):
            raise WorldError(
                f"a {self.kind} cannot contain a {self.contains.kind}; a box takes only what can be carried"
            )

    @property
    def has_identity(self) -> bool:
        """Return whether each one put is an object of its own: doors, keys, balls, boxes, and what is like them."""
        if self.own is None:
            return self.kind == "door" or self.is_carried
        return self.own.has_identity

    @property
    def is_carried(self) -> bool:
        """Return whether it can be picked up."""
        if self.own is None:
            return self.kind in ("key", "ball", "box")
        return self.own.carried


def wall(colour: Colour = "grey") -> Item:
    """Make a wall: nothing passes, nothing is seen behind it."""
    return Item("wall", colour)


def floor(colour: Colour = "blue") -> Item:
    """Make a coloured floor to walk on."""
    return Item("floor", colour)


def lava() -> Item:
    """Make lava: stepping in ends the episode."""
    return Item("lava", "red")


def goal(colour: Colour = "green") -> Item:
    """Make the goal: stepping on it ends the episode with success."""
    return Item("goal", colour)


def door(colour: Colour, *, locked: bool = False, is_open: bool = False) -> Item:
    """Make a door; a locked one opens to the key of its colour."""
    state = "closed"
    if locked:
        state = "locked"
    elif is_open:
        state = "open"
    return Item("door", colour, state)


def key(colour: Colour = "blue") -> Item:
    """Make a key to carry."""
    return Item("key", colour)


def ball(colour: Colour = "blue") -> Item:
    """Make a ball to carry."""
    return Item("ball", colour)


def box(colour: Colour, contains: Item | None = None) -> Item:
    """Make a box to carry, or to open ("toggle"), which leaves what it contains."""
    return Item("box", colour, contains=contains)


RGB = tuple[int, int, int]
Draw = Callable[[Canvas, RGB, str], None]  # a tile to paint on, the thing's colour, "open", "closed" or "locked"

TAKEN_LETTERS = frozenset("WFDLOKABGV")  # by what there is already


@dataclass(frozen=True, slots=True)
class BlockShape:
    """A plain block seen from inside: its sides in metres (along x, up, along z). A cell is a metre wide."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshShape:
    """A mesh of our own seen from inside, in the thing's colour: "cone", "potion", "tree", ... so many metres high."""

    mesh: str
    height_m: float


def plain(canvas: Canvas, colour: RGB, state: str) -> None:
    """Draw a kind that does not draw itself: a rounded square, hollow while it is open."""
    canvas.fill(canvas.box(0.12, 0.12, 0.88, 0.88, 0.12), colour)
    if state != "open":
        return
    dark = tuple(part * 0.6 for part in colour)
    canvas.fill(canvas.box(0.24, 0.24, 0.76, 0.76, 0.08), (dark[0], dark[1], dark[2]))


@dataclass(frozen=True, slots=True)
class ObjectKind:
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
    inside: BlockShape | MeshShape | None = BlockShape((0.6, 0.6, 0.6))
    inside_open: BlockShape | MeshShape | None = None

    def __post_init__(self) -> None:
        """Refuse what another kind is called already."""
        if not self.name or self.name in KINDS:
            raise WorldError(f"a kind cannot be called {self.name!r}; {', '.join(KINDS)} are taken")
        if len(self.letter) != 1 or not "A" <= self.letter <= "Z" or self.letter in TAKEN_LETTERS:
            taken_letters = "".join(sorted(TAKEN_LETTERS))
            raise WorldError(
                f"the letter of {self.name!r} is {self.letter!r}; use one of A to Z except {taken_letters}"
            )

    def __call__(self, colour: str, *, locked: bool = False, is_open: bool = False) -> Item:
        """Make an item of this kind.

        Raises:
            WorldError: if it is to be locked or open and is of no kind that opens.
        """
        if (locked or is_open) and not self.opens:
            raise WorldError(f"{self.name!r} does not open, so it cannot be locked or open; define it with opens=True")
        closed = "locked" if locked else "closed"
        return Item(self.name, colour, closed if self.opens and not is_open else "open", own=self)

    @property
    def bits(self) -> int:
        """Encode what it lets happen, as kernels read it."""
        flags = (self.stepped_on, STEPPED_ON), (self.carried, CARRIED), (self.hides, HIDES), (self.opens, OPENS)
        return sum(bit for does, bit in flags if does)

    @property
    def has_identity(self) -> bool:
        """Return whether each one put is an object of its own: what is carried or opens."""
        return self.carried or self.opens


def check_kinds(kinds: Sequence[ObjectKind]) -> int:
    """Check a world's kinds, and encode them as the number that its row holds.

    Raises:
        WorldError: if there are too many, or two share a name or a letter.
    """
    if len(kinds) > MAX_OWN_KINDS:
        raise WorldError(f"{len(kinds)} kinds of its own are too many; a world takes at most {MAX_OWN_KINDS}")
    for attribute in ("name", "letter"):
        texts = [getattr(kind, attribute) for kind in kinds]
        if len(set(texts)) < len(texts):
            raise WorldError(f"two kinds of a world share a {attribute}: {', '.join(texts)}")
    return sum(kind.bits << 1 + 4 * place for place, kind in enumerate(kinds))


def kind_name(number: int, kinds: Sequence[ObjectKind]) -> str:
    """Return what the kind of a number is called in a world with these kinds of its own."""
    if number < FIRST_OWN_KIND:
        return KINDS[number]
    return kinds[number - FIRST_OWN_KIND].name
