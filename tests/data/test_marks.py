"""A reviewer's marks."""

import pytest

from minihuman.dataset.annotations import Annotation, add_annotation, annotations_path, collect_tags, read_annotations
from minihuman.dataset.selection import Selection
from minihuman.errors import LogError
from tests.builders import session, session_of

AT = "2026-01-06T10:00:00Z"


@pytest.fixture
def log(tmp_path):
    return session(episodes=2, path=tmp_path / "sub-01_ses-01.mcap")


def test_marks_come_back_in_the_order_they_were_made(log):
    marks = (Annotation("exclude", AT, episode=3, note="phone rang"), Annotation("look-again", AT))
    for mark in marks:
        add_annotation(log, mark)
    assert read_annotations(log.path) == marks


def test_a_mark_lies_beside_the_log_under_the_same_name_while_it_is_live_and_after(log, tmp_path):
    beside = tmp_path / "sub-01_ses-01.marks.jsonl"
    assert add_annotation(log, Annotation("exclude", AT, episode=1)) == beside
    for name in ("sub-01_ses-01.mcap.part", "sub-01_ses-01_seg-02.mcap.part", "sub-01_ses-01.mcap"):
        assert annotations_path(tmp_path / name) == beside


def test_the_log_itself_is_never_touched(log):
    log.path.write_bytes(b"the log")
    add_annotation(log, Annotation("exclude", AT, episode=1))
    assert log.path.read_bytes() == b"the log"


def test_a_mark_taken_back_no_longer_counts_but_stays_written(log):
    add_annotation(log, Annotation("exclude", AT, episode=1))
    add_annotation(log, Annotation("exclude", AT, episode=1, taken_back=True))
    assert collect_tags(read_annotations(log.path)) == {}
    assert len(read_annotations(log.path)) == 2


def test_episode_numbers_are_the_screens_and_the_figures(log):
    add_annotation(log, Annotation("exclude", AT, episode=3))
    assert [episode.number for episode in Selection().judge(log).episodes] == [1, 2, 4]
    only = Selection(only=("exclude",), with_=("exclude",))
    assert [episode.number for episode in only.judge(log).episodes] == [3]


def test_a_mark_on_the_session_covers_every_episode(log):
    add_annotation(log, Annotation("pilot", AT))
    assert Selection(without=("pilot",)).judge(log).episodes == ()


def test_without_marks_nothing_is_left_out(log):
    assert Selection().judge(log).episodes == log.episodes


@pytest.mark.parametrize(
    ("mark", "word"),
    [
        (Annotation("exclude", AT, episode=5), "1 to 4"),
        (Annotation("Not good", AT), "not a valid tag"),
        (Annotation("exlude", AT), "too similar to the built-in tag 'exclude'"),
    ],
)
def test_a_mark_that_means_nothing_is_refused_and_not_written(log, mark, word):
    with pytest.raises(LogError, match=word):
        add_annotation(log, mark)
    assert not annotations_path(log.path).exists()


def test_an_episode_of_a_session_without_episodes_is_refused_in_one_line(tmp_path):
    log = session_of([], path=tmp_path / "one.mcap")
    with pytest.raises(LogError, match="has no episodes; annotate the session without --episode"):
        add_annotation(log, Annotation("exclude", "2026-01-06T10:00:00Z", episode=1))
    assert not annotations_path(log.path).exists()


def test_a_line_that_is_no_mark_is_named(log):
    annotations_path(log.path).write_text('{"tag": "exclude", "at": "x"}\nnonsense\n')
    with pytest.raises(LogError, match=r"marks\.jsonl:2: 'nonsense'"):
        read_annotations(log.path)
