"""A reviewer's marks."""

import pytest

from minihuman.data.marks import Mark, add_mark, marks_path, read_marks, tags
from minihuman.data.selection import Selection
from minihuman.errors import LogError
from tests.builders import session

AT = "2026-01-06T10:00:00Z"


@pytest.fixture
def log(tmp_path):
    return session(episodes=2, path=tmp_path / "sub-01_ses-01.mcap")


def test_marks_come_back_in_the_order_they_were_made(log):
    marks = (Mark("exclude", AT, episode=3, note="phone rang"), Mark("look-again", AT))
    for mark in marks:
        add_mark(log, mark)
    assert read_marks(log.path) == marks


def test_a_mark_lies_beside_the_log_under_the_same_name_while_it_is_live_and_after(log, tmp_path):
    beside = tmp_path / "sub-01_ses-01.marks.jsonl"
    assert add_mark(log, Mark("exclude", AT, episode=1)) == beside
    for name in ("sub-01_ses-01.mcap.part", "sub-01_ses-01_seg-02.mcap.part", "sub-01_ses-01.mcap"):
        assert marks_path(tmp_path / name) == beside


def test_the_log_itself_is_never_touched(log):
    log.path.write_bytes(b"the log")
    add_mark(log, Mark("exclude", AT, episode=1))
    assert log.path.read_bytes() == b"the log"


def test_a_mark_taken_back_no_longer_counts_but_stays_written(log):
    add_mark(log, Mark("exclude", AT, episode=1))
    add_mark(log, Mark("exclude", AT, episode=1, taken_back=True))
    assert tags(read_marks(log.path)) == {}
    assert len(read_marks(log.path)) == 2


def test_episode_numbers_are_the_screens_and_the_figures(log):
    add_mark(log, Mark("exclude", AT, episode=3))
    assert [episode.number for episode in Selection().judge(log).episodes] == [1, 2, 4]
    only = Selection(only=("exclude",), with_=("exclude",))
    assert [episode.number for episode in only.judge(log).episodes] == [3]


def test_a_mark_on_the_session_covers_every_episode(log):
    add_mark(log, Mark("pilot", AT))
    assert Selection(without=("pilot",)).judge(log).episodes == ()


def test_without_marks_nothing_is_left_out(log):
    assert Selection().judge(log).episodes == log.episodes


@pytest.mark.parametrize(
    ("mark", "word"), [(Mark("exclude", AT, episode=5), "1 to 4"), (Mark("Not good", AT), "no word")]
)
def test_a_mark_that_means_nothing_is_refused_and_not_written(log, mark, word):
    with pytest.raises(LogError, match=word):
        add_mark(log, mark)
    assert not marks_path(log.path).exists()


def test_a_line_that_is_no_mark_is_named(log):
    marks_path(log.path).write_text('{"tag": "exclude", "at": "x"}\nnonsense\n')
    with pytest.raises(LogError, match=r"marks\.jsonl:2: 'nonsense'"):
        read_marks(log.path)
