"""GoToObj in the grid: an empty room with objects at the middles of its four walls.

The agent must face the named one.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.contract import PathLengthBounds
from minihuman.worlds.go_to_obj import KINDS, draw_arrangement
from minihuman.worlds.grid.core.rewards import FORWARD, REACH, TOGGLE, cell_in_front, success_reward
from minihuman.worlds.grid.core.state import TARGET
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.object_kinds import Item
from minihuman.worlds.grid.planner import facing, walk
from minihuman.worlds.options import MAX_CELLS, check_bool, check_whole


class GoToObjGrid(GridWorld):
    """The source world of the transfer experiment. All defaults but ``ambiguous`` are those of the published world.

    The agent starts in the middle, facing right. Facing the target ends the episode and earns ``1 - 0.9 * step /
    max_steps``.

    Args:
        size: the number of columns and rows, including the walls; odd.
        max_steps: the step limit; by default ``4 * size**2``, as published.
        ambiguous: whether a mission may describe two objects, as it could in the published world.
        toggle_ends: whether the action "toggle" ends the episode without a reward, as published.
        see_through_walls: whether the agent sees through walls.
        options: settings of `GridEngine`.
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
        self.size = check_whole("size", size, 5, MAX_CELLS - 1, odd=True)  # with a middle, and four objects
        self.ambiguous = check_bool("ambiguous", ambiguous)
        self.toggle_ends = check_bool("toggle_ends", toggle_ends)
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
        middle = self.size // 2
        last = self.size - 2
        places = ((1, middle), (middle, last), (last, middle), (middle, 1))  # in the order of WALLS
        arrangement = draw_arrangement(self.np_random, ambiguous=self.ambiguous)
        grid.wall_rect()
        for (colour, kind), (x, y) in zip(arrangement.objects, places, strict=True):
            grid.put(Item(kind, colour), x, y)
        grid.put_agent(middle, middle, 0)
        grid.task(REACH, *places[arrangement.target])
        grid.mission = arrangement.mission

    def reward_and_done(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Return the reward of success and True if the agent faces the target, or else ``reward`` and ``terminated``.

        The action "toggle" also ends the episode, if ``toggle_ends``.
        """
        if cell_in_front(self._row) == (self._row[TARGET], self._row[TARGET + 1]):
            return success_reward(self._row), True
        return reward, terminated or (self.toggle_ends and action == TOGGLE)

    def shortest_path(self) -> Sequence[int] | None:
        """Return the turns and steps after which the agent faces the target, a step if it does already; () for none."""
        if cell_in_front(self._row) == (self._row[TARGET], self._row[TARGET + 1]):
            return [FORWARD]  # the object blocks the step, which is judged nevertheless
        return walk(self._in_world(), facing(np.array([self._row[TARGET : TARGET + 2]], np.int64))) or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return the length of the shortest path as both bounds; None for both if there is no path."""
        path = self.shortest_path()
        length = len(path) if path else None
        return PathLengthBounds(length, length)
