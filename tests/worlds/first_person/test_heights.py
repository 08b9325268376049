"""Buildings: bodies stand on what is under them, climb stairs and ramps, and stop or fall at edges."""

import copy
import math
import pickle
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import minihuman
from minihuman.errors import WorldError
from minihuman.figures.path_figures import session_paths
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.first_person.entities import Ball, Box
from minihuman.worlds.first_person.heights.env import BuildingEnv
from minihuman.worlds.first_person.heights.planner import least_steps, plan
from minihuman.worlds.first_person.pathfinding.planner import plan as plan_in_flat_world
from tests.worlds.first_person.buildings import ThirtyRooms

FOLDER = Path(__file__).parents[3] / "protocols" / "navigation"
FORWARD = 2


@pytest.fixture(autouse=True, scope="module")
def wayfinding():
    """Register the world of the protocol, from its folder."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(FOLDER)
        yield import_module("wayfinding")


class Layout(BuildingEnv):
    """A building with the layout of a test; the body starts where it says, and looks along x."""

    def __init__(self, layout, *, start=(1.0, 0.0, 1.0), **options):
        self.layout = layout
        self.start = start
        super().__init__(trig=1, **options)

    def build(self):
        self.layout(self)
        self.place_agent(pos=self.start, dir=0.0)


class Falling(Layout):
    fall_height = 4.0


def walk(world, steps=60):
    """Walk ahead; return the poses after each step."""
    poses = []
    for _ in range(steps):
        world.step(FORWARD)
        poses.append(world.pose())
    return poses


def start(layout, kind=Layout, **options):
    world = kind(layout, **options)
    world.reset(seed=1)
    return world


def two_rooms_with(between, upper_y, **upper):
    """Return a layout: a lower room, something that leads up, and an upper room."""

    def build(world):
        low = world.add_rect_room(min_x=0, max_x=3, min_z=0, max_z=2)
        high = world.add_rect_room(min_x=7, max_x=11, min_z=0, max_z=2, floor_y=upper_y, **upper)
        flight = between(world)
        world.connect_rooms(low, flight)
        world.connect_rooms(flight, high)

    return build


def stairs(world):
    return world.add_stairs(min_x=3, max_x=7, min_z=0, max_z=2, up="east", floor_y=0, top_y=1.8)


def ramp(world):
    return world.add_ramp(min_x=3, max_x=7, min_z=0, max_z=2, up="east", floor_y=0, top_y=1.8)


def test_a_body_climbs_stairs_step_by_step_and_comes_down_again():
    world = start(two_rooms_with(stairs, 1.8))
    up = [pose.y for pose in walk(world, 50)]
    assert up[0] == 0
    assert up[-1] == pytest.approx(1.8)
    rises = np.diff(up)
    assert set(np.round(rises[rises > 0], 3)) == {0.18}
    for _ in range(12):
        world.step(0)
    down = [pose.y for pose in walk(world, 50)]
    assert down[-1] == 0
    assert (np.diff(down) <= 0).all()


def test_the_floor_of_a_ramp_is_under_the_body_everywhere():
    world = start(two_rooms_with(ramp, 1.8))
    for pose in walk(world, 50):
        assert pose.y == pytest.approx(1.8 * min(max((pose.x - 3) / 4, 0), 1))


@pytest.mark.parametrize(
    ("rise", "climbs"), [(0.3, True), (0.31, False)], ids=["as high as a step", "higher than a step"]
)
def test_a_body_climbs_a_podium_only_if_it_is_no_higher_than_a_step(rise, climbs):
    def build(world):
        low = world.add_rect_room(min_x=0, max_x=3, min_z=0, max_z=2)
        podium = world.add_rect_room(min_x=3, max_x=6, min_z=0, max_z=2, floor_y=rise, must_be_reached=False)
        world.connect_rooms(low, podium)

    pose = walk(start(build))[-1]
    assert pose.y == (rise if climbs else 0)
    assert (pose.x > 3) == climbs
    if not climbs:
        assert 2.45 < pose.x <= 2.6  # a radius before the riser


def balcony(world):
    """A balcony in the west of a hall that is two floors high."""
    above = world.add_rect_room(min_x=0, max_x=3, min_z=0, max_z=2, floor_y=3)
    hall = world.add_rect_room(min_x=3, max_x=9, min_z=0, max_z=2, height=5.74, must_be_reached=False)
    world.connect_rooms(above, hall)


def test_a_body_stops_at_an_edge_unless_it_may_fall():
    pose = walk(start(balcony, start=(1.0, 3.0, 1.0)))[-1]
    assert pose.y == 3
    assert pose.x <= 2.6


def test_a_body_that_may_fall_lands_beside_the_edge_and_walks_on():
    poses = walk(start(balcony, Falling, start=(1.0, 3.0, 1.0)))
    fallen = next(number for number, pose in enumerate(poses) if pose.y == 0)
    assert poses[fallen].x == pytest.approx(3.4, abs=1e-6)  # a radius from the wall below the balcony
    assert {pose.y for pose in poses} == {0.0, 3.0}
    assert poses[-1].x > 8


def cellar(world):
    """A room with a hole in its floor, above a cellar."""
    above = world.add_rect_room(min_x=0, max_x=8, min_z=0, max_z=2, floor_y=3)
    below = world.add_rect_room(min_x=0, max_x=8, min_z=0, max_z=2, height=3, must_be_reached=False)
    world.add_hole(above, below, min_x=3, max_x=6, min_z=0, max_z=2)


def test_a_hole_stops_a_body_or_lets_it_fall_into_the_room_below():
    pose = walk(start(cellar, start=(1.0, 3.0, 1.0)))[-1]
    assert (pose.x <= 2.6, pose.y) == (True, 3)
    poses = walk(start(cellar, Falling, start=(1.0, 3.0, 1.0)))
    assert [pose.y for pose in poses if pose.x < 3] == [3] * sum(pose.x < 3 for pose in poses)
    assert poses[-1].y == 0


def test_through_a_hole_one_sees_what_stands_below():
    def build(world):
        cellar(world)
        world.box = world.place_entity(Box("red", 1.0), pos=(7.0, 0.0, 1.0))

    world = start(build, start=(1.0, 3.0, 1.0), parameters={"cam_pitch": -30.0})
    picture = world.picture().astype(int)
    assert ((picture[..., 0] > 100) & (picture[..., 1] < 60)).any()


def test_walls_and_things_of_another_floor_stop_nobody():
    def build(world):
        world.add_rect_room(min_x=0, max_x=10, min_z=0, max_z=2)
        for x in (0, 5):
            world.add_rect_room(min_x=x, max_x=x + 5, min_z=0, max_z=2, floor_y=3, must_be_reached=False)
        world.place_entity(Box("blue"), pos=(7.0, 3.0, 1.0))

    assert walk(start(build))[-1].x > 9


def test_a_thing_is_carried_upstairs_and_put_down_there():
    def build(world):
        two_rooms_with(stairs, 1.8)(world)
        world.ball = world.place_entity(Ball("green", 0.4), pos=(1.8, 0.0, 1.0))

    world = start(build)
    world.step(world.action_names.index("pickup"))
    assert world.agent.carrying is world.ball
    walk(world, 55)
    world.step(world.action_names.index("drop"))
    assert world.ball.pos[1] == pytest.approx(1.8)
    assert world.ball.pos[0] > 8


def overlapping(world):
    world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5, height=3.2)
    world.add_rect_room(min_x=2, max_x=7, min_z=0, max_z=5, floor_y=3)


def gap(world):
    low = world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5)
    high = world.add_rect_room(min_x=8, max_x=12, min_z=0, max_z=5, floor_y=2)
    world.connect_rooms(low, high)


def unreachable(world):
    low = world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5)
    high = world.add_rect_room(min_x=5, max_x=12, min_z=0, max_z=5, floor_y=1)
    world.connect_rooms(low, high)


def apart(world):
    world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5)
    world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5, floor_y=3)


def low_door(world):
    a = world.add_rect_room(min_x=0, max_x=5, min_z=0, max_z=5)
    b = world.add_rect_room(min_x=5, max_x=9, min_z=0, max_z=5)
    world.connect_rooms(a, b, max_y=1.5)


@pytest.mark.parametrize(
    ("layout", "words"),
    [
        (overlapping, ["room 0 (x 0 to 5", "room 1 (x 2 to 7", "overlap between 3 and 3.2 m"]),
        (gap, ["gap of 3 m between room 0", "at 0 and 2 m", "add_stairs"]),
        (unreachable, ["room 1 (x 5 to 12", "cannot be reached", "step up at (x 5, z 2.5) is 1 m"]),
        (apart, ["floor 1: room 1", "no opening leads there"]),
        (low_door, ["the opening at (x 5, z 2.5) is 1.5 m high, lower than the body's 1.6 m"]),
        (lambda world: world.add_stairs(min_x=0, max_x=4, min_z=0, max_z=2, up="east", floor_y=0, top_y=3, steps=5),
         ["steps of 0.6 m", "give steps=10"]),
        (lambda world: world.add_ramp(min_x=0, max_x=2, min_z=0, max_z=2, up="up", floor_y=0, top_y=3), ["up is 'up'"]),
        (lambda world: world.add_ramp(min_x=0, max_x=2, min_z=0, max_z=2, up="east", floor_y=0, top_y=3), ["steeper"]),
        (lambda world: world.add_rect_room(min_x=0, max_x=2, min_z=0, max_z=2, floor_y=math.nan), ["floor_y is nan"]),
    ],
)  # fmt: skip
def test_a_mistake_in_a_layout_is_an_error_that_names_it(layout, words):
    with pytest.raises(WorldError) as raised:
        start(layout)
    for word in words:
        assert word in str(raised.value)


def test_a_window_is_seen_through_and_stops_bodies():
    def build(world):
        a = world.add_rect_room(min_x=0, max_x=3, min_z=0, max_z=2)
        b = world.add_rect_room(min_x=3, max_x=8, min_z=0, max_z=2, must_be_reached=False)
        world.connect_rooms(a, b, min_z=0.5, max_z=1.5, min_y=1.0, max_y=2.0)
        world.box = world.place_entity(Box("red", (0.6, 1.8, 0.6)), pos=(6.0, 0.0, 1.0))

    world = start(build)
    picture = world.picture()
    assert ((picture[..., 0] > 100) & (picture[..., 1] < 60)).any()
    assert walk(world)[-1].x <= 2.6


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_path_over_three_floors_leads_to_the_goal(seed):
    world = ThirtyRooms(trig=1)
    world.reset(seed=seed)
    assert world.floor_levels == (0.0, 3.0, 6.0)
    path = world.shortest_path()
    assert least_steps(world, world.goal) <= len(path)
    saved = world.save()
    before = world.pose()
    assert world.shortest_path() == path
    assert world.pose() == before
    floors = set()
    for action in path:
        _, reward, terminated, _, _ = world.step(action)
        floors.add(world.agent_floor)
    assert terminated
    assert reward > 0
    assert floors == {0, 1, 2}
    ended = world.state_hash()
    world.restore(saved)
    for action in path[: len(path) // 2]:
        world.advance(action)
    other = ThirtyRooms(trig=1)
    other.restore(world.save())
    for action in path[len(path) // 2 :]:
        other.advance(action)
    assert other.state_hash() == ended
    assert np.array_equal(other.picture(), other.picture())


def test_the_plan_of_a_floor_shows_what_is_on_it(wayfinding):
    world = wayfinding.TwoFloors(trig=1)
    world.reset(seed=2)
    ground, upper = (world.picture(view="full", floor=floor, size_px=(200, 160)).astype(int) for floor in (0, 1))

    def red(picture):
        return int(((picture[..., 0] > 150) & (picture[..., 1] < 60) & (picture[..., 2] < 60)).sum())

    assert red(ground) > 0  # the agent
    assert red(upper) > 0  # the box
    assert not np.array_equal(ground, upper)
    assert np.array_equal(world.picture(view="full", size_px=(200, 160)), ground)
    with pytest.raises(WorldError, match="floors of this building are 0 to 1"):
        world.picture(view="full", floor=2)
    plan_of_upper = world.map().plan_of(1)
    assert [thing.name for thing in plan_of_upper.things] == ["red box"]
    assert 0 < len(plan_of_upper.walls) < len(world.map().walls)


def test_a_body_that_moves_freely_climbs_and_slides_as_on_one_floor():
    world = start(two_rooms_with(stairs, 1.8), control="continuous", parameters={"forward_step": 0.1})
    heights = []
    for _ in range(90):
        world.step(np.array([1.0, 0.01], np.float32))  # a little towards the wall, along which it slides
        heights.append(world.pose().y)
    assert max(heights) == pytest.approx(1.8)
    assert (np.diff(heights) >= 0).all()


def test_the_planner_of_flat_worlds_refuses_a_building():
    world = ThirtyRooms(trig=1)
    world.reset(seed=1)
    with pytest.raises(WorldError, match=r"heights\.planner"):
        plan_in_flat_world(world, world.goal)
    assert plan(world, world.goal)


@pytest.mark.program
def test_a_study_of_two_floors_runs_is_proved_and_knows_the_floor(tmp_path):
    (log,) = minihuman.simulate(FOLDER / "wayfinding.toml", participants=1, data=tmp_path, trust=True)
    assert [check.text for check in minihuman.verify(log)][-1].endswith("all as logged")
    steps = minihuman.open_study(tmp_path / "wayfinding").query("select * from steps")
    assert steps["y"].max() == pytest.approx(3.0)
    assert steps["y"].min() == 0
    panel = next(ax for ax in session_paths(read_log(log)).axes if ax.collections)
    assert [text.get_text() for text in panel.texts] == ["floor 0", "floor 1"]


def test_a_building_can_be_pickled_copied_and_played_on():
    world = ThirtyRooms(trig=1)
    world.reset(seed=4)
    path = world.shortest_path()
    for action in path[:150]:
        world.advance(action)
    copies = [pickle.loads(pickle.dumps(world)), copy.deepcopy(world)]
    for action in path[150:]:
        world.advance(action)
        for other in copies:
            other.advance(action)
    assert {other.state_hash() for other in copies} == {world.state_hash()}


def test_what_stands_upstairs_has_a_shadow_there():
    def build(world):
        two_rooms_with(stairs, 1.8)(world)
        world.box = world.place_entity(Box("red", 0.5), pos=(10.4, 1.8, 1.0))

    plain, shaded = (start(build, start=(7.5, 1.8, 1.0), contact_shadows=shows).picture() for shows in (False, True))
    assert (plain != shaded).any()


def test_joints_are_dark_on_a_display_on_every_floor():
    def corner(world):
        world.add_rect_room(min_x=0, max_x=4, min_z=0, max_z=4, floor_y=5)

    classic, display = (
        start(corner, start=(1.0, 5.0, 2.0), look=look).picture().astype(float).mean(axis=2)
        for look in ("classic", "display")
    )
    joint = slice(440, 456)  # rows around the foot of the far wall
    assert display[joint, 300:340].mean() < 0.8 * classic[joint, 300:340].mean()
