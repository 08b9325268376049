"""Code written for Miniworld's worlds reads ours by Miniworld's names."""

import math
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Agent
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.rules import ACTIONS
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
    assert world.render_top_view().shape == (60, 80, 3)
    assert world.render_top_view(world.vis_fb).shape == world.render_obs(world.vis_fb).shape == (600, 800, 3)
    assert world.get_visible_ents() == set(world.visible_entities())


def test_actions_have_miniworlds_numbers_and_those_it_does_not_take_are_refused(world):
    numbers = {action.name: action.value for action in world.actions}
    assert numbers == {name: number for number, name in enumerate(ACTIONS)}
    with pytest.raises(WorldError, match=r"action is <Actions\.pickup: 4>; it must be a whole number, 0 to 2"):
        world.step(world.actions.pickup)
    other = Own(actions=("move_forward", "turn_left"))
    assert [action.name for action in other.actions] == ["move_forward", "turn_left"]
    assert world.max_episode_steps == world.max_steps
    assert world.max_forward_step == 0.17  # the end of its range


class Own(FirstPersonEnv):
    """A world of one's own that uses Miniworld's names for itself."""

    def build(self):
        self.room = self.add_rect_room(min_x=0, max_x=4, min_z=0, max_z=4)
        self.rooms = 3
        self.place_agent()


def test_a_world_of_ones_own_may_use_such_a_name_for_itself():
    world = Own()
    world.reset(seed=0)
    world.step(2)
    world.anything = 1
    assert world.rooms == 3
    del world.rooms
    assert world.rooms == [world.room]
    with pytest.raises(WorldError, match="cannot be deleted"):
        del world.rooms


def test_rooms_things_and_the_eye_answer_to_miniworlds_names(world):
    room = world.rooms[0]
    assert (room.mid_x, room.mid_z, room.area, room.num_walls, room.neighbors) == (-4, 4, 36, 4, [])
    assert room.point_inside(np.array([-4, 0, 4]))
    assert not room.point_inside((room.min_x, 0, 4))
    assert room.edge_dirs.tolist() == [[0, 0, -1], [-1, 0, 0], [0, 0, 1], [1, 0, 0]]
    assert (room.edge_norms[0] == [-1, 0, 0]).all()
    assert (room.wall_tex_name, room.floor_tex_name, room.no_ceiling) == (room.wall, room.floor, room.ceiling is None)
    agent = Agent()
    agent.pos, agent.dir, agent.cam_fwd_disp, agent.cam_pitch = np.array([1.0, 0.0, 2.0]), math.pi / 2, 0.5, 30.0
    assert agent.pos == (1.0, 0.0, 2.0)
    assert np.allclose(agent.dir_vec, (0, 0, -1))
    assert np.allclose(agent.right_vec, (1, 0, 0))
    assert np.allclose(agent.cam_pos, (1, 1.5, 1.5))
    assert np.allclose(agent.cam_dir, (0, 0.5, -math.sqrt(0.75)))
    assert (world.box.color, world.box.is_static, world.box.color_vec.tolist()) == ("red", False, [1, 0, 0])
    assert (world.obs_disp_width, world.obs_disp_height, world.reward_range) == (256, 192, (-math.inf, math.inf))


def test_the_agent_is_moved_and_turned_as_steps_do_it():
    by_hand, by_steps = (gymnasium.make("minihuman/MiniWorld-Hallway-v0").unwrapped for _ in range(2))
    for seed in range(3):
        by_hand.reset(seed=seed)
        by_steps.reset(seed=seed)
        for action in (0, 2, 2, 1, 2, 1, 1, *(2,) * 30):
            by_steps.step(action)
            if action == 2:
                by_hand.move_agent(0.15, 0)
            else:
                by_hand.turn_agent(15 if action == 0 else -15)
            assert by_hand.agent.pos == by_steps.agent.pos
            assert by_hand.agent.dir == by_steps.agent.dir
        assert not all(by_hand.move_agent(0.5, 0) for _ in range(40))  # there are walls


def test_what_is_carried_moves_and_turns_along_and_may_be_in_the_way():
    world = gymnasium.make("minihuman/MiniWorld-PickupObjects-v0").unwrapped
    world.reset(seed=3)
    thing = world.entities[0]
    world.agent.carrying = thing
    rng, outcomes = np.random.default_rng(0), []
    for _ in range(120):
        before = world.agent.pos, world.agent.dir, thing.pos
        amount = float(rng.uniform(-0.5, 1.0))
        is_done = world.turn_agent(90 * amount) if rng.integers(2) else world.move_agent(amount, 0.1)
        outcomes.append(is_done)
        if is_done:
            assert thing.pos == tuple(world._get_carry_pos(world.agent.pos, thing))
        else:
            assert (world.agent.pos, world.agent.dir, thing.pos) == before
    assert {*outcomes} == {True, False}


def test_settings_count_from_the_next_step_on():
    env = gymnasium.make("minihuman/MiniWorld-Hallway-v0", disable_env_checker=True)
    world = env.unwrapped
    env.reset(seed=1)
    env.step(2)
    heading = world.agent.dir
    world.params.set("turn_step", 45)
    env.step(0)
    assert world.agent.dir == heading + math.pi / 4
    assert (world.params.get_max("turn_step"), world.params.sample(None, "turn_step")) == (45, 45)
    world.max_episode_steps = 4
    assert [env.step(np.array([0]))[3] for _ in range(2)] == [False, True]
    env.reset(seed=1)
    world.step_count = 2
    assert [env.step(0.0)[3] for _ in range(2)] == [False, True]
    bright = world.render_obs().mean()
    world.light_ambient, world.light_color = [0, 0, 0], (0, 0, 0)
    assert world.render_obs().mean() < bright / 3


def test_parameters_of_miniworlds_form_make_a_world():
    table = gymnasium.make("minihuman/MiniWorld-Hallway-v0").unwrapped.params.no_random()
    table.set("forward_step", 0.7)
    world = gymnasium.make("minihuman/MiniWorld-Hallway-v0", params=table).unwrapped
    world.reset(seed=0)
    x = world.agent.pos
    world.step(2)
    assert math.dist(x, world.agent.pos) == pytest.approx(0.7)
    assert world.params.params["sky_color"].min.tolist() == [0.25, 0.82, 1.0]
    world.params = world.params.copy()
    with pytest.raises(WorldError, match="params is 3"):
        world.params = 3


@pytest.mark.parametrize(
    ("name", "setting", "message"),
    [
        ("max_episode_steps", 0, "max_steps is 0"),
        ("rooms", [], r"cannot be set; write build\(\)"),
        ("obs_fb", None, "give obs_width and obs_height when the world is made"),
        ("max_episode_step", 3, "no attribute 'max_episode_step' to set, so setting it would do nothing"),
        ("move_agent", len, r"move_agent\(\) of .* cannot be replaced"),
        ("window", None, "render_mode='human'"),
    ],
)
def test_what_would_do_nothing_is_refused(world, name, setting, message):
    with pytest.raises(WorldError, match=message):
        setattr(world, name, setting)


def test_what_has_no_meaning_here_names_what_to_use(world):
    with pytest.raises(AttributeError, match=r"color of <red box at .*> cannot be set; place another Box\('blue'\)"):
        world.box.color = "blue"
    with pytest.raises(AttributeError, match="nothing here is drawn by OpenGL"):
        _ = world.shadow_window
    with pytest.raises(AttributeError, match=r"'add_portal'; call open\(\)"):
        world.rooms[0].add_portal(0)
    with pytest.raises(AttributeError, match="only actions move things"):
        world.box.step(1)
    with pytest.raises(WorldError, match=r"map\(\) has the coordinates"):
        world.render_top_view(return_scale=True)


def test_the_human_mode_shows_every_reset_and_step_without_a_warning(monkeypatch, recwarn):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    env = gymnasium.make("minihuman/MiniWorld-Hallway-v0", render_mode="human", window_width=80, window_height=60)
    shown = []
    drawn = env.unwrapped._rendered
    monkeypatch.setattr(type(env.unwrapped), "_rendered", lambda self: shown.append(1) or drawn())
    env.reset(seed=0)
    env.step(2)
    assert env.render() is None
    assert len(shown) == 3
    env.close()
    assert [warning for warning in recwarn if "render" in str(warning.message)] == []


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
