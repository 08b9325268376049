"""What keys do to an action space, whatever its kind; what `check` says of worlds that are hard to record."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from minihuman.errors import WorldError
from minihuman.experiment.keys import assign_usual_keys, find_period_ms
from minihuman.experiment.plan.dry_run import list_world_notices
from minihuman.worlds.adapters.spaces import CHORD, REST, VectorActions
from minihuman.worlds.adapters.world import World

LEVERS = "tests.worlds.levers:tests/Levers-v0"


@pytest.mark.parametrize("kind", ["box", "arm", "buttons", "choices", "board", "pair"])
def test_every_element_and_every_pair_is_a_value_of_the_space(kind):
    world = World(LEVERS, {"kind": kind})
    world.reset(0)
    for one in world.actions.numbers:
        for other in world.actions.numbers:
            number, vector = world.actions.combine([one, other])
            assert world.actions.value(vector) in world.action_space
            assert world.actions.resolve(vector) == (number, vector)
            world.step(vector)
    assert world.action_names[0] == REST
    assert world.action_names[-1] == CHORD
    with pytest.raises(WorldError, match=r"action .* is not in"):
        world.step(len(world.action_names) - 1)


def test_a_box_without_bounds_moves_by_one_and_rests_at_zero():
    actions = VectorActions(spaces.Box(-np.inf, np.inf, (2,), np.float64))
    assert actions.rest == (0.0, 0.0)
    assert actions.combine([1, 4])[1] == (-1.0, 1.0)


def test_a_box_that_does_not_hold_zero_rests_at_its_nearest_end():
    assert VectorActions(spaces.Box(1.0, 3.0, (1,), np.float64)).rest == (1.0,)


def test_an_axis_moves_a_component_of_whole_numbers_by_whole_numbers():
    actions = VectorActions(spaces.Box(0, 8, (2,), np.int64))
    assert actions.move(actions.rest, 0, 0.37) == (3.0, 0.0)
    assert actions.move(actions.rest, 1, 1.0) == (0.0, 8.0)


def test_a_space_that_keys_cannot_do_is_refused_by_name():
    class Words(gymnasium.Env):
        metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
        action_space = spaces.Text(5)

        def __init__(self, render_mode=None):
            pass

    gymnasium.register("tests/Words-v0", entry_point=Words)
    try:
        with pytest.raises(WorldError, match="Discrete, MultiDiscrete, MultiBinary or Box"):
            World("tests/Words-v0")
    finally:
        del gymnasium.registry["tests/Words-v0"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({}, []),
        ({"kind": "arm"}, ["the first 4 of 6 parts"]),
        ({"locked": True}, ["cannot be copied"]),
        ({"chance": True}, ["nondeterministic: two plays of one seed differ, first in the observation at step 1"]),
    ],
)
def test_check_says_what_to_know_of_a_world(options, said):
    notices = list(list_world_notices(World(LEVERS, options)))
    assert len(notices) == len(said)
    assert all(words in notice for words, notice in zip(said, notices, strict=True))


def test_a_world_that_moves_by_itself_has_a_pace_and_usual_keys():
    world = World("MountainCarContinuous-v0")
    assert find_period_ms(world) == pytest.approx(1000 / 30)
    assert assign_usual_keys(world) == {"left": "axis_0_minus", "right": "axis_0_plus"}
    assert find_period_ms(World("minihuman/MiniGrid-FourRooms-v0")) is None
