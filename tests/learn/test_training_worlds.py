"""Worlds to train in: an episode is its level, alone or in a batch, and can be played again to where it was."""

import gymnasium
import numpy as np
import pytest

from minihuman.errors import LearnError
from minihuman.learn.training_settings import WorldChoice
from minihuman.learn.training_worlds import BatchWorlds, TrainingLevel, WorldsInTurn, make_worlds
from minihuman.worlds.adapters.world import World
from tests.worlds.grid.own_world_examples import Patrol

DOOR_KEY = "minihuman/MiniGrid-DoorKey-5x5-v0"
EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"


@pytest.fixture(scope="module", autouse=True)
def patrol():
    gymnasium.register("minihuman-test/Training-Patrol-v0", entry_point=Patrol)
    yield
    del gymnasium.registry["minihuman-test/Training-Patrol-v0"]


CHOICES = {
    "grid": [WorldChoice(DOOR_KEY, {"max_steps": 30})],
    "pictures": [WorldChoice("minihuman/MiniWorld-OneRoom-v0", {"max_steps": 9})],
    "own": [WorldChoice("minihuman-test/Training-Patrol-v0", {"coins_to_collect": 2})],
    "several": [WorldChoice(DOOR_KEY, {"max_steps": 20}), WorldChoice(EMPTY, {"max_steps": 15})],
}


@pytest.mark.parametrize("kind", CHOICES)
def test_each_world_of_a_batch_plays_its_level_as_it_would_alone(kind):
    choices = CHOICES[kind]
    worlds = make_worlds(choices, 3, 1)
    assert isinstance(worlds, WorldsInTurn if kind == "several" else BatchWorlds)
    levels = [TrainingLevel(number % len(choices), 40 + number) for number in range(3)]
    alone = [World(choices[level.world].id, choices[level.world].options).env for level in levels]
    shown = [env.reset(seed=level.seed)[0] for env, level in zip(alone, levels, strict=True)]
    worlds.begin(range(3), levels)
    rng, ended = np.random.default_rng(1), 0
    for step in range(60):
        for number in range(3):
            image = shown[number]["image"] if isinstance(shown[number], dict) else shown[number]
            np.testing.assert_array_equal(worlds.images[number], image)
        actions = rng.integers(0, 3, 3)
        joint_step = worlds.step(actions)
        for number, env in enumerate(alone):
            shown[number], reward, *ends, _ = env.step(int(actions[number]))
            assert (joint_step.rewards[number], joint_step.terminated[number]) == (pytest.approx(reward), ends[0])
            assert joint_step.truncated[number] == ends[1]
            if any(ends):
                ended += 1
                shown[number], _ = env.reset(seed=1000 + step)
                worlds.begin([number], [TrainingLevel(levels[number].world, 1000 + step)])
    assert ended >= 2


@pytest.mark.parametrize("kind", CHOICES)
def test_replaying_brings_every_world_to_where_its_actions_lead(kind):
    worlds, other = (make_worlds(CHOICES[kind], 4, 1) for _ in range(2))
    rng = np.random.default_rng(3)
    levels = [TrainingLevel(number % len(CHOICES[kind]), int(rng.integers(1000))) for number in range(4)]
    playing = [[] for _ in levels]
    worlds.begin(range(4), levels)
    for _ in range(40):
        actions = rng.integers(0, 3, 4)
        joint_step = worlds.step(actions)
        for number, action in enumerate(actions.tolist()):
            playing[number].append(action)
        for number in np.flatnonzero(joint_step.terminated | joint_step.truncated).tolist():
            levels[number], playing[number] = levels[number]._replace(seed=int(rng.integers(1000))), []
            worlds.begin([number], [levels[number]])
    other.replay(levels, playing)
    for _ in range(5):
        np.testing.assert_array_equal(other.images, worlds.images)
        actions = rng.integers(0, 3, 4)
        joint_step = worlds.step(actions)
        other.step(actions)
        if (joint_step.terminated | joint_step.truncated).any():
            break


def test_worlds_that_differ_in_what_they_show_and_teams_among_others_are_refused():
    with pytest.raises(LearnError, match=r"Empty-5x5-v0 has the images \(5, 5, 3\), and .*-v0 has \(7, 7, 3\)"):
        make_worlds([WorldChoice(DOOR_KEY), WorldChoice(EMPTY, {"agent_view_size": 5})], 2, 1)
    with pytest.raises(LearnError, match="is a team world, which is trained in alone"):
        make_worlds([WorldChoice("minihuman/Team-CrampedRoom-v0"), WorldChoice(EMPTY)], 2, 1)
