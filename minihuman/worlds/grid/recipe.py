"""Recipe: everything that makes a family's world beside the drawn layout."""

from collections.abc import Callable
from dataclasses import dataclass

from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.state import Row
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
    mission: MissionSpace
    see_through_walls: bool = False
    actions: int = 7  # the first so many of the seven
    draws: bool = False  # steps draw random numbers too

    def lay_out(self, row: Row, words: Words) -> None:
        """Lay an episode out into a cleared row."""
        self.layout(row, words, *self.numbers)
