"""The levels of BabyAI: going to objects, opening doors, picking objects up, moving them, and the whole language.

Options are named as Minigrid names them. `LEVELS` has each level by the name of its function. Importing this module
compiles what all levels have in common.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai.language import (
    PLACES,
    After,
    Before,
    GoTo,
    Instruction,
    ObjectDescription,
    Open,
    Pickup,
    PutNext,
)
from minihuman.worlds.grid.babyai.level_builder import Level, LevelBuilder, level
from minihuman.worlds.grid.babyai.level_values import AnyOf, Use
from minihuman.worlds.options import check_bool, check_one_of, check_whole

ONE_ROOM = ("num_rows", "num_cols")  # sizes that are fixed in a level of one room
MOST_THINGS = 1000


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_ball_grey(builder: LevelBuilder, num_dists: int = 7) -> Instruction:
    """Lay out one room with the red ball and ``num_dists`` grey objects; the task is to go to the ball."""
    builder.place_agent()
    ball = builder.thing(builder.room(0, 0), "ball", "red")
    builder.recolour(builder.things(check_whole("num_dists", num_dists, 0, MOST_THINGS)), "grey")
    builder.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_ball(builder: LevelBuilder, num_dists: int = 7) -> Instruction:
    """Lay out one room with a red ball and ``num_dists`` other objects; the task is to go to the ball."""
    builder.place_agent()
    ball = builder.thing(builder.room(0, 0), "ball", "red")
    builder.things(check_whole("num_dists", num_dists, 0, MOST_THINGS))
    builder.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=("room_size", *ONE_ROOM))
def go_to_red_ball_no_dists(builder: LevelBuilder) -> Instruction:
    """Lay out one room with only the red ball; the task is to go to it."""
    builder.place_agent()
    ball = builder.thing(builder.room(0, 0), "ball", "red")
    builder.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_obj(builder: LevelBuilder) -> Instruction:
    """Lay out one room with one object; the task is to go to it."""
    builder.place_agent()
    return GoTo(builder.things(1, different=True).first.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_local(builder: LevelBuilder, num_dists: int = 8) -> Instruction:
    """Lay out one room with ``num_dists`` objects; the task is to go to one of them."""
    builder.place_agent()
    things = builder.things(check_whole("num_dists", num_dists, 1, MOST_THINGS))
    builder.require_reachable()
    return GoTo(builder.choice(things).thing)


@level()
def go_to(builder: LevelBuilder, num_dists: int = 18, doors_open: bool = False) -> Instruction:
    """Lay out several rooms with ``num_dists`` objects in all; the task is to go to one of them.

    With ``doors_open``, all doors are open at the start.
    """
    builder.place_agent()
    builder.connect_all()
    things = builder.things(check_whole("num_dists", num_dists, 1, MOST_THINGS))
    builder.require_reachable()
    thing = builder.choice(things)
    if check_bool("doors_open", doors_open):
        builder.open_all_doors()
    return GoTo(thing.thing)


@level()
def go_to_imp_unlock(builder: LevelBuilder, sound: bool = False) -> Instruction:
    """Lay out several rooms; the task is to go to an object in a locked room.

    With ``sound``, the key is in another room, and the locked room has no other objects.
    """
    locked = builder.any_room()
    door = builder.door(locked, locked=True)
    elsewhere = builder.any_room()
    if check_bool("sound", sound):
        builder.require_other(elsewhere, locked)
    builder.thing(elsewhere, "key", door.colour)
    builder.connect_all()
    for room in builder.rooms():
        builder.things(2, room, but_not_in=locked if sound else None)
    builder.place_agent(not_in=locked)
    builder.require_reachable()
    return GoTo(builder.things(1, locked).first.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_blue_ball(builder: LevelBuilder, num_dists: int = 7) -> Instruction:
    """Lay out one room with ``num_dists`` objects and a red or a blue ball; the task is to go to this ball."""
    builder.place_agent()
    things = builder.things(check_whole("num_dists", num_dists, 0, MOST_THINGS))
    for colour in ("red", "blue"):
        builder.require_no(things, "ball", colour)
    ball = builder.thing(builder.room(0, 0), "ball", builder.choice(("red", "blue")))
    builder.require_reachable()
    return GoTo(ball.thing)


@level(room=7, fixed=("room_size",))
def go_to_door(builder: LevelBuilder) -> Instruction:
    """Lay out the middle room with four doors; the task is to go to one of them."""
    middle = builder.room(1, 1)
    doors = builder.four_doors(middle)
    builder.place_agent(middle)
    return GoTo(ObjectDescription("door", builder.choice(doors).colour))


@level(fixed=("room_size",))
def go_to_obj_door(builder: LevelBuilder) -> Instruction:
    """Lay out the middle room with objects and doors; the task is to go to one of them."""
    middle = builder.room(1, 1)
    builder.place_agent(middle)
    things = builder.things(8, middle) + builder.four_doors(middle)
    builder.require_reachable()
    return GoTo(builder.choice(things).thing)


ALL = ("room_size", "num_rows", "num_cols")  # all sizes are fixed


@level()
def open_(builder: LevelBuilder) -> Instruction:
    """Lay out several rooms; the task is to open one of the doors."""
    builder.place_agent()
    builder.connect_all()
    builder.things(18)
    builder.require_reachable()
    return Open(builder.any_door().thing)


@level(room=5, columns=2, lines=1, fixed=ALL)
def open_red_door(builder: LevelBuilder) -> Instruction:
    """Lay out two rooms with a red door between them; the task is to open it."""
    left = builder.room(0, 0)
    builder.door(left, "right", colour="red", locked=False)
    builder.place_agent(left)
    return Open(ObjectDescription("door", "red"))


@level()
def open_door(builder: LevelBuilder, debug: bool = False, select_by: str | None = None) -> Instruction | None:
    """Lay out the middle room with four doors; the task is to open one, given by its colour or place.

    ``select_by`` is "color" or "loc", or None to draw one of them. With ``debug``, opening another door is a failure.
    """
    strict = check_bool("debug", debug)
    select_by = check_one_of("select_by", select_by, ("color", "loc", None))
    middle = builder.room(1, 1)
    colours = builder.colours(4)
    walls = ("right", "down", "left", "up")
    doors = [
        builder.door(middle, wall, colour=colour, locked=False) for wall, colour in zip(walls, colours, strict=True)
    ]
    by_colour = Open(doors[0].thing, strict)

    def by_place() -> Open:
        return Open(ObjectDescription("door", place=builder.choice(PLACES)), strict)

    if select_by is not None:
        chosen: Instruction | None = by_place() if select_by == "loc" else by_colour
    else:
        builder.finish(builder.one_of(by_colour, by_place))
        chosen = None
    builder.place_agent(middle)
    return chosen


@level(room=6, steps_by_area=20, fixed=("room_size",))
def open_two_doors(
    builder: LevelBuilder, first_color: str | None = None, second_color: str | None = None, strict: bool = False
) -> Instruction:
    """Lay out the middle room; the task is to open its left door, then its right door.

    The colours of the doors are drawn unless given. With ``strict``, opening the wrong door first is a failure.
    """
    first_drawn, second_drawn = builder.colours(2)
    first = first_drawn if check_one_of("first_color", first_color, (*COLOURS, None)) is None else first_color
    second = second_drawn if check_one_of("second_color", second_color, (*COLOURS, None)) is None else second_color
    middle = builder.room(1, 1)
    left = builder.door(middle, "left", colour=first, locked=False)
    right = builder.door(middle, "right", colour=second, locked=False)
    builder.place_agent(middle)
    return Before(Open(left.thing, check_bool("strict", strict)), Open(right.thing))


@level(room=6, steps_by_area=20, fixed=("room_size",))
def open_doors_order(builder: LevelBuilder, num_doors: int, debug: bool = False) -> AnyOf:
    """Lay out the middle room with ``num_doors`` doors; the task is to open one, or two in order.

    With ``debug``, opening the wrong door is a failure.
    """
    strict = check_bool("debug", debug)
    middle = builder.room(1, 1)
    colours = builder.colours(check_whole("num_doors", num_doors, 2, 4))
    doors = [builder.door(middle, colour=colour, locked=False) for colour in colours]
    builder.place_agent(middle)
    first, second = (Open(door.thing, strict) for door in builder.two_of(doors))
    return builder.one_of(first, Before(first, second), After(first, second))


@level()
def unlock(builder: LevelBuilder, sound: bool = False) -> Instruction:
    """Lay out several rooms, one of which is locked; the task is to open its door.

    With ``sound``, the key is in another room, and the locked room has no objects.
    """
    locked = builder.any_room()
    door = builder.door(locked, locked=True)
    elsewhere = builder.any_room()
    if check_bool("sound", sound):
        builder.require_other(elsewhere, locked)
    builder.thing(elsewhere, "key", door.colour)
    builder.connect_all(without=door.colour)
    for room in builder.rooms():
        builder.things(3, room, but_not_in=locked if sound else None)
    builder.place_agent(not_in=locked)
    builder.require_reachable()
    return Open(door.thing)


@level()
def unlock_local(builder: LevelBuilder, distractors: bool = False) -> Instruction:
    """Lay out the middle room with a locked door and its key; the task is to open the door.

    With ``distractors``, three other objects lie in the room.
    """
    middle = builder.room(1, 1)
    door = builder.door(middle, locked=True)
    builder.thing(middle, "key", door.colour)
    if check_bool("distractors", distractors):
        builder.things(3, middle, different=True)
    builder.place_agent(middle)
    return Open(ObjectDescription("door"))


@level()
def key_in_box(builder: LevelBuilder) -> Instruction:
    """Lay out the middle room with a locked door and its key in a box; the task is to open the door."""
    middle = builder.room(1, 1)
    door = builder.door(middle, locked=True)
    builder.boxed_key(middle, door.colour)
    builder.place_agent(middle)
    return Open(ObjectDescription("door"))


@level(room=6, columns=2, lines=1, fixed=ALL)
def unlock_pickup(builder: LevelBuilder, distractors: bool = False) -> Instruction:
    """Lay out two rooms; the task is to pick up a box behind a locked door.

    With ``distractors``, four other objects lie in the rooms.
    """
    box = builder.thing(builder.room(1, 0), "box")
    left = builder.room(0, 0)
    door = builder.door(left, "right", locked=True)
    builder.thing(left, "key", door.colour)
    if check_bool("distractors", distractors):
        builder.things(4, different=True)
    builder.place_agent(left)
    return Pickup(box.thing)


@level(room=6, columns=2, lines=1, steps_by_area=16, fixed=ALL)
def blocked_unlock_pickup(builder: LevelBuilder) -> Instruction:
    """Lay out two rooms; the task is to pick up a box behind a locked door that a ball blocks."""
    builder.thing(builder.room(1, 0), "box")
    left = builder.room(0, 0)
    door = builder.door(left, "right", locked=True)
    builder.block(door)
    builder.thing(left, "key", door.colour)
    builder.place_agent(left)
    return Pickup(ObjectDescription("box"))


@level(room=6, columns=3, lines=1, steps_by_area=30, fixed=ALL)
def unlock_to_unlock(builder: LevelBuilder) -> Instruction:
    """Lay out three rooms; a key opens the door to another key, which opens the door to a ball to pick up."""
    first, second = builder.colours(2)
    left, middle, right = (builder.room(column, 0) for column in range(3))
    builder.door(left, "right", colour=first, locked=True)
    builder.thing(right, "key", first)
    builder.door(middle, "right", colour=second, locked=True)
    builder.thing(middle, "key", second)
    builder.thing(left, "ball")
    builder.place_agent(middle)
    return Pickup(ObjectDescription("ball"))


@level()
def pickup(builder: LevelBuilder) -> Instruction:
    """Lay out several rooms with objects; the task is to pick up one of them."""
    builder.place_agent()
    builder.connect_all()
    things = builder.things(18)
    builder.require_reachable()
    return Pickup(builder.choice(things).thing)


@level()
def unblock_pickup(builder: LevelBuilder) -> Instruction:
    """Lay out several rooms in which some objects block the way; the task is to pick up one of the objects."""
    builder.place_agent()
    builder.connect_all()
    things = builder.things(20)
    builder.require_reachable(False)
    return Pickup(builder.choice(things).thing)


@level(room=7, columns=1, lines=1, fixed=("room_size", *ONE_ROOM))
def pickup_dist(builder: LevelBuilder, debug: bool = False) -> AnyOf:
    """Lay out one room with five objects; the task is to pick up one, given by its kind, its colour or both.

    With ``debug``, picking up another object is a failure.
    """
    strict = check_bool("debug", debug)
    things = builder.things(5, different=True)
    builder.place_agent(builder.room(0, 0))
    thing = builder.choice(things)
    descriptions = (ObjectDescription(thing.kind), ObjectDescription(None, thing.colour), thing.thing)
    return builder.one_of(*(Pickup(description, strict) for description in descriptions))


@level(room=6, steps_by_area=8, fixed=("room_size",))
def pickup_above(builder: LevelBuilder) -> Instruction:
    """Lay out several rooms; the task is to pick up an object in the room above the agent's."""
    thing = builder.thing(builder.room(1, 0))
    middle = builder.room(1, 1)
    builder.door(middle, "up", locked=False)
    builder.place_agent(middle)
    builder.connect_all()
    return Pickup(thing.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def one_room(builder: LevelBuilder) -> Instruction:
    """Lay out one room with a ball; the task is to pick it up."""
    builder.thing(builder.room(0, 0), "ball")
    builder.place_agent()
    return Pickup(ObjectDescription("ball"))


@level(room=5, steps_by_area=20)
def find_obj(builder: LevelBuilder) -> Instruction:
    """Lay out several rooms with an object in one of them; the task is to pick it up."""
    if builder.columns != builder.lines:
        raise WorldError(
            f"find_obj has {builder.columns} columns and {builder.lines} rows of rooms; use the same number of each"
        )
    column = builder.integer(0, builder.lines)
    thing = builder.thing(builder.room(column, builder.integer(0, builder.columns)))
    builder.place_agent(builder.room(1, 1))
    builder.connect_all()
    return Pickup(ObjectDescription(thing.kind))


@level(room=6, steps_by_area=30)
def key_corridor(builder: LevelBuilder, obj_type: str = "ball") -> Instruction:
    """Lay out a corridor between rooms; the task is to pick up an object of kind ``obj_type`` behind a locked door.

    The key is in a room on the other side of the corridor.
    """
    for line in range(1, builder.lines):
        builder.remove_wall(builder.room(1, line), "up")
    locked = builder.room(2, builder.integer(0, builder.lines))
    door = builder.door(locked, "left", locked=True)
    thing = builder.thing(locked, check_one_of("obj_type", obj_type, ("key", "ball", "box")))
    builder.thing(builder.room(0, builder.integer(0, builder.lines)), "key", door.colour)
    builder.place_agent(builder.room(1, builder.lines // 2))
    builder.connect_all()
    return Pickup(ObjectDescription(thing.kind))


@level(room=7, fixed=("room_size",))
def action_obj_door(builder: LevelBuilder) -> AnyOf:
    """Lay out the middle room; the task is to go to an object or a door, pick the object up or open the door."""
    middle = builder.room(1, 1)
    things = builder.things(5, middle, different=True) + builder.four_doors(middle, locked=False)
    builder.place_agent(middle)
    thing = builder.choice(things).thing
    return builder.one_of(GoTo(thing), Use(thing))


@level(columns=1, lines=1, fixed=ONE_ROOM)
def put_next_local(builder: LevelBuilder, num_objs: int = 8) -> Instruction:
    """Lay out one room with ``num_objs`` different objects; the task is to put one of them next to another."""
    builder.place_agent()
    things = builder.things(check_whole("num_objs", num_objs, 2, 18), different=True)
    builder.require_reachable()
    moved, fixed = builder.two_of(things)
    return PutNext(moved.thing, fixed.thing)


@level(room=5, columns=2, lines=1, steps_by_area=8, fixed=ONE_ROOM)
def put_next(builder: LevelBuilder, objs_per_room: int, start_carrying: bool = False) -> Instruction:
    """Lay out two rooms without a wall between them; the task is to put an object next to one of the other room.

    Each room has ``objs_per_room`` objects. With ``start_carrying``, the agent carries the object from the start.
    """
    left = builder.room(0, 0)
    right = builder.room(1, 0)
    count = check_whole("objs_per_room", objs_per_room, 1, 9)
    builder.place_agent(left)
    left_things = builder.things(count, left, different=True)
    right_things = builder.things(count, right, different=True)
    builder.remove_wall(left, "right")
    moved, fixed = builder.maybe_swap(builder.choice(left_things), builder.choice(right_things))
    if check_bool("start_carrying", start_carrying):
        builder.give(moved)
    return PutNext(moved.thing, fixed.thing)


@level(room=5, columns=2, lines=1, steps_by_area=16, fixed=ONE_ROOM)
def move_two_across(builder: LevelBuilder, objs_per_room: int) -> Instruction:
    """Lay out two rooms without a wall between them; the task is to put an object of each next to one of the other.

    Each room has ``objs_per_room`` objects.
    """
    left = builder.room(0, 0)
    right = builder.room(1, 0)
    count = check_whole("objs_per_room", objs_per_room, 2, 9)
    builder.place_agent(left)
    left_things = builder.things(count, left, different=True)
    right_things = builder.things(count, right, different=True)
    builder.remove_wall(left, "right")
    first, fourth = builder.two_of(left_things)
    second, third = builder.two_of(right_things)
    return Before(PutNext(first.thing, second.thing), PutNext(third.thing, fourth.thing))


@level()
def level_gen(
    builder: LevelBuilder,
    num_dists: int = 18,
    locked_room_prob: float = 0.5,
    locations: bool = True,
    unblocking: bool = True,
    implicit_unlock: bool = True,
    action_kinds: Sequence[str] = ("goto", "pickup", "open", "putnext"),
    instr_kinds: Sequence[str] = ("action", "and", "seq"),
) -> None:
    """Lay out several rooms, one of which may be locked; the task is any random instruction.

    Args:
        builder: the rooms.
        num_dists: the number of objects in all rooms, apart from the key of the locked room.
        locked_room_prob: the probability that a room is locked.
        locations: whether objects may be described by their place.
        unblocking: whether objects may block the way, and no instruction is about the key of the locked room.
        implicit_unlock: whether an instruction may require the locked room to be opened without naming its door.
        action_kinds: the verbs of the instruction.
        instr_kinds: the forms of the instruction: one clause, two in any order, or two parts in a given order.
    """
    for name, value in (("locations", locations), ("unblocking", unblocking), ("implicit_unlock", implicit_unlock)):
        check_bool(name, value)
    locked = builder.maybe_locked_room(locked_room_prob)
    builder.connect_all()
    builder.things(check_whole("num_dists", num_dists, 0, MOST_THINGS))
    builder.place_agent(not_in=locked)
    if not unblocking:
        builder.require_reachable()
    builder.keys_matter = unblocking
    builder.invent(action_kinds, instr_kinds, places=locations, implicit_unlock=implicit_unlock, locked_room=locked)


LEVELS: Mapping[str, Level] = MappingProxyType(
    {
        "level:" + name.strip("_"): level_function
        for name, level_function in list(globals().items())
        if isinstance(level_function, Level)
    }
)
