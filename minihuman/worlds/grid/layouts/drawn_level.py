"""DrawnLevel: a grid that is given as a diagram, in a protocol or from the level editor. It needs no Python.

[blocks.options]
mission = "get the ball"
diagram = '''
WWWWWWWWWW
WW>>  LyWW
WW  KyDyBb
...'''
"""

import textwrap
from typing import Any

from minihuman.errors import WorldError
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import AGENT, Layout, from_text
from minihuman.worlds.options import MAX_CELLS

EXAMPLE = """
WWWWWWWWWWWWWW
WW>>    WW  WW
WW      LyGgWW
WW  Ky  WW  WW
WWWWWWWWWWWWWW
"""


class DrawnLevel(GridWorld):
    """A level given by a diagram, in the characters that `from_text` reads.

    If the diagram has no agent, every episode places it in a random empty cell, drawn from its seed. An episode ends at
    a green goal square or in lava.

    Args:
        diagram: the diagram, with a line per row and two characters per cell, at least 3 by 3 cells; common indentation
            is removed.
        mission: the mission in words.
        max_steps: the number of steps after which an episode is truncated; by default four times the number of cells.
        options: further options, as for every grid world.

    Raises:
        WorldError: if the diagram is too small or too large, has an invalid cell, or has several agents.
    """

    def __init__(
        self,
        *,
        diagram: str = EXAMPLE,
        mission: str = "get to the green goal square",
        max_steps: int | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(diagram, str):
            raise WorldError(f"diagram is {diagram!r}; it must be a string with a line per row")
        self.diagram = textwrap.dedent(diagram.replace("\r\n", "\n")).strip("\n")
        lines = self.diagram.split("\n")
        width = max((len(line) + 1) // 2 for line in lines)  # two characters per cell; the last one may be missing
        height = len(lines)
        if not (3 <= width <= MAX_CELLS and 3 <= height <= MAX_CELLS):
            raise WorldError(
                f"the diagram has {width} columns and {height} rows; draw 3 to {MAX_CELLS} of each, "
                "with two characters per cell"
            )
        agents = sum(line[x : x + 2] in AGENT for line in lines for x in range(0, len(line), 2))
        if agents > 1:
            raise WorldError(f"the diagram has {agents} agents; draw one, or none to have it placed at random")
        self._has_agent = agents == 1
        if max_steps is None:
            limit = 4 * width * height
        else:
            limit = max_steps
        super().__init__(width=width, height=height, max_steps=limit, mission=mission, **options)
        from_text(self.diagram, Layout(self._row.copy(), self.np_random, mission))  # a wrong cell is refused at once

    def layout(self, grid: Layout) -> None:
        """Lay out the diagram, and place the agent if the diagram has none."""
        from_text(self.diagram, grid)
        if not self._has_agent:
            grid.place_agent()
