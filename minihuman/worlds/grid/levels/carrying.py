"""Levels about picking things up and putting them next to others. Options are named as Minigrid names them."""

from minihuman.errors import WorldError
from minihuman.worlds.grid.instructions.language import Before, GoTo, Instruction, Pickup, PutNext, Thing
from minihuman.worlds.grid.levels.going import ONE_ROOM
from minihuman.worlds.grid.levels.level import level
from minihuman.worlds.grid.levels.tracing import AnyOf, House, Use
from minihuman.worlds.options import one_of, whole


@level()
def pickup(house: House) -> Instruction:
    """A house, one of its things."""
    house.place_agent()
    house.connect_all()
    things = house.things(18)
    house.require_reachable()
    return Pickup(house.choice(things).thing)


@level()
def unblock_pickup(house: House) -> Instruction:
    """A house where some things bar the way."""
    house.place_agent()
    house.connect_all()
    things = house.things(20)
    house.require_reachable(False)
    return Pickup(house.choice(things).thing)


@level(room=7, columns=1, lines=1, fixed=("room_size", *ONE_ROOM))
def pickup_dist(house: House, debug: bool = False) -> AnyOf:
    """One room, five things, one by its kind, its colour or both; ``debug``: another one is failure."""
    strict = one_of("debug", debug, (True, False))
    things = house.things(5, different=True)
    house.place_agent(house.room(0, 0))
    thing = house.choice(things)
    said = (Thing(thing.kind), Thing(None, thing.colour), thing.thing)
    return house.one_of(*(Pickup(each, strict) for each in said))


@level(room=6, steps_by_area=8, fixed=("room_size",))
def pickup_above(house: House) -> Instruction:
    """Something in the room above."""
    thing = house.thing(house.room(1, 0))
    middle = house.room(1, 1)
    house.door(middle, "up", locked=False)
    house.place_agent(middle)
    house.connect_all()
    return Pickup(thing.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def one_room(house: House) -> Instruction:
    """One room and a ball."""
    house.thing(house.room(0, 0), "ball")
    house.place_agent()
    return Pickup(Thing("ball"))


@level(room=5, steps_by_area=20)
def find_obj(house: House) -> Instruction:
    """Something in a drawn room."""
    if house.columns != house.lines:
        raise WorldError(
            f"find_obj has {house.columns} columns of rooms and {house.lines} lines; give it as many of both"
        )
    column = house.integer(0, house.lines)
    thing = house.thing(house.room(column, house.integer(0, house.columns)))
    house.place_agent(house.room(1, 1))
    house.connect_all()
    return Pickup(Thing(thing.kind))


@level(room=6, steps_by_area=30)
def key_corridor(house: House, obj_type: str = "ball") -> Instruction:
    """A corridor between rooms: something behind a locked door, its key on the other side."""
    for line in range(1, house.lines):
        house.remove_wall(house.room(1, line), "up")
    locked = house.room(2, house.integer(0, house.lines))
    door = house.door(locked, "left", locked=True)
    thing = house.thing(locked, one_of("obj_type", obj_type, ("key", "ball", "box")))
    house.thing(house.room(0, house.integer(0, house.lines)), "key", door.colour)
    house.place_agent(house.room(1, house.lines // 2))
    house.connect_all()
    return Pickup(Thing(thing.kind))


@level(room=7, fixed=("room_size",))
def action_obj_door(house: House) -> AnyOf:
    """The middle room: go to a thing or a door, or pick it up or open it."""
    middle = house.room(1, 1)
    things = house.things(5, middle, different=True) + house.four_doors(middle, locked=False)
    house.place_agent(middle)
    thing = house.choice(things).thing
    return house.one_of(GoTo(thing), Use(thing))


@level(columns=1, lines=1, fixed=ONE_ROOM)
def put_next_local(house: House, num_objs: int = 8) -> Instruction:
    """One room, different things, one to be put next to another."""
    house.place_agent()
    things = house.things(whole("num_objs", num_objs, 2, 18), different=True)
    house.require_reachable()
    one, other = house.two_of(things)
    return PutNext(one.thing, other.thing)


@level(room=5, columns=2, lines=1, steps_by_area=8, fixed=ONE_ROOM)
def put_next(house: House, objs_per_room: int, start_carrying: bool = False) -> Instruction:
    """Two rooms without a wall between them, a thing of one to be put next to one of the other."""
    left, right = house.room(0, 0), house.room(1, 0)
    count = whole("objs_per_room", objs_per_room, 1, 9)
    house.place_agent(left)
    one = house.things(count, left, different=True)
    other = house.things(count, right, different=True)
    house.remove_wall(left, "right")
    moved, fixed = house.maybe_swap(house.choice(one), house.choice(other))
    if one_of("start_carrying", start_carrying, (True, False)):
        house.give(moved)
    return PutNext(moved.thing, fixed.thing)


@level(room=5, columns=2, lines=1, steps_by_area=16, fixed=ONE_ROOM)
def move_two_across(house: House, objs_per_room: int) -> Instruction:
    """Two rooms without a wall between them, a thing of each to be put next to one of the other."""
    left, right = house.room(0, 0), house.room(1, 0)
    count = whole("objs_per_room", objs_per_room, 2, 9)
    house.place_agent(left)
    here = house.things(count, left, different=True)
    there = house.things(count, right, different=True)
    house.remove_wall(left, "right")
    one, four = house.two_of(here)
    two, three = house.two_of(there)
    return Before(PutNext(one.thing, two.thing), PutNext(three.thing, four.thing))
