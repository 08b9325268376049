"""Recipe: everything that makes a family's world beside the drawn layout."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.state import Row
from minihuman.worlds.grid.instructions.space import InstructionSpace
from minihuman.worlds.grid.missions import MissionSpace

LayoutFunction = Callable[..., None]  # (row, words, *numbers)


@dataclass(frozen=True, slots=True)
class Recipe:
    """A layout with its numbers, the size it fills, its mission and its default settings."""

    layout: LayoutFunction
    numbers: tuple[int, ...]
    width: int
    height: int
    max_steps: int
    mission: MissionSpace | InstructionSpace
    see_through_walls: bool = False
    actions: int = 7  # the first so many of the seven

    def lay_out(self, row: Row, words: Words) -> None:
        """Lay an episode out into a cleared row."""
        self.layout(row, words, *self.numbers)

    def limited(self, max_steps: int) -> "Recipe":
        """The recipe of the same world with this step limit in every episode."""
        return replace(self, max_steps=max_steps)

    def about(self, mission: str) -> "Recipe":
        """The recipe of the same world with a mission set by hand.

        Raises:
            WorldError: because only worlds with instructions can have one set.
        """
        raise WorldError(
            f"mission {mission!r}: only worlds with instructions (BabyAI-...) have their mission set by hand"
        )
