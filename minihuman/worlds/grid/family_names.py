"""Attributes that only some of Minigrid's classes have, which describe a world's task, rooms and options.

The module also says what to use instead of attributes that have no meaning here.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core import rewards
from minihuman.worlds.grid.core.state import TARGET, TASK
from minihuman.worlds.grid.instruction_views import InstructionView, view_instruction
from minihuman.worlds.grid.object_kinds import kind_name
from minihuman.worlds.grid.object_views import ObjectView
from minihuman.worlds.grid.room_views import RoomView
from minihuman.worlds.upstream_names import missing_name

Place = tuple[int, int]  # column, row

_RANDOM = "draw with env.unwrapped.np_random"
_LAYOUT = "write the layout of a GridWorld of your own"
_BY_CELLS = "read the cells of env.unwrapped.grid"
_OPTIONS = "options that were given are in env.spec.kwargs"
INSTEAD: Mapping[str, str] = MappingProxyType(
    {
        **dict.fromkeys(
            ("_rand_int", "_rand_float", "_rand_bool", "_rand_elem", "_rand_subset", "_rand_color"), _RANDOM
        ),
        **dict.fromkeys(("_rand_pos", "rand_instr", "rand_obj"), _RANDOM),
        **dict.fromkeys(("_gen_grid", "_placeRoom", "gen_mission", "validate_instrs", "add_locked_room"), _LAYOUT),
        **dict.fromkeys(("add_door", "connect_all"), _LAYOUT),
        **dict.fromkeys(("remove_wall", "add_key", "add_locked_door", "open_all_doors"), _LAYOUT),
        **dict.fromkeys(("rooms", "gap_pos", "move_pos", "obj_a", "locked_room", "door_colors"), _BY_CELLS),
        **dict.fromkeys(("obstacle_type", "doors_open", "debug", "strict"), _OPTIONS),
        **dict.fromkeys(("num_dists", "num_objs", "num_doors", "objs_per_room", "distractors"), _OPTIONS),
        **dict.fromkeys(("select_by", "start_carrying", "action_kinds", "instr_kinds", "locations"), _OPTIONS),
        **dict.fromkeys(("unblocking", "implicit_unlock", "locked_room_prob"), _OPTIONS),
        "_gen_mission": "set env.unwrapped.mission",
        "check_objs_reachable": "env.unwrapped.shortest_path() is empty where something is out of reach",
        "num_navs_needed": "max_steps follows from it",
        "level_name": "read env.spec.id",
        "gym_id": "read env.spec.id",
        "grid_size": "read width and height",
        "obs_space": "read observation_space",
    }
)


def _target_cell(world: Any, first: int) -> Place:
    """Return the column and row that the numbers ``first`` and ``first + 1`` of the world's task are."""
    row = world.state.row
    return int(row[TARGET + first]), int(row[TARGET + first + 1])


def _obstacles(world: Any) -> list[ObjectView]:
    views = world.object_views()
    count = int(world.state.row[TARGET])
    return [views.of_identity(number) for number in range(1, count + 1)]


def _target_pos(world: Any) -> Place:
    return _target_cell(world, 0 if world.state.row[TASK] == rewards.STAND_BY else 2)


def _success_pos(world: Any) -> Place:
    return _target_cell(world, 0)


def _failure_pos(world: Any) -> Place:
    return _target_cell(world, 2)


def _first_door(world: Any) -> ObjectView | None:
    door: ObjectView | None = world.grid.get(*_target_cell(world, 0))
    return door


def _second_door(world: Any) -> ObjectView | None:
    door: ObjectView | None = world.grid.get(*_target_cell(world, 2))
    return door


def _picked_object(world: Any) -> ObjectView:
    view: ObjectView = world.object_views().of_identity(int(world.state.row[TARGET]))
    return view


def _target_kind(world: Any) -> str:
    return kind_name(int(world.state.row[TARGET]), world.kinds)


def _target_colour(world: Any) -> str:
    return COLOURS[int(world.state.row[TARGET + 1])]


def _last_word(world: Any) -> str:
    return str(world.mission).split()[-1]


def _word_before_last(world: Any) -> str:
    return str(world.mission).split()[-2]


def _position_update(world: Any) -> Callable[..., None]:
    def update_objs_poss(instr: InstructionView | None = None) -> None:
        """Do nothing, because the positions of an instruction's objects are always up to date."""

    return update_objs_poss


def _instruction(world: Any) -> InstructionView:
    return view_instruction(world.object_views())


def _object_kinds(world: Any) -> list[str]:
    """Return the kinds of the objects that the layouts of a world draw."""
    if world.state.row[TASK] == rewards.FETCH:
        return ["key", "ball"]
    return ["key", "ball", "box"]


def _mission(world: Any) -> str:
    return str(world.mission)


@dataclass(frozen=True, slots=True)
class _TaskName:
    """An attribute that worlds with certain tasks have, and the function that reads it."""

    tasks: tuple[int, ...]
    read: Callable[[Any], Any]


_TASK_NAMES: Mapping[str, tuple[_TaskName, ...]] = MappingProxyType(
    {
        "obstacles": (_TaskName((rewards.DODGE,), _obstacles),),
        "target_pos": (_TaskName((rewards.STAND_BY, rewards.PUT_NEAR), _target_pos),),
        "target_color": (_TaskName((rewards.STAND_BY, rewards.PUT_NEAR), _word_before_last),),
        "target_type": (_TaskName((rewards.PUT_NEAR,), _last_word),),
        "targetType": (_TaskName((rewards.FETCH,), _target_kind), _TaskName((rewards.STAND_BY,), _last_word)),
        "targetColor": (_TaskName((rewards.FETCH,), _target_colour),),
        "obj_types": (_TaskName((rewards.FETCH, rewards.STAND_BY, rewards.PUT_NEAR), _object_kinds),),
        "move_type": (_TaskName((rewards.PUT_NEAR,), _target_kind),),
        "moveColor": (_TaskName((rewards.PUT_NEAR,), _target_colour),),
        "success_pos": (_TaskName((rewards.MATCH,), _success_pos),),
        "failure_pos": (_TaskName((rewards.MATCH,), _failure_pos),),
        "red_door": (_TaskName((rewards.IN_ORDER,), _first_door),),
        "blue_door": (_TaskName((rewards.IN_ORDER,), _second_door),),
        "door": (_TaskName((rewards.OPEN_DOOR,), _first_door),),
        "obj": (_TaskName((rewards.PICK,), _picked_object),),
        "update_objs_poss": (_TaskName((rewards.INSTRUCTED,), _position_update),),
        "instrs": (_TaskName((rewards.INSTRUCTED,), _instruction),),
        "surface": (_TaskName((rewards.INSTRUCTED,), _mission),),
    }
)


def _room_size(world: Any) -> int:
    return int(world._rooms().size)


def _room_columns(world: Any) -> int:
    return int(world._rooms().columns)


def _room_rows(world: Any) -> int:
    return int(world._rooms().rows)


def _room_grid(world: Any) -> list[list[RoomView]]:
    return list(world._rooms())


_ROOM_NAMES: Mapping[str, Callable[[Any], Any]] = MappingProxyType(
    {"room_size": _room_size, "num_cols": _room_columns, "num_rows": _room_rows, "room_grid": _room_grid}
)


FAMILY_NAMES = frozenset({*_TASK_NAMES, *_ROOM_NAMES, *INSTEAD})


def read_family_name(world: Any, name: str) -> Any:
    """Return the value of an attribute that Minigrid's class of this world has: of its task, or of its grid of rooms.

    Raises:
        WorldAttributeError: if this world has no such attribute; the message says what to use instead.
    """
    attributes = vars(world)
    if name in _TASK_NAMES and "_row" in attributes:
        task = int(attributes["_row"][TASK])
        for task_name in _TASK_NAMES[name]:
            if task in task_name.tasks:
                return task_name.read(world)
    if name in _ROOM_NAMES and getattr(attributes.get("recipe"), "room_size", False):
        return _ROOM_NAMES[name](world)
    raise missing_name(world, name, INSTEAD)
