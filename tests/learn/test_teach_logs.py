from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import LearnError
from minihuman.learn.teaching.dataset import LessonFragment
from minihuman.learn.teaching.learner import LearningRequest, make_learner
from minihuman.learn.teaching.log_dataset import read_session_dataset, read_study_dataset
from minihuman.learn.teaching.preference_learner import choose_disputed_pair
from minihuman.learn.teaching.provenance import make_policy, reproduce_policy
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate

pytestmark = pytest.mark.program

TAUGHT = Path(__file__).parents[1] / "golden/v1/taught/sub-01/ses-01"
WORLD = "minihuman/MiniGrid-DoorKey-5x5-v0"
PROTOCOL = f"""
[study]
name = "shown"
version = "1.0"
seed = 3
participants = 20

[keys]
pool = ["1", "2", "3", "4", "5", "6"]

[[groups]]
name = "everyone"
blocks = ["doors"]

[[blocks]]
name = "doors"
world = "{WORLD}"
episodes = 3
actions = ["left", "right", "forward", "pickup", "drop", "toggle"]
max_steps = 60
key_map = "shown"
view = "full"
"""


CORRECTED = """
[study]
name = "corrected"
version = "1.0"
seed = 3
participants = 20

[keys]
pool = ["1", "2", "3"]

[[groups]]
name = "everyone"
parts = ["teach", "correct"]

[[blocks]]
name = "teach"
kind = "rating"
world = "minihuman/MiniGrid-Empty-6x6-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 30
key_map = "shown"
[blocks.agent]
policy = "random"

[[activities]]
name = "correct"
kind = "correction"
settings = { source = "teach", episodes = 2, steps = 6 }
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shown")
    (folder / "shown.toml").write_text(PROTOCOL)
    protocol = read_protocol(folder / "shown.toml")
    return list(simulate(protocol, folder, participants=1, player="exploring", seed=1))


def test_what_a_session_showed_is_read_as_the_person_played_it(logs):
    shown = read_session_dataset(logs, "doors", 2)
    assert [lesson.is_demonstration for lesson in shown.lessons] == [True, True]
    assert all(lesson.rewards[-1] > 0 for lesson in shown.lessons)
    assert all(np.all(np.diff(lesson.shown_ns) > 0) for lesson in shown.lessons)
    assert shown.action_names[-1] == "toggle"
    assert [source.sha256 != "" for source in shown.sources] == [True]
    assert len(read_session_dataset(logs, "doors", 3).lessons) == 3
    with pytest.raises(LearnError, match="no step of block 'windows'"):
        read_session_dataset(logs, "windows", 3)


def test_a_policy_is_made_again_from_the_logs_that_it_names(logs, tmp_path):
    made = make_policy(read_session_dataset(logs, "doors", 2), "cloning:updates=10", tmp_path / "policy.pt", seed=1)
    (source,) = made.card.notes["made"]["sources"]
    assert source["name"] == logs[0].name
    assert reproduce_policy(made.path, read_session_dataset(logs, "doors", 2)) == []
    assert "data_sha256" in reproduce_policy(made.path, read_session_dataset(logs, "doors", 3))[0]


def test_a_study_is_read_whole(logs):
    study = read_study_dataset(logs[0].parents[2], WORLD)
    assert [len(lesson.actions) for lesson in study.lessons] == [
        len(lesson.actions) for lesson in read_session_dataset(logs, "doors", 3).lessons
    ]


def test_what_was_compared_reaches_the_learner(tmp_path):
    taught = read_session_dataset(list(TAUGHT.glob("*.mcap")), "takeover", 4)
    assert [each.answer for each in taught.comparisons] == ["left", "left"]
    assert taught.comparisons[1].left == LessonFragment("sub-01_ses-01:2", 0, 2)
    assert taught.comparisons[1].right == LessonFragment("sub-01_ses-01:1", 2, 4)
    made = make_policy(taught, "preferences:reward_updates=2,steps=64,n_steps=64,n_epochs=1", tmp_path / "p.pt", seed=1)
    assert made.card.notes["made"]["comparisons"] == 2
    assert reproduce_policy(made.path, taught) == []


def test_what_was_compared_is_learnt_from_in_another_block_of_the_same_world():
    rating = read_session_dataset(list(TAUGHT.glob("*.mcap")), "rating", 4)
    assert [lesson.name for lesson in rating.lessons] == [f"sub-01_ses-01:{number}" for number in (1, 2, 3, 4)]
    assert (len(rating.comparisons), len(rating.ratings)) == (2, 6)


def test_a_session_is_asked_about_the_pair_on_which_its_answers_leave_most_doubt():
    logs = list(TAUGHT.glob("*.mcap"))
    compared = read_log(TAUGHT).comparisons
    same = (compared[0].left, compared[0].left)  # no model can doubt which of two equal sides is better
    pairs = [same, (compared[0].left, compared[1].right), same]
    assert choose_disputed_pair(logs, "takeover", pairs, seed=1) == 1


def test_what_should_have_been_done_is_read_as_a_lesson_of_its_own(tmp_path):
    (tmp_path / "corrected.toml").write_text(CORRECTED)
    protocol = read_protocol(tmp_path / "corrected.toml")
    logs = list(simulate(protocol, tmp_path, participants=1, player="supervisor", seed=1))
    shown = read_session_dataset(logs, "teach", 2)
    said = read_log(logs[0].parent).corrections
    better = [lesson for lesson in shown.lessons if lesson.corrects is not None]
    assert [lesson.corrects for lesson in better] == [(f"sub-01_ses-01:{each.episode + 1}", each.step) for each in said]
    for lesson, each in zip(better, said, strict=True):
        of = shown.lesson(lesson.corrects[0])
        assert np.array_equal(lesson.actions, each.actions)
        assert np.array_equal(lesson.observations["image"][0], of.observations["image"][each.step])
        assert lesson.by_person.all()
        assert not of.by_person.any()
    assert make_learner("hg-dagger:updates=1").learn(LearningRequest(shown, np.random.default_rng(1))).notes[
        "labelled_steps"
    ] == sum(len(each.actions) for each in said)
