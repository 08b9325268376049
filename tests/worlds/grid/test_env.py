"""The environment as Gymnasium and its users see it: checks, misuse, save and restore, maps, text."""

import pickle
from copy import deepcopy

import gymnasium
import numpy as np
import pytest

import minihuman
from minihuman.errors import WorldError
from minihuman.worlds.grid.env import GridEnv, GridWorld
from minihuman.worlds.grid.layout import from_text
from minihuman.worlds.grid.object_kinds import Item, ball, box, door, key
from minihuman.worlds.pose import Pose

OBSTRUCTED = "minihuman/MiniGrid-ObstructedMaze-1Dlhb-v0"
DYNAMIC = "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0"


def after(world, steps, seed=0):
    env = gymnasium.make(world)
    env.reset(seed=seed)
    for action in np.random.default_rng(seed).integers(0, env.action_space.n, 1000).tolist():
        if env.unwrapped.state.step == steps:
            break
        if any(env.step(action)[2:4]):
            env.reset()
    return env


def future(env, steps=60):
    """Everything that happens under fixed actions, new episodes included."""
    seen = []
    for action in np.random.default_rng(5).integers(0, env.action_space.n, steps).tolist():
        observation, reward, terminated, truncated, _ = env.step(action)
        seen.append((observation["image"].tobytes(), observation["mission"], reward, terminated, truncated))
        if terminated or truncated:
            seen.append(env.reset()[0]["image"].tobytes())
        seen.append(env.unwrapped.state_hash())
    return seen


@pytest.mark.parametrize("world", [OBSTRUCTED, DYNAMIC, "minihuman/MiniGrid-Fetch-5x5-N2-v0"])
@pytest.mark.parametrize("copied", [deepcopy, lambda env: pickle.loads(pickle.dumps(env))], ids=["deepcopy", "pickle"])
def test_a_copy_is_equal_and_independent(world, copied):
    env = after(world, 2)
    twin, expected = copied(env), future(deepcopy(env))
    assert future(env) == expected
    assert future(twin) == expected


@pytest.mark.parametrize("world", [OBSTRUCTED, DYNAMIC])
def test_a_saved_state_can_be_gone_back_to_again_and_again(world):
    env = after(world, 2)
    saved = env.unwrapped.save()
    first = future(env)
    for _ in range(2):
        env.unwrapped.restore(saved)
        env.unwrapped.picture()  # drawing changes nothing
        assert future(env) == first
    other = gymnasium.make(world)
    other.reset(seed=99)
    other.unwrapped.restore(pickle.loads(pickle.dumps(saved)))
    assert future(other) == first


def test_a_state_of_another_world_is_refused():
    saved = after(DYNAMIC, 1).unwrapped.save()
    with pytest.raises(WorldError, match=r"6 x 6 cells and .*FourRooms.* is 19 x 19"):
        gymnasium.make("minihuman/MiniGrid-FourRooms-v0").unwrapped.restore(saved)


@pytest.fixture
def four_rooms():
    return gymnasium.make("minihuman/MiniGrid-FourRooms-v0", max_steps=3)


def test_stepping_and_looking_before_reset_say_so(four_rooms):
    with pytest.raises(WorldError, match=r"FourRooms-v0 is not in an episode; call reset\(\)"):
        four_rooms.step(0)
    for look in ("picture", "pose", "map", "text", "observation"):
        with pytest.raises(WorldError, match=r"has not been reset; call reset\(\)"):
            getattr(four_rooms.unwrapped, look)()


def test_stepping_after_the_end_says_so(four_rooms):
    four_rooms.reset(seed=0)
    assert [four_rooms.step(0)[3] for _ in range(3)] == [False, False, True]
    with pytest.raises(WorldError, match="again after each episode"):
        four_rooms.step(0)


@pytest.mark.parametrize("action", [-1, 7, np.int64(100)])
def test_an_action_there_is_not_is_refused_and_changes_nothing(four_rooms, action):
    four_rooms.reset(seed=0)
    before = four_rooms.unwrapped.state_hash()
    with pytest.raises(WorldError, match=r"does not exist in .*FourRooms-v0; actions are 0 to 6"):
        four_rooms.step(action)
    assert four_rooms.unwrapped.state_hash() == before


@pytest.mark.parametrize(
    ("make", "complaint"),
    [
        (lambda: GridEnv("five_rooms"), "unknown family 'five_rooms'"),
        (lambda: GridEnv("four_rooms", size=3), "does not take"),
        (lambda: GridEnv("empty", size=2), "size is 2; it must be a whole number from 3 to 1024"),
        (lambda: GridEnv("empty", max_steps=0), "max_steps is 0; use a whole number from 1 to"),
        (lambda: GridEnv("empty", agent_view_size=8), "it must be an odd number from 3 to 61"),
        (lambda: GridEnv("crossing", size=8), "size is 8; it must be an odd number"),
        (lambda: GridEnv("memory", size=8), "size is 8; it must be an odd number"),
        (lambda: GridEnv("crossing", obstacle_type="water"), "obstacle_type is 'water'; use one of 'lava', 'wall'"),
        (
            lambda: GridEnv("multi_room", minNumRooms=3, maxNumRooms=2),
            "maxNumRooms is 2; it must be a whole number",
        ),
        (lambda: Item("dragon", "red"), "unknown kind 'dragon'"),
        (lambda: Item("key", "pink"), "unknown colour 'pink'"),
        (lambda: Item("door", "red", "ajar"), "unknown door state 'ajar'"),
        (lambda: box("red", contains=door("red")), "cannot contain a door"),
    ],
)
def test_impossible_worlds_are_refused(make, complaint):
    with pytest.raises(WorldError, match=complaint):
        make()


class Drawn(GridWorld):
    """A world laid out by what the test gives it."""

    def __init__(self, lay_out, width=5, height=4):
        self.lay_out = lay_out
        super().__init__(width=width, height=height, max_steps=20)

    def layout(self, grid):
        self.lay_out(grid)


@pytest.mark.parametrize(
    ("lay_out", "complaint"),
    [
        (lambda grid: grid.put(key(), 5, 0), r"cell \(5, 0\) is outside the grid of 5 x 4"),
        (lambda grid: grid.wall_rect(0, 0, 6, 4), r"cell \(5, 3\) is outside"),
        (lambda grid: [grid.place(key()) for _ in range(21)], "no free cell for the key"),
        (lambda grid: grid.place(key(), reject=lambda x, y: True, tries=9), "no free cell for the key"),
        (lambda grid: grid.place_agent(top=(7, 7), size=(1, 1)), "no free cell for the agent"),
        (lambda grid: grid.wall_rect(), "placed no agent"),
        (lambda grid: from_text("WW??", grid), r"'\?\?' in column 1, row 0"),
    ],
)
def test_a_world_that_cannot_be_laid_out_says_why(lay_out, complaint):
    with pytest.raises(WorldError, match=complaint):
        Drawn(lay_out).reset(seed=0)


def test_a_layout_that_does_not_fit_says_so():
    env = GridEnv("multi_room", minNumRooms=40, maxNumRooms=40, width=9, height=9)
    with pytest.raises(WorldError, match="has no free cell"):
        env.reset(seed=0)


DIAGRAM = """\
WWWWWWWWWW
WW>>  KyWW
WWA-OrDbLp
WWBgFyG-Vr"""


def test_text_is_read_back_as_it_was_written():
    world = Drawn(lambda grid: from_text(DIAGRAM, grid))
    world.reset(seed=0)
    assert world.text() == DIAGRAM
    world.step(2)
    assert world.text().splitlines()[1] == "WW  >>KyWW"


def test_outside_the_grid_is_wall_and_the_agent_stays_in():
    world = Drawn(lambda grid: grid.put_agent(0, 0, direction=3))
    world.reset(seed=0)
    for action in (2, 3, 4, 5):
        world.step(action)
    assert world.pose() == Pose(0.0, 0.0, 0.0, np.pi / 2)


def test_an_agent_may_drop_what_it_carries_only_where_nothing_is():
    def lay_out(grid):
        grid.put_agent(0, 0)
        grid.put(ball("red"), 1, 0)
        grid.put(ball("blue"), 0, 1)

    world = Drawn(lay_out)
    world.reset(seed=0)
    for action in (3, 1, 4):  # take the red ball, turn to the blue one, try to drop
        world.step(action)
    assert world.text().splitlines()[:2] == ["vv        ", "Ab        "]
    world.step(0)
    world.step(4)
    assert world.text().splitlines()[0] == ">>Ar      "


def test_the_map_holds_outlines_of_walls_and_things_by_name():
    world = Drawn(lambda grid: from_text(DIAGRAM, grid))
    world.reset(seed=0)
    plan = world.map()
    assert plan.unit == "cell"
    assert plan.bounds == (-0.5, -0.5, 4.5, 3.5)
    assert (-0.5, -0.5, 4.5, -0.5) in plan.walls  # the top face of the upper wall, in one piece
    assert (0.5, 0.5, 0.5, 3.5) in plan.walls
    assert {(thing.name, thing.x, thing.z) for thing in plan.things} == {
        ("yellow key", 3.0, 1.0),
        ("grey ball", 1.0, 2.0),
        ("red door", 2.0, 2.0),
        ("blue door", 3.0, 2.0),
        ("purple door", 4.0, 2.0),
        ("green box", 1.0, 3.0),
        ("yellow floor", 2.0, 3.0),
        ("grey goal", 3.0, 3.0),
        ("lava", 4.0, 3.0),
    }


def test_an_observation_is_read_as_text():
    env = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0")
    observation, _ = env.reset(seed=1)
    assert minihuman.observation_to_text(observation).splitlines() == [
        "....WWWWWWWW..",
        "....WW  KyLy..",
        "....WW    WW..",
        "....WW    WW..",
        "....WW    WW..",
        "....WW    WW..",
        "....WW^^  WW..",
    ]
    for action in env.unwrapped.shortest_path():
        observation, *_ = env.step(action)
        if env.unwrapped.carrying:
            break
    assert minihuman.observation_to_text(observation["image"]).endswith("WW^^      \ncarries Ky")
    assert minihuman.observation_to_text(env.unwrapped.full_image()) == env.unwrapped.text()


def test_what_is_no_observation_is_refused():
    with pytest.raises(WorldError, match=r"the image has the shape \(7, 7\); use \[columns, rows, 3\]"):
        minihuman.observation_to_text(np.zeros((7, 7)))
    with pytest.raises(WorldError, match="the image has the unknown kind 12; pass the world's own kinds"):
        minihuman.observation_to_text(np.full((3, 3, 3), 12))
