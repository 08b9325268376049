"""The same seed and actions give the same world as in Minigrid, step for step."""

from collections import Counter

import gymnasium
import minigrid  # noqa: F401  # registers the worlds we compare with
import numpy as np
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import GRID_WORLDS
from minihuman.worlds.grid.core.cells import KINDS, kind_of
from minihuman.worlds.grid.core.rewards import DODGE, cell_in_front
from minihuman.worlds.grid.core.rules import ACTION_NAMES
from minihuman.worlds.grid.core.state import TASK
from minihuman.worlds.grid.planner import plan
from tests.counts import count

pytestmark = pytest.mark.nightly(sample=True)

STEPS = count(120, 1500)  # a world and policy; 76 worlds and two policies make over 200,000 in the full count
NAMES = [entry.name for entry in GRID_WORLDS if entry.kwargs.get("family", "wfc") != "wfc"]  # others: test_wfc.py
RESTLESS = (0.15, 0.15, 0.4, 0.1, 0.07, 0.1, 0.03)  # probabilities of the seven actions


@pytest.fixture(scope="module")
def seen(request):
    """What actions did in all steps of this module that were compared, printed at its end."""
    seen = Counter()
    yield seen
    with request.config.pluginmanager.get_plugin("capturemanager").global_and_fixture_disabled():
        print("\nequal to Minigrid's:", in_words(seen))


def in_words(seen):
    return ", ".join(f"{what} x{times}" for what, times in sorted(seen.items()))


def assert_same_grid(ours, theirs):
    codes, grid = ours.unwrapped.state.cells, theirs.unwrapped.grid.encode()
    np.testing.assert_array_equal(np.stack([codes & 15, codes >> 4 & 7, codes >> 7 & 3], -1), grid)


def assert_same(ours, theirs):
    np.testing.assert_array_equal(ours["image"], theirs["image"])
    assert (ours["direction"], ours["mission"]) == (theirs["direction"], theirs["mission"])


def effect(env, action, before):
    """What an action did, in words, for the coverage that is printed."""
    state = env.unwrapped.state
    if state.carrying != before.carrying:
        moved = before.carrying if state.carrying == 1 else state.carrying
        return f"{ACTION_NAMES[action]} {KINDS[kind_of(moved)]}"
    if action == 5:
        x, y = cell_in_front(before.row)
        old, new = before.cells[x, y], state.cells[x, y]
        if old != new:
            return f"toggle {KINDS[kind_of(old)]} {old >> 7 & 3} to {KINDS[kind_of(new)]} {new >> 7 & 3}"
    moved = state.position != before.position or state.direction != before.direction
    return f"{ACTION_NAMES[action]} {'moves' if moved else 'nothing'}"


def play(name, choose, steps, seen):
    """Play both worlds until ``steps`` are compared; two of three episodes go on with the random stream."""
    ours, theirs = gymnasium.make(f"minihuman/{name}"), gymnasium.make(name)
    done, episode = 0, 0
    while done < steps:
        seed = 7 * episode if episode % 3 == 0 else None
        assert_same(ours.reset(seed=seed)[0], theirs.reset(seed=seed)[0])
        assert_same_grid(ours, theirs)
        for action in choose(ours):
            before = type(ours.unwrapped.state)(ours.unwrapped.state.row.copy())
            ours_step, theirs_step = ours.step(action), theirs.step(action)
            assert_same(ours_step[0], theirs_step[0])
            assert ours_step[1:4] == theirs_step[1:4]
            seen["any step"] += 1
            seen[effect(ours, action, before)] += 1
            seen["obstacles move"] += before.row[TASK] == DODGE and bool(
                (ours.unwrapped.state.cells != before.cells).any()
            )
            seen["episode ends"] += ours_step[2] or ours_step[3]
            seen["episode ends with a prize"] += ours_step[1] > 0
            done += 1
            if ours_step[2] or ours_step[3] or done >= steps:
                break
        assert_same_grid(ours, theirs)
        assert ours.unwrapped.np_random.bit_generator.state == theirs.unwrapped.np_random.bit_generator.state
        episode += 1


def at_random(chance):
    def choose(env):
        actions = env.action_space.n
        while True:
            yield int(chance.choice(7, p=RESTLESS)) % actions

    return choose


def as_planned(chance):
    """The expert, where it has a plan for this world, and chance where it has none or has slipped."""

    def choose(env):
        if env.unwrapped.state.row[TASK] != DODGE and env.unwrapped.state.cells.size < 260:
            try:
                for action in plan(env.unwrapped.state, limit=1 << 16) or ():
                    if chance.random() < 0.03:
                        break
                    yield action
            except WorldError:
                pass  # too many things to move for a short search
        yield from at_random(chance)(env)

    return choose


@pytest.mark.filterwarnings("ignore:.*out of date")
@pytest.mark.parametrize("policy", [at_random, as_planned])
@pytest.mark.parametrize("name", NAMES)
def test_the_same_seed_and_actions_give_the_same_episodes(name, policy, seen):
    play(name, policy(np.random.default_rng(1)), STEPS, seen)


@pytest.mark.filterwarnings("ignore:.*out of date")
def test_the_long_chains_are_really_played(capsys):
    seen = Counter()
    for name in (
        "ObstructedMaze-1Dlhb-v0",
        "BlockedUnlockPickup-v0",
        "KeyCorridorS3R2-v0",
        "PutNear-6x6-N2-v0",
        "Playground-v0",
        "GoToObject-8x8-N2-v0",
    ):
        play(f"MiniGrid-{name}", as_planned(np.random.default_rng(2)), 400, seen)
    with capsys.disabled():
        print("\neffects compared:", in_words(seen))
    for what in (
        "pickup key",
        "pickup ball",
        "pickup box",
        "drop key",
        "drop ball",
        "drop box",
        "toggle box 0 to key 0",
        "toggle box 0 to empty 0",
        "toggle door 2 to door 0",
        "toggle door 1 to door 0",
        "toggle door 0 to door 1",
        "forward moves",
        "forward nothing",
    ):
        assert seen[what] > 0, what


def test_the_catalogue_is_every_classic_world():
    theirs = {
        name
        for name, spec in gymnasium.registry.items()
        if str(spec.entry_point).startswith("minigrid.envs:") and "BabyAI" not in name and "WFC" not in name
    }
    assert set(NAMES) == theirs
    assert len(NAMES) == len(theirs) == 76
