"""The table of levels: every BabyAI world of Minigrid under its name.

``-v0`` keeps what decides results, even where it is odd; where an accident of Minigrid's changes results, ``-v1`` does
what the instruction says. `docs/instructions.md` lists both.
"""

from typing import Any

from minihuman.worlds.entry import Entry

_MAKE = "minihuman.worlds.inside.make:make"
_MAKE_MANY = "minihuman.worlds.grid.batch:GridBatch"


def _level(name: str, level: str, summary: str, **options: Any) -> Entry:
    given = {"family": f"level:{level}", **options}
    return Entry(f"BabyAI-{name}", _MAKE, given, _MAKE_MANY, summary, guards_itself=True)


def _repaired(name: str, level: str, summary: str, *, repair: dict[str, Any], **options: Any) -> tuple[Entry, Entry]:
    """The world as it is in Minigrid, and repaired."""
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

ENTRIES: tuple[Entry, ...] = (
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
