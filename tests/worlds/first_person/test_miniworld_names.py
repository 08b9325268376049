"""Code written for Miniworld's worlds reads ours by Miniworld's names."""

from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.wrappers import StochasticAction


@pytest.fixture(scope="module")
def wrappers():
    """Miniworld's wrappers by themselves: the package around them asks for a display."""
    file = Path(find_spec("miniworld").origin).parent / "wrappers.py"
    spec = spec_from_file_location("wrappers_of_miniworld", file)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def world():
    env = gymnasium.make("minihuman/MiniWorld-FourRooms-v0").unwrapped
    env.reset(seed=4)
    return env


def test_rooms_and_walls(world):
    assert len(world.rooms) == 8  # four, and four passages
    assert world.min_x == min(room.min_x for room in world.rooms) == -7
    assert (world.max_x, world.min_z, world.max_z) == (7, -7, 7)
    assert world.wall_segs.shape == (len(world.map().walls), 2, 3)
    assert (world.wall_segs[:, :, 1] == 0).all()
    for _ in range(20):
        world.step(world.actions.move_forward)
        x, _, z = world.agent.pos
        assert any(room.min_x <= x <= room.max_x and room.min_z <= z <= room.max_z for room in world.rooms)


def test_what_a_body_would_touch(world):
    agent, box = world.agent, world.box
    assert world.intersect(agent, agent.pos, agent.radius) is None
    assert world.intersect(agent, (world.min_x, 0, -4), agent.radius) is True
    assert world.intersect(agent, np.array(box.pos), agent.radius) is box
    assert world.intersect(box, box.pos, box.radius) is None


def test_pictures_have_miniworlds_shapes(world):
    assert world.render_obs().shape == world.observation_space.shape == (60, 80, 3)
    assert world.render_depth().shape == (60, 80, 1)
    assert world.render_top_view().shape == (600, 800, 3)
    assert world.get_visible_ents() == set(world.visible_entities())


def test_actions_have_miniworlds_numbers_and_those_it_lacks_are_not_there(world):
    numbers = {action.name: action.value for action in world.actions}
    assert numbers == {"turn_left": 0, "turn_right": 1, "move_forward": 2}
    with pytest.raises(AttributeError, match="pickup"):
        _ = world.actions.pickup
    assert world.max_episode_steps == world.max_steps
    assert world.max_forward_step == 0.17  # the end of its range


def test_a_world_may_use_such_a_name_for_itself(world):
    world.rooms = "mine"
    assert world.rooms == "mine"
    del world.rooms
    assert len(world.rooms) == 8


def test_miniworlds_wrappers_run_and_an_action_outside_the_space_is_refused(wrappers):
    env = gymnasium.make("minihuman/MiniWorld-Hallway-v0")
    assert wrappers.PyTorchObsWrapper(env).reset(seed=0)[0].shape == (3, 80, 60)
    assert wrappers.GreyscaleWrapper(env).reset(seed=0)[0].shape == (60, 80, 1)
    noisy = wrappers.StochasticActionWrapper(env, prob=0.0, random_action=1)
    noisy.reset(seed=0)
    before = env.unwrapped.agent.dir
    noisy.step(0)
    assert env.unwrapped.agent.dir < before  # turned right
    noisy = wrappers.StochasticActionWrapper(env, prob=0.0, random_action=4)  # without, it draws one of six
    with pytest.raises(WorldError, match="action is 4; it must be a whole number, 0 to 2"):
        noisy.step(0)
    noisy = StochasticAction(env, prob=0.0)  # draws among the world's own
    for _ in range(10):
        noisy.step(0)
