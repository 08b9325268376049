"""Curricula choose the levels that they say."""

from collections import Counter

import pytest

from minihuman.errors import LearnError
from minihuman.learn.curriculum import make_curriculum
from minihuman.learn.training_settings import TrainingSettings
from minihuman.learn.training_worlds import TrainingLevel


def make(name, n_worlds=2, **settings):
    return make_curriculum(n_worlds, TrainingSettings(curriculum=name, **settings), 5)


def test_uniform_draws_all_worlds_alike_and_a_new_seed_each_time():
    curriculum = make("uniform", 3)
    levels = [curriculum.draw() for _ in range(3000)]
    assert len({level.seed for level in levels}) == 3000
    assert min(Counter(level.world for level in levels).values()) > 900


def test_a_limited_number_of_levels_is_drawn_again():
    curriculum = make("uniform", 1, levels=7)
    assert len({curriculum.draw() for _ in range(500)}) == 7


def test_stages_go_on_when_the_latest_episodes_succeeded():
    curriculum = make("staged", 2, stage_success=0.75, stage_episodes=4)
    for success in (True, True, False, False, True, True):
        level = curriculum.draw()
        assert level.world == 0
        curriculum.finish(level, success)
    curriculum.finish(level, True)  # three of the latest four
    assert curriculum.draw().world == 1
    assert curriculum.describe() == "stage 2 of 2"
    curriculum.finish(level, False)  # an episode of the first world that ended later changes nothing
    for _ in range(9):
        curriculum.finish(curriculum.draw(), True)
    assert curriculum.draw().world == 1, "there is no third"
    with pytest.raises(LearnError, match="name two or more worlds"):
        make("staged", 1)


def test_plr_plays_the_level_with_the_highest_score_again_and_others_when_they_are_stale():
    curriculum = make("plr", replay=1.0, staleness=0.3)
    levels = [TrainingLevel(0, 1), TrainingLevel(1, 2), TrainingLevel(0, 3)]
    for level, score in zip(levels, (0.1, 0.9, 0.5), strict=True):
        curriculum.score(level, score)
    drawn = Counter(curriculum.draw() for _ in range(1000))
    assert set(drawn) == set(levels)
    assert drawn[levels[1]] > 600
    curriculum.score(levels[1], 0.0)
    again = Counter(curriculum.draw() for _ in range(1000))
    assert again[levels[2]] > 600


def test_plr_draws_new_levels_and_forgets_those_that_teach_least():
    curriculum = make("plr", replay=0.5, replay_levels=3)
    for seed in range(10):
        curriculum.score(TrainingLevel(0, seed), seed / 10)
    assert curriculum.describe() == "3 levels to replay"
    drawn = [curriculum.draw() for _ in range(1000)]
    again = [level for level in drawn if level.seed < 10]
    assert {level.seed for level in again} == {7, 8, 9}
    assert 400 < len(again) < 600


@pytest.mark.parametrize("name", ["uniform", "staged", "plr"])
def test_a_restored_curriculum_draws_what_the_saved_one_would_have(name):
    curriculum, other = make(name, stage_episodes=3), make(name, stage_episodes=3)
    for number in range(30):
        level = curriculum.draw()
        curriculum.finish(level, True)
        curriculum.score(level, number / 7)
    other.restore(curriculum.save())
    assert [curriculum.draw() for _ in range(50)] == [other.draw() for _ in range(50)]
    assert curriculum.describe() == other.describe()
