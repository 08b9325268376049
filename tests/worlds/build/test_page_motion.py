"""Free motion in the page's modules: steps and pictures are Python's, and what is restored goes on alike."""

import math

import gymnasium
import numpy as np
import pytest

from tests.counts import count
from tests.machine import needs
from tests.worlds.build.page_cases import Extent, Files, as_action, differing, page_case
from tests.worlds.build.player import page_player

STEPS = count(240, 100_000)  # of each policy, in all worlds together
WORLDS = {  # with what bodies meet, carry and lose there, and what varies
    "OneRoom": {"control": "continuous"},
    "FourRooms": {"control": "continuous-strafe", "acceleration": 0.25},
    "PickupObjects": {"control": "continuous-strafe"},
    "PutNext": {"control": "continuous", "domain_rand": True},
    "CollectHealth": {"control": "continuous", "acceleration": 0.5},
    "RoomObjects": {"control": "discrete-strafe", "domain_rand": True},
}


def _roam(env, rng):
    """Any action."""
    return env.action_space.sample()


def _follow_walls(env, rng):
    """Straight on at full speed for long, so that walls and things are slid along, with a turn now and then."""
    action = env.action_space.sample()
    if isinstance(action, np.integer):
        return 2 if rng.random() < 0.9 else action
    move = action["move"] if isinstance(action, dict) else action
    move[:] = 0.0
    move[0] = 1.0
    move[1] = rng.choice([0.0, 0.0, 0.0, -0.37, 1.0])
    return action


def _seek(env, rng):
    """Towards the nearest thing, with a hand on it where it is near."""
    action = env.action_space.sample()
    if isinstance(action, np.integer):
        return action
    x, _, z = env.agent.pos
    others = [thing for thing in env.entities if thing is not env.agent and thing is not env.agent.carrying]
    near = min(others, key=lambda thing: math.hypot(thing.pos[0] - x, thing.pos[2] - z))
    off = math.remainder(math.atan2(z - near.pos[2], near.pos[0] - x) - env.agent.dir, math.tau)
    move = action["move"] if isinstance(action, dict) else action
    move[:2] = rng.random(), max(-1.0, min(1.0, off / 0.26))
    if isinstance(action, dict) and rng.random() < 0.7:
        is_close = math.hypot(near.pos[0] - x, near.pos[2] - z) < 1.4
        action["use"] = 1 if is_close else 0
    return action


POLICIES = (_roam, _follow_walls, _seek)


def _flat(action):
    """An action in a form for JSON: its number, or the components of its vector one after the other."""
    if isinstance(action, dict):
        return [*action["move"].tolist(), int(action["use"])]
    return int(action) if isinstance(action, int | np.integer) else action.tolist()


def _act(env, policy, n_steps, seed):
    """The actions of a policy in an episode that begins again whenever it ends."""
    rng, actions = np.random.default_rng(seed), []
    env.reset(seed=seed)
    env.action_space.seed(seed)
    first = env.save()
    for _ in range(n_steps):
        actions.append(_flat(policy(env, rng)))
        if any(env.advance(as_action(env, actions[-1]))[1:]):
            env.restore(first)
    return actions


@needs("node")
@pytest.mark.program
@pytest.mark.nightly(sample=True)
def test_free_motion_in_the_page_is_that_of_python_to_the_bit(tmp_path):
    """Three policies, a sample of steps; 100,000 steps of each under MINIHUMAN_NIGHTLY=1."""
    files, cases, expected = Files(tmp_path), [], {}
    extent = Extent(every=20)
    for number, (world, options) in enumerate(WORLDS.items()):
        env = gymnasium.make(f"minihuman/MiniWorld-{world}-v0", trig=1, **options).unwrapped
        for policy in POLICIES:
            name = f"{world} {policy.__name__}"
            actions = _act(env, policy, STEPS // len(WORLDS), number)
            assert env.is_compiled
            case, expected[name] = page_case(env, number, files, name, extent, actions)
            cases.append(case)
    with page_player("node", tmp_path, simd=True) as player:
        player.submit(cases)
        assert differing(expected, player.digests()) == []
    assert len(expected) == len(WORLDS) * len(POLICIES)
