"""The same seed and actions give the same level as in Minigrid: what is seen, said, earned, and drawn."""

import gymnasium
import minigrid  # noqa: F401  # registers the worlds we compare with
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.worlds.catalogue import BABYAI_WORLDS
from minihuman.worlds.grid.babyai.exploring_expert import Explorer
from tests.counts import count

NAMES = sorted(name for name in gymnasium.registry if name.startswith("BabyAI-"))
SEEDS = count(1, 20)
STEPS = count(30, 87)  # 96 worlds x 20 seeds x 3 policies x 87 steps are over 5e5
AT_RANDOM = (0.2, 0.2, 0.4, 0.05, 0.05, 0.05, 0.05)
HANDY = (0.12, 0.12, 0.28, 0.17, 0.13, 0.17, 0.01)  # picks up, drops and toggles often

pytestmark = [pytest.mark.filterwarnings("ignore:.*out of date")]


EXPERTS = {}  # of each world, as long as its episode lasts


def at_random(env, chance):
    return int(chance.choice(7, p=AT_RANDOM))


def handily(env, chance):
    return int(chance.choice(7, p=HANDY))


def as_told(env, chance):
    """The exploring expert, which slips now and then."""
    if env.state.step == 0:
        EXPERTS[env] = Explorer(env.state)
    action = EXPERTS[env].action(env.state)
    return int(chance.integers(7)) if action is None or chance.random() < 0.05 else action


def assert_same(ours, theirs, seen, expected):
    np.testing.assert_array_equal(seen["image"], expected["image"])
    assert (seen["direction"], seen["mission"]) == (expected["direction"], expected["mission"])
    assert ours.np_random.bit_generator.state == theirs.np_random.bit_generator.state
    assert ours.max_steps == theirs.max_steps
    state, held = ours.state, theirs.carrying
    np.testing.assert_array_equal(
        np.stack([state.kinds, state.colours, state.cells >> 7 & 3], -1), theirs.grid.encode()
    )
    assert (state.carrying != 1) == (held is not None)


def play(name, policy, seeds, steps):
    """Play both worlds from each seed; after an end they go on with the random stream, until the steps are made."""
    ours, theirs = gymnasium.make(f"minihuman/{name}").unwrapped, gymnasium.make(name).unwrapped
    chance = np.random.default_rng([seeds, steps])
    compared = 0
    for seed in range(seeds):
        seen, expected = ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0]
        assert_same(ours, theirs, seen, expected)
        for _ in range(steps):
            action = policy(ours, chance)
            one, other = ours.step(action), theirs.step(action)
            np.testing.assert_array_equal(one[0]["image"], other[0]["image"])
            assert (one[0]["direction"], one[0]["mission"]) == (other[0]["direction"], other[0]["mission"])
            assert one[1:4] == other[1:4]
            compared += 1
            if one[2] or one[3]:
                assert_same(ours, theirs, one[0], other[0])
                seen, expected = ours.reset()[0], theirs.reset()[0]
                assert_same(ours, theirs, seen, expected)
    return compared


def test_the_catalogue_has_every_babyai_world():
    ours = {entry.name for entry in BABYAI_WORLDS}
    assert len(NAMES) == 96
    assert set(NAMES) <= ours


@pytest.mark.parametrize("policy", [at_random, handily, as_told])
@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_and_actions_give_the_same_episodes(name, policy):
    assert play(name, policy, SEEDS, STEPS) > 0
