"""The kitchen against Overcooked-AI: its recordings by the rules of 2019, its own dynamics by those of 1.1.0."""

import os

import numpy as np
import pytest

from minihuman.agents.team_agents import KitchenView
from minihuman.errors import WorldError
from minihuman.worlds.grid.core import kitchen_rules as fields
from minihuman.worlds.grid.kitchen import KITCHENS, Kitchen, KitchenLayout, draw_layout

from . import overcooked

LONG = os.environ.get("MINIHUMAN_NIGHTLY") == "1"
STEPS = 1_000_000 if LONG else 10_000


@overcooked.needs_overcooked
def test_every_recorded_step_of_people_is_stepped_alike_by_the_rules_of_2019():
    kitchens = {old: Kitchen(layout=new, rules="2019") for old, new in overcooked.LAYOUTS.items()}
    for kitchen in kitchens.values():
        kitchen.reset(0)
    rows = different = 0
    for layout, state, actions, after, reward in overcooked.recordings():
        kitchen = kitchens[layout]
        overcooked.write_state(kitchen, state)
        done = kitchen.step([overcooked.action_number(each) for each in actions])
        rows += 1
        same = np.array_equal(kitchen.row[fields.COOK :], overcooked.numbers_of(kitchen, after))
        different += not same or done.rewards != (reward, reward)
    assert (rows, different) == (46_729, 0)


@overcooked.needs_overcooked
@pytest.mark.nightly(sample=True)
def test_random_play_is_stepped_alike_by_the_rules_of_1_1_0():
    different = 0
    for name in overcooked.LAYOUTS.values():
        different += compare_random_play(name, STEPS // len(overcooked.LAYOUTS))
    assert different == 0


@overcooked.needs_overcooked
@pytest.mark.parametrize("name", sorted(KITCHENS.keys() - set(overcooked.LAYOUTS.values())))
def test_every_other_kitchen_is_stepped_alike_too(name):
    assert compare_random_play(name, 20_000 if LONG else 60) == 0


def compare_random_play(name, steps):
    """How many of so many random joint steps differ from the oracle's in state, rewards or observation."""
    mdp = overcooked.dynamics().OvercookedGridworld.from_layout_name(name)
    kitchen, rng = Kitchen(layout=name), np.random.default_rng(len(name))
    start = mdp.get_random_start_state_fn(random_start_pos=kitchen.bodies <= 2, rnd_obj_prob_thresh=0.6)
    np.random.seed(1)  # which the oracle draws its starts from
    different = 0
    for step in range(steps):
        if step % 60 == 0:
            state = start()
            kitchen.reset(0)
            overcooked.write_state(kitchen, state.to_dict())
        numbers = rng.choice(6, kitchen.bodies, p=(0.16, 0.16, 0.16, 0.16, 0.06, 0.3)).tolist()
        state, info = mdp.get_state_transition(state, [overcooked.action_of(each) for each in numbers])
        done = kitchen.step(numbers)
        shaping = tuple(info["shaped_reward_by_agent"])
        same = done.rewards[0] == sum(info["sparse_reward_by_agent"])
        same &= done.info.get("delivered", (0,) * kitchen.bodies) == tuple(info["sparse_reward_by_agent"])
        same &= done.info.get("shaping", (0,) * kitchen.bodies) == shaping
        same &= np.array_equal(kitchen.row[fields.COOK :], overcooked.numbers_of(kitchen, state.to_dict()))
        if step % 20 == 7 and kitchen.bodies == 2:
            seen = mdp.lossless_state_encoding(state, horizon=400 - state.timestep + kitchen.row[fields.STEP])
            same &= all(np.array_equal(kitchen.observation(body), seen[body]) for body in range(2))
        different += not same
    return different


@overcooked.needs_overcooked
def test_the_same_kitchens_are_there_with_the_same_orders():
    for name, layout in KITCHENS.items():
        mdp = overcooked.dynamics().OvercookedGridworld.from_layout_name(name)
        state = mdp.get_standard_start_state()
        for recipe in overcooked.dynamics().Recipe.ALL_RECIPES:
            letters = "".join(sorted(word[0] for word in recipe.ingredients))
            assert mdp.get_recipe_value(state, recipe) == layout.value(letters), (name, letters)
            assert recipe.time == layout.time(letters), (name, letters)


def test_a_floor_plan_of_ones_own_is_a_kitchen():
    kitchen = Kitchen(layout="XPX/O1S/XDX")
    kitchen.reset(0)
    earned = []
    up, down, right, left, _, interact = range(6)
    for action in (
        *[left, interact, up, interact] * 3,
        interact,
        *[4] * 20,
        down,
        interact,
        up,
        interact,
        right,
        interact,
    ):
        earned.append(kitchen.step([action]).rewards[0])
    assert earned == [*[0.0] * (len(earned) - 1), 20.0]


def cook_together(kitchen, alone=False, steps=100):
    """The steps until the first soup, of two cooks or of the first one alone; 0 for none."""
    for step in range(1, steps + 1):
        actions = [KitchenView(kitchen, body).choose()[0] for body in range(2)]
        done = kitchen.step([actions[0], kitchen.idle_action] if alone else actions)
        assert done.terminated == (sum(done.rewards) > 0)
        if done.terminated:
            assert (done.rewards, done.truncated) == ((20.0, 20.0), False)
            return step
    return 0


def test_a_drawn_kitchen_takes_two_cooks_and_ends_at_its_first_soup():
    kitchen, plans, took = Kitchen(layout="drawn", ends_at_soup=True), set(), []
    for seed in range(200):
        kitchen.reset(seed)
        plans.add(kitchen.layout.plan)
        saved = kitchen.save()
        assert cook_together(kitchen, alone=True) == 0, "a soup takes both"
        kitchen.restore(saved)
        took.append(cook_together(kitchen))
        with pytest.raises(WorldError, match="no episode is running"):
            kitchen.step([4, 4])
        kitchen.reset(seed)
        assert np.array_equal(kitchen.save(), saved)
    assert len(plans) == 200
    assert 30 <= min(took) <= max(took) <= 70
    assert draw_layout(1).plan == "XPXXXXX/X  X  D/X  X 1X/X  X  X/S 2X  X/XXXXXOX"


def test_kitchens_that_do_not_begin_and_end_alike_have_no_batch():
    for options in ({"layout": "drawn"}, {"ends_at_soup": True}):
        with pytest.raises(WorldError, match="no batch; step each by itself"):
            Kitchen(**options).batch(2)


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        ("XPX/O S/XDX", "cooks"),
        ("XPX/O1S/XD", "equally long"),
        ("X X/O1S/XDX", "edge"),
        ("XPX/O1Q/XDX", "contain only"),
    ],
)
def test_what_is_no_kitchen_is_refused(plan, why):
    with pytest.raises(WorldError, match=why):
        KitchenLayout(plan)


def test_a_batch_steps_as_single_kitchens_do():
    kitchen, single = Kitchen(max_steps=30), Kitchen(max_steps=30)
    batch = kitchen.batch(3)
    batch.reset(0)
    single.reset(0)
    rng = np.random.default_rng(0)
    for _ in range(70):
        actions = rng.integers(0, 6, (3, 2))
        observations, rewards, ends = batch.step(actions)
        done = single.step(actions[1].tolist())
        assert (tuple(rewards[1]), ends[1]) == (done.rewards, done.truncated)
        if done.truncated:
            single.reset(0)
        assert all(np.array_equal(observations[1, body], single.observation(body)) for body in range(2))
    with pytest.raises(WorldError, match=r"int64\[3, 2\]"):
        batch.step(np.zeros((3, 3), np.int64))
    before = batch.rows.copy()
    with pytest.raises(WorldError, match="kitchen 1 refused"):
        batch.step(np.array([[0, 0], [6, 0], [0, 0]]))
    assert np.array_equal(batch.rows, before)


def test_a_scene_is_the_same_whenever_it_comes_and_its_state_is_not():
    kitchen = Kitchen(max_steps=3)
    kitchen.reset(0)
    scene, state, picture = kitchen.scene_hash(), kitchen.state_hash(), kitchen.frame(0, 200, 160)
    for _ in range(2):
        kitchen.step((fields.STAY, fields.STAY))
        assert kitchen.scene_hash() == scene
        assert kitchen.state_hash() != state
    kitchen.step((fields.RIGHT, fields.STAY))
    assert kitchen.scene_hash() != scene, "a cook has turned, and the episode is over"
    assert not np.array_equal(kitchen.frame(0, 200, 160), picture)
    assert np.array_equal(_begun().frame(0, 200, 160), picture), "what is drawn on is not kept"


def _begun() -> Kitchen:
    kitchen = Kitchen()
    kitchen.reset(0)
    return kitchen
