"""A log at a glance: what its end says is what its messages say, and only a summary that is whole is believed."""

from pathlib import Path

import msgspec
import pytest

from minihuman.admin.session_index import summarize_session
from minihuman.errors import LogError
from minihuman.experiment.machine.events import SessionEnded
from minihuman.log.read.session_reader import read_log
from minihuman.log.salvage.summary_section import read_first_metadata, read_summary
from tests.log.played import record
from tests.log.samples import session_events, session_plan


def resumed(data: Path) -> Path:
    plan = session_plan(episodes=3)
    first = [event for event in session_events(plan, steps=20) if not isinstance(event, SessionEnded)]
    record(data, plan, first[: len(first) // 2])
    again = msgspec.structs.replace(session_plan(episodes=3, segment=2), first_episode=1)
    return record(data, again, session_events(again, steps=6))


@pytest.mark.parametrize("make", [lambda data: record(data, session_plan(), session_events(session_plan())), resumed])
def test_a_summary_at_a_glance_is_the_one_read_message_by_message(tmp_path, monkeypatch, make):
    log = make(tmp_path)
    quickly = summarize_session([log])
    assert read_summary(log) is not None
    monkeypatch.setattr("minihuman.log.salvage.summary_section.read_summary", lambda path: None)
    assert quickly == summarize_session([log])
    assert quickly.episodes_completed == 3


def test_whose_session_it_is_is_known_from_the_first_kilobytes(tmp_path):
    facts = read_first_metadata(record(tmp_path, session_plan(), session_events(session_plan())))
    assert (facts["study"], facts["participant"], facts["session"]) == ("fourrooms", "sub-07", "1")
    (tmp_path / "empty.mcap").touch()
    assert read_first_metadata(tmp_path / "empty.mcap") == read_first_metadata(tmp_path / "none.mcap") == {}


def test_no_changed_byte_of_a_logs_summary_is_passed_over(tmp_path):
    log = record(tmp_path, session_plan(), session_events(session_plan()))
    whole = log.read_bytes()
    summary = len(whole) - summary_bytes(whole)
    for at in range(summary, len(whole), 97):
        log.write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        assert read_summary(log) is None
    for cut in (0, 3, len(whole) // 2, len(whole) - 1):
        log.write_bytes(whole[:cut])
        assert read_summary(log) is None
    assert read_summary(tmp_path / "none.mcap") is None


def test_what_is_changed_between_start_and_summary_is_left_to_who_reads_messages(tmp_path):
    log = record(tmp_path, session_plan(), session_events(session_plan()))
    whole = log.read_bytes()
    said = read_summary(log)
    assert said is not None
    at = whole.index(b"zstd")  # within a chunk
    log.write_bytes(whole[: at + 40] + bytes([whole[at + 40] ^ 1]) + whole[at + 41 :])
    assert read_summary(log) == said
    with pytest.raises(LogError, match="damaged"):
        read_log(log)


def test_a_summary_longer_than_most_is_read_whole(tmp_path, monkeypatch):
    log = record(tmp_path, session_plan(), session_events(session_plan()))
    said = read_summary(log)
    monkeypatch.setattr("minihuman.log.salvage.summary_section._LAST_BYTES", 100)
    assert read_summary(log) == said


def summary_bytes(log: bytes) -> int:
    """How many bytes a log's summary has, its footer and the file's end with it."""
    footer = len(log) - 8 - 20
    return len(log) - int.from_bytes(log[footer : footer + 8], "little")
