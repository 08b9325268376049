"""The kernels that lay out grid worlds, which are built ahead of time for pages that draw layouts from seeds.

They are called like those of `exports`, from modules of their own, which only those pages load.
"""

from collections.abc import Callable, Mapping
from typing import Any

from minihuman.worlds.grid.babyai.level_program import furnish
from minihuman.worlds.grid.babyai.verifier import hand_over
from minihuman.worlds.grid.core.state import clear
from minihuman.worlds.grid.layouts import room_grid, rooms, single_rooms

_LAYOUTS: tuple[Callable[..., Any], ...] = (
    *(rooms.four_rooms, rooms.door_key, rooms.multi_room, rooms.red_blue_doors, rooms.locked_room, rooms.playground),
    *(single_rooms.empty, single_rooms.crossing, single_rooms.gap, single_rooms.dist_shift),
    *(single_rooms.dynamic_obstacles, single_rooms.fetch, single_rooms.go_to_door, single_rooms.go_to_object),
    *(single_rooms.put_near, single_rooms.memory, room_grid.unlock, room_grid.unlock_pickup, room_grid.key_corridor),
    *(room_grid.obstructed_pair, room_grid.obstructed_maze),
)

# by module, as in `exports`; with a prefix, for a function of the name `memory` would hide the module's memory
LAYOUT_EXPORTS: Mapping[str, Mapping[str, Callable[..., Any]]] = {
    "layouts": {"clear": clear, **{f"layout_{layout.__name__}": layout for layout in _LAYOUTS}},
    "levels": {"clear": clear, "hand_over": hand_over, "layout_furnish": furnish},
}
