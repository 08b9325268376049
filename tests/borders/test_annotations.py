"""Annotations that somebody wrote by hand, with numbers that no session has: named, and without effect."""

from pathlib import Path

import pytest

from minihuman import api
from minihuman.admin.status import format_status
from minihuman.dataset.annotations import annotations_path
from tests.builders import session, write_log

NUMBERS = ("99999999999999999999", "-1", "0", "9223372036854775808", "1000001", "-99999999999999999999999")


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")


@pytest.mark.parametrize("number", NUMBERS)
def test_an_annotation_of_an_episode_that_is_none_is_named_and_excludes_nothing(
    log: Path, tmp_path: Path, number: str
) -> None:
    study = log.parents[2]
    annotations_path(log).write_text(f'{{"tag":"exclude","at":"now","episode":{number}}}\n')
    assert api.export("csv", study, tmp_path / "out").episodes == 2
    assert "has no effect" in "\n".join(format_status(study))
    lines = [line.text for line in api.verify(log) if "has no effect" in line.text and not line.ok]
    assert [f"of episode {number[:12]}" in line for line in lines] == [True]


@pytest.mark.parametrize("number", ["1e999", "NaN", '"1"', "1.5", "[1]", "1" * 5000])
def test_an_annotation_that_cannot_be_read_is_named_without_a_traceback(log: Path, tmp_path: Path, number: str) -> None:
    other = write_log(session(participant="sub-02", index=1, blocks=("grid",), episodes=2), tmp_path / "data")
    annotations_path(log).write_text(f'{{"tag":"exclude","at":"now","episode":{number}}}\n')
    exported = api.export("csv", other.parents[2], tmp_path / "out")
    assert exported.episodes in (2, 4)
    assert exported.episodes == 4 or any("marks.jsonl" in note for note in exported.notes)
