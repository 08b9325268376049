"""The catalogue: the name of every built-in world, and the registration of these worlds with Gymnasium.

The catalogue has Minigrid's, BabyAI's and Miniworld's worlds under their original names. Version `-v0` keeps all
behaviour that affects results, even where it is odd; where a bug in Minigrid affects results, `-v1` does what the
instruction says (`docs/grid-worlds.md` lists both). Importing this module imports no world.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """A world of the catalogue: its name, the entry points and arguments that make it, and a summary."""

    name: str  # "MiniGrid-FourRooms-v0"; the id is "minihuman/" + name
    entry_point: str  # "minihuman.worlds.grid.env:GridEnv"
    kwargs: dict[str, Any] = field(default_factory=dict)
    vector_entry_point: str | None = None
    summary: str = ""
    guards_itself: bool = False  # it refuses misuse by itself: Gymnasium's two checking wrappers are left out

    @property
    def id(self) -> str:
        """Return the Gymnasium id."""
        return f"minihuman/{self.name}"


_MAKE_GRID = "minihuman.worlds.inside.entry_points:make_grid_world"
_BATCH_GRID = "minihuman.worlds.inside.batch:make_grid_batch"


def _make_grid_entry(name: str, family: str, summary: str, **options: Any) -> CatalogueEntry:
    """Return the catalogue entry of the world "MiniGrid-NAME", of a family of layouts with the given options."""
    return CatalogueEntry(
        f"MiniGrid-{name}", _MAKE_GRID, {"family": family, **options}, _BATCH_GRID, summary, guards_itself=True
    )


GRID_WORLDS: tuple[CatalogueEntry, ...] = (
    _make_grid_entry("Empty-5x5-v0", "empty", "an empty room", size=5),
    _make_grid_entry("Empty-Random-5x5-v0", "empty", "an empty room, start anywhere", size=5, agent_start_pos=None),
    _make_grid_entry("Empty-6x6-v0", "empty", "an empty room", size=6),
    _make_grid_entry("Empty-Random-6x6-v0", "empty", "an empty room, start anywhere", size=6, agent_start_pos=None),
    _make_grid_entry("Empty-8x8-v0", "empty", "an empty room"),
    _make_grid_entry("Empty-16x16-v0", "empty", "an empty room", size=16),
    _make_grid_entry("FourRooms-v0", "four_rooms", "four rooms, a goal somewhere"),
    _make_grid_entry("DoorKey-5x5-v0", "door_key", "find the key, open the door, reach the goal", size=5),
    _make_grid_entry("DoorKey-6x6-v0", "door_key", "find the key, open the door, reach the goal", size=6),
    _make_grid_entry("DoorKey-8x8-v0", "door_key", "find the key, open the door, reach the goal", size=8),
    _make_grid_entry("DoorKey-16x16-v0", "door_key", "find the key, open the door, reach the goal", size=16),
    _make_grid_entry(
        "MultiRoom-N2-S4-v0", "multi_room", "two small rooms", minNumRooms=2, maxNumRooms=2, maxRoomSize=4
    ),
    _make_grid_entry(
        "MultiRoom-N4-S5-v0", "multi_room", "six rooms, despite the name", minNumRooms=6, maxNumRooms=6, maxRoomSize=5
    ),
    _make_grid_entry("MultiRoom-N4-S5-v1", "multi_room", "four rooms", minNumRooms=4, maxNumRooms=4, maxRoomSize=5),
    _make_grid_entry("MultiRoom-N6-v0", "multi_room", "six rooms", minNumRooms=6, maxNumRooms=6),
    _make_grid_entry("LavaCrossingS9N1-v0", "crossing", "cross a river of lava", size=9, num_crossings=1),
    _make_grid_entry("LavaCrossingS9N2-v0", "crossing", "cross two rivers of lava", size=9, num_crossings=2),
    _make_grid_entry("LavaCrossingS9N3-v0", "crossing", "cross three rivers of lava", size=9, num_crossings=3),
    _make_grid_entry("LavaCrossingS11N5-v0", "crossing", "cross five rivers of lava", size=11, num_crossings=5),
    *(
        _make_grid_entry(
            f"SimpleCrossingS{s}N{n}-v0", "crossing", f"cross {walls}", size=s, num_crossings=n, obstacle_type="wall"
        )
        for s, n, walls in ((9, 1, "a wall"), (9, 2, "two walls"), (9, 3, "three walls"), (11, 5, "five walls"))
    ),
    _make_grid_entry("LavaGapS5-v0", "lava_gap", "find the gap in the lava", size=5),
    _make_grid_entry("LavaGapS6-v0", "lava_gap", "find the gap in the lava", size=6),
    _make_grid_entry("LavaGapS7-v0", "lava_gap", "find the gap in the lava", size=7),
    _make_grid_entry("DistShift1-v0", "dist_shift", "lava along the way, for training", strip2_row=2),
    _make_grid_entry("DistShift2-v0", "dist_shift", "lava elsewhere, for the test", strip2_row=5),
    _make_grid_entry("Dynamic-Obstacles-5x5-v0", "dynamic_obstacles", "avoid moving balls", size=5, n_obstacles=2),
    _make_grid_entry(
        "Dynamic-Obstacles-Random-5x5-v0",
        "dynamic_obstacles",
        "avoid moving balls, start anywhere",
        size=5,
        agent_start_pos=None,
        n_obstacles=2,
    ),
    _make_grid_entry("Dynamic-Obstacles-6x6-v0", "dynamic_obstacles", "avoid moving balls", size=6, n_obstacles=3),
    _make_grid_entry(
        "Dynamic-Obstacles-Random-6x6-v0",
        "dynamic_obstacles",
        "avoid moving balls, start anywhere",
        size=6,
        agent_start_pos=None,
        n_obstacles=3,
    ),
    _make_grid_entry("Dynamic-Obstacles-8x8-v0", "dynamic_obstacles", "avoid moving balls"),
    _make_grid_entry("Dynamic-Obstacles-16x16-v0", "dynamic_obstacles", "avoid moving balls", size=16, n_obstacles=8),
    _make_grid_entry("Fetch-5x5-N2-v0", "fetch", "pick up what is asked for", size=5, numObjs=2),
    _make_grid_entry("Fetch-6x6-N2-v0", "fetch", "pick up what is asked for", size=6, numObjs=2),
    _make_grid_entry("Fetch-8x8-N3-v0", "fetch", "pick up what is asked for"),
    _make_grid_entry("GoToDoor-5x5-v0", "go_to_door", "go to the door of a colour"),
    _make_grid_entry("GoToDoor-6x6-v0", "go_to_door", "go to the door of a colour", size=6),
    _make_grid_entry("GoToDoor-8x8-v0", "go_to_door", "go to the door of a colour", size=8),
    _make_grid_entry("GoToObject-6x6-N2-v0", "go_to_object", "go to an object"),
    _make_grid_entry("GoToObject-8x8-N2-v0", "go_to_object", "go to an object", size=8, numObjs=2),
    _make_grid_entry("PutNear-6x6-N2-v0", "put_near", "put one object near another"),
    _make_grid_entry("PutNear-8x8-N3-v0", "put_near", "put one object near another", size=8, numObjs=3),
    _make_grid_entry("MemoryS7-v0", "memory", "find the match of what was seen", size=7),
    _make_grid_entry("MemoryS9-v0", "memory", "find the match of what was seen", size=9),
    _make_grid_entry("MemoryS11-v0", "memory", "find the match of what was seen", size=11),
    _make_grid_entry("MemoryS13-v0", "memory", "find the match of what was seen", size=13),
    _make_grid_entry("MemoryS13Random-v0", "memory", "the same, corridor of drawn length", size=13, random_length=True),
    _make_grid_entry("MemoryS17Random-v0", "memory", "the same, corridor of drawn length", size=17, random_length=True),
    _make_grid_entry("RedBlueDoors-6x6-v0", "red_blue_doors", "open the red door, then the blue one", size=6),
    _make_grid_entry("RedBlueDoors-8x8-v0", "red_blue_doors", "open the red door, then the blue one"),
    _make_grid_entry("LockedRoom-v0", "locked_room", "the key of the goal's room is in another room"),
    _make_grid_entry("Playground-v0", "playground", "rooms and objects without a task"),
    _make_grid_entry("Unlock-v0", "unlock", "open a locked door"),
    _make_grid_entry("UnlockPickup-v0", "unlock_pickup", "pick up a box behind a locked door"),
    _make_grid_entry("BlockedUnlockPickup-v0", "blocked_unlock_pickup", "the same, a ball before the door"),
    _make_grid_entry("KeyCorridorS3R1-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=1),
    _make_grid_entry("KeyCorridorS3R2-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=2),
    _make_grid_entry("KeyCorridorS3R3-v0", "key_corridor", "find the key, then the ball", room_size=3, num_rows=3),
    _make_grid_entry("KeyCorridorS4R3-v0", "key_corridor", "find the key, then the ball", room_size=4, num_rows=3),
    _make_grid_entry("KeyCorridorS5R3-v0", "key_corridor", "find the key, then the ball", room_size=5, num_rows=3),
    _make_grid_entry("KeyCorridorS6R3-v0", "key_corridor", "find the key, then the ball", room_size=6, num_rows=3),
    *(
        _make_grid_entry(f"WFC-{preset}-v0", "wfc", summary, wfc_config=preset)
        for preset, summary in (
            ("MazeSimple", "a maze by Wave Function Collapse"),
            ("DungeonMazeScaled", "a dungeon of passages and halls"),
            ("RoomsFabric", "rooms with openings"),
            ("ObstaclesBlackdots", "a floor with single blocks"),
            ("ObstaclesAngular", "a floor with wedges"),
            ("ObstaclesHogs3", "a floor with hooks"),
        )
    ),
    _make_grid_entry("ObstructedMaze-1Dl-v0", "obstructed_pair", "a locked door", key_in_box=False, blocked=False),
    _make_grid_entry(
        "ObstructedMaze-1Dlh-v0", "obstructed_pair", "its key hidden in a box", key_in_box=True, blocked=False
    ),
    _make_grid_entry("ObstructedMaze-1Dlhb-v0", "obstructed_pair", "and a ball before the door"),
    *(
        _make_grid_entry(
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
    CatalogueEntry(
        "MiniGrid-GoToObj-Transfer-v0",
        "minihuman.worlds.inside.entry_points:make_go_to_obj_world",
        vector_entry_point="minihuman.worlds.vector_faces:make_go_to_obj_batch",
        summary="go to one of four objects, the 3D one's pair",
    ),
)


def _level(name: str, level: str, summary: str, **options: Any) -> CatalogueEntry:
    """Return the catalogue entry of the world "BabyAI-NAME", which is a level of the given kind with options."""
    level_options = {"family": f"level:{level}", **options}
    return CatalogueEntry(f"BabyAI-{name}", _MAKE_GRID, level_options, _BATCH_GRID, summary, guards_itself=True)


def _repaired(
    name: str, level: str, summary: str, *, repair: dict[str, Any], **options: Any
) -> tuple[CatalogueEntry, CatalogueEntry]:
    """Return two entries: the world as Minigrid has it (`-v0`), and with the options ``repair`` added (`-v1`)."""
    return (
        _level(f"{name}-v0", level, summary, **options),
        _level(f"{name}-v1", level, f"{summary}, repaired", **options, **repair),
    )


_OWN = {"own_steps": True}
_SOUND = {"sound": True}
_TIME = {"max_steps": 288}
_GO_IN_ORDER = {"action_kinds": ("goto",), "locked_room_prob": 0, "locations": False, "unblocking": False}
_PICK_IN_PLACE = {
    "num_rows": 1,
    "num_cols": 1,
    "num_dists": 8,
    "action_kinds": ("pickup",),
    "instr_kinds": ("action",),
    "locked_room_prob": 0,
    "unblocking": False,
}
_SYNTH = {"instr_kinds": ("action",), "locations": False, "implicit_unlock": False}
_SMALL = {"room_size": 5, "num_rows": 2, "num_cols": 2}
_MINI = {**_SMALL, "num_dists": 7, "locked_room_prob": 0.25}
_RED_BLUE = {"first_color": "red", "second_color": "blue"}

BABYAI_WORLDS: tuple[CatalogueEntry, ...] = (
    _level("GoToRedBallGrey-v0", "go_to_red_ball_grey", "go to the red ball among grey things"),
    _level("GoToRedBall-v0", "go_to_red_ball", "go to the red ball"),
    _level("GoToRedBallNoDists-v0", "go_to_red_ball_no_dists", "go to the red ball, the only thing"),
    _level("GoToObj-v0", "go_to_obj", "go to the only thing"),
    _level("GoToObjS4-v0", "go_to_obj", "go to the only thing", room_size=4),
    _level("GoToObjS6-v1", "go_to_obj", "go to the only thing", room_size=6),
    _level("GoToLocal-v0", "go_to_local", "go to a thing in the room"),
    *(
        _level(
            f"GoToLocalS{size}N{count}-v0", "go_to_local", "go to a thing in the room", room_size=size, num_dists=count
        )
        for size, counts in ((5, (2,)), (6, (2, 3, 4)), (7, (4, 5)), (8, (2, 3, 4, 5, 6, 7)))
        for count in counts
    ),
    _level("GoTo-v0", "go_to", "go to a thing in the house"),
    _level("GoToOpen-v0", "go_to", "go to a thing in the house, doors open", doors_open=True),
    _level("GoToObjMaze-v0", "go_to", "go to the only thing in the house", num_dists=1),
    _level(
        "GoToObjMazeOpen-v0", "go_to", "go to the only thing in the house, doors open", num_dists=1, doors_open=True
    ),
    *(
        _level(f"GoToObjMazeS{size}-v0", "go_to", "go to the only thing in the house", num_dists=1, room_size=size)
        for size in (4, 5, 6, 7)
    ),
    _level(
        "GoToObjMazeS4R2-v0", "go_to", "go to the only thing in four rooms", num_dists=1, **{**_SMALL, "room_size": 4}
    ),
    *_repaired("GoToImpUnlock", "go_to_imp_unlock", "go to a thing in a locked room", repair=_SOUND),
    *_repaired("GoToSeq", "level_gen", "go to things, in order", **_GO_IN_ORDER, repair=_OWN),
    *_repaired(
        "GoToSeqS5R2", "level_gen", "go to things, in order", **_GO_IN_ORDER, **_SMALL, num_dists=4, repair=_OWN
    ),
    _level("GoToRedBlueBall-v0", "go_to_red_blue_ball", "go to the red or the blue ball"),
    _level("GoToDoor-v0", "go_to_door", "go to a door"),
    _level("GoToObjDoor-v0", "go_to_obj_door", "go to a thing or a door"),
    _level("Open-v0", "open", "open a door in the house"),
    _level("OpenRedDoor-v0", "open_red_door", "open the red door"),
    _level("OpenDoor-v0", "open_door", "open a door, by colour or place"),
    _level("OpenDoorDebug-v0", "open_door", "open a door and no other", debug=True),
    _level("OpenDoorColor-v0", "open_door", "open a door, by colour", select_by="color"),
    _level("OpenDoorLoc-v0", "open_door", "open a door, by place", select_by="loc"),
    _level("OpenTwoDoors-v0", "open_two_doors", "open two doors, in order"),
    _level("OpenRedBlueDoors-v0", "open_two_doors", "open the red door, then the blue one", **_RED_BLUE),
    _level("OpenRedBlueDoorsDebug-v0", "open_two_doors", "open the red door first", **_RED_BLUE, strict=True),
    _level("OpenDoorsOrderN2-v0", "open_doors_order", "open doors, in order", num_doors=2),
    _level("OpenDoorsOrderN4-v0", "open_doors_order", "open doors, in order", num_doors=4),
    *_repaired("OpenDoorsOrderN2Debug", "open_doors_order", "no wrong door", num_doors=2, debug=True, repair=_OWN),
    *_repaired("OpenDoorsOrderN4Debug", "open_doors_order", "no wrong door", num_doors=4, debug=True, repair=_OWN),
    *_repaired("Unlock", "unlock", "open a locked door in the house", repair=_SOUND),
    _level("UnlockLocal-v0", "unlock_local", "open a locked door"),
    _level("UnlockLocalDist-v0", "unlock_local", "open a locked door, things about", distractors=True),
    _level("KeyInBox-v0", "key_in_box", "open a locked door, its key in a box"),
    *_repaired("UnlockPickup", "unlock_pickup", "a box behind a locked door", repair=_TIME),
    *_repaired("UnlockPickupDist", "unlock_pickup", "a box behind a locked door", distractors=True, repair=_TIME),
    _level("BlockedUnlockPickup-v0", "blocked_unlock_pickup", "a box behind a locked door behind a ball"),
    _level("UnlockToUnlock-v0", "unlock_to_unlock", "two locked doors, one key behind the other"),
    _level("Pickup-v0", "pickup", "pick up a thing in the house"),
    _level("UnblockPickup-v0", "unblock_pickup", "pick up a thing where things bar the way"),
    _level("PickupDist-v0", "pickup_dist", "pick up a thing, by kind or colour"),
    _level("PickupDistDebug-v0", "pickup_dist", "pick up a thing and no other", debug=True),
    _level("PickupAbove-v0", "pickup_above", "pick up the thing in the room above"),
    _level("PickupLoc-v0", "level_gen", "pick up a thing, by place", **_PICK_IN_PLACE),
    _level("OneRoomS8-v0", "one_room", "pick up the ball"),
    *(_level(f"OneRoomS{size}-v0", "one_room", "pick up the ball", room_size=size) for size in (12, 16, 20)),
    _level("FindObjS5-v0", "find_obj", "find a thing in the house"),
    *(_level(f"FindObjS{size}-v0", "find_obj", "find a thing in the house", room_size=size) for size in (6, 7)),
    _level("KeyCorridor-v0", "key_corridor", "a ball behind a locked door off a corridor"),
    *(
        _level(
            f"KeyCorridorS{size}R{lines}-v0",
            "key_corridor",
            "a ball behind a locked door off a corridor",
            room_size=size,
            num_rows=lines,
        )
        for size, lines in ((3, 1), (3, 2), (3, 3), (4, 3), (5, 3), (6, 3))
    ),
    _level("ActionObjDoor-v0", "action_obj_door", "go to, pick up or open"),
    _level("PutNextLocal-v0", "put_next_local", "put a thing next to another"),
    _level("PutNextLocalS5N3-v0", "put_next_local", "put a thing next to another", room_size=5, num_objs=3),
    _level("PutNextLocalS6N4-v0", "put_next_local", "put a thing next to another", room_size=6, num_objs=4),
    *(
        _level(
            f"PutNextS{size}N{count}-v0",
            "put_next",
            "put a thing next to one in the other room",
            room_size=size,
            objs_per_room=count,
        )
        for size, count in ((4, 1), (5, 1), (5, 2), (6, 3), (7, 4))
    ),
    *(
        entry
        for size, count in ((5, 2), (6, 3), (7, 4))
        for entry in _repaired(
            f"PutNextS{size}N{count}Carrying",
            "put_next",
            "put what is in hand next to a thing",
            room_size=size,
            objs_per_room=count,
            start_carrying=True,
            repair=_OWN,
        )
    ),
    _level("MoveTwoAcrossS5N2-v0", "move_two_across", "two things, each next to another", room_size=5, objs_per_room=2),
    _level("MoveTwoAcrossS8N9-v0", "move_two_across", "two things, each next to another", room_size=8, objs_per_room=9),
    _level("Synth-v0", "level_gen", "any one thing to do", **_SYNTH),
    _level("SynthS5R2-v0", "level_gen", "any one thing to do", **_SYNTH, room_size=5, num_rows=2),
    _level("SynthLoc-v0", "level_gen", "any one thing to do, by place", instr_kinds=("action",), implicit_unlock=False),
    *_repaired("SynthSeq", "level_gen", "anything to do, in order", implicit_unlock=False, repair=_OWN),
    *_repaired("MiniBossLevel", "level_gen", "anything, in four small rooms", **_MINI, repair=_OWN),
    *_repaired("BossLevel", "level_gen", "anything", repair=_OWN),
    *_repaired("BossLevelNoUnlock", "level_gen", "anything", locked_room_prob=0, implicit_unlock=False, repair=_OWN),
)

_FAST = {"forward_step": 0.7, "turn_step": 45.0}
_MAKE_FIRST_PERSON = "minihuman.worlds.first_person.batch:make_world"
_BATCH_FIRST_PERSON = "minihuman.worlds.first_person.batch:make_batch"


def _make_first_person_entry(name: str, layout: str, summary: str, **options: Any) -> CatalogueEntry:
    """Return the catalogue entry of a first-person world, whose layout is named by module and class."""
    options = {"layout": layout, **options}
    return CatalogueEntry(
        f"MiniWorld-{name}-v0", _MAKE_FIRST_PERSON, options, _BATCH_FIRST_PERSON, summary, guards_itself=True
    )


FIRST_PERSON_WORLDS: tuple[CatalogueEntry, ...] = (
    _make_first_person_entry(
        "CollectHealth", "layouts.one_room:CollectHealth", "Stay alive on slime by picking up medical kits"
    ),
    _make_first_person_entry("FourRooms", "layouts.connected_rooms:FourRooms", "Find the red box in one of four rooms"),
    _make_first_person_entry(
        "GoToObj-Transfer", "layouts.go_to_obj:GoToObj", "Go to the object that is named, the grid one's pair"
    ),
    _make_first_person_entry(
        "Hallway", "layouts.connected_rooms:Hallway", "Walk to the red box at the end of a hallway"
    ),
    _make_first_person_entry("Maze", "layouts.mazes:Maze", "Find the red box in a maze of 8 by 8 rooms"),
    _make_first_person_entry(
        "MazeS2", "layouts.mazes:Maze", "Find the red box in a maze of 2 by 2 rooms", num_rows=2, num_cols=2
    ),
    _make_first_person_entry(
        "MazeS3", "layouts.mazes:Maze", "Find the red box in a maze of 3 by 3 rooms", num_rows=3, num_cols=3
    ),
    _make_first_person_entry(
        "MazeS3Fast",
        "layouts.mazes:Maze",
        "MazeS3 with longer steps and wider turns",
        num_rows=3,
        num_cols=3,
        max_steps=300,
        parameters=_FAST,
    ),
    _make_first_person_entry("OneRoom", "layouts.one_room:OneRoom", "Walk to the red box in a room of 10 m"),
    _make_first_person_entry(
        "OneRoomS6", "layouts.one_room:OneRoom", "Walk to the red box in a room of 6 m", size=6, max_steps=100
    ),
    _make_first_person_entry(
        "OneRoomS6Fast",
        "layouts.one_room:OneRoom",
        "OneRoomS6 with longer steps and wider turns",
        size=6,
        max_steps=50,
        parameters=_FAST,
    ),
    _make_first_person_entry("PickupObjects", "layouts.one_room:PickupObjects", "Pick up everything in the yard"),
    _make_first_person_entry("PutNext", "layouts.one_room:PutNext", "Put the red box next to the yellow one"),
    _make_first_person_entry("RoomObjects", "layouts.one_room:RoomObjects", "A box, a ball and a key to look at"),
    _make_first_person_entry(
        "Sidewalk", "layouts.connected_rooms:Sidewalk", "Walk to the box without stepping into the street"
    ),
    _make_first_person_entry("Sign", "layouts.sign:Sign", "Touch the thing whose colour is on the sign"),
    _make_first_person_entry("TMaze", "layouts.mazes:TMaze", "Find the red box in the left or the right arm"),
    _make_first_person_entry(
        "TMazeLeft", "layouts.mazes:TMaze", "TMaze with the box on the left", goal_pos=(10, 0, -6)
    ),
    _make_first_person_entry(
        "TMazeRight", "layouts.mazes:TMaze", "TMaze with the box on the right", goal_pos=(10, 0, 6)
    ),
    _make_first_person_entry(
        "ThreeRooms", "layouts.connected_rooms:ThreeRooms", "Three rooms with five things to look at"
    ),
    _make_first_person_entry(
        "WallGap", "layouts.connected_rooms:WallGap", "Go through the gap in the wall to the red box"
    ),
    _make_first_person_entry("YMaze", "layouts.mazes:YMaze", "Find the red box in one of two slanted arms"),
    _make_first_person_entry(
        "YMazeLeft", "layouts.mazes:YMaze", "YMaze with the box on the left", goal_pos=(3.9, 0, -7.0)
    ),
    _make_first_person_entry(
        "YMazeRight", "layouts.mazes:YMaze", "YMaze with the box on the right", goal_pos=(3.9, 0, 7.0)
    ),
)

DRAWN_LEVEL = CatalogueEntry(
    "Level-v0",
    "minihuman.worlds.inside.entry_points:make_drawn_level",
    vector_entry_point="minihuman.worlds.vector_faces:make_level_batch",
    summary="a level of your own, drawn as a diagram",
    guards_itself=True,
)
RULES = CatalogueEntry(
    "Rules-v0",
    "minihuman.worlds.grid.ruleset.env:RulesetWorld",
    vector_entry_point="minihuman.worlds.grid.ruleset.batch:RulesetBatch",
    summary="a goal, and rules by which things turn into others",
    guards_itself=True,
)

_TEAMS = "minihuman.worlds.grid.layouts.team_layouts"


def _team(name: str, entry_point: str, summary: str, **options: Any) -> CatalogueEntry:
    return CatalogueEntry(f"Team-{name}-v0", entry_point, options, summary=summary, guards_itself=True)


# made by `worlds.team.make_team`: several bodies act at once
TEAM_WORLDS: tuple[CatalogueEntry, ...] = (
    *(
        _team(name, "minihuman.worlds.grid.kitchen:Kitchen", f"Cook soups together: {description}", layout=layout)
        for name, layout, description in (
            ("CrampedRoom", "cramped_room", "a small kitchen in which cooks get into each other's way"),
            ("AsymmetricAdvantages", "asymmetric_advantages", "each side is nearer to something else"),
            ("CoordinationRing", "coordination_ring", "two cooks go round in a circle"),
            ("ForcedCoordination", "forced_coordination", "one has the onions, the other the pots"),
            ("CounterCircuit", "counter_circuit_o_1order", "hand over the counter or walk around it"),
        )
    ),
    _team("FourRooms", f"{_TEAMS}:TeamFourRooms", "Find the goal together in four rooms"),
    _team(
        "FourRooms3D",
        "minihuman.worlds.first_person.layouts.team_rooms:TeamRooms",
        "Find the red box together in first person",
    ),
    _team("DoorKey-TwoKeys", f"{_TEAMS}:TwoKeyDoorKey", "Two locked doors, a hand for each key"),
    _team("SwapCorridor", f"{_TEAMS}:SwapCorridor", "Pass each other in a corridor with one bay: who gives way?"),
    _team("CarryTogether", f"{_TEAMS}:CarryTogether", "Carry a load that needs two"),
    _team("HideAndSeek", f"{_TEAMS}:HideAndSeek", "One seeks, the others hide"),
)

WORLDS: tuple[CatalogueEntry, ...] = (*GRID_WORLDS, *BABYAI_WORLDS, *FIRST_PERSON_WORLDS, DRAWN_LEVEL, RULES)

TRIAL_WORLDS = {  # environments of a single trial; not listed as worlds, since their options define them
    "minihuman/Stimulus-v0": "minihuman.experiment.stimuli:Stimulus",
    "minihuman/TwoStep-v0": "minihuman.experiment.stimuli:TwoStep",
}


def register() -> None:
    """Register every world with Gymnasium. Calling this again changes nothing."""
    import gymnasium

    for world_id, entry_point in TRIAL_WORLDS.items():
        if world_id not in gymnasium.registry:
            gymnasium.register(world_id, entry_point=entry_point, disable_env_checker=True)
    for entry in (*WORLDS, *TEAM_WORLDS):
        if entry.id not in gymnasium.registry:
            gymnasium.register(
                entry.id,
                entry_point=entry.entry_point,
                vector_entry_point=entry.vector_entry_point,
                kwargs=entry.kwargs,
                order_enforce=not entry.guards_itself,
                disable_env_checker=entry.guards_itself,
            )


def is_compiled_grid(world_id: str, options: Mapping[str, Any]) -> bool:
    """Return whether an id names a built-in grid world that compiled kernels alone step and draw.

    A web page can compute these worlds. The function does not make the world.
    """
    return world_id in _COMPILED_GRIDS and options.get("view", "grid") == "grid"


def is_first_person(world_id: str) -> bool:
    """Return whether an id names a built-in first-person world.

    A web page can compute these worlds, because the package's sine function gives the same bits on every machine.
    """
    return world_id in _FIRST_PERSON


_FIRST_PERSON = frozenset(entry.id for entry in FIRST_PERSON_WORLDS)
_COMPILED_GRIDS = frozenset(
    entry.id
    for entry in (*GRID_WORLDS, *BABYAI_WORLDS, DRAWN_LEVEL)
    if entry.entry_point == _MAKE_GRID or entry is DRAWN_LEVEL
)
