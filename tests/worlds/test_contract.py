"""What every world of ours answers for players, measures and whoever looks ahead."""

import pytest

import minihuman  # noqa: F401
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import UNKNOWN_BOUNDS, PathLengthBounds
from minihuman.worlds.first_person.layouts.one_room import OneRoom
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.object_kinds import door, goal, key, wall
from tests.counts import count
from tests.worlds.catalogue_worlds import start

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")  # some ids are kept for their published results


@pytest.mark.parametrize("world_id", ["minihuman/MiniGrid-FourRooms-v0", "minihuman/MiniWorld-GoToObj-Transfer-v0"])
def test_ways_that_meet_have_the_same_scene_and_another_state(world_id):
    env = start(world_id)
    saved, scene, state = env.save(), env.scene_hash(), env.state_hash()
    for _ in range(4):
        env.advance(env.action_names.index("left" if "left" in env.action_names else "turn_left"))
    if "MiniGrid" in world_id:
        assert env.scene_hash() == scene
    assert env.state_hash() != state
    env.restore(saved)
    assert (env.scene_hash(), env.state_hash()) == (scene, state)


def test_what_was_on_stage_is_the_same_thing_after_going_back():
    env = start("minihuman/MiniWorld-PutNext-v0")
    saved, box, stage = env.save(), env.red_box, env.stage
    box.pos = (1.0, 0.0, 1.0)
    env.restore(saved)
    assert (env.red_box, env.stage) == (box, stage)
    assert box.pos != (1.0, 0.0, 1.0)
    other = start("minihuman/MiniWorld-PutNext-v0")
    other.restore(saved)
    assert other.red_box is not box
    assert other.red_box in other.entities
    assert other.state_hash() == env.state_hash()


class Judged(GridWorld):
    """Success takes a step, whatever the goal says."""

    def __init__(self):
        super().__init__(width=9, height=9, max_steps=50)

    def layout(self, grid: Layout) -> None:
        grid.wall_rect()
        grid.put(goal(), 7, 7)
        grid.put_agent(1, 1, 0)

    def reward_and_done(self, action, reward, terminated):
        return 1.0, True


class Helped(Judged):
    """It knows how."""

    def shortest_path(self):
        return [0]


class JudgedRoom(OneRoom):
    def reward_and_done(self, action):
        return 1.0, True


@pytest.mark.parametrize("world", [Judged, JudgedRoom])
def test_of_a_world_that_judges_itself_nothing_is_claimed(world):
    env = world()
    env.reset(seed=0)
    assert env.shortest_path() is None
    assert env.path_length_bounds() == UNKNOWN_BOUNDS


def test_a_world_may_say_its_way_itself():
    env = Helped()
    env.reset(seed=0)
    assert list(env.shortest_path()) == [0]
    assert env.path_length_bounds() == PathLengthBounds(None, 1)


def class_with_old_names():
    class Old(Judged):
        def judge(self, action, reward, terminated):
            return super().judge(action, reward, terminated)[0] / 2, True

        def way(self):
            return [1]

    return Old


def test_the_names_of_the_last_release_still_work_and_warn():
    with pytest.warns(DeprecationWarning, match="is called") as warned:
        old = class_with_old_names()
    assert [str(one.message).split(";")[0].split("Old.")[1] for one in warned] == [
        "way is called shortest_path now",
        "judge is called reward_and_done now",
    ]
    env = old()
    env.reset(seed=0)
    with pytest.warns(DeprecationWarning, match=r"judge\(\) is called reward_and_done\(\)"):
        assert env.step(0)[1:3] == (0.5, True)
    env.reset(seed=0)
    assert env.shortest_path() == env.way() == [1]
    with pytest.warns(DeprecationWarning, match="path_length_bounds"):
        assert env.bounds() == PathLengthBounds(None, 1)
    with pytest.warns(DeprecationWarning, match="subgoals"):
        assert env.clauses() == ()


def test_a_class_with_old_names_below_one_with_new_names_is_asked():
    class Twice(Helped):
        def reward_and_done(self, action, reward, terminated):
            return 2 * super().reward_and_done(action, reward, terminated)[0], True

    with pytest.warns(DeprecationWarning, match="judge"):

        class Below(Twice):
            def judge(self, action, reward, terminated):
                return 3 * super().reward_and_done(action, reward, terminated)[0], True

    env = Below()
    env.reset(seed=0)
    assert env.step(0)[1] == 6.0
    assert env.shortest_path() is None  # Twice's rules are not Helped's


def test_a_session_world_answers_to_the_old_names_too():
    world = World("minihuman/MiniGrid-Empty-5x5-v0")
    world.reset(0)
    with pytest.warns(DeprecationWarning, match="shortest_path"):
        assert world.way() == world.shortest_path()


def follow(world: World, most: int) -> float:
    """What a world's own way earns, made anew where it ends."""
    for _ in range(most):
        for name in world.shortest_path():
            made = world.step(world.action_names.index(name))
            if made.terminated or made.truncated:
                return made.reward
    return 0.0


@pytest.mark.parametrize("view", ["grid", "first_person"])
@pytest.mark.parametrize("name", ["DoorKey-6x6-v0", "GoToObj-Transfer-v0", "Dynamic-Obstacles-6x6-v0", "MemoryS7-v0"])
def test_the_way_leads_to_success_in_both_views(name, view):
    world = World(f"minihuman/MiniGrid-{name}", {"view": view})
    for seed in range(count(3, 50)):
        world.reset(seed)
        bounds, way = world.path_length_bounds(), world.shortest_path()
        assert len(way) == bounds.at_least == bounds.feasible
        assert follow(world, 1) > 0


class Wide(GridWorld):
    """A wall with a locked door across a wide grid, the key in the far corner on this side."""

    def __init__(self, size: int):
        super().__init__(width=size, height=size, max_steps=10_000)
        self.size = size

    def layout(self, grid: Layout) -> None:
        size = self.size
        grid.wall_rect()
        for y in range(1, size - 1):
            grid.put(door("red", locked=True) if y == size // 2 else wall(), size - 3, y)
        grid.put(key("red"), 1, size - 2)
        grid.put(goal(), size - 2, 1)
        grid.put_agent(1, 1, 0)


@pytest.mark.parametrize("size", [20, 70, 128, 200])
def test_wide_grids_with_doors_are_planned_right(size):
    env = Wide(size)
    env.reset(seed=0)
    way = env.shortest_path()
    walked = (size - 4) + (size - 2 - size // 2) + (size - 3) + (size // 2 - 1)  # to the key, to the door's row, on, up
    assert len(way) == walked + 1 + 1 + 4  # taking the key, opening the door, four turns
    for action in way:
        reward, terminated, _ = env.advance(action)
    assert terminated
    assert reward > 0
