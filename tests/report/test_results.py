import pandas as pd
import pytest

from minihuman.report.published import published
from minihuman.report.results import exclusions, group_rewards, target_block


def test_the_published_subject_means_are_the_papers():
    rows = published().groupby("group")["reward_mean"].apply(list)
    assert rows["Minigrid then Miniworld"] == [0.93, 0.84, 0.74, 0.89, 0.93]
    assert rows["directly Miniworld"] == [0.89, 0.91, 0.94, 0.82, 0.94]
    means = group_rewards(published()).set_index("group")["reward_mean"]
    assert means["Minigrid then Miniworld"] == pytest.approx(0.866)
    assert means["directly Miniworld"] == pytest.approx(0.900)


def test_groups_are_compared_on_the_last_block_they_all_played():
    blocks = pd.DataFrame({"group": ["a", "a", "b"], "block": ["grid", "room", "room"]})
    assert target_block(blocks) == "room"
    assert target_block(blocks.iloc[:0]) == ""


def test_what_was_left_out_is_listed_with_its_reason():
    people = pd.DataFrame({"left_out": ["asleep", None], "participant": ["s1", "s2"], "session": [1, 1]})
    rows = pd.DataFrame(
        {
            "left_out": [None, "slow"],
            "participant": ["s1", "s2"],
            "session": [1, 1],
            "episode": [1, 4],
            "attempt": [1, 1],
        }
    )
    listed = exclusions(rows, people)
    assert listed[["left_out", "level", "participant"]].to_numpy().tolist() == [
        ["asleep", "participant", "s1"],
        ["slow", "episode", "s2"],
    ]
    assert listed["episode"].tolist()[1] == 4
