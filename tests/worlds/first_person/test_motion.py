"""A body moves freely: it slides, passes through nothing, and takes continuous actions that are logged as they were."""

import math

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import minihuman
from minihuman.errors import WorldError
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import UNKNOWN_BOUNDS
from minihuman.worlds.first_person.entities import Box
from minihuman.worlds.first_person.env import FirstPersonEnv

ROOM_M = 6.0
LONGEST_M = 2.0


class Yard(FirstPersonEnv):
    """A square room with a box in its middle."""

    def build(self):
        self.add_rect_room(min_x=0, max_x=ROOM_M, min_z=0, max_z=ROOM_M)
        self.box = self.place_entity(Box("red"), pos=(3.0, 0.0, 3.0), dir=0.0)
        self.place_agent(pos=(1.0, 0.0, 1.0), dir=0.0)


class Cell(FirstPersonEnv):
    """Two rooms with a wall as thin as a line between them."""

    def build(self):
        self.add_rect_room(min_x=0, max_x=3, min_z=0, max_z=3)
        self.add_rect_room(min_x=3, max_x=6, min_z=0, max_z=3)
        self.place_agent(pos=(2.0, 0.0, 1.5), dir=0.0)


def _made(kind=Yard, **options):
    world = kind(trig=1, **options)
    world.reset(seed=1)
    return world


def _overlaps(world):
    agent = world.agent
    return world.stage.blocker(agent, agent.pos[0], agent.pos[2], agent.radius) is not None


def test_a_move_at_an_angle_to_a_wall_slides_along_it():
    world = _made()
    assert world.move(0.5, -2.0)
    x, _, z = world.agent.pos
    assert z == pytest.approx(world.agent.radius, abs=1e-6)
    assert x == pytest.approx(1.5)
    assert not _overlaps(world)


def test_a_move_past_an_entity_goes_around_it():
    world = _made()
    world.agent.pos = (1.5, 0.0, 2.8)
    for _ in range(60):
        world.move(0.1, 0.0)
    assert world.agent.pos[0] > 4.5
    assert not _overlaps(world)


def test_no_move_passes_through_a_thin_wall():
    world = _made(Cell)
    world.move(3.0, 0.0)
    assert world.agent.pos[0] == pytest.approx(3.0 - world.agent.radius, abs=1e-6)


def test_what_is_carried_comes_along_and_must_fit():
    world = _made()
    world.box.pos = (1.8, 0.0, 1.0)
    world.step(world.action_names.index("pickup"))
    assert world.agent.carrying is world.box
    assert world.move(0.0, 0.5)
    assert world.box.pos[0] == pytest.approx(world.stage.carrying_position(world.agent.pos, world.box)[0])
    for _ in range(60):
        world.move(0.1, 0.0)
    assert world.box.pos[0] + world.box.radius <= ROOM_M + 1e-6
    assert not world.move(0.1, 0.0)


@settings(max_examples=25)
@given(st.lists(st.tuples(*[st.floats(-LONGEST_M, LONGEST_M)] * 3), min_size=1, max_size=12), st.integers(0, 50))
def test_no_path_ever_overlaps_anything(moves, seed):
    world = gymnasium.make("minihuman/MiniWorld-RoomObjects-v0", trig=1).unwrapped
    world.reset(seed=seed)
    for dx, dz, dyaw in moves:
        world.move(dx, dz, dyaw)
        assert not _overlaps(world)


@pytest.mark.parametrize(
    ("control", "world", "space", "names"),
    [
        ("continuous", "OneRoom", (2,), ("move_back", "move_forward", "turn_right", "turn_left")),
        ("continuous-strafe", "OneRoom", (3,), ("strafe_left", "strafe_right")),
        ("continuous", "PickupObjects", {"move", "use"}, ("pickup",)),
        ("discrete-strafe", "OneRoom", 5, ("strafe_left", "strafe_right")),
    ],
)
def test_the_control_says_which_actions_there_are(control, world, space, names):
    made = World(f"minihuman/MiniWorld-{world}-v0", {"control": control})
    made.reset(3)
    assert set(names) < set(made.action_names)
    match made.action_space:
        case gymnasium.spaces.Box(shape=shape):
            assert shape == space
        case gymnasium.spaces.Dict(spaces=spaces):
            assert set(spaces) == space
        case gymnasium.spaces.Discrete(n=n):
            assert n == space
    assert not made.is_compiled  # by the host's sine
    assert made.path_length_bounds() == UNKNOWN_BOUNDS


def test_a_continuous_step_is_the_discrete_one_where_they_can_say_the_same():
    discrete = gymnasium.make("minihuman/MiniWorld-OneRoom-v0", trig=1)
    continuous = gymnasium.make("minihuman/MiniWorld-OneRoom-v0", trig=1, control="continuous")
    as_vector = {0: (0.0, 1.0), 1: (0.0, -1.0), 2: (1.0, 0.0)}
    pictures = [discrete.reset(seed=4)[0], continuous.reset(seed=4)[0]]
    for action in (0, 2, 2, 1, 2, 0, 0, 2):
        pictures = [discrete.step(action)[0], continuous.step(np.array(as_vector[action], np.float32))[0]]
        assert (pictures[0] == pictures[1]).all()
    poses = [world.unwrapped.pose() for world in (discrete, continuous)]
    assert poses[0] == poses[1]


def test_an_action_is_rounded_before_it_is_used_and_as_it_is_logged():
    world = World("minihuman/MiniWorld-FourRooms-v0", {"control": "continuous", "trig": 1})
    hashes = []
    for action in ((0.30001, -0.7), (round(0.3 * 1024) / 1024, round(-0.7 * 1024) / 1024)):
        world.reset(1)
        world.step(action)
        hashes.append(world.state_hash())
    assert hashes[0] == hashes[1]
    assert world.actions.resolve((0.30001, -0.7))[1] == (307 / 1024, -717 / 1024)


@pytest.mark.parametrize("action", [(1.5, 0.0), (0.0,), (math.nan, 0.0), 3, "forward"])
def test_an_action_outside_the_space_is_named(action):
    world = _made(control="continuous", actions=("move_forward",))
    with pytest.raises(WorldError, match=r"action is .* it must be in Box"):
        world.step(np.array(action) if isinstance(action, tuple) else action)


def test_who_goes_ahead_and_sideways_is_no_faster():
    world = _made(control="continuous-strafe", actions=("move_forward",))
    before = np.array(world.agent.pos)
    world.step(np.array((1.0, 0.0, 1.0), np.float32))
    assert np.linalg.norm(np.array(world.agent.pos) - before) == pytest.approx(0.15)


def test_a_body_with_acceleration_takes_steps_to_its_speed_and_keeps_it_in_its_state():
    world = _made(control="continuous", actions=("move_forward",), acceleration=0.25)
    ahead = np.array((1.0, 0.0), np.float32)
    x = [world.agent.pos[0]]
    for _ in range(5):
        world.step(ahead)
        x.append(world.agent.pos[0])
    assert np.diff(x) == pytest.approx([0.0375, 0.075, 0.1125, 0.15, 0.15])
    saved = world.save()
    moving = world.state_hash()
    world.step(np.zeros(2, np.float32))
    assert world.state_hash() != moving
    world.restore(saved)
    assert (world.state_hash(), world.velocity) == (moving, (1.0, 0.0))


@pytest.mark.parametrize("control", ["continuous-strafe", "discrete-strafe"])
def test_a_batch_does_what_its_worlds_do_alone(control):
    options = {"control": control, "trig": 1}
    batch = gymnasium.make_vec(
        "minihuman/MiniWorld-PutNext-v0", num_envs=3, vectorization_mode="vector_entry_point", **options
    )
    alone = [gymnasium.make("minihuman/MiniWorld-PutNext-v0", **options) for _ in range(3)]
    pictures, _ = batch.reset(seed=5)
    batch.action_space.seed(2)
    assert all((pictures[i] == world.reset(seed=5 + i)[0]).all() for i, world in enumerate(alone))
    for _ in range(15):
        actions = batch.action_space.sample()
        pictures, rewards, *_ = batch.step(actions)
        for i, action in enumerate(gymnasium.vector.utils.iterate(batch.action_space, actions)):
            picture, reward, *_ = alone[i].step(action)
            assert (picture == pictures[i]).all()
            assert reward == rewards[i]


def test_a_session_with_held_keys_is_recorded_and_proved(tmp_path):
    protocol = tmp_path / "roam.toml"
    protocol.write_text(
        """
[study]
name = "roam"
version = "1"
seed = 3
participants = 2

[[groups]]
name = "everyone"
blocks = ["roam"]

[[blocks]]
name = "roam"
world = "minihuman/MiniWorld-OneRoomS6-v0"
episodes = 1
actions = ["move_forward", "turn_left", "turn_right", "strafe_left"]
noop_action = "rest"
pace = "real_time"
step_period_ms = 33
max_steps = 100
hold = "repeat"
key_map = "constant"

[blocks.options]
control = "continuous-strafe"
acceleration = 0.5
trig = 1
""",
        encoding="utf-8",
    )
    (log,) = minihuman.simulate(protocol, participants=1, data=tmp_path)
    lines = [check.text for check in minihuman.verify(log)]
    assert lines[-1].endswith("all as logged")
