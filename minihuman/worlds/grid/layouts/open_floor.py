"""Worlds of one open room: Empty, DistShift, LavaGap, DynamicObstacles."""

from minihuman.worlds.grid.core.cells import BALL, BLUE, EMPTY, GREEN_GOAL, RED_LAVA
from minihuman.worlds.grid.core.chance import Words, integer
from minihuman.worlds.grid.core.place import across, down, draw_place, outer_walls, place_agent_anywhere, stand
from minihuman.worlds.grid.core.state import HEIGHT, TARGET, TASK, WIDTH, Row, make, put
from minihuman.worlds.grid.core.tasks import DODGE
from minihuman.worlds.kernels import kernel


@kernel()
def empty(row: Row, words: Words, agent_x: int, agent_y: int, direction: int) -> None:
    """Nothing but a goal in the corner. A negative ``agent_x`` draws agent and direction."""
    outer_walls(row)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    start(row, words, agent_x, agent_y, direction)


@kernel()
def start(row: Row, words: Words, x: int, y: int, direction: int) -> None:
    """Put the agent where it is said to start, or draw where that is negative."""
    if x < 0:
        place_agent_anywhere(row, words)
    else:
        stand(row, x, y, direction)


@kernel()
def dist_shift(row: Row, words: Words, agent_x: int, agent_y: int, direction: int, second_strip: int) -> None:
    """Two strips of lava, one below the top wall and one in the row ``second_strip``."""
    outer_walls(row)
    put(row, row[WIDTH] - 2, 1, GREEN_GOAL)
    across(row, 3, 1, row[WIDTH] - 6, RED_LAVA)
    across(row, 3, second_strip, row[WIDTH] - 6, RED_LAVA)
    start(row, words, agent_x, agent_y, direction)


@kernel()
def gap(row: Row, words: Words, obstacle: int) -> None:
    """One column of lava (or of the code ``obstacle``) with a gap."""
    outer_walls(row)
    stand(row, 1, 1, 0)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    x = integer(words, 2, row[WIDTH] - 2)
    y = integer(words, 1, row[HEIGHT] - 1)
    down(row, x, 1, row[HEIGHT] - 2, obstacle)
    put(row, x, y, EMPTY)


@kernel()
def dynamic_obstacles(row: Row, words: Words, agent_x: int, agent_y: int, direction: int, obstacles: int) -> None:
    """Balls that move by themselves."""
    outer_walls(row)
    put(row, row[WIDTH] - 2, row[HEIGHT] - 2, GREEN_GOAL)
    start(row, words, agent_x, agent_y, direction)
    for _ in range(obstacles):
        ball = make(row, BALL, BLUE, 0)
        x, y = draw_place(row, words, 0, 0, row[WIDTH], row[HEIGHT], 101)
        if x >= 0:
            put(row, x, y, ball)
    row[TASK] = DODGE
    row[TARGET] = obstacles
