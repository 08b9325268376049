"""Items: what a layout written in Python puts into cells. ``goal()``, ``door("red", locked=True)``, ``key("red")``."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from minihuman.errors import WorldError
from minihuman.worlds.colours import Colour
from minihuman.worlds.grid.core.cells import COLOURS, DOOR_STATES, KINDS

if TYPE_CHECKING:
    from minihuman.worlds.grid.kinds import Kind


@dataclass(frozen=True, slots=True)
class Item:
    """A kind of thing in a colour. Putting it into a grid makes the thing; one item can be put many times."""

    kind: str
    colour: str
    state: str = "open"  # doors: open, closed or locked
    contains: "Item | None" = None  # boxes
    own: "Kind | None" = None  # what made it, where it is of no kind of ours

    def __post_init__(self) -> None:
        """Refuse what there is not."""
        if self.own is None and self.kind not in KINDS[2:10]:
            raise WorldError(f"{self.kind!r} is no kind of item; there are {', '.join(KINDS[2:10])}")
        if self.colour not in COLOURS:
            raise WorldError(f"{self.colour!r} is no colour; there are {', '.join(COLOURS)}")
        if self.state not in DOOR_STATES:
            raise WorldError(f"{self.state!r} is no state of a door; there are {', '.join(DOOR_STATES)}")
        if self.contains is not None and (self.kind != "box" or not self.contains.is_carried):
            raise WorldError(f"a {self.kind} cannot contain a {self.contains.kind}; a box holds what can be carried")

    @property
    def has_identity(self) -> bool:
        """Whether each one put is an object of its own: doors, keys, balls, boxes, and what is like them."""
        return self.kind == "door" or self.is_carried if self.own is None else self.own.has_identity

    @property
    def is_carried(self) -> bool:
        """Whether it can be picked up."""
        return self.kind in ("key", "ball", "box") if self.own is None else self.own.carried


def wall(colour: Colour = "grey") -> Item:
    """A wall: nothing passes, nothing is seen behind it."""
    return Item("wall", colour)


def floor(colour: Colour = "blue") -> Item:
    """A coloured floor to walk on."""
    return Item("floor", colour)


def lava() -> Item:
    """Lava: stepping in ends the episode."""
    return Item("lava", "red")


def goal(colour: Colour = "green") -> Item:
    """The goal: stepping on it ends the episode with success."""
    return Item("goal", colour)


def door(colour: Colour, *, locked: bool = False, is_open: bool = False) -> Item:
    """A door; a locked one opens to the key of its colour."""
    return Item("door", colour, "locked" if locked else "open" if is_open else "closed")


def key(colour: Colour = "blue") -> Item:
    """A key to carry."""
    return Item("key", colour)


def ball(colour: Colour = "blue") -> Item:
    """A ball to carry."""
    return Item("ball", colour)


def box(colour: Colour, contains: Item | None = None) -> Item:
    """A box to carry, or to open ("toggle"), which leaves what it contains."""
    return Item("box", colour, contains=contains)
