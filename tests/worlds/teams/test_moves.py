"""The rule of moves of several bodies, and the tasks that only several have."""

import gymnasium
import numpy as np
import pytest

import minihuman
from minihuman.errors import WorldError
from minihuman.worlds.grid.core.bodies import CARRY, HIDE, OWN_GOALS
from minihuman.worlds.grid.core.cells import AGENT
from minihuman.worlds.grid.object_kinds import ball, box, door, goal, key, lava, wall
from minihuman.worlds.grid.team_grid import TeamGrid

LEFT, RIGHT, FORWARD, PICKUP, DROP, TOGGLE, STAY = range(7)
EAST, SOUTH, WEST, NORTH = range(4)


class Yard(TeamGrid):
    """An empty yard with bodies and things where a test wants them."""

    def __init__(self, bodies, things=(), task=(), size=9, shared=False):
        self.bodies, self._placed, self._things, self._task = len(bodies), bodies, things, task
        self.shared_reward = shared
        super().__init__(width=size, height=size, max_steps=50, mission="stand about")

    def layout(self, grid):
        grid.wall_rect()
        for item, x, y in self._things:
            grid.put(item, x, y)
        for body, (x, y, direction) in enumerate(self._placed):
            grid.put_agent(x, y, direction, body=body)
        if self._task:
            grid.task(*self._task)


def yard(*bodies, **options):
    """A yard in an episode."""
    world = Yard(bodies, **options)
    world.reset(0)
    return world


def places(world):
    """Where everybody stands."""
    return [(int(pose.x), int(pose.z)) for pose in map(world.pose, range(world.bodies))]


def test_two_that_want_one_cell_take_turns_in_getting_it():
    for waited, winner in ((0, 0), (1, 1)):
        world = yard((2, 2, EAST), (4, 2, WEST))
        for _ in range(waited):
            world.step([STAY, STAY])
        world.step([FORWARD, FORWARD])
        assert places(world)[winner] == (3, 2)
        assert places(world)[1 - winner] == ((4, 2), (2, 2))[winner]


def test_bodies_follow_each_other_and_go_round_but_never_pass_through():
    row = yard((1, 1, EAST), (2, 1, EAST), (3, 1, EAST))
    row.step([FORWARD, FORWARD, FORWARD])
    assert places(row) == [(2, 1), (3, 1), (4, 1)]
    row.step([FORWARD, FORWARD, STAY])  # the first in line stays, so nobody goes
    assert places(row) == [(2, 1), (3, 1), (4, 1)]
    ring = yard((1, 1, EAST), (2, 1, SOUTH), (2, 2, WEST), (1, 2, NORTH))
    ring.step([FORWARD] * 4)
    assert places(ring) == [(2, 1), (2, 2), (1, 2), (1, 1)]
    facing = yard((1, 1, EAST), (2, 1, WEST))
    facing.step([FORWARD, FORWARD])
    assert places(facing) == [(1, 1), (2, 1)]


def test_hands_act_in_order_and_not_where_another_stands():
    two = yard((2, 2, EAST), (4, 2, WEST), things=[(ball("red"), 3, 2)])
    two.step([PICKUP, PICKUP])
    assert [two.held_by(body) is not None for body in range(2)] == [True, False]
    gate = yard((2, 2, EAST), (3, 2, WEST), things=[(door("red", is_open=True), 3, 2)])
    gate.step([TOGGLE, STAY])
    assert gate.state.states[3, 2] == 0  # still open: somebody stands in it
    gate.step([DROP, FORWARD])
    assert places(gate) == [(2, 2), (3, 2)]


def test_each_sees_the_other_in_its_colour_and_as_it_faces():
    world = yard((2, 4, EAST), (4, 4, SOUTH))
    seen = world.observation(0)
    assert tuple(seen[3, 4]) == (AGENT, 2, 0)  # two ahead; blue; it looks to the viewer's right
    assert tuple(world.observation(1)[5, 6]) == (AGENT, 0, 2)  # to the right; red; it looks to the viewer's left
    world.step([STAY, RIGHT])
    assert tuple(world.observation(1)[3, 4]) == (AGENT, 0, 1)  # red, looking towards the viewer
    assert not world.save().row[-1]  # scratch numbers are 0 between steps


def test_rewards_are_shared_or_a_bodys_own():
    for shared in (False, True):
        world = yard((1, 1, EAST), (5, 5, EAST), things=[(goal(), 2, 1)], shared=shared)
        done = world.step([FORWARD, STAY])
        assert done.rewards == ((1 - 0.9 / 50,) * 2 if shared else (1 - 0.9 / 50, 0.0))
        assert done.terminated
    drowned = yard((1, 1, EAST), (5, 5, EAST), things=[(lava(), 2, 1)]).step([FORWARD, STAY])
    assert (drowned.rewards, drowned.terminated) == ((0.0, 0.0), True)


def test_with_goals_of_their_own_all_have_to_arrive():
    world = yard((1, 1, EAST), (1, 3, EAST), things=[(goal("red"), 2, 1), (goal("blue"), 3, 3)], task=(OWN_GOALS,))
    first = world.step([FORWARD, FORWARD])
    assert (first.rewards, first.terminated) == ((1 - 0.9 / 50, 0.0), False)
    last = world.step([FORWARD, FORWARD])  # who is there stays
    assert (last.rewards, last.terminated) == ((0.0, 1 - 0.9 * 2 / 50), True)
    assert places(world) == [(2, 1), (3, 3)]


def test_a_load_moves_where_two_agree():
    def world():
        made = yard(
            (2, 3, EAST), (4, 3, WEST), things=[(box("purple"), 3, 3), (goal(), 6, 2), (wall(), 3, 6)], task=(CARRY, 1)
        )
        made.step([FORWARD, PICKUP])
        made.step([PICKUP, STAY])
        return made

    def load(made):
        return made.state.find(1)

    alone = world()
    alone.step([FORWARD, DROP])
    assert load(alone) == (3, 3)  # the other did not stay
    alone.step([FORWARD, STAY])
    assert load(alone) == (3, 3)
    both = world()
    both.step([LEFT, LEFT])  # one north, the other south
    assert load(both) == (3, 3)
    both.step([LEFT, RIGHT])
    assert (load(both), places(both)) == ((3, 2), [(2, 2), (4, 2)])
    both.step([FORWARD, STAY])
    both.step([FORWARD, STAY])
    done = both.step([FORWARD, STAY])
    assert (load(both), places(both), done.terminated) == ((6, 2), [(5, 2), (7, 2)], True)
    assert done.rewards == (1 - 0.9 * 7 / 50,) * 2
    walled = world()
    for _ in range(5):
        walled.step([RIGHT, LEFT])
    assert load(walled) == (3, 5)  # the block below is in the way of the load


def test_a_seeker_waits_and_then_earns_by_seeing():
    world = yard((2, 4, WEST), (4, 6, WEST), task=(HIDE, 2))
    assert [world.step([RIGHT, STAY]).rewards for _ in range(2)] == [(0.0, 0.0)] * 2
    assert world.step([RIGHT, STAY]).rewards == (-1 / 50, 1 / 50)
    assert world.step([RIGHT, STAY]).rewards == (1 / 50, -1 / 50)


class Together(TeamGrid):
    """Both have to hold a key at once."""

    bodies = 2

    def __init__(self):
        super().__init__(width=6, height=6, max_steps=400, mission="pick up a key each")

    def layout(self, grid):
        grid.wall_rect()
        for body in range(self.bodies):
            grid.place_agent(body=body)
            grid.place(key("yellow"))

    def reward_and_done(self, actions, rewards, terminated):
        done = all(self.held_by(body) is not None for body in range(self.bodies))
        return (float(done),) * self.bodies, done


def test_a_world_of_ones_own_says_its_bodies_and_its_layout():
    gymnasium.register("own_worlds/Together-v0", entry_point=f"{__name__}:Together")
    try:
        world = minihuman.make_team("own_worlds/Together-v0")
    finally:
        del gymnasium.registry["own_worlds/Together-v0"]
    for seed in range(40):
        world.reset(seed)
        assert len(set(places(world))) == 2  # never in one cell
    rng = np.random.default_rng(1)
    done = world.step([STAY, STAY])
    while not done.terminated:
        done = world.step(rng.integers(0, 4, 2).tolist())  # raises once the episode is truncated
    assert done.rewards == (2.0, 2.0)  # shared: what both earn together


def test_bodies_that_nobody_placed_are_refused():
    class Forgotten(Together):
        def layout(self, grid):
            grid.place_agent()

    class Crowded(Together):
        def layout(self, grid):
            for body in range(2):
                grid.put_agent(2, 2, body=body)

    class Third(Together):
        def layout(self, grid):
            grid.place_agent(body=2)

    for world, why in ((Forgotten(), "body 1 nowhere"), (Crowded(), "where body 0 stands"), (Third(), "has 2")):
        with pytest.raises(WorldError, match=why):
            world.reset(0)


def test_one_body_of_a_team_is_the_classic_grid():
    """A team of one steps and sees as the world of one body does, number by number."""
    rng = np.random.default_rng(0)
    alone = gymnasium.make("minihuman/MiniGrid-DoorKey-8x8-v0").unwrapped
    things = [
        (door("yellow", locked=True), 4, 3),
        (key("yellow"), 2, 5),
        (goal(), 6, 6),
        *((wall(), 4, y) for y in (1, 2, 4, 5, 6)),
    ]
    team = yard((1, 1, EAST), things=things, size=8)
    alone.reset(seed=0)
    row = alone.state.row
    row[:] = team.save().row
    row[7] = team.max_steps
    for _ in range(49):
        action = int(rng.choice(7, p=(0.15, 0.15, 0.4, 0.1, 0.05, 0.1, 0.05)))
        observed, reward, terminated, truncated, _ = alone.step(action)
        done = team.step([action])
        assert (done.rewards[0], done.terminated, done.truncated) == (reward, terminated, truncated)
        assert np.array_equal(observed["image"], team.observation(0))
        assert np.array_equal(row, team.save().row)
        if terminated:
            break
