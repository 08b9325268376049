import gymnasium
import pytest

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import BALL, KEY
from minihuman.worlds.grid.missions import COLOUR_WORDS, MissionSpace, kind_words


def test_a_mission_space_holds_its_sentences_and_no_others():
    space = MissionSpace("get the {} {}", COLOUR_WORDS, kind_words(KEY, BALL))
    assert "get the red key" in space
    assert "get the red box" not in space
    assert "get the red key now" not in space
    assert 7 not in space


def test_samples_are_seeded_and_reach_every_sentence():
    space = MissionSpace("get the {} {}", COLOUR_WORDS, kind_words(KEY, BALL), seed=1)
    samples = [space.sample() for _ in range(300)]
    assert len(set(samples)) == 12
    assert all(sample in space for sample in samples)
    space.seed(1)
    assert [space.sample() for _ in range(300)] == samples


def test_equal_spaces_are_those_with_equal_sentences():
    assert MissionSpace("go {}", ["left"]) == MissionSpace("go {}", ["left"])
    assert MissionSpace("go {}", ["left"]) != MissionSpace("go {}", ["right"])
    assert MissionSpace("go") != gymnasium.spaces.Discrete(2)


def test_a_template_and_its_choices_belong_together():
    with pytest.raises(WorldError, match="2 placeholders but 1 lists"):
        MissionSpace("the {} {}", ["red"])
    with pytest.raises(WorldError, match="no mask and no probability"):
        MissionSpace("go").sample(mask=1)


@pytest.mark.parametrize("seed", range(5))
def test_a_worlds_mission_is_one_of_its_space(seed):
    for name in ("Fetch-8x8-N3-v0", "PutNear-8x8-N3-v0", "LockedRoom-v0", "KeyCorridorS3R3-v0"):
        env = gymnasium.make(f"minihuman/MiniGrid-{name}")
        observation, _ = env.reset(seed=seed)
        assert observation["mission"] == env.unwrapped.mission
        assert observation["mission"] in env.observation_space["mission"]
