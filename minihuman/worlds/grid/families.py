"""The families of worlds: what a name with its options is, as a recipe. Options are named as Minigrid names them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Literal

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import BALL, BOX, GREY_WALL, KEY, KINDS, RED_LAVA
from minihuman.worlds.grid.layouts import crossing as crossing_layout
from minihuman.worlds.grid.layouts import multi_room as multi_room_layout
from minihuman.worlds.grid.layouts import objects, open_floor, rooms, unlocking
from minihuman.worlds.grid.missions import COLOUR_WORDS, MissionSpace, kind_words
from minihuman.worlds.grid.recipe import Recipe
from minihuman.worlds.grid.wfc.world import wfc
from minihuman.worlds.options import MOST_CELLS, cell, one_of, pair, truth, whole

Place = tuple[int, int] | None  # column and row; None draws one
Obstacle = Literal["lava", "wall"]

TO_THE_GOAL = "get to the green goal square"
PAST_LAVA = "avoid the lava and get to the green goal square"
THROUGH_OPENING = "find the opening and get to the green goal square"
DIFFERENT = 18  # objects there are: three kinds in six colours
MOST_ROOMS = 100  # of a chain
OBSTACLES: Mapping[str, int] = MappingProxyType({"lava": RED_LAVA, "wall": GREY_WALL})


def empty(*, size: int = 8, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0) -> Recipe:
    """An empty room."""
    whole("size", size, 3 if agent_start_pos else 4, MOST_CELLS)
    numbers = _start(agent_start_pos, agent_start_dir, size, size)
    return Recipe(open_floor.empty, numbers, size, size, 4 * size**2, MissionSpace(TO_THE_GOAL), True)


def dist_shift(
    *,
    width: int = 9,
    height: int = 7,
    agent_start_pos: Place = (1, 1),
    agent_start_dir: int = 0,
    strip2_row: int = 2,
) -> Recipe:
    """Two strips of lava."""
    whole("width", width, 3 if agent_start_pos else 5, MOST_CELLS)
    whole("height", height, 3 if agent_start_pos else 5, MOST_CELLS)
    numbers = (
        *_start(agent_start_pos, agent_start_dir, width, height),
        whole("strip2_row", strip2_row, 0, height - 1),
    )
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(open_floor.dist_shift, numbers, width, height, 4 * width * height, mission, True)


def lava_gap(*, size: int, obstacle_type: Obstacle = "lava") -> Recipe:
    """A wall of lava with a gap."""
    whole("size", size, 5, MOST_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    return Recipe(open_floor.gap, (_obstacle(obstacle_type),), size, size, 4 * size**2, mission)


def dynamic_obstacles(
    *, size: int = 8, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0, n_obstacles: int = 4
) -> Recipe:
    """Balls that move by themselves."""
    whole("size", size, 4, MOST_CELLS)
    whole("n_obstacles", n_obstacles, 0, MOST_CELLS)
    obstacles = n_obstacles if n_obstacles <= size / 2 + 1 else size // 2
    numbers = (*_start(agent_start_pos, agent_start_dir, size, size), obstacles)
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(open_floor.dynamic_obstacles, numbers, size, size, 4 * size**2, mission, True, actions=3)


def crossing(*, size: int = 9, num_crossings: int = 1, obstacle_type: Obstacle = "lava") -> Recipe:
    """Rivers of lava or walls, each with an opening."""
    whole("size", size, 3, MOST_CELLS - 1, odd=True)
    whole("num_crossings", num_crossings, 0, MOST_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    numbers = (num_crossings, _obstacle(obstacle_type))
    return Recipe(crossing_layout.crossing, numbers, size, size, 4 * size**2, mission)


def four_rooms(*, agent_pos: Place = None, goal_pos: Place = None) -> Recipe:
    """Four rooms and a goal somewhere."""
    numbers = (*_place("agent_pos", agent_pos, 19, 19), *_place("goal_pos", goal_pos, 19, 19))
    return Recipe(rooms.four_rooms, numbers, 19, 19, 100, MissionSpace("reach the goal"))


def door_key(*, size: int = 8) -> Recipe:
    """A locked door, its key on this side, the goal on the other."""
    whole("size", size, 5, MOST_CELLS)
    mission = MissionSpace("use the key to open the door and then get to the goal")
    return Recipe(rooms.door_key, (), size, size, 10 * size**2, mission)


def red_blue_doors(*, size: int = 8) -> Recipe:
    """A red door to open first, and a blue one."""
    whole("size", size, 3, MOST_CELLS // 2)
    mission = MissionSpace("open the red door then the blue door")
    return Recipe(rooms.red_blue_doors, (), 2 * size, size, 20 * size**2, mission)


def locked_room(*, size: int = 19) -> Recipe:
    """Six rooms, one locked, its key in another."""
    whole("size", size, 10, MOST_CELLS)
    template = "get the {} key from the {} room, unlock the {} door and go to the goal"
    mission = MissionSpace(template, COLOUR_WORDS, COLOUR_WORDS, COLOUR_WORDS)
    return Recipe(rooms.locked_room, (), size, size, 10 * size, mission)


def playground() -> Recipe:
    """Nine rooms, twelve objects, no task."""
    return Recipe(rooms.playground, (), 19, 19, 100, MissionSpace(""))


def multi_room(
    *,
    minNumRooms: int,
    maxNumRooms: int,
    maxRoomSize: int = 10,
    width: int = 25,
    height: int = 25,
) -> Recipe:
    """A chain of rooms with closed doors between them."""
    whole("width", width, 6, MOST_CELLS)
    whole("height", height, 6, MOST_CELLS)
    whole("minNumRooms", minNumRooms, 1, MOST_ROOMS)
    whole("maxNumRooms", maxNumRooms, minNumRooms, MOST_ROOMS)
    numbers = (minNumRooms, maxNumRooms, whole("maxRoomSize", maxRoomSize, 4, MOST_CELLS))
    mission = MissionSpace("traverse the rooms to get to the goal")
    return Recipe(multi_room_layout.multi_room, numbers, width, height, 20 * maxNumRooms, mission)


def fetch(*, size: int = 8, numObjs: int = 3) -> Recipe:
    """Keys and balls, one to fetch."""
    _objects(numObjs, 1, 100, size)
    verbs = ("get a", "go get a", "fetch a", "go fetch a", "you must fetch a")
    mission = MissionSpace("{} {} {}", verbs, COLOUR_WORDS, kind_words(KEY, BALL))
    return Recipe(objects.fetch, (numObjs,), size, size, 5 * size**2, mission, True)


def go_to_object(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Objects, one to go to."""
    _objects(numObjs, 1, DIFFERENT, size)
    mission = MissionSpace("go to the {} {}", COLOUR_WORDS, kind_words(KEY, BALL, BOX))
    return Recipe(objects.go_to_object, (numObjs,), size, size, 5 * size**2, mission, True)


def put_near(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Objects, one to put near another."""
    _objects(numObjs, 2, DIFFERENT, size)
    if 9 * (numObjs - 1) >= (size - 2) ** 2:
        raise WorldError(f"numObjs is {numObjs}: so many that touch none need not fit into size = {size}; enlarge it")
    kinds = kind_words(KEY, BALL, BOX)
    mission = MissionSpace("put the {} {} near the {} {}", COLOUR_WORDS, kinds, COLOUR_WORDS, kinds)
    return Recipe(objects.put_near, (numObjs,), size, size, 5 * size, mission, True)


def go_to_door(*, size: int = 5) -> Recipe:
    """Four doors, one to go to."""
    whole("size", size, 5, MOST_CELLS)
    mission = MissionSpace("go to the {} door", COLOUR_WORDS)
    return Recipe(objects.go_to_door, (), size, size, 4 * size**2, mission, True)


def memory(*, size: int = 8, random_length: bool = False) -> Recipe:
    """A corridor between an object and its match."""
    whole("size", size, 7 if truth("random_length", random_length) else 5, MOST_CELLS - 1, odd=True)
    mission = MissionSpace("go to the matching object at the end of the hallway")
    return Recipe(objects.memory, (int(random_length),), size, size, 5 * size**2, mission)


def unlock() -> Recipe:
    """A locked door to open."""
    return Recipe(unlocking.unlock, (), 11, 6, 288, MissionSpace("open the door"))


def unlock_pickup() -> Recipe:
    """A box behind a locked door."""
    mission = MissionSpace("pick up the {} box", COLOUR_WORDS)
    return Recipe(unlocking.unlock_pickup, (0,), 11, 6, 288, mission)


def blocked_unlock_pickup() -> Recipe:
    """A box behind a locked door behind a ball."""
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(BOX, KEY))
    return Recipe(unlocking.unlock_pickup, (1,), 11, 6, 576, mission)


def key_corridor(*, num_rows: int = 3, obj_type: Literal["key", "ball", "box"] = "ball", room_size: int = 6) -> Recipe:
    """An object behind a locked door off a corridor."""
    kind = KINDS.index(one_of("obj_type", obj_type, ("key", "ball", "box")))
    whole("room_size", room_size, 3, MOST_CELLS // 3)
    whole("num_rows", num_rows, 1, min(100, (MOST_CELLS - 1) // (room_size - 1)))
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(kind))
    width, height = 3 * (room_size - 1) + 1, num_rows * (room_size - 1) + 1
    return Recipe(unlocking.key_corridor, (num_rows, room_size, kind), width, height, 30 * room_size**2, mission)


def obstructed_pair(*, key_in_box: bool = True, blocked: bool = True) -> Recipe:
    """A blue ball behind one locked door."""
    numbers = (int(truth("key_in_box", key_in_box)), int(truth("blocked", blocked)))
    return Recipe(unlocking.obstructed_pair, numbers, 11, 6, 288, MissionSpace("pick up the blue ball"))


def obstructed_maze(
    *,
    agent_room: tuple[int, int] = (1, 1),
    key_in_box: bool = True,
    blocked: bool = True,
    num_quarters: int = 4,
    num_rooms_visited: int = 25,
    keys_last: bool = False,
) -> Recipe:
    """A blue ball in a corner of nine rooms."""
    column, line = pair("agent_room", agent_room, 0, 2)
    whole("num_quarters", num_quarters, 1, 4)
    whole("num_rooms_visited", num_rooms_visited, 1, 1_000_000)
    boxed, hindered = int(truth("key_in_box", key_in_box)), int(truth("blocked", blocked))
    numbers = (column + 3 * line, boxed, hindered, num_quarters, int(truth("keys_last", keys_last)))
    mission = MissionSpace("pick up the blue ball")
    return Recipe(unlocking.obstructed_maze, numbers, 16, 16, 144 * num_rooms_visited, mission)


FAMILIES: Mapping[str, Callable[..., Recipe]] = MappingProxyType(
    {
        family.__name__: family
        for family in (
            empty,
            dist_shift,
            lava_gap,
            dynamic_obstacles,
            crossing,
            four_rooms,
            door_key,
            red_blue_doors,
            locked_room,
            playground,
            multi_room,
            fetch,
            go_to_object,
            put_near,
            go_to_door,
            memory,
            unlock,
            unlock_pickup,
            blocked_unlock_pickup,
            key_corridor,
            obstructed_pair,
            obstructed_maze,
            wfc,
        )
    }
)


def recipe(family: str, **options: Any) -> Recipe:
    """The recipe of a family's world.

    Raises:
        WorldError: if there is no such family, or it takes no such option.
    """
    if family.startswith("level:"):
        from minihuman.worlds.grid.levels.table import LEVELS  # compiled: only where a level is made

        if family in LEVELS:
            return LEVELS[family](**options)
    if family not in FAMILIES:
        raise WorldError(f"{family!r} is no family of grid worlds; there are {', '.join(FAMILIES)}")
    try:
        return FAMILIES[family](**options)
    except TypeError as error:
        raise WorldError(f"grid worlds of the family {family!r} do not take {options}: {error}") from error


def _place(name: str, place: Place, width: int, height: int, *, wall: int = 0) -> tuple[int, int]:
    """A cell; none is negative."""
    return (-1, -1) if place is None else cell(name, place, width, height, wall=wall)


def _start(place: Place, direction: int, width: int, height: int) -> tuple[int, int, int]:
    whole("agent_start_dir", direction, 0, 3)
    return *_place("agent_start_pos", place, width, height, wall=1), direction


def _objects(count: int, fewest: int, most: int, size: int) -> None:
    """So many objects have to fit into a room, and the agent too."""
    whole("size", size, 4, MOST_CELLS)
    whole("numObjs", count, fewest, max(fewest, min(most, (size - 2) ** 2 - 1)))


def _obstacle(name: str) -> int:
    return OBSTACLES[one_of("obstacle_type", name, tuple(OBSTACLES))]
