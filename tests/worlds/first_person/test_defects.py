"""What Miniworld 2.1 does wrong, as listed in docs/first-person-worlds.md: each row that play can show, pinned."""

import math
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Key
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.layouts.connected_rooms import FourRooms
from minihuman.worlds.first_person.pictures import build_light

DRAW_WITHOUT_A_DISPLAY = """
import sys
import gymnasium, minihuman
env = gymnasium.make("minihuman/MiniWorld-OneRoom-v0")
assert env.reset(seed=0)[0].shape == (60, 80, 3)
print([name for name in sys.modules if name.split(".")[0] in ("pyglet", "OpenGL", "pygame", "moderngl", "miniworld")])
"""


def begun(name: str, **options) -> FirstPersonEnv:
    env = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", obs_width=40, obs_height=30, **options).unwrapped
    env.reset(seed=0)
    return env


@pytest.mark.program
def test_drawing_needs_neither_a_display_nor_a_graphics_library():
    environment = {"PATH": "", "HOME": "/nonexistent"}
    run = subprocess.run(
        [sys.executable, "-c", DRAW_WITHOUT_A_DISPLAY], env=environment, capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == "[]"


@pytest.mark.parametrize("name", ["PickupObjects", "CollectHealth"])
def test_a_thing_that_is_gone_is_gone_from_the_picture_of_that_step(name):
    env = begun(name)
    thing = next(entity for entity in env.entities if not entity.static and entity is not env.agent)
    env.agent.pos, env.agent.dir = (6.0, 0.0, 6.0), 0.0
    for entity in env.entities:  # out of the way, and out of sight
        if entity is not env.agent:
            entity.pos = 1.0, 0.0, 1.0
    without = env.observe()
    thing.pos = env.stage.carrying_position(env.agent.pos, thing)  # where Miniworld's picture still has it
    assert not np.array_equal(env.observe(), without)
    thing.pos = 6.9, 0.0, 6.0
    if name == "CollectHealth":
        env.place_entity = lambda kit: FirstPersonEnv.place_entity(env, kit, pos=(1.0, 0.0, 1.0))  # behind the agent
    seen, reward, *_ = env.step(env.action_names.index("pickup"))
    assert reward > 0
    assert np.array_equal(seen, without)


def test_an_arrival_at_the_last_step_is_rewarded_and_terminates_too():
    env = begun("FourRooms", max_steps=3)
    env.box.pos = env.agent.pos[0] + 1.0, 0.0, env.agent.pos[2]
    env.agent.dir = 0.0
    env.step_count = 2
    _, reward, terminated, truncated, _ = env.step(0)
    assert (reward, terminated, truncated) == (0.8, True, True)


def test_making_a_world_plays_no_episode():
    class Counted(FourRooms):
        built = 0

        def build(self):
            Counted.built += 1
            super().build()

    env = Counted()
    assert Counted.built == 0
    env.reset(seed=0)
    assert Counted.built == 1


@pytest.mark.parametrize("action", [-1, 3, 7])
def test_an_action_that_the_world_lacks_is_refused(action):
    env = begun("FourRooms")
    before = env.state_hash()
    with pytest.raises(WorldError, match="must be a whole number, 0 to 2"):
        env.step(action)
    assert env.state_hash() == before


def test_signs_fourth_action_ends_the_episode_and_steps_back():
    env = begun("Sign")
    x, _, z = env.agent.pos
    env.agent.dir = math.pi / 2
    terminated = env.step(3)[2]
    assert env.action_names[3] == "done"
    assert terminated
    assert env.agent.pos == pytest.approx((x, 0.0, z + 0.7))


def test_sign_can_be_randomised():
    looks = [begun("Sign", domain_rand=seed) for seed in (False, True)]
    signs = [next(entity for entity in env.entities if entity.name == "sign BLUE") for env in looks]
    assert signs[0].variants == (0, 0, 0, 0)
    assert signs[1].variants != (0, 0, 0, 0)


def test_nothing_is_picked_up_next_to_a_wall():
    env = begun("RoomObjects")
    env.agent.radius = 0.4
    key = next(entity for entity in env.entities if isinstance(entity, Key))
    for x, expected in ((5.0, key), (9.8, None)):
        env.agent.pos, env.agent.dir, env.agent.carrying = (x - 0.8, 0.0, 5.0), 0.0, None
        for entity in env.entities:
            if entity is not env.agent:
                entity.pos = 1.0, 0.0, 1.0
        key.pos = x, 0.0, 5.0
        env.step(env.action_names.index("pickup"))
        assert env.agent.carrying is expected


def test_the_radius_of_a_mesh_is_in_single_precision():
    assert isinstance(Key("red").radius, np.float32)


def test_the_lamp_is_a_direction():
    env = begun("OneRoom")
    x, y, z = env.stage.light_pos
    assert build_light(env.stage).towards == (x + 1, y + 1, z + 1)


def test_an_arm_of_ymaze_reaches_into_its_middle():
    env = begun("YMaze")
    hub, left = env.stage.floor.rooms[1].outline, env.stage.floor.rooms[2].outline
    ends = [((a + c) / 2, (b + d) / 2) for (a, b), (c, d), *_ in left.edges]
    ((x, z),) = [end for end in ends if hub.contains(*end)]
    depth = min(nx * (x - ax) + nz * (z - az) for (ax, az), _, _, _, (nx, nz) in hub.edges)
    assert 0.003 < depth < 0.01
