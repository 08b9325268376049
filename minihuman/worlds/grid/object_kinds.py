"""Object kinds: items that a layout puts into cells (`goal()`, `door("red", locked=True)`), and a world's own kinds.

A world declares its own kinds, each with its properties, and its layout puts items of them into cells:

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

_BUILT_IN_KINDS = KINDS[2:10]  # from "wall" to "lava": those that a layout can put into a cell


@dataclass(frozen=True, slots=True)
class Item:
    """A kind of object in a colour. Putting it into a grid makes an object; one item can be put many times."""

    kind: str
    colour: str
    state: str = "open"  # of a door: open, closed or locked
    contains: "Item | None" = None  # of a box
    own: "ObjectKind | None" = None  # the world's own kind that made it; None for a built-in kind

    def __post_init__(self) -> None:
        """Check that the kind, the colour, the door state and the contents are valid; raise a WorldError if not."""
        if self.own is None and self.kind not in _BUILT_IN_KINDS:
            raise WorldError(f"unknown kind {self.kind!r} of item; use one of {', '.join(_BUILT_IN_KINDS)}")
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
        """Return whether each object made from the item is tracked by itself, as doors, keys, balls and boxes are."""
        if self.own is None:
            return self.kind == "door" or self.is_carried
        return self.own.has_identity

    @property
    def is_carried(self) -> bool:
        """Return whether the agent can pick up an object made from the item."""
        if self.own is None:
            return self.kind in ("key", "ball", "box")
        return self.own.carried


def wall(colour: Colour = "grey") -> Item:
    """Return a wall, which blocks movement and sight."""
    return Item("wall", colour)


def floor(colour: Colour = "blue") -> Item:
    """Return a coloured floor, on which the agent can walk."""
    return Item("floor", colour)


def lava() -> Item:
    """Return lava, which ends the episode when the agent steps into it."""
    return Item("lava", "red")


def goal(colour: Colour = "green") -> Item:
    """Return a goal, which ends the episode with success when the agent steps on it."""
    return Item("goal", colour)


def door(colour: Colour, *, locked: bool = False, is_open: bool = False) -> Item:
    """Return a door, closed unless it is locked or open; the key of its colour opens a locked door."""
    state = "closed"
    if locked:
        state = "locked"
    elif is_open:
        state = "open"
    return Item("door", colour, state)


def key(colour: Colour = "blue") -> Item:
    """Return a key, which the agent can carry."""
    return Item("key", colour)


def ball(colour: Colour = "blue") -> Item:
    """Return a ball, which the agent can carry."""
    return Item("ball", colour)


def box(colour: Colour, contains: Item | None = None) -> Item:
    """Return a box, which the agent can carry, or open with "toggle" so that what it ``contains`` remains."""
    return Item("box", colour, contains=contains)


RGB = tuple[int, int, int]
# takes a tile to paint on, the colour of the object, and its state: "open", "closed" or "locked"
Draw = Callable[[Canvas, RGB, str], None]

TAKEN_LETTERS = frozenset("WFDLOKABGV")  # by the built-in kinds and the states of doors


@dataclass(frozen=True, slots=True)
class BlockShape:
    """A plain block, for the view from inside, with its sides in metres (along x, up, along z).

    A cell is a metre wide.
    """

    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class MeshShape:
    """A built-in mesh, such as "cone", "potion" or "tree", for the view from inside, and its height in metres."""

    mesh: str
    height_m: float


def plain(canvas: Canvas, colour: RGB, state: str) -> None:
    """Draw an object of a kind that has no drawing as a rounded square, hollow while its state is "open"."""
    canvas.fill(canvas.box(0.12, 0.12, 0.88, 0.88, 0.12), colour)
    if state != "open":
        return
    red, green, blue = (part * 0.6 for part in colour)  # darker
    canvas.fill(canvas.box(0.24, 0.24, 0.76, 0.76, 0.08), (red, green, blue))


@dataclass(frozen=True, slots=True)
class ObjectKind:
    """A kind of object. Calling it makes an item of this kind: ``MUD("yellow")``, ``GATE("red", locked=True)``.

    Args:
        name: a noun in lower case, for maps and errors.
        letter: a capital letter for diagrams; an open object has the small letter.
        stepped_on: whether the agent can stand on it.
        carried: whether it can be picked up, put down and lie in a box.
        hides: whether it hides what is behind it.
        opens: whether "toggle" opens and closes it, and a key of its colour unlocks it; while it is open, the agent can
            pass and see through it.
        draw: a function that paints it on a tile seen from above, over the floor; `plain` shows only the colour.
        inside: its shape in the view from inside; if it opens, the shape while it is closed.
        inside_open: its shape in the view from inside while it is open; None for nothing.
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
        """Check that the name and the letter are valid and not taken; raise a WorldError if not."""
        if not self.name or self.name in KINDS:
            raise WorldError(f"a kind cannot be called {self.name!r}; {', '.join(KINDS)} are taken")
        if len(self.letter) != 1 or not "A" <= self.letter <= "Z" or self.letter in TAKEN_LETTERS:
            taken_letters = "".join(sorted(TAKEN_LETTERS))
            raise WorldError(
                f"the letter of {self.name!r} is {self.letter!r}; use one of A to Z except {taken_letters}"
            )

    def __call__(self, colour: str, *, locked: bool = False, is_open: bool = False) -> Item:
        """Return an item of this kind in a colour; if the kind opens, it is closed unless it is ``locked`` or open.

        Raises:
            WorldError: if the item is to be locked or open, but the kind does not open.
        """
        if (locked or is_open) and not self.opens:
            raise WorldError(f"{self.name!r} does not open, so it cannot be locked or open; define it with opens=True")
        state = "open"
        if self.opens and not is_open:
            state = "locked" if locked else "closed"
        return Item(self.name, colour, state, own=self)

    @property
    def bits(self) -> int:
        """Return the kind's properties as a field of four bits, which kernels read."""
        flags = (self.stepped_on, STEPPED_ON), (self.carried, CARRIED), (self.hides, HIDES), (self.opens, OPENS)
        return sum(bit for has_property, bit in flags if has_property)

    @property
    def has_identity(self) -> bool:
        """Return whether each object of this kind is tracked by itself: those that can be carried or opened are."""
        return self.carried or self.opens


def check_kinds(kinds: Sequence[ObjectKind]) -> int:
    """Check a world's own kinds, and return their properties as bits of the number at `SEE_THROUGH` in its row.

    Raises:
        WorldError: if there are too many, or two share a name or a letter.
    """
    if len(kinds) > MAX_OWN_KINDS:
        raise WorldError(f"{len(kinds)} kinds of its own are too many; a world takes at most {MAX_OWN_KINDS}")
    for attribute in ("name", "letter"):
        texts = [getattr(kind, attribute) for kind in kinds]
        if len(set(texts)) < len(texts):
            raise WorldError(f"two kinds of a world share a {attribute}: {', '.join(texts)}")
    return sum(kind.bits << 1 + 4 * position for position, kind in enumerate(kinds))


def kind_name(number: int, kinds: Sequence[ObjectKind]) -> str:
    """Return the name of the kind with a number in a world whose own kinds are ``kinds``."""
    if number < FIRST_OWN_KIND:
        return KINDS[number]
    return kinds[number - FIRST_OWN_KIND].name
