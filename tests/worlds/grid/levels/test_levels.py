"""What a level can do beside being played: missions set by hand, copies in mid-clause, batches, wrappers, options."""

import json
import pickle
import subprocess
import sys
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings, strategies as st

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import BABYAI_WORLDS
from minihuman.worlds.grid.babyai.encoding import instruction_of
from minihuman.worlds.grid.babyai.expert import plan_instruction
from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.babyai.language import GoTo, ObjectDescription, PutNext, as_tree, clauses, parse
from minihuman.worlds.grid.babyai.level_builder import level
from minihuman.worlds.grid.babyai.levels import LEVELS
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.wrappers import FullyObserved, OneHot, PictureObservation, Tokens, ViewSize
from tests.counts import count

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")

BOSS = "minihuman/BabyAI-MiniBossLevel-v1"


def in_two_clauses(name=BOSS):
    """A world whose mission has two clauses or more, and a way to do it."""
    env = gymnasium.make(name).unwrapped
    for seed in range(50):
        env.reset(seed=seed)
        way = plan_instruction(env.state.row)
        if len(env.subgoals()) > 1 and way.found:
            return env, way.actions
    raise AssertionError("no such mission")


def test_a_mission_is_what_its_sentence_says():
    env = gymnasium.make(BOSS).unwrapped
    for seed in range(count(60, 600)):
        env.reset(seed=seed)
        said = instruction_of(env.state.row)
        assert str(said) == env.mission
        assert parse(env.mission) == said
        assert env.mission in env.observation_space["mission"]
        json.dumps(as_tree(said))


def test_the_tree_of_a_mission():
    assert as_tree(parse("put the blue ball next to a box")) == {
        "do": "PutNext",
        "thing": {"kind": "ball", "colour": "blue", "many": False},
        "other": {"kind": "box", "many": True},
    } or as_tree(PutNext(ObjectDescription("ball", "blue"), ObjectDescription("box")))


@pytest.mark.parametrize("sentence", ["banana", "go to", "go to the red", "fetch a ball", "go to the ball quickly", ""])
def test_what_is_no_mission_is_refused_with_a_reason(sentence):
    with pytest.raises(WorldError, match="mission"):
        parse(sentence)
    assert sentence not in InstructionSpace()


def test_clauses_are_satisfied_one_by_one_and_the_step_is_known():
    env, actions = in_two_clauses()
    done = []
    for action in actions:
        env.step(action)
        done.append([step for _, step in env.subgoals()])
    assert all(
        all(before == 0 or before == after for before, after in zip(a, b, strict=True)) for a, b in pairwise(done)
    )
    assert all(done[-1])


def test_save_and_restore_in_mid_clause():
    env, actions = in_two_clauses()
    half = next(k for k in range(len(actions)) if env.step(actions[k]) and any(step for _, step in env.subgoals())) + 1
    saved, copied = env.save(), pickle.loads(pickle.dumps(env))
    ends = []
    for world in (env, copied, env):
        world.restore(saved)
        ends.append([world.step(action)[1:4] for action in actions[half:]] + [world.state_hash(), world.subgoals()])
    assert ends[0] == ends[1] == ends[2]
    assert ends[0][-3][1]


@pytest.mark.parametrize(
    "name", ["BossLevel-v0", "PutNextS5N2Carrying-v0", "OpenDoorsOrderN4Debug-v1", "UnlockLocal-v0"]
)
def test_a_batch_plays_as_each_would_alone(name):
    n, chance = 6, np.random.default_rng(0)
    batch = gymnasium.make_vec(
        f"minihuman/BabyAI-{name}", num_envs=n, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )
    alone = [gymnasium.make(f"minihuman/BabyAI-{name}") for _ in range(n)]
    seen, _ = batch.reset(seed=3)
    for k, env in enumerate(alone):
        one, _ = env.reset(seed=3 + k)
        np.testing.assert_array_equal(seen["image"][k], one["image"])
        assert seen["mission"][k] == one["mission"]
    over = np.zeros(n, bool)
    for _ in range(40):
        if over.any():
            seen, _ = batch.reset(options={"reset_mask": over})
            for k in np.flatnonzero(over):
                assert alone[k].reset()[0]["mission"] == seen["mission"][k]
        actions = chance.integers(0, 7, n)
        seen, rewards, terminated, truncated, _ = batch.step(actions)
        over = terminated | truncated
        for k, env in enumerate(alone):
            one, reward, end, late, _ = env.step(actions[k])
            np.testing.assert_array_equal(seen["image"][k], one["image"])
            assert (rewards[k], terminated[k], truncated[k]) == (reward, end, late)


def test_a_mission_set_by_hand_is_the_mission():
    env = gymnasium.make("minihuman/BabyAI-GoTo-v0", any_mission=True)
    for mission in ("go to the red ball", "pick up a key, then open a blue door", "put the box next to a green ball"):
        observation, _ = env.reset(seed=1, options={"mission": mission})
        assert observation["mission"] == mission
        assert plan_instruction(env.unwrapped.state.row).found
    observation, _ = env.reset(options={"mission": "go to red ball"})
    assert observation["mission"] in ("go to the red ball", "go to a red ball")


def test_a_mission_of_every_episode():
    env = gymnasium.make("minihuman/BabyAI-GoToLocal-v0", mission="pick up the yellow key")
    assert {env.reset(seed=seed)[0]["mission"] for seed in range(5)} == {"pick up the yellow key"}


@pytest.mark.parametrize(
    ("mission", "said"),
    [
        ("open the red door", "any_mission=True"),
        ("go to the banana", "names no object"),
        ("go to the ball on your left", "any_mission=True"),
        (7, "must be a string"),
    ],
)
def test_a_mission_that_cannot_be_is_refused(mission, said):
    env = gymnasium.make("minihuman/BabyAI-GoToObj-v0")
    with pytest.raises(WorldError, match=said):
        env.reset(seed=0, options={"mission": mission})
    with pytest.raises(WorldError, match="only worlds with instructions"):
        gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").reset(options={"mission": "go to the ball"})


@level(room=6, columns=2, lines=1)
def next_door(builder, num_dists=3):
    """A level of one's own: go to a thing in the other room."""
    left, right = builder.room(0, 0), builder.room(1, 0)
    builder.door(left, "right", locked=False)
    builder.place_agent(left)
    things = builder.things(num_dists, right)
    builder.require_reachable()
    return GoTo(builder.choice(things).thing)


def test_a_level_of_ones_own_is_seven_lines():
    env = GridEnv(next_door, num_dists=2)
    for seed in range(10):
        observation, _ = env.reset(seed=seed)
        assert observation["mission"].startswith("go to ")
        assert plan_instruction(env.state.row).found
    with pytest.raises(WorldError, match="has no option"):
        GridEnv(next_door, doors=2)


@pytest.mark.parametrize("wrap", [PictureObservation, OneHot, FullyObserved, lambda env: ViewSize(env, 9)])
def test_grid_wrappers_fit_levels(wrap):
    env = wrap(gymnasium.make(BOSS))
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    assert env.step(1)[0] in env.observation_space


def test_a_level_from_inside():
    env = gymnasium.make(BOSS, view="first_person")
    grid = gymnasium.make(BOSS)
    env.reset(seed=4)
    grid.reset(seed=4)
    for action in (2, 1, 2, 5, 0, 2):
        inside, plain = env.step(action), grid.step(action)
        assert inside[1:4] == plain[1:4]
    assert inside[0].ndim == 3 if isinstance(inside[0], np.ndarray) else inside[0]["mission"] == plain[0]["mission"]


def test_missions_are_tokens_of_babyais_words():
    env = Tokens(gymnasium.make("minihuman/BabyAI-BossLevel-v0"))
    assert len(env.words) == 33
    for seed in range(20):
        observation, _ = env.reset(seed=seed)
        assert observation in env.observation_space
        said = [env.words[token - 1] for token in observation["mission"] if token]
        assert " ".join(said).replace(" ,", ",") == env.unwrapped.mission


def test_done_has_to_be_said_where_it_is_required():
    env = gymnasium.make("minihuman/BabyAI-OpenTwoDoors-v0", done_required=True).unwrapped
    for seed in range(5):
        env.reset(seed=seed)
        way = plan_instruction(env.state.row)
        assert way.found
        assert way.actions.count(6) == 2
        results = [env.step(action)[1:3] for action in way.actions]
        assert not any(end for _, end in results[:-1])
        assert results[-1][0] > 0


OPTIONS = {
    "room_size": st.integers(-1, 70),
    "num_rows": st.integers(-1, 8),
    "num_cols": st.integers(-1, 8),
    "num_dists": st.integers(-1, 40),
    "num_objs": st.integers(-1, 20),
    "objs_per_room": st.integers(-1, 12),
    "num_doors": st.integers(-1, 6),
    "locked_room_prob": st.sampled_from([-1, 0, 0.5, 1, 2, "x", None]),
    "debug": st.sampled_from([True, False, 1, "yes"]),
    "select_by": st.sampled_from([None, "color", "loc", "size"]),
    "doors_open": st.booleans(),
    "sound": st.booleans(),
    "distractors": st.booleans(),
    "strict": st.booleans(),
    "start_carrying": st.booleans(),
    "locations": st.booleans(),
    "unblocking": st.booleans(),
    "implicit_unlock": st.booleans(),
    "obj_type": st.sampled_from(["key", "ball", "box", "door", "banana", 3]),
    "first_color": st.sampled_from([None, "red", "black"]),
    "second_color": st.sampled_from([None, "blue", 7]),
    "action_kinds": st.sampled_from([("goto",), ("open", "putnext"), (), ("fly",), "goto"]),
    "instr_kinds": st.sampled_from([("action",), ("seq", "and"), ("or",)]),
    "own_steps": st.sampled_from([True, False, 2]),
    "done_required": st.booleans(),
    "any_mission": st.booleans(),
    "mission": st.sampled_from([None, "go to the red ball", "open a door", "banana", 5]),
    "max_steps": st.sampled_from([None, 1, 50, 0, -3, 2.5, "9"]),
}
SCRIPT = """
import json, sys
import minihuman
from minihuman.errors import WorldError
from minihuman.worlds.grid.env import GridEnv
for family, options in json.load(sys.stdin):
    try:
        env = GridEnv(family, **options)
        env.reset(seed=0)
        for action in (2, 1, 2, 5, 3, 2, 4, 0, 2):
            if any(env.step(action)[2:4]):
                break
    except WorldError:
        pass
print("well")
"""


@pytest.mark.program
@settings(max_examples=count(2, 60), deadline=None, suppress_health_check=list(HealthCheck), phases=[Phase.generate])
@given(st.data())
def test_any_options_make_a_world_or_one_line(data):
    drawn = []
    for _ in range(30):
        family = data.draw(st.sampled_from(sorted(LEVELS)))
        names = data.draw(st.lists(st.sampled_from(sorted(OPTIONS)), max_size=4, unique=True))
        drawn.append((family, {name: data.draw(OPTIONS[name]) for name in names}))
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT],
        input=json.dumps(drawn),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stdout.strip() == "well", (done.returncode, done.stderr[-600:], drawn)


def test_every_entry_has_its_summary():
    assert all(entry.summary for entry in BABYAI_WORLDS)
    assert all(clauses(parse(GridEnv(**entry.kwargs).mission)) for entry in BABYAI_WORLDS)
