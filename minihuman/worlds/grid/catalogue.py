"""The table of grid worlds: every classic world of Minigrid, under its name."""

from typing import Any

from minihuman.worlds.entry import Entry

_MAKE = "minihuman.worlds.inside.make:make"
_MAKE_MANY = "minihuman.worlds.grid.batch:GridBatch"


def _world(name: str, family: str, summary: str, **options: Any) -> Entry:
    return Entry(f"MiniGrid-{name}", _MAKE, {"family": family, **options}, _MAKE_MANY, summary, guards_itself=True)


ENTRIES: tuple[Entry, ...] = (
    _world("Empty-5x5-v0", "empty", "an empty room", size=5),
    _world("Empty-Random-5x5-v0", "empty", "an empty room, start anywhere", size=5, agent_start_pos=None),
    _world("Empty-6x6-v0", "empty", "an empty room", size=6),
    _world("Empty-Random-6x6-v0", "empty", "an empty room, start anywhere", size=6, agent_start_pos=None),
    _world("Empty-8x8-v0", "empty", "an empty room"),
    _world("Empty-16x16-v0", "empty", "an empty room", size=16),
    _world("FourRooms-v0", "four_rooms", "four rooms, a goal somewhere"),
    _world("DoorKey-5x5-v0", "door_key", "find the key, open the door, reach the goal", size=5),
    _world("DoorKey-6x6-v0", "door_key", "find the key, open the door, reach the goal", size=6),
    _world("DoorKey-8x8-v0", "door_key", "find the key, open the door, reach the goal", size=8),
    _world("DoorKey-16x16-v0", "door_key", "find the key, open the door, reach the goal", size=16),
    _world("MultiRoom-N2-S4-v0", "multi_room", "two small rooms", minNumRooms=2, maxNumRooms=2, maxRoomSize=4),
    _world(
        "MultiRoom-N4-S5-v0", "multi_room", "six rooms, despite the name", minNumRooms=6, maxNumRooms=6, maxRoomSize=5
    ),
    _world("MultiRoom-N4-S5-v1", "multi_room", "four rooms", minNumRooms=4, maxNumRooms=4, maxRoomSize=5),
    _world("MultiRoom-N6-v0", "multi_room", "six rooms", minNumRooms=6, maxNumRooms=6),
    _world("LavaCrossingS9N1-v0", "crossing", "cross a river of lava", size=9, num_crossings=1),
    _world("LavaCrossingS9N2-v0", "crossing", "cross two rivers of lava", size=9, num_crossings=2),
    _world("LavaCrossingS9N3-v0", "crossing", "cross three rivers of lava", size=9, num_crossings=3),
    _world("LavaCrossingS11N5-v0", "crossing", "cross five rivers of lava", size=11, num_crossings=5),
    _world("SimpleCrossingS9N1-v0", "crossing", "cross a wall", size=9, num_crossings=1, obstacle_type="wall"),
    _world("SimpleCrossingS9N2-v0", "crossing", "cross two walls", size=9, num_crossings=2, obstacle_type="wall"),
    _world("SimpleCrossingS9N3-v0", "crossing", "cross three walls", size=9, num_crossings=3, obstacle_type="wall"),
    _world("SimpleCrossingS11N5-v0", "crossing", "cross five walls", size=11, num_crossings=5, obstacle_type="wall"),
    _world("LavaGapS5-v0", "lava_gap", "find the gap in the lava", size=5),
    _world("LavaGapS6-v0", "lava_gap", "find the gap in the lava", size=6),
    _world("LavaGapS7-v0", "lava_gap", "find the gap in the lava", size=7),
    _world("DistShift1-v0", "dist_shift", "lava along the way, for training", strip2_row=2),
    _world("DistShift2-v0", "dist_shift", "lava elsewhere, for the test", strip2_row=5),
    _world("Dynamic-Obstacles-5x5-v0", "dynamic_obstacles", "avoid moving balls", size=5, n_obstacles=2),
    _world(
        "Dynamic-Obstacles-Random-5x5-v0",
        "dynamic_obstacles",
        "avoid moving balls, start anywhere",
        size=5,
        agent_start_pos=None,
        n_obstacles=2,
    ),
    _world("Dynamic-Obstacles-6x6-v0", "dynamic_obstacles", "avoid moving balls", size=6, n_obstacles=3),
    _world(
        "Dynamic-Obstacles-Random-6x6-v0",
        "dynamic_obstacles",
        "avoid moving balls, start anywhere",
        size=6,
        agent_start_pos=None,
        n_obstacles=3,
    ),
    _world("Dynamic-Obstacles-8x8-v0", "dynamic_obstacles", "avoid moving balls"),
    _world("Dynamic-Obstacles-16x16-v0", "dynamic_obstacles", "avoid moving balls", size=16, n_obstacles=8),
    _world("Fetch-5x5-N2-v0", "fetch", "pick up what is asked for", size=5, numObjs=2),
    _world("Fetch-6x6-N2-v0", "fetch", "pick up what is asked for", size=6, numObjs=2),
    _world("Fetch-8x8-N3-v0", "fetch", "pick up what is asked for"),
    _world("GoToDoor-5x5-v0", "go_to_door", "go to the door of a colour"),
    _world("GoToDoor-6x6-v0", "go_to_door", "go to the door of a colour", size=6),
    _world("GoToDoor-8x8-v0", "go_to_door", "go to the door of a colour", size=8),
    _world("GoToObject-6x6-N2-v0", "go_to_object", "go to an object"),
    _world("GoToObject-8x8-N2-v0", "go_to_object", "go to an object", size=8, numObjs=2),
    _world("PutNear-6x6-N2-v0", "put_near", "put one object near another"),
    _world("PutNear-8x8-N3-v0", "put_near", "put one object near another", size=8, numObjs=3),
    _world("MemoryS7-v0", "memory", "find the match of what was seen", size=7),
    _world("MemoryS9-v0", "memory", "find the match of what was seen", size=9),
    _world("MemoryS11-v0", "memory", "find the match of what was seen", size=11),
    _world("MemoryS13-v0", "memory", "find the match of what was seen", size=13),
    _world("MemoryS13Random-v0", "memory", "the same, corridor of drawn length", size=13, random_length=True),
    _world("MemoryS17Random-v0", "memory", "the same, corridor of drawn length", size=17, random_length=True),
    _world("RedBlueDoors-6x6-v0", "red_blue_doors", "open the red door, then the blue one", size=6),
    _world("RedBlueDoors-8x8-v0", "red_blue_doors", "open the red door, then the blue one"),
    _world("LockedRoom-v0", "locked_room", "the key of the goal's room is in another room"),
    _world("Playground-v0", "playground", "rooms and objects without a task"),
    _world("Unlock-v0", "unlock", "open a locked door"),
    _world("UnlockPickup-v0", "unlock_pickup", "pick up a box behind a locked door"),
    _world("BlockedUnlockPickup-v0", "blocked_unlock_pickup", "the same, a ball before the door"),
    _world("KeyCorridorS3R1-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=1),
    _world("KeyCorridorS3R2-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=2),
    _world("KeyCorridorS3R3-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=3),
    _world("KeyCorridorS4R3-v0", "key_corridor", "find the key, then the ball", room_size=4, num_rows=3),
    _world("KeyCorridorS5R3-v0", "key_corridor", "find the key, then the ball", room_size=5, num_rows=3),
    _world("KeyCorridorS6R3-v0", "key_corridor", "find the key, then the ball", room_size=6, num_rows=3),
    *(
        _world(f"WFC-{preset}-v0", "wfc", summary, wfc_config=preset)
        for preset, summary in (
            ("MazeSimple", "a maze by Wave Function Collapse"),
            ("DungeonMazeScaled", "a dungeon of passages and halls"),
            ("RoomsFabric", "rooms with openings"),
            ("ObstaclesBlackdots", "a floor with single blocks"),
            ("ObstaclesAngular", "a floor with wedges"),
            ("ObstaclesHogs3", "a floor with hooks"),
        )
    ),
    _world("ObstructedMaze-1Dl-v0", "obstructed_pair", "a locked door", key_in_box=False, blocked=False),
    _world("ObstructedMaze-1Dlh-v0", "obstructed_pair", "its key hidden in a box", key_in_box=True, blocked=False),
    _world("ObstructedMaze-1Dlhb-v0", "obstructed_pair", "and a ball before the door"),
    *(
        _world(
            f"ObstructedMaze-{name}-v{version}",
            "obstructed_maze",
            summary,
            agent_room=room,
            key_in_box=boxed,
            blocked=blocked,
            num_quarters=quarters,
            num_rooms_visited=visited,
            keys_last=version == 1,
        )
        for name, version, summary, room, boxed, blocked, quarters, visited in (
            ("2Dl", 0, "two locked doors", (2, 1), False, False, 1, 4),
            ("2Dlh", 0, "two locked doors, keys in boxes", (2, 1), True, False, 1, 4),
            ("2Dlhb", 0, "two blocked doors, keys in boxes", (2, 1), True, True, 1, 4),
            ("1Q", 0, "a quarter of the maze", (1, 1), True, True, 1, 5),
            ("2Q", 0, "half of the maze", (2, 1), True, True, 2, 11),
            ("Full", 0, "a ball in one of four corners", (1, 1), True, True, 4, 25),
            ("2Dlhb", 1, "two blocked doors, no ball on a key", (2, 1), True, True, 1, 4),
            ("1Q", 1, "a quarter of the maze, no ball on a key", (1, 1), True, True, 1, 5),
            ("2Q", 1, "half of the maze, no ball on a key", (2, 1), True, True, 2, 11),
            ("Full", 1, "four corners, no ball on a key", (1, 1), True, True, 4, 25),
        )
    ),
    Entry(
        "MiniGrid-GoToObj-Transfer-v0",
        "minihuman.worlds.inside.make:make_go_to_obj",
        summary="go to one of four objects, the 3D one's pair",
    ),
)
