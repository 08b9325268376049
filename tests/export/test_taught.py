"""What an agent and a person did together, and what was compared, in exports."""

from pathlib import Path

import pytest

from minihuman.dataset.selection import Selection
from minihuman.exporters.exporter import export_study

STUDY = Path(__file__).parents[1] / "golden/v1/taught"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    import datasets

    written, _ = export_study("imitation", STUDY, tmp_path_factory.mktemp("taught") / "out", Selection())
    return {path.name: datasets.load_from_disk(str(path)) for path in written.paths}


def test_a_comparison_has_the_steps_of_both_sides_and_which_one_is_preferred(exported):
    episodes, pairs = exported["minigrid-empty-5x5-v0"], exported["minigrid-empty-5x5-v0-preferences"]
    assert pairs["preference"][:] == [1.0, 1.0]  # the left one both times
    whole = [row["acts"] for row in episodes]
    first, second = pairs[0], pairs[1]
    assert (first["left_acts"], first["right_acts"]) == (whole[2][4:7], whole[2][5:8])
    assert (second["left_acts"], second["right_acts"]) == (whole[1][:3], whole[0][2:5])
    assert second["right_obs"] == episodes[0]["obs"][2:6]
    assert second["right_rews"] == episodes[0]["rews"][2:5]
    assert (second["left_terminal"], second["right_terminal"]) == (False, True)  # the episode of five steps ends there


def test_a_study_without_comparisons_has_no_file_of_them(tmp_path):
    written, _ = export_study("imitation", STUDY.parent / "plain", tmp_path / "out", Selection())
    assert [path.name for path in written.paths] == ["minigrid-fourrooms-v0"]
