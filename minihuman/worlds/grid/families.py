"""The families of Minigrid's worlds: functions from options, named as Minigrid names them, to recipes.

The sizes, step limits and default options are Minigrid's.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import BALL, BOX, GREY_WALL, KEY, KINDS, RED_LAVA
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.grid.layouts import room_grid, rooms, single_rooms
from minihuman.worlds.grid.missions import COLOUR_WORDS, MissionSpace, kind_words
from minihuman.worlds.grid.wfc.family import wfc
from minihuman.worlds.options import MAX_CELLS, check_bool, check_cell, check_one_of, check_pair, check_whole

Place = tuple[int, int] | None  # column and row; None draws one
Obstacle = Literal["lava", "wall"]
TO_THE_GOAL = "get to the green goal square"
PAST_LAVA = "avoid the lava and get to the green goal square"
THROUGH_OPENING = "find the opening and get to the green goal square"
DIFFERENT = 18  # the number of objects that all differ: three kinds in six colours
MOST_ROOMS = 100  # in a chain of rooms
OBSTACLES: Mapping[str, int] = MappingProxyType({"lava": RED_LAVA, "wall": GREY_WALL})


def empty(*, size: int = 8, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0) -> Recipe:
    """Return the recipe of an empty room; if ``agent_start_pos`` is None, the agent's start is drawn."""
    check_whole("size", size, 3 if agent_start_pos else 4, MAX_CELLS)
    numbers = _start_numbers(agent_start_pos, agent_start_dir, size, size)
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(single_rooms.empty, numbers, size, size, 4 * size**2, mission, see_through_walls=True)


def dist_shift(
    *, width: int = 9, height: int = 7, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0, strip2_row: int = 2
) -> Recipe:
    """Return the recipe of a room with two strips of lava, the second in the row ``strip2_row``.

    If ``agent_start_pos`` is None, the agent's start is drawn.
    """
    check_whole("width", width, 3 if agent_start_pos else 5, MAX_CELLS)
    check_whole("height", height, 3 if agent_start_pos else 5, MAX_CELLS)
    numbers = (
        *_start_numbers(agent_start_pos, agent_start_dir, width, height),
        check_whole("strip2_row", strip2_row, 0, height - 1),
    )
    mission = MissionSpace(TO_THE_GOAL)
    max_steps = 4 * width * height
    return Recipe(single_rooms.dist_shift, numbers, width, height, max_steps, mission, see_through_walls=True)


def lava_gap(*, size: int, obstacle_type: Obstacle = "lava") -> Recipe:
    """Return the recipe of a room with a column of lava or wall that has a gap."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    return Recipe(single_rooms.gap, (_obstacle_code(obstacle_type),), size, size, 4 * size**2, mission)


def dynamic_obstacles(
    *, size: int = 8, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0, n_obstacles: int = 4
) -> Recipe:
    """Return the recipe of a room with balls that move at random.

    There are ``n_obstacles`` of them, or half as many as the room is wide if more were asked for than that plus 1. If
    ``agent_start_pos`` is None, the agent's start is drawn.
    """
    check_whole("size", size, 4, MAX_CELLS)
    check_whole("n_obstacles", n_obstacles, 0, MAX_CELLS)
    if n_obstacles <= size / 2 + 1:
        obstacles = n_obstacles
    else:
        obstacles = size // 2
    numbers = (*_start_numbers(agent_start_pos, agent_start_dir, size, size), obstacles)
    layout = single_rooms.dynamic_obstacles
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(layout, numbers, size, size, 4 * size**2, mission, see_through_walls=True, actions=3)


def crossing(*, size: int = 9, num_crossings: int = 1, obstacle_type: Obstacle = "lava") -> Recipe:
    """Return the recipe of a room with ``num_crossings`` rivers of lava or walls, each with an opening."""
    check_whole("size", size, 3, MAX_CELLS - 1, odd=True)
    check_whole("num_crossings", num_crossings, 0, MAX_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    numbers = (num_crossings, _obstacle_code(obstacle_type))
    return Recipe(single_rooms.crossing, numbers, size, size, 4 * size**2, mission)


def four_rooms(*, agent_pos: Place = None, goal_pos: Place = None) -> Recipe:
    """Return the recipe of four rooms, with the goal in one of them; a place that is None is drawn."""
    size = 19
    numbers = (*_cell_numbers("agent_pos", agent_pos, size, size), *_cell_numbers("goal_pos", goal_pos, size, size))
    return Recipe(rooms.four_rooms, numbers, size, size, 100, MissionSpace("reach the goal"))


def door_key(*, size: int = 8) -> Recipe:
    """Return the recipe of two rooms with a locked door between them: the key on the agent's side, the goal beyond."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace("use the key to open the door and then get to the goal")
    return Recipe(rooms.door_key, (), size, size, 10 * size**2, mission)


def red_blue_doors(*, size: int = 8) -> Recipe:
    """Return the recipe of a room with a red door to open first and a blue door to open next."""
    check_whole("size", size, 3, MAX_CELLS // 2)
    mission = MissionSpace("open the red door then the blue door")
    return Recipe(rooms.red_blue_doors, (), 2 * size, size, 20 * size**2, mission)


def locked_room(*, size: int = 19) -> Recipe:
    """Return the recipe of six rooms, one of which is locked, with its key in another room."""
    check_whole("size", size, 10, MAX_CELLS)
    template = "get the {} key from the {} room, unlock the {} door and go to the goal"
    mission = MissionSpace(template, COLOUR_WORDS, COLOUR_WORDS, COLOUR_WORDS)
    return Recipe(rooms.locked_room, (), size, size, 10 * size, mission)


def playground() -> Recipe:
    """Return the recipe of nine rooms with twelve objects and no task."""
    return Recipe(rooms.playground, (), 19, 19, 100, MissionSpace(""))


def multi_room(
    *, minNumRooms: int, maxNumRooms: int, maxRoomSize: int = 10, width: int = 25, height: int = 25
) -> Recipe:
    """Return the recipe of a chain of rooms with closed doors between them.

    Args:
        minNumRooms: the smallest number of rooms.
        maxNumRooms: the largest number of rooms.
        maxRoomSize: the largest number of columns and rows of a room, including its walls.
        width: the number of columns of the grid.
        height: the number of rows of the grid.
    """
    check_whole("width", width, 6, MAX_CELLS)
    check_whole("height", height, 6, MAX_CELLS)
    check_whole("minNumRooms", minNumRooms, 1, MOST_ROOMS)
    check_whole("maxNumRooms", maxNumRooms, minNumRooms, MOST_ROOMS)
    numbers = (minNumRooms, maxNumRooms, check_whole("maxRoomSize", maxRoomSize, 4, MAX_CELLS))
    mission = MissionSpace("traverse the rooms to get to the goal")
    return Recipe(rooms.multi_room, numbers, width, height, 20 * maxNumRooms, mission)


def fetch(*, size: int = 8, numObjs: int = 3) -> Recipe:
    """Return the recipe of a room with ``numObjs`` keys and balls, one of which is to be fetched."""
    _check_objects(numObjs, 1, 100, size)
    verbs = ("get a", "go get a", "fetch a", "go fetch a", "you must fetch a")
    mission = MissionSpace("{} {} {}", verbs, COLOUR_WORDS, kind_words(KEY, BALL))
    return Recipe(single_rooms.fetch, (numObjs,), size, size, 5 * size**2, mission, see_through_walls=True)


def go_to_object(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Return the recipe of a room with ``numObjs`` objects, one of which is to be reached."""
    _check_objects(numObjs, 1, DIFFERENT, size)
    mission = MissionSpace("go to the {} {}", COLOUR_WORDS, kind_words(KEY, BALL, BOX))
    return Recipe(single_rooms.go_to_object, (numObjs,), size, size, 5 * size**2, mission, see_through_walls=True)


def put_near(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Return the recipe of a room with ``numObjs`` objects, one of which is to be put near another."""
    _check_objects(numObjs, 2, DIFFERENT, size)
    if 9 * (numObjs - 1) >= (size - 2) ** 2:  # no object may lie in the nine cells around another
        raise WorldError(
            f"numObjs is {numObjs}, too many to keep apart with size = {size}; use fewer, or a larger size"
        )
    kinds = kind_words(KEY, BALL, BOX)
    mission = MissionSpace("put the {} {} near the {} {}", COLOUR_WORDS, kinds, COLOUR_WORDS, kinds)
    return Recipe(single_rooms.put_near, (numObjs,), size, size, 5 * size, mission, see_through_walls=True)


def go_to_door(*, size: int = 5) -> Recipe:
    """Return the recipe of a room with four doors, one of which is to be reached."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace("go to the {} door", COLOUR_WORDS)
    return Recipe(single_rooms.go_to_door, (), size, size, 4 * size**2, mission, see_through_walls=True)


def memory(*, size: int = 8, random_length: bool = False) -> Recipe:
    """Return the recipe of a corridor that leads from an object to a choice between its match and another object.

    With ``random_length``, the length of the corridor is drawn.
    """
    smallest = 7 if check_bool("random_length", random_length) else 5
    check_whole("size", size, smallest, MAX_CELLS - 1, odd=True)
    mission = MissionSpace("go to the matching object at the end of the hallway")
    return Recipe(single_rooms.memory, (int(random_length),), size, size, 5 * size**2, mission)


def unlock() -> Recipe:
    """Return the recipe of two rooms with a locked door that is to be opened."""
    return Recipe(room_grid.unlock, (), 11, 6, 288, MissionSpace("open the door"), room_size=room_grid.SIZE)


def unlock_pickup() -> Recipe:
    """Return the recipe of a box behind a locked door."""
    mission = MissionSpace("pick up the {} box", COLOUR_WORDS)
    blocked = 0
    return Recipe(room_grid.unlock_pickup, (blocked,), 11, 6, 288, mission, room_size=room_grid.SIZE)


def blocked_unlock_pickup() -> Recipe:
    """Return the recipe of a box behind a locked door that a ball blocks."""
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(BOX, KEY))
    blocked = 1
    return Recipe(room_grid.unlock_pickup, (blocked,), 11, 6, 576, mission, room_size=room_grid.SIZE)


def key_corridor(*, num_rows: int = 3, obj_type: Literal["key", "ball", "box"] = "ball", room_size: int = 6) -> Recipe:
    """Return the recipe of a corridor between rooms, one of which has a locked door with an object behind it.

    Args:
        num_rows: the number of rooms on each side of the corridor.
        obj_type: the kind of the object.
        room_size: the number of cells on a side of a room, including its walls.
    """
    kind = KINDS.index(check_one_of("obj_type", obj_type, ("key", "ball", "box")))
    check_whole("room_size", room_size, 3, MAX_CELLS // 3)
    check_whole("num_rows", num_rows, 1, min(100, (MAX_CELLS - 1) // (room_size - 1)))
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(kind))
    width = 3 * (room_size - 1) + 1
    height = num_rows * (room_size - 1) + 1
    numbers = num_rows, room_size, kind
    return Recipe(room_grid.key_corridor, numbers, width, height, 30 * room_size**2, mission, room_size=room_size)


def obstructed_pair(*, key_in_box: bool = True, blocked: bool = True) -> Recipe:
    """Return the recipe of two rooms with a blue ball behind the locked door between them.

    With ``blocked``, another ball lies in front of the door.
    """
    numbers = (int(check_bool("key_in_box", key_in_box)), int(check_bool("blocked", blocked)))
    mission = MissionSpace("pick up the blue ball")
    return Recipe(room_grid.obstructed_pair, numbers, 11, 6, 288, mission, room_size=room_grid.SIZE)


def obstructed_maze(
    *,
    agent_room: tuple[int, int] = (1, 1),
    key_in_box: bool = True,
    blocked: bool = True,
    num_quarters: int = 4,
    num_rooms_visited: int = 25,
    keys_last: bool = False,
) -> Recipe:
    """Return the recipe of three rooms by three with a blue ball in a corner room.

    Args:
        agent_room: the column and row of the room in which the agent starts.
        key_in_box: whether the keys are in boxes.
        blocked: whether a ball lies in front of each locked door.
        num_quarters: the number of side rooms that are open, from the right one clockwise, each with two locked doors.
        num_rooms_visited: the number of rooms to which the step limit is proportional.
        keys_last: whether the keys of a side are placed after its doors and balls, so that no ball is put on a key.
    """
    column, row = check_pair("agent_room", agent_room, 0, 2)
    check_whole("num_quarters", num_quarters, 1, 4)
    check_whole("num_rooms_visited", num_rooms_visited, 1, 1_000_000)
    room = column + 3 * row
    has_boxes = check_bool("key_in_box", key_in_box)
    has_balls = check_bool("blocked", blocked)
    numbers = (room, int(has_boxes), int(has_balls), num_quarters, int(check_bool("keys_last", keys_last)))
    mission = MissionSpace("pick up the blue ball")
    max_steps = 144 * num_rooms_visited
    return Recipe(room_grid.obstructed_maze, numbers, 16, 16, max_steps, mission, room_size=room_grid.SIZE)


_FAMILIES: tuple[Callable[..., Recipe], ...] = (
    *(empty, dist_shift, lava_gap, dynamic_obstacles, crossing, four_rooms, door_key, red_blue_doors),
    *(locked_room, playground, multi_room, fetch, go_to_object, put_near, go_to_door, memory),
    *(unlock, unlock_pickup, blocked_unlock_pickup, key_corridor, obstructed_pair, obstructed_maze, wfc),
)
FAMILIES: Mapping[str, Callable[..., Recipe]] = MappingProxyType({family.__name__: family for family in _FAMILIES})


def recipe(family: str, **options: Any) -> Recipe:
    """Return the recipe of a family's world.

    Raises:
        WorldError: if there is no such family, or it does not take one of the options.
    """
    if family.startswith("level:"):
        from minihuman.worlds.grid.babyai.levels import LEVELS  # compiled: only where a level is made

        if family in LEVELS:
            return LEVELS[family](**options)
    if family not in FAMILIES:
        raise WorldError(f"unknown family {family!r}; use one of {', '.join(FAMILIES)}")
    try:
        return FAMILIES[family](**options)
    except TypeError as error:
        raise WorldError(f"the family {family!r} does not take {options}: {error}") from error


def _cell_numbers(name: str, place: Place, width: int, height: int, *, wall: int = 0) -> tuple[int, int]:
    """Return the column and row of a cell as the numbers of a layout: (-1, -1) for None, so that the layout draws one.

    Raises:
        WorldError: if the cell is outside the grid, or in one of ``wall`` rows and columns at each edge.
    """
    if place is None:
        return (-1, -1)
    return check_cell(name, place, width, height, wall=wall)


def _start_numbers(place: Place, direction: int, width: int, height: int) -> tuple[int, int, int]:
    """Return the agent's column, row and direction as the numbers of a layout, as `_cell_numbers` does.

    Raises:
        WorldError: if the cell or the direction is not valid.
    """
    check_whole("agent_start_dir", direction, 0, 3)
    return *_cell_numbers("agent_start_pos", place, width, height, wall=1), direction


def _check_objects(count: int, fewest: int, most: int, size: int) -> None:
    """Check that a room of ``size`` cells on a side is valid, and that ``count`` objects and the agent fit into it.

    Raises:
        WorldError: if they do not, or there are not ``fewest`` to ``most`` objects.
    """
    check_whole("size", size, 4, MAX_CELLS)
    check_whole("numObjs", count, fewest, max(fewest, min(most, (size - 2) ** 2 - 1)))


def _obstacle_code(name: str) -> int:
    """Return the code of a cell of the obstacle "lava" or "wall"; raise a WorldError for another name."""
    return OBSTACLES[check_one_of("obstacle_type", name, tuple(OBSTACLES))]
