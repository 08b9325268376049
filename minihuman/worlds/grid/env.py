"""GridEnv: a world of the catalogue, laid out by its family's compiled layout."""

from collections.abc import Callable
from typing import Any

from minihuman.worlds.grid.core.state import FAILED
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.families import recipe
from minihuman.worlds.grid.recipe import Recipe

SETTINGS = frozenset({"agent_view_size", "render_mode", "tile_size", "palette", "highlight", "agent_pov"})


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
        self._told = self.recipe  # of this episode: with a mission set by hand, or as it is

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode; in worlds with instructions ``options={"mission": ...}`` says what is to be done.

        Houses are drawn until one fits the mission: everything it names is there, as many as its articles say.

        Raises:
            WorldError: if the mission is none of this world's, or no house fits it.
        """
        mission = (options or {}).get("mission")
        self._told = self.recipe if mission is None else self.recipe.about(mission)
        return super().reset(seed=seed, options=options)

    def _lay_out(self) -> None:
        self._told.lay_out(self._row, self._stream())
        if not self._row[FAILED]:
            self.mission = self.mission_space.of(self._row)
