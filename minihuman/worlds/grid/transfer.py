"""GoToObj in the grid: an empty room, four objects at the middles of its walls, face the one that is named."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from minihuman.worlds.contract import Bounds
from minihuman.worlds.go_to_obj import COLOURS, KINDS, arrange
from minihuman.worlds.grid.core.state import TARGET
from minihuman.worlds.grid.core.tasks import FORWARD, REACH, TOGGLE, front, prize
from minihuman.worlds.grid.items import Item
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.planner import facing, walk
from minihuman.worlds.grid.world import GridWorld
from minihuman.worlds.options import MOST_CELLS, truth, whole


class GoToObj(GridWorld):
    """The source world of the transfer experiment; every default is a fact of the published one but ``ambiguous``.

    The agent starts in the middle, facing right. Facing the target ends the episode and earns
    ``1 - 0.9 * step / max_steps``.

    Args:
        size: Columns and rows, walls included; odd.
        max_steps: ``4 * size**2`` by default, as published.
        ambiguous: Let a mission fit two objects, as it could in the published world.
        toggle_ends: The action "toggle" ends the episode with nothing, as published.
        options: `GridEngine`'s settings.
    """

    def __init__(
        self,
        *,
        size: int = 11,
        max_steps: int | None = None,
        ambiguous: bool = False,
        toggle_ends: bool = True,
        see_through_walls: bool = True,
        **options: Any,
    ) -> None:
        self.size = whole("size", size, 5, MOST_CELLS - 1, odd=True)  # with a middle, and four objects
        self.ambiguous = truth("ambiguous", ambiguous)
        self.toggle_ends = truth("toggle_ends", toggle_ends)
        super().__init__(
            width=size,
            height=size,
            max_steps=4 * size * size if max_steps is None else max_steps,
            mission=MissionSpace("go to the {} {}", COLOURS, KINDS),
            see_through_walls=see_through_walls,
            **options,
        )

    def layout(self, grid: Layout) -> None:
        """Lay out the room, the objects and the agent."""
        middle, last = self.size // 2, self.size - 2
        places = ((1, middle), (middle, last), (last, middle), (middle, 1))  # in the order of WALLS
        drawn = arrange(self.np_random, ambiguous=self.ambiguous)
        grid.wall_rect()
        for (colour, kind), (x, y) in zip(drawn.objects, places, strict=True):
            grid.put(Item(kind, colour), x, y)
        grid.put_agent(middle, middle, 0)
        grid.task(REACH, *places[drawn.target])
        grid.mission = drawn.mission

    def judge(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Facing the target is success; "toggle" is the end."""
        if front(self._row) == (self._row[TARGET], self._row[TARGET + 1]):
            return prize(self._row), True
        return reward, terminated or (self.toggle_ends and action == TOGGLE)

    def way(self) -> Sequence[int] | None:
        """Turns and steps to where the target is ahead."""
        if front(self._row) == (self._row[TARGET], self._row[TARGET + 1]):
            return [FORWARD]  # which stays where it is, and is judged
        return walk(self._in_world(), facing(np.array([self._row[TARGET : TARGET + 2]], np.int64))) or ()

    def bounds(self) -> Bounds:
        """The length of that way, twice."""
        count = len(self.way() or ()) or None
        return Bounds(count, count)
