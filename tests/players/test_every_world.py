"""Every world of the catalogue that has a goal is played to it by the way it knows, in every view."""

import pytest

from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import WORLDS
from tests.counts import count

NO_WAY = ("Playground", "RoomObjects", "ThreeRooms", "CollectHealth")  # they have no goal
PLAYED = [
    (entry.id, view)
    for entry in WORLDS
    if "BabyAI" not in entry.id and not any(name in entry.id for name in NO_WAY)
    for view in (("grid", "first_person") if "MiniGrid" in entry.id else ("first_person",))
]
pytestmark = [pytest.mark.nightly(sample=True), pytest.mark.filterwarnings("ignore:.*out of date")]


@pytest.mark.parametrize(("name", "view"), PLAYED[:: count(9, 1)])
def test_a_worlds_own_way_leads_to_its_goal(name, view):
    world = World(name, {"view": view} if "MiniGrid" in name else {})
    for seed in range(count(1, 5)):
        world.reset(seed)
        bounds, way = world.path_length_bounds(), world.shortest_path()
        assert way, "no way was found"
        assert bounds.feasible is not None
        assert (bounds.at_least or 0) <= bounds.feasible
        for action in way:
            made = world.step(world.action_names.index(action))
        assert made.reward > 0
        assert made.terminated
