"""A lab's own kinds of things: what one may do with them, and how they look."""

import copy
import pickle

import gymnasium
import numpy as np
import pytest

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.rules import ACTION_NAMES
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import from_text
from minihuman.worlds.grid.object_kinds import BlockShape, MeshShape, ObjectKind, box, goal, key
from minihuman.worlds.grid.planner import plan
from minihuman.worlds.grid.wrappers import OneHot, Symbolic
from minihuman.worlds.inside.env import GridFromInside

LEFT, RIGHT, FORWARD, PICKUP, DROP, TOGGLE, _ = range(len(ACTION_NAMES))

MUD = ObjectKind("mud", "M", stepped_on=True, inside=BlockShape((0.9, 0.05, 0.9)))
GLASS = ObjectKind("glass", "S")
BUSH = ObjectKind("bush", "U", stepped_on=True, hides=True, inside=MeshShape("tree", 0.8))
APPLE = ObjectKind("apple", "P", carried=True, inside=MeshShape("ball", 0.3))
GATE = ObjectKind("gate", "T", hides=True, opens=True, inside=BlockShape((0.1, 1.0, 1.0)))


class Lane(GridWorld):
    """One lane to the right, with a thing of every kind that a test asks for."""

    kinds = (MUD, GLASS, BUSH, APPLE, GATE)

    def __init__(self, *things, **options):
        self.things = things
        super().__init__(width=9, height=3, max_steps=100, mission="go right", **options)

    def layout(self, grid):
        grid.wall_rect()
        for x, thing in enumerate(self.things, 2):
            if thing is not None:
                grid.put(thing, x, 1)
        grid.put(goal(), 7, 1)
        grid.put_agent(1, 1, 0)


def lane(*things, **options):
    world = Lane(*things, **options)
    world.reset(seed=0)
    return world


def go(world, *actions):
    for action in actions:
        world.step(action)
    return world.state.position[0]


def sees_the_goal(world):
    return bool((world.observation()["image"][..., 0] == 8).any())


def test_what_may_be_stepped_on_lets_pass_and_what_may_not_does_not():
    assert go(lane(MUD("yellow")), FORWARD, FORWARD) == 3
    assert go(lane(GLASS("blue")), FORWARD, FORWARD) == 1


def test_what_hides_is_not_seen_through():
    assert sees_the_goal(lane(GLASS("blue")))
    assert not sees_the_goal(lane(BUSH("green")))
    assert sees_the_goal(lane(BUSH("green"), see_through_walls=True))


def test_what_is_carried_is_picked_up_put_down_and_lies_in_boxes():
    world = lane(APPLE("red"))
    assert go(world, PICKUP, FORWARD) == 2
    assert world.observation()["image"][3, 6].tolist() == [14, 0, 0]  # in hand: the fourth own kind, red
    assert go(world, DROP, FORWARD) == 2
    world = lane(box("grey", contains=APPLE("red")))
    go(world, TOGGLE, PICKUP)
    assert world.observation()["image"][3, 6, 0] == 14


def test_what_opens_bars_the_way_until_it_is_open():
    world = lane(GATE("red"))
    assert not sees_the_goal(world)
    assert go(world, FORWARD) == 1
    go(world, TOGGLE)
    assert sees_the_goal(world)
    assert go(world, FORWARD, FORWARD) == 3


def test_what_is_locked_opens_to_the_key_of_its_colour():
    world = lane(key("red"), GATE("red", locked=True))
    assert go(world, PICKUP, FORWARD, FORWARD) == 2
    assert go(world, TOGGLE, FORWARD) == 3
    other = lane(key("blue"), GATE("red", locked=True))
    assert go(other, PICKUP, FORWARD, TOGGLE, FORWARD) == 2


@pytest.mark.parametrize(
    ("things", "steps"), [((MUD("red"), None), 6), ((GATE("red"),), 7), ((key("red"), GATE("red", locked=True)), 8)]
)
def test_the_planner_knows_what_own_things_do(things, steps):
    world = lane(*things)
    actions = plan(world.state)
    assert len(actions) == steps
    for action in actions:
        _, reward, terminated, _, _ = world.step(action)
    assert terminated
    assert reward > 0
    assert plan(lane(GLASS("blue")).state) is None


def test_a_diagram_and_its_world_are_one():
    diagram = "WWWWWWWWWWWW\nWW>>MyUgtrWW\nWWSbPpTrGgWW\nWWWWWWWWWWWW"

    class Drawn(GridWorld):
        kinds = Lane.kinds

        def __init__(self):
            super().__init__(width=6, height=4, max_steps=9)

        def layout(self, grid):
            from_text(diagram, grid)

    world = Drawn()
    world.reset(seed=0)
    assert world.text() == diagram
    assert [thing.name for thing in world.map().things][:3] == ["blue glass", "yellow mud", "purple apple"]


@pytest.mark.parametrize("view", ["partial", "full"])
@pytest.mark.parametrize("palette", ["classic", "colour-safe"])
def test_every_kind_and_state_looks_different_from_above(view, palette):
    striped = ObjectKind(
        "stripe", "Z", draw=lambda canvas, colour, state: canvas.fill(canvas.box(0, 0.4, 1, 0.6), colour)
    )

    class Striped(Lane):
        kinds = (striped,)

    things = (None, GATE("red"), GATE("red", is_open=True), MUD("blue"))
    pictures = [lane(thing).picture(view=view, palette=palette).tobytes() for thing in things]
    striped_world = Striped(striped("red"))
    striped_world.reset(seed=0)
    pictures.append(striped_world.picture(view=view, palette=palette).tobytes())
    assert len(set(pictures)) == 5


@pytest.mark.parametrize("thing", [MUD("red"), BUSH("red"), APPLE("red"), GATE("red")])
def test_own_things_are_seen_from_inside(thing):
    empty, with_thing = (GridFromInside(lane(*(things), see_through_walls=True)) for things in ((), (None, thing)))
    assert not np.array_equal(empty.picture(), with_thing.picture())


def test_an_own_thing_in_hand_is_seen_from_inside():
    world = GridFromInside(lane(APPLE("red")))
    before = world.picture()
    world.step(PICKUP)
    world.step(LEFT)
    other = GridFromInside(lane(None))
    other.step(LEFT)
    assert not np.array_equal(world.picture(), other.picture())
    assert not np.array_equal(world.picture(), before)


def test_a_world_with_own_things_is_saved_copied_and_hashed_with_them():
    world = lane(GATE("red"), APPLE("blue"))
    saved, before = world.save(), world.state_hash()
    for other in (copy.deepcopy(world), pickle.loads(pickle.dumps(world))):
        assert other.state_hash() == before
    go(world, TOGGLE)
    assert world.state_hash() != before
    world.restore(saved)
    assert world.state_hash() == before
    assert lane(MUD("red")).state_hash() != lane(MUD("blue")).state_hash()


def test_wrappers_make_room_for_own_kinds():
    world = lane(GATE("red"), APPLE("blue"))
    hot = OneHot(world).observation(world.observation())["image"]
    assert hot.shape == (7, 7, 16 + 6 + 3)
    assert (hot.sum(axis=-1) == 3).all()
    symbols = Symbolic(world)
    assert symbols.observation(world.observation()) in symbols.observation_space


def test_a_registered_world_with_own_things_passes_gymnasiums_checker():
    from gymnasium.utils.env_checker import check_env

    check_env(Lane(GATE("red"), APPLE("blue")), skip_render_check=True)
    assert isinstance(Lane().observation_space["image"], gymnasium.spaces.Box)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: ObjectKind("wall", "X"), "cannot be called 'wall'"),
        (lambda: ObjectKind("tree", "W"), "the letter of 'tree' is 'W'"),
        (lambda: ObjectKind("tree", "tr"), "the letter of 'tree' is 'tr'"),
        (lambda: MUD("red", locked=True), "'mud' does not open"),
        (lambda: MUD("pink"), "unknown colour 'pink'"),
        (lambda: box("red", contains=MUD("red")), "cannot contain a mud"),
        (lambda: lane(ObjectKind("sand", "N")("yellow")), "unknown kind 'sand'"),
        (lambda: type("Six", (Lane,), {"kinds": (*Lane.kinds, ObjectKind("sand", "N"))})(), "at most 5"),
        (lambda: type("Two", (Lane,), {"kinds": (MUD, ObjectKind("moss", "M"))})(), "share a letter: M, M"),
    ],
)
def test_what_makes_no_sense_is_said(wrong, said):
    with pytest.raises(WorldError, match=said):
        wrong()


def test_minigrids_names_say_what_own_things_are():
    world = lane(APPLE("red"), GATE("blue", locked=True), MUD("yellow"))
    apple, gate, mud = (world.grid.get(x, 1) for x in (2, 3, 4))
    assert (apple.type, apple.color, apple.can_pickup(), apple.can_overlap()) == ("apple", "red", True, False)
    assert (gate.type, gate.is_locked, gate.is_open, gate.can_overlap()) == ("gate", True, False, False)
    assert (mud.type, mud.can_pickup(), mud.can_overlap()) == ("mud", False, True)
    assert ("blue", "gate") in world.grid
    for thing, x in ((apple, 2), (gate, 3), (mud, 4)):
        assert thing.encode() == tuple(world.grid.encode()[x, 1])
    world.step(PICKUP)
    assert world.carrying.type == "apple"
