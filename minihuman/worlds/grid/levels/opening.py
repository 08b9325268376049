"""Levels about opening doors and unlocking them. Options are named as Minigrid names them."""

from minihuman.worlds.grid.core.cells import COLOURS
from minihuman.worlds.grid.instructions.language import PLACES, After, Before, Instruction, Open, Pickup, Thing
from minihuman.worlds.grid.levels.level import level
from minihuman.worlds.grid.levels.tracing import AnyOf, House
from minihuman.worlds.options import one_of, whole

YES_NO = (True, False)
ALL = ("room_size", "num_rows", "num_cols")


@level()
def open_(house: House) -> Instruction:
    """A house, one of its doors."""
    house.place_agent()
    house.connect_all()
    house.things(18)
    house.require_reachable()
    return Open(house.any_door().thing)


@level(room=5, columns=2, lines=1, fixed=ALL)
def open_red_door(house: House) -> Instruction:
    """Two rooms, a red door."""
    left = house.room(0, 0)
    house.door(left, "right", colour="red", locked=False)
    house.place_agent(left)
    return Open(Thing("door", "red"))


@level()
def open_door(house: House, debug: bool = False, select_by: str | None = None) -> Instruction | None:
    """The middle room, one of four doors, by colour or by place; ``debug``: another one is failure."""
    strict = one_of("debug", debug, YES_NO)
    select_by = one_of("select_by", select_by, ("color", "loc", None))
    middle = house.room(1, 1)
    colours = house.colours(4)
    walls = ("right", "down", "left", "up")
    doors = [house.door(middle, wall, colour=each, locked=False) for wall, each in zip(walls, colours, strict=True)]
    by_colour = Open(doors[0].thing, strict)

    def by_place() -> Open:
        return Open(Thing("door", place=house.choice(PLACES)), strict)

    if select_by is not None:
        chosen: Instruction | None = by_place() if select_by == "loc" else by_colour
    else:
        house.finish(house.one_of(by_colour, by_place))
        chosen = None
    house.place_agent(middle)
    return chosen


@level(room=6, steps_by_area=20, fixed=("room_size",))
def open_two_doors(
    house: House, first_color: str | None = None, second_color: str | None = None, strict: bool = False
) -> Instruction:
    """The middle room, its left and its right door in order; ``strict``: the wrong one first is failure."""
    drawn = house.colours(2)
    first, second = (
        each if one_of(name, given, (*COLOURS, None)) is None else given
        for name, given, each in zip(("first_color", "second_color"), (first_color, second_color), drawn, strict=True)
    )
    middle = house.room(1, 1)
    left = house.door(middle, "left", colour=first, locked=False)
    right = house.door(middle, "right", colour=second, locked=False)
    house.place_agent(middle)
    return Before(Open(left.thing, one_of("strict", strict, YES_NO)), Open(right.thing))


@level(room=6, steps_by_area=20, fixed=("room_size",))
def open_doors_order(house: House, num_doors: int, debug: bool = False) -> AnyOf:
    """The middle room, one door or two in order; ``debug``: the wrong one is failure."""
    strict = one_of("debug", debug, YES_NO)
    middle = house.room(1, 1)
    colours = house.colours(whole("num_doors", num_doors, 2, 4))
    doors = [house.door(middle, colour=colour, locked=False) for colour in colours]
    house.place_agent(middle)
    one, two = (Open(door.thing, strict) for door in house.two_of(doors))
    return house.one_of(one, Before(one, two), After(one, two))


@level()
def unlock(house: House, sound: bool = False) -> Instruction:
    """A house with a locked room; ``sound``: its key is elsewhere, and nothing else is in that room."""
    locked = house.any_room()
    door = house.door(locked, locked=True)
    elsewhere = house.any_room()
    if one_of("sound", sound, YES_NO):
        house.require_other(elsewhere, locked)
    house.thing(elsewhere, "key", door.colour)
    house.connect_all(without=door.colour)
    for room in house.rooms():
        house.things(3, room, but_not_in=locked if sound else None)
    house.place_agent(not_in=locked)
    house.require_reachable()
    return Open(door.thing)


@level()
def unlock_local(house: House, distractors: bool = False) -> Instruction:
    """The middle room, a locked door and its key."""
    middle = house.room(1, 1)
    door = house.door(middle, locked=True)
    house.thing(middle, "key", door.colour)
    if one_of("distractors", distractors, YES_NO):
        house.things(3, middle, different=True)
    house.place_agent(middle)
    return Open(Thing("door"))


@level()
def key_in_box(house: House) -> Instruction:
    """The middle room, a locked door, its key in a box."""
    middle = house.room(1, 1)
    door = house.door(middle, locked=True)
    house.boxed_key(middle, door.colour)
    house.place_agent(middle)
    return Open(Thing("door"))


@level(room=6, columns=2, lines=1, fixed=ALL)
def unlock_pickup(house: House, distractors: bool = False) -> Instruction:
    """Two rooms, a box behind a locked door."""
    box = house.thing(house.room(1, 0), "box")
    left = house.room(0, 0)
    door = house.door(left, "right", locked=True)
    house.thing(left, "key", door.colour)
    if one_of("distractors", distractors, YES_NO):
        house.things(4, different=True)
    house.place_agent(left)
    return Pickup(box.thing)


@level(room=6, columns=2, lines=1, steps_by_area=16, fixed=ALL)
def blocked_unlock_pickup(house: House) -> Instruction:
    """Two rooms, a box behind a locked door behind a ball."""
    house.thing(house.room(1, 0), "box")
    left = house.room(0, 0)
    door = house.door(left, "right", locked=True)
    house.block(door)
    house.thing(left, "key", door.colour)
    house.place_agent(left)
    return Pickup(Thing("box"))


@level(room=6, columns=3, lines=1, steps_by_area=30, fixed=ALL)
def unlock_to_unlock(house: House) -> Instruction:
    """Three rooms: a key that opens the door to the key that opens the door to the ball."""
    first, second = house.colours(2)
    left, middle, right = (house.room(column, 0) for column in range(3))
    house.door(left, "right", colour=first, locked=True)
    house.thing(right, "key", first)
    house.door(middle, "right", colour=second, locked=True)
    house.thing(middle, "key", second)
    house.thing(left, "ball")
    house.place_agent(middle)
    return Pickup(Thing("ball"))
