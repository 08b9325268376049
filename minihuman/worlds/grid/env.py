"""GridEnv: a world of the catalogue, laid out by its family's compiled layout."""

from collections.abc import Callable
from typing import Any

from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.families import recipe
from minihuman.worlds.grid.recipe import Recipe

SETTINGS = frozenset({"agent_view_size", "render_mode", "tile_size", "palette"})


class GridEnv(GridEngine):
    """A world of a family: ``GridEnv("four_rooms", max_steps=50)``.

    Args:
        family: One of ``families.FAMILIES`` or of the levels, or a level of your own.
        max_steps: Instead of the family's own.
        see_through_walls: Instead of the family's own.
        options: `GridEngine`'s settings, and what the family's function takes (``size=9``).
    """

    def __init__(
        self,
        family: str | Callable[..., Recipe],
        *,
        max_steps: int | None = None,
        see_through_walls: bool | None = None,
        **options: Any,
    ) -> None:
        settings = {name: options.pop(name) for name in SETTINGS & options.keys()}
        self.recipe = family(**options) if callable(family) else recipe(family, **options)
        if max_steps is not None:
            self.recipe = self.recipe.limited(max_steps)
        super().__init__(
            width=self.recipe.width,
            height=self.recipe.height,
            max_steps=self.recipe.max_steps,
            mission=self.recipe.mission,
            see_through_walls=self.recipe.see_through_walls if see_through_walls is None else see_through_walls,
            actions=self.recipe.actions,
            **settings,
        )
        self._draws = self.recipe.draws

    def _lay_out(self) -> None:
        self.recipe.lay_out(self._row, self._stream())
        self.mission = self.mission_space.of(self._row)
