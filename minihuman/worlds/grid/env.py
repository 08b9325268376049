"""GridEnv: a world of the catalogue, laid out by the compiled layout of its family; and GridWorld: the class to
subclass for a grid world of your own, which `docs/grid-worlds.md` writes in fifteen lines.

Each family is a function from options, named as Minigrid names them, to a recipe.
"""

import abc
import sys
from collections.abc import Callable, Mapping
from inspect import signature
from types import MappingProxyType
from typing import Any, ClassVar, Literal

from minihuman.errors import WorldError
from minihuman.worlds.grid.babyai.binding import instruct
from minihuman.worlds.grid.core.cells import BALL, BOX, GREY_WALL, KEY, KINDS, RED_LAVA
from minihuman.worlds.grid.core.state import FAILED, OVER, PHASE, PLAYING
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.family_names import INSTEAD
from minihuman.worlds.grid.layout import Layout, Recipe
from minihuman.worlds.grid.layouts import room_grid, rooms, single_rooms
from minihuman.worlds.grid.minigrid_compat import MinigridCompat
from minihuman.worlds.grid.missions import COLOUR_WORDS, MissionSpace, kind_words
from minihuman.worlds.grid.wfc.family import wfc
from minihuman.worlds.options import MAX_CELLS, check_bool, check_cell, check_one_of, check_pair, check_whole
from minihuman.worlds.upstream_names import (
    WorldAttributeError,
    define_names,
    missing_name,
    refuse_replaced_method,
    refuse_unknown_attribute,
)

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
    check_whole("size", size, 3 if agent_start_pos else 4, MAX_CELLS)
    numbers = _start(agent_start_pos, agent_start_dir, size, size)
    return Recipe(single_rooms.empty, numbers, size, size, 4 * size**2, MissionSpace(TO_THE_GOAL), True)


def dist_shift(
    *, width: int = 9, height: int = 7, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0, strip2_row: int = 2
) -> Recipe:
    """Two strips of lava."""
    check_whole("width", width, 3 if agent_start_pos else 5, MAX_CELLS)
    check_whole("height", height, 3 if agent_start_pos else 5, MAX_CELLS)
    numbers = (
        *_start(agent_start_pos, agent_start_dir, width, height),
        check_whole("strip2_row", strip2_row, 0, height - 1),
    )
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(single_rooms.dist_shift, numbers, width, height, 4 * width * height, mission, True)


def lava_gap(*, size: int, obstacle_type: Obstacle = "lava") -> Recipe:
    """A wall of lava with a gap."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    return Recipe(single_rooms.gap, (_obstacle(obstacle_type),), size, size, 4 * size**2, mission)


def dynamic_obstacles(
    *, size: int = 8, agent_start_pos: Place = (1, 1), agent_start_dir: int = 0, n_obstacles: int = 4
) -> Recipe:
    """Balls that move by themselves."""
    check_whole("size", size, 4, MAX_CELLS)
    check_whole("n_obstacles", n_obstacles, 0, MAX_CELLS)
    obstacles = n_obstacles if n_obstacles <= size / 2 + 1 else size // 2
    numbers = (*_start(agent_start_pos, agent_start_dir, size, size), obstacles)
    mission = MissionSpace(TO_THE_GOAL)
    return Recipe(single_rooms.dynamic_obstacles, numbers, size, size, 4 * size**2, mission, True, actions=3)


def crossing(*, size: int = 9, num_crossings: int = 1, obstacle_type: Obstacle = "lava") -> Recipe:
    """Rivers of lava or walls, each with an opening."""
    check_whole("size", size, 3, MAX_CELLS - 1, odd=True)
    check_whole("num_crossings", num_crossings, 0, MAX_CELLS)
    mission = MissionSpace(PAST_LAVA if obstacle_type == "lava" else THROUGH_OPENING)
    numbers = (num_crossings, _obstacle(obstacle_type))
    return Recipe(single_rooms.crossing, numbers, size, size, 4 * size**2, mission)


def four_rooms(*, agent_pos: Place = None, goal_pos: Place = None) -> Recipe:
    """Four rooms and a goal somewhere."""
    numbers = (*_place("agent_pos", agent_pos, 19, 19), *_place("goal_pos", goal_pos, 19, 19))
    return Recipe(rooms.four_rooms, numbers, 19, 19, 100, MissionSpace("reach the goal"))


def door_key(*, size: int = 8) -> Recipe:
    """A locked door, its key on this side, the goal on the other."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace("use the key to open the door and then get to the goal")
    return Recipe(rooms.door_key, (), size, size, 10 * size**2, mission)


def red_blue_doors(*, size: int = 8) -> Recipe:
    """A red door to open first, and a blue one."""
    check_whole("size", size, 3, MAX_CELLS // 2)
    mission = MissionSpace("open the red door then the blue door")
    return Recipe(rooms.red_blue_doors, (), 2 * size, size, 20 * size**2, mission)


def locked_room(*, size: int = 19) -> Recipe:
    """Six rooms, one locked, its key in another."""
    check_whole("size", size, 10, MAX_CELLS)
    template = "get the {} key from the {} room, unlock the {} door and go to the goal"
    mission = MissionSpace(template, COLOUR_WORDS, COLOUR_WORDS, COLOUR_WORDS)
    return Recipe(rooms.locked_room, (), size, size, 10 * size, mission)


def playground() -> Recipe:
    """Nine rooms, twelve objects, no task."""
    return Recipe(rooms.playground, (), 19, 19, 100, MissionSpace(""))


def multi_room(
    *, minNumRooms: int, maxNumRooms: int, maxRoomSize: int = 10, width: int = 25, height: int = 25
) -> Recipe:
    """A chain of rooms with closed doors between them."""
    check_whole("width", width, 6, MAX_CELLS)
    check_whole("height", height, 6, MAX_CELLS)
    check_whole("minNumRooms", minNumRooms, 1, MOST_ROOMS)
    check_whole("maxNumRooms", maxNumRooms, minNumRooms, MOST_ROOMS)
    numbers = (minNumRooms, maxNumRooms, check_whole("maxRoomSize", maxRoomSize, 4, MAX_CELLS))
    mission = MissionSpace("traverse the rooms to get to the goal")
    return Recipe(rooms.multi_room, numbers, width, height, 20 * maxNumRooms, mission)


def fetch(*, size: int = 8, numObjs: int = 3) -> Recipe:
    """Keys and balls, one to fetch."""
    _objects(numObjs, 1, 100, size)
    verbs = ("get a", "go get a", "fetch a", "go fetch a", "you must fetch a")
    mission = MissionSpace("{} {} {}", verbs, COLOUR_WORDS, kind_words(KEY, BALL))
    return Recipe(single_rooms.fetch, (numObjs,), size, size, 5 * size**2, mission, True)


def go_to_object(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Objects, one to go to."""
    _objects(numObjs, 1, DIFFERENT, size)
    mission = MissionSpace("go to the {} {}", COLOUR_WORDS, kind_words(KEY, BALL, BOX))
    return Recipe(single_rooms.go_to_object, (numObjs,), size, size, 5 * size**2, mission, True)


def put_near(*, size: int = 6, numObjs: int = 2) -> Recipe:
    """Objects, one to put near another."""
    _objects(numObjs, 2, DIFFERENT, size)
    if 9 * (numObjs - 1) >= (size - 2) ** 2:
        raise WorldError(
            f"numObjs is {numObjs}, too many to keep apart with size = {size}; use fewer, or a larger size"
        )
    kinds = kind_words(KEY, BALL, BOX)
    mission = MissionSpace("put the {} {} near the {} {}", COLOUR_WORDS, kinds, COLOUR_WORDS, kinds)
    return Recipe(single_rooms.put_near, (numObjs,), size, size, 5 * size, mission, True)


def go_to_door(*, size: int = 5) -> Recipe:
    """Four doors, one to go to."""
    check_whole("size", size, 5, MAX_CELLS)
    mission = MissionSpace("go to the {} door", COLOUR_WORDS)
    return Recipe(single_rooms.go_to_door, (), size, size, 4 * size**2, mission, True)


def memory(*, size: int = 8, random_length: bool = False) -> Recipe:
    """A corridor between an object and its match."""
    check_whole("size", size, 7 if check_bool("random_length", random_length) else 5, MAX_CELLS - 1, odd=True)
    mission = MissionSpace("go to the matching object at the end of the hallway")
    return Recipe(single_rooms.memory, (int(random_length),), size, size, 5 * size**2, mission)


def unlock() -> Recipe:
    """A locked door to open."""
    return Recipe(room_grid.unlock, (), 11, 6, 288, MissionSpace("open the door"), room_size=room_grid.SIZE)


def unlock_pickup() -> Recipe:
    """A box behind a locked door."""
    mission = MissionSpace("pick up the {} box", COLOUR_WORDS)
    return Recipe(room_grid.unlock_pickup, (0,), 11, 6, 288, mission, room_size=room_grid.SIZE)


def blocked_unlock_pickup() -> Recipe:
    """A box behind a locked door behind a ball."""
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(BOX, KEY))
    return Recipe(room_grid.unlock_pickup, (1,), 11, 6, 576, mission, room_size=room_grid.SIZE)


def key_corridor(*, num_rows: int = 3, obj_type: Literal["key", "ball", "box"] = "ball", room_size: int = 6) -> Recipe:
    """An object behind a locked door off a corridor."""
    kind = KINDS.index(check_one_of("obj_type", obj_type, ("key", "ball", "box")))
    check_whole("room_size", room_size, 3, MAX_CELLS // 3)
    check_whole("num_rows", num_rows, 1, min(100, (MAX_CELLS - 1) // (room_size - 1)))
    mission = MissionSpace("pick up the {} {}", COLOUR_WORDS, kind_words(kind))
    width, height = 3 * (room_size - 1) + 1, num_rows * (room_size - 1) + 1
    numbers = num_rows, room_size, kind
    return Recipe(room_grid.key_corridor, numbers, width, height, 30 * room_size**2, mission, room_size=room_size)


def obstructed_pair(*, key_in_box: bool = True, blocked: bool = True) -> Recipe:
    """A blue ball behind one locked door."""
    numbers = (int(check_bool("key_in_box", key_in_box)), int(check_bool("blocked", blocked)))
    return Recipe(
        room_grid.obstructed_pair, numbers, 11, 6, 288, MissionSpace("pick up the blue ball"), room_size=room_grid.SIZE
    )


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
    column, line = check_pair("agent_room", agent_room, 0, 2)
    check_whole("num_quarters", num_quarters, 1, 4)
    check_whole("num_rooms_visited", num_rooms_visited, 1, 1_000_000)
    boxed, hindered = int(check_bool("key_in_box", key_in_box)), int(check_bool("blocked", blocked))
    numbers = (column + 3 * line, boxed, hindered, num_quarters, int(check_bool("keys_last", keys_last)))
    mission = MissionSpace("pick up the blue ball")
    return Recipe(
        room_grid.obstructed_maze, numbers, 16, 16, 144 * num_rooms_visited, mission, room_size=room_grid.SIZE
    )


_FAMILIES: tuple[Callable[..., Recipe], ...] = (
    *(empty, dist_shift, lava_gap, dynamic_obstacles, crossing, four_rooms, door_key, red_blue_doors),
    *(locked_room, playground, multi_room, fetch, go_to_object, put_near, go_to_door, memory),
    *(unlock, unlock_pickup, blocked_unlock_pickup, key_corridor, obstructed_pair, obstructed_maze, wfc),
)
FAMILIES: Mapping[str, Callable[..., Recipe]] = MappingProxyType({family.__name__: family for family in _FAMILIES})


def recipe(family: str, **options: Any) -> Recipe:
    """The recipe of a family's world.

    Raises:
        WorldError: if there is no such family, or it takes no such option.
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


def _place(name: str, place: Place, width: int, height: int, *, wall: int = 0) -> tuple[int, int]:
    """A cell; none is negative."""
    return (-1, -1) if place is None else check_cell(name, place, width, height, wall=wall)


def _start(place: Place, direction: int, width: int, height: int) -> tuple[int, int, int]:
    check_whole("agent_start_dir", direction, 0, 3)
    return *_place("agent_start_pos", place, width, height, wall=1), direction


def _objects(count: int, fewest: int, most: int, size: int) -> None:
    """So many objects have to fit into a room, and the agent too."""
    check_whole("size", size, 4, MAX_CELLS)
    check_whole("numObjs", count, fewest, max(fewest, min(most, (size - 2) ** 2 - 1)))


def _obstacle(name: str) -> int:
    return OBSTACLES[check_one_of("obstacle_type", name, tuple(OBSTACLES))]


ENGINE_SETTINGS = frozenset(
    {"agent_view_size", "render_mode", "tile_size", "palette", "highlight", "agent_pov", "screen_size"}
)
_UPSTREAM_METHODS = vars(MinigridCompat)
_SET_BY_RESETS = frozenset(  # not looked up further, as a short episode is mostly its reset
    {"cell_marks", "mission", "_told", "_draws", "_stream_is_held", "_stream_is_ahead", "_views", "_np_random"}
    | {"_np_random_seed"}
)
_OWN_NAMES = frozenset({"width", "height", "goal_pos", "agent_pos", "mission", "room_size", "num_rows", "num_cols"})


def options_of(family: str | Callable[..., Recipe], options: Mapping[str, Any]) -> dict[str, Any]:
    """What a family's function is given, with its defaults, by name; of an obstacle, Minigrid's class."""
    if not isinstance(family, str):
        return dict(options)
    if family.startswith("level:"):
        from minihuman.worlds.grid.babyai.levels import LEVELS  # compiled: only where a level is made

        function: Callable[..., Any] = LEVELS[family].trace
    else:
        function = FAMILIES[family]
    parameters = signature(function).parameters.values()
    settings = {each.name: each.default for each in parameters if each.default is not each.empty} | dict(options)
    if "obstacle_type" in settings:
        name = settings["obstacle_type"]
        settings["obstacle_type"] = getattr(sys.modules.get("minigrid.core.world_object"), name.capitalize(), name)
    return settings


class GridEnv(GridEngine):
    """A world of a family: ``GridEnv("four_rooms", max_steps=50)``.

    Args:
        family: One of ``env.FAMILIES`` or of the levels, or a level of your own.
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
        settings = {name: options.pop(name) for name in ENGINE_SETTINGS & options.keys()}
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
        settings = {**options_of(family, options), "fixed_max_steps": max_steps is not None}
        if self.recipe.width == self.recipe.height:
            settings.setdefault("size", self.recipe.width)
        self._family_options = {name: setting for name, setting in settings.items() if name not in _OWN_NAMES}
        self._is_made = True  # last: no `vars` here, which would slow every attribute of the world down

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _SET_BY_RESETS and self._is_made:
            if name in self._family_options:
                raise WorldAttributeError(f"{name} of {self} cannot be set; give it when the world is made")
            refuse_unknown_attribute(self, name, INSTEAD)
            refuse_replaced_method(self, name, _UPSTREAM_METHODS)
        super().__setattr__(name, value)

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


_LEVEL_OPTIONS = (
    *(
        "num_dists",
        "doors_open",
        "debug",
        "select_by",
        "strict",
        "first_color",
        "second_color",
        "num_doors",
        "num_objs",
    ),
    *("objs_per_room", "start_carrying", "distractors", "locked_room_prob", "implicit_unlock", "unblocking"),
    *("locations", "instr_kinds", "action_kinds", "fixed_max_steps", "size"),
)


def _read_option(world: GridEnv, name: str) -> Any:
    if name in world._family_options:
        return world._family_options[name]
    raise missing_name(world, name, INSTEAD)


_OPTION_NAMES = {name for family in _FAMILIES for name in signature(family).parameters} | {*_LEVEL_OPTIONS}
define_names(GridEnv, sorted(_OPTION_NAMES), _read_option, over=(*_LEVEL_OPTIONS, "obstacle_type"))


class GridEnvOnScreen(GridEnv):
    """A world of a family that shows itself at every reset and step, as Minigrid's do: ``render_mode="human"``."""

    metadata: dict[str, Any] = {**GridEnv.metadata, "render_modes": ["human", *GridEnv.metadata["render_modes"]]}  # noqa: RUF012  # Gymnasium's name and type

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode and show it."""
        answer = super().reset(seed=seed, options=options)
        self.render()
        return answer

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act, and show what became of it."""
        answer = super().step(action)
        self.render()
        return answer

    shortest_path, path_length_bounds = GridEngine.shortest_path, GridEngine.path_length_bounds


class GridWorld(GridEngine, abc.ABC):
    """A grid world laid out in plain Python; what an action does and what the agent sees is compiled.

    A subclass writes `layout`, and `reward_and_done` unless it is about goal, lava or a task of `rewards`.
    """

    own_steps: ClassVar[bool] = True  # of an instruction: judge each part by its own steps
    done_required: ClassVar[bool] = False  # a clause ends when "done" is said right after it was done
    _has_own_reward: ClassVar[bool] = False
    _has_own_step_values: ClassVar[bool] = False  # a reward or an observation that kernels do not make

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Note whether the subclass has a reward and an observation of its own."""
        super().__init_subclass__(**kwargs)
        cls._has_own_reward = cls.reward_and_done is not GridWorld.reward_and_done
        looks_otherwise = any(getattr(cls, name) is not getattr(GridEngine, name) for name in ("observation", "look"))
        cls._has_own_step_values = cls._has_own_reward or looks_otherwise

    @abc.abstractmethod
    def layout(self, grid: Layout) -> None:
        """Lay out an episode on an empty grid. It places the agent."""

    def reward_and_done(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Reward and end of a step that was made, given what goal, lava and task say.

        It may change the world (through ``self.state``); the observation is taken afterwards.
        """
        return reward, terminated

    @property
    def is_compiled(self) -> bool:
        """Whether kernels alone step and draw it: not with a `reward_and_done` of its own."""
        return not self._has_own_reward and self._is_plain(GridWorld)

    def _has_own_rules(self) -> bool:
        own_steps = any(getattr(type(self), name) is not getattr(GridWorld, name) for name in ("step", "advance"))
        return self._has_own_reward or own_steps

    def _lay_out(self) -> None:
        grid = Layout(self._row, self.np_random, self.mission_space.first(), self.kinds)
        self.layout(grid)
        self.mission = grid.mission
        if grid.instruction is not None:
            instruct(self._row, grid.instruction, own_steps=self.own_steps, done_required=self.done_required)
            self.mission = self.mission_space.of(self._row)

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act. Raises WorldError before `reset`, after an episode's end, and for an action there is not."""
        if not self._has_own_step_values:
            return super().step(action)
        reward, terminated, truncated = self.advance(action)
        return self.observation(), reward, terminated, truncated, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step without its observation: reward, terminated, truncated."""
        reward, terminated, truncated = super().advance(action)
        if self._has_own_reward:
            reward, terminated = self.reward_and_done(self._number_of(action), reward, terminated)
            self._row[PHASE] = OVER if terminated or truncated else PLAYING
        return float(reward), bool(terminated), truncated

    shortest_path, path_length_bounds = GridEngine.shortest_path, GridEngine.path_length_bounds
