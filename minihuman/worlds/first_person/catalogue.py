"""The table of first-person worlds."""

from typing import Any

from minihuman.worlds.entry import Entry

_FAST = {"forward_step": 0.7, "turn_step": 45.0}
_MAKE = "minihuman.worlds.first_person.make:make"
_MAKE_MANY = "minihuman.worlds.first_person.make:make_many"


def _entry(name: str, layout: str, summary: str, **options: Any) -> Entry:
    options = {"layout": layout, **options}
    return Entry(f"MiniWorld-{name}-v0", _MAKE, options, _MAKE_MANY, summary, guards_itself=True)


ENTRIES: tuple[Entry, ...] = (
    _entry("CollectHealth", "layouts.one_room:CollectHealth", "Stay alive on slime by picking up medical kits"),
    _entry("FourRooms", "layouts.connected_rooms:FourRooms", "Find the red box in one of four rooms"),
    _entry("GoToObj-Transfer", "transfer:GoToObj", "Go to the object that is named, the grid one's pair"),
    _entry("Hallway", "layouts.connected_rooms:Hallway", "Walk to the red box at the end of a hallway"),
    _entry("Maze", "layouts.mazes:Maze", "Find the red box in a maze of 8 by 8 rooms"),
    _entry("MazeS2", "layouts.mazes:Maze", "Find the red box in a maze of 2 by 2 rooms", num_rows=2, num_cols=2),
    _entry("MazeS3", "layouts.mazes:Maze", "Find the red box in a maze of 3 by 3 rooms", num_rows=3, num_cols=3),
    _entry(
        "MazeS3Fast",
        "layouts.mazes:Maze",
        "MazeS3 with longer steps and wider turns",
        num_rows=3,
        num_cols=3,
        max_steps=300,
        parameters=_FAST,
    ),
    _entry("OneRoom", "layouts.one_room:OneRoom", "Walk to the red box in a room of 10 m"),
    _entry("OneRoomS6", "layouts.one_room:OneRoom", "Walk to the red box in a room of 6 m", size=6, max_steps=100),
    _entry(
        "OneRoomS6Fast",
        "layouts.one_room:OneRoom",
        "OneRoomS6 with longer steps and wider turns",
        size=6,
        max_steps=50,
        parameters=_FAST,
    ),
    _entry("PickupObjects", "layouts.one_room:PickupObjects", "Pick up everything in the yard"),
    _entry("PutNext", "layouts.one_room:PutNext", "Put the red box next to the yellow one"),
    _entry("RoomObjects", "layouts.one_room:RoomObjects", "A box, a ball and a key to look at"),
    _entry("Sidewalk", "layouts.sidewalk:Sidewalk", "Walk to the box without stepping into the street"),
    _entry("Sign", "layouts.sign:Sign", "Touch the thing whose colour is on the sign"),
    _entry("TMaze", "layouts.mazes:TMaze", "Find the red box in the left or the right arm"),
    _entry("TMazeLeft", "layouts.mazes:TMaze", "TMaze with the box on the left", goal_pos=(10, 0, -6)),
    _entry("TMazeRight", "layouts.mazes:TMaze", "TMaze with the box on the right", goal_pos=(10, 0, 6)),
    _entry("ThreeRooms", "layouts.connected_rooms:ThreeRooms", "Three rooms with five things to look at"),
    _entry("WallGap", "layouts.connected_rooms:WallGap", "Go through the gap in the wall to the red box"),
    _entry("YMaze", "layouts.mazes:YMaze", "Find the red box in one of two slanted arms"),
    _entry("YMazeLeft", "layouts.mazes:YMaze", "YMaze with the box on the left", goal_pos=(3.9, 0, -7.0)),
    _entry("YMazeRight", "layouts.mazes:YMaze", "YMaze with the box on the right", goal_pos=(3.9, 0, 7.0)),
)
