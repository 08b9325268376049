"""Levels about going to things. Options are named as Minigrid names them."""

from minihuman.worlds.grid.instructions.language import GoTo, Instruction, Thing
from minihuman.worlds.grid.levels.level import level
from minihuman.worlds.grid.levels.tracing import House
from minihuman.worlds.options import one_of, whole

ONE_ROOM = ("num_rows", "num_cols")
MOST_THINGS = 1000


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_ball_grey(house: House, num_dists: int = 7) -> Instruction:
    """One room, the red ball and other things, all grey."""
    house.place_agent()
    ball = house.thing(house.room(0, 0), "ball", "red")
    house.recolour(house.things(whole("num_dists", num_dists, 0, MOST_THINGS)), "grey")
    house.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_ball(house: House, num_dists: int = 7) -> Instruction:
    """One room, a red ball and other things."""
    house.place_agent()
    ball = house.thing(house.room(0, 0), "ball", "red")
    house.things(whole("num_dists", num_dists, 0, MOST_THINGS))
    house.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=("room_size", *ONE_ROOM))
def go_to_red_ball_no_dists(house: House) -> Instruction:
    """One room and the red ball."""
    house.place_agent()
    ball = house.thing(house.room(0, 0), "ball", "red")
    house.require_reachable()
    return GoTo(ball.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_obj(house: House) -> Instruction:
    """One room and one thing."""
    house.place_agent()
    return GoTo(house.things(1, different=True).first.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_local(house: House, num_dists: int = 8) -> Instruction:
    """One room, one of its things."""
    house.place_agent()
    things = house.things(whole("num_dists", num_dists, 1, MOST_THINGS))
    house.require_reachable()
    return GoTo(house.choice(things).thing)


@level()
def go_to(house: House, num_dists: int = 18, doors_open: bool = False) -> Instruction:
    """A house, one of its things."""
    house.place_agent()
    house.connect_all()
    things = house.things(whole("num_dists", num_dists, 1, MOST_THINGS))
    house.require_reachable()
    thing = house.choice(things)
    if one_of("doors_open", doors_open, (True, False)):
        house.open_all_doors()
    return GoTo(thing.thing)


@level()
def go_to_imp_unlock(house: House, sound: bool = False) -> Instruction:
    """A house, a thing in a locked room; ``sound``: its key is elsewhere, and nothing else is in that room."""
    locked = house.any_room()
    door = house.door(locked, locked=True)
    elsewhere = house.any_room()
    if one_of("sound", sound, (True, False)):
        house.require_other(elsewhere, locked)
    house.thing(elsewhere, "key", door.colour)
    house.connect_all()
    for room in house.rooms():
        house.things(2, room, but_not_in=locked if sound else None)
    house.place_agent(not_in=locked)
    house.require_reachable()
    return GoTo(house.things(1, locked).first.thing)


@level(columns=1, lines=1, fixed=ONE_ROOM)
def go_to_red_blue_ball(house: House, num_dists: int = 7) -> Instruction:
    """One room, the red ball or the blue one."""
    house.place_agent()
    things = house.things(whole("num_dists", num_dists, 0, MOST_THINGS))
    for colour in ("red", "blue"):
        house.require_no(things, "ball", colour)
    ball = house.thing(house.room(0, 0), "ball", house.choice(("red", "blue")))
    house.require_reachable()
    return GoTo(ball.thing)


@level(room=7, fixed=("room_size",))
def go_to_door(house: House) -> Instruction:
    """The middle room, one of its four doors."""
    middle = house.room(1, 1)
    doors = house.four_doors(middle)
    house.place_agent(middle)
    return GoTo(Thing("door", house.choice(doors).colour))


@level(fixed=("room_size",))
def go_to_obj_door(house: House) -> Instruction:
    """The middle room, a thing or a door."""
    middle = house.room(1, 1)
    house.place_agent(middle)
    things = house.things(8, middle) + house.four_doors(middle)
    house.require_reachable()
    return GoTo(house.choice(things).thing)
