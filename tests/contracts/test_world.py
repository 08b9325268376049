"""The contract of worlds: kinds of worlds that keep it, and what a lab may get wrong, which is named.

That every world of the catalogue keeps it is in ``tests/worlds/test_every_world.py``.
"""

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401  # registers the worlds
from minihuman.errors import WorldError
from minihuman.testing.checks import ContractError
from minihuman.testing.world_contract import check_world
from minihuman.worlds.catalogue import WORLDS
from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import goal
from tests.worlds.catalogue_worlds import world_parameters
from tests.worlds.grid.test_kinds import APPLE, GATE, Lane

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")  # v0 of worlds that have a v1
INSIDE = [entry.id for entry in WORLDS if entry.kwargs.get("family")][::12]


@pytest.mark.parametrize("world", world_parameters(INSIDE))
def test_a_grid_seen_from_inside_keeps_what_worlds_promise(world):
    check_world(world, {"view": "first_person"})


@pytest.mark.parametrize("world", ["minigrid:MiniGrid-DoorKey-8x8-v0", "minigrid:MiniGrid-Dynamic-Obstacles-6x6-v0"])
def test_a_world_of_minigrids_keeps_it(world):
    check_world(world)


def test_a_world_with_things_of_its_own_keeps_it():
    check_world(lambda **options: Lane(GATE("red"), APPLE("blue"), **options))


class Room(GridWorld):
    """An empty room, kept right; each of the wrong ones changes one thing."""

    def __init__(self, **options):
        super().__init__(width=6, height=6, max_steps=20, mission="go", **options)

    def layout(self, grid):
        grid.wall_rect()
        grid.put(goal(), 4, 4)
        grid.place_agent()


class Counts(Room):
    kept = ("turns",)

    def layout(self, grid):
        super().layout(grid)
        self.turns = 0

    def reward_and_done(self, action, reward, terminated):
        self.turns += action < 2
        return reward + self.turns, terminated


class CountsBesideTheState(Counts):
    kept = ()


class NeverForgets(Room):
    def __init__(self, **options):
        super().__init__(**options)
        self._visits = {}

    def reward_and_done(self, action, reward, terminated):
        place = self.state.position
        self._visits[place] = self._visits.get(place, 0) + 1
        return 1 / self._visits[place], terminated


class CountsSeldom(Room):
    """Counts how often the agent stands in one corner, which random actions hardly reach."""

    kept = ("visits",)

    def layout(self, grid):
        super().layout(grid)
        grid.put_agent(4, 1)
        self.visits = 0

    def reward_and_done(self, action, reward, terminated):
        self.visits += self.state.position == (1, 3)
        return reward, terminated


class CountsSeldomBesideTheState(CountsSeldom):
    kept = ()


class RemembersSeldom(Room):
    _visits = 0

    def reward_and_done(self, action, reward, terminated):
        if self.state.position != (1, 3):
            return reward, terminated
        self._visits += 1
        return -1 / self._visits, terminated


class DrawsFromElsewhere(Room):
    def reward_and_done(self, action, reward, terminated):
        return float(np.random.default_rng().random()), terminated


class ChangesWhileDrawn(Room):
    def picture(self, **how):
        self.state.row[7] += 1
        return super().picture(**how)


class GoesOn(Room):
    def step(self, action):
        self.state.row[8] = 1  # playing, whatever was
        return super().step(action)


class Yard(FirstPersonEnv):
    def build(self):
        self.add_rect_room(min_x=0, max_x=4, min_z=0, max_z=4)
        self.box = self.place_entity(Box("red"))
        self.place_agent()
        self.seen = 0

    def reward_and_done(self, action):
        self.seen += self.box in self.visible_entities()
        return float(self.seen), self.near(self.box)


@pytest.mark.parametrize("world", [Room, Counts, Yard])
def test_a_labs_world_keeps_them(world):
    check_world(world)


@pytest.mark.parametrize(
    ("world", "said"),
    [
        (CountsBesideTheState, "turns changes in an episode and does not come back; name it in the world's kept"),
        (CountsSeldomBesideTheState, "visits changes in an episode and does not come back"),
        (RemembersSeldom, "(forward|toggle|left) after a restore: step 0 has another reward"),
        (NeverForgets, "reset again with seed 0: step 1 has another reward"),
        (DrawsFromElsewhere, "has another reward"),
        (ChangesWhileDrawn, "drawing it changes its state"),
        (GoesOn, "is accepted after the end of an episode"),
    ],
)
def test_a_promise_that_is_not_kept_is_named(world, said):
    with pytest.raises(ContractError, match=said):
        check_world(world)


def test_a_check_says_what_it_covered():
    report = check_world(CountsSeldom)
    assert report.search.changed["visits"] > 0
    assert report.search.situations == 60  # 15 cells without the goal, four directions
    said = str(report)
    assert said.startswith("CountsSeldom keeps what a world promises:\n  seeds: two episodes, ")
    assert "visits (" in said
    assert "no shortest_path(self)" in said
    assert "path_length_bounds(self)" in said
    assert "shortest_path() has" in str(check_world("minihuman/MiniGrid-Empty-5x5-v0"))


def test_what_is_no_world_is_refused_as_anywhere():
    with pytest.raises(WorldError, match="rgb_array"):
        check_world("tests.worlds.corridor:tests/PictureLess-v0")


def test_checking_leaves_nothing_registered():
    before = set(gymnasium.registry)
    check_world(Room)
    assert set(gymnasium.registry) == before
