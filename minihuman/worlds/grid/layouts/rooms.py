"""FourRooms: four rooms, a gap in every wall between them, agent and goal anywhere."""

from numba import njit

from minihuman.worlds.grid.cells import EMPTY, GREEN_GOAL, GREY_WALL
from minihuman.worlds.grid.chance import Words, integer
from minihuman.worlds.grid.place import across, down, outer_walls, place_agent_anywhere, place_anywhere, stand
from minihuman.worlds.grid.state import HEIGHT, WIDTH, Row, put


@njit(cache=True)
def four_rooms(row: Row, words: Words, agent_x: int, agent_y: int, goal_x: int, goal_y: int) -> None:
    """Four rooms. A negative ``agent_x`` or ``goal_x`` draws the place."""
    outer_walls(row)
    room_width, room_height = row[WIDTH] // 2, row[HEIGHT] // 2
    for j in range(2):
        for i in range(2):
            left, top = i * room_width, j * room_height
            right, bottom = left + room_width, top + room_height
            if i == 0:
                down(row, right, top, room_height, GREY_WALL)
                put(row, right, integer(words, top + 1, bottom), EMPTY)
            if j == 0:
                across(row, left, bottom, room_width, GREY_WALL)
                put(row, integer(words, left + 1, right), bottom, EMPTY)
    if agent_x < 0:
        place_agent_anywhere(row, words)
    else:
        put(row, agent_x, agent_y, EMPTY)
        stand(row, agent_x, agent_y, integer(words, 0, 4))
    if goal_x < 0:
        place_anywhere(row, words, GREEN_GOAL)
    else:
        put(row, goal_x, goal_y, GREEN_GOAL)
