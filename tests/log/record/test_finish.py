"""Finishing: segments become one log, leftovers are found and merged, nothing is lost at any interruption."""

import shutil
from pathlib import Path

import pytest
from mcap.reader import make_reader

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Event, SessionEnded
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.names import END_METADATA
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import CHUNK_BYTES, NotPublishedError, find_leftovers, recover_log
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.log.samples import STARTED_NS, session_events, session_plan

FIRST = session_plan(episodes=3)
SECOND = session_plan(episodes=3, segment=2)
HOUR_NS = 3_600_000_000_000


def _first_events() -> list[Event]:
    """One episode and a half, then the window is closed."""
    whole = session_events(FIRST, steps=8)
    return [*whole[:60], SessionEnded(whole[59].t_ns + 1, "window_closed", "", 1)]


def _record(data: Path, plan: SessionPlan, events: list[Event], *, started_ns: int = STARTED_NS) -> Path:
    recorder = McapRecorder(data, plan, started_ns=started_ns)
    recorder.write(events)
    log = recorder.close()
    assert log is not None
    return log


def _left_over(data: Path, plan: SessionPlan, events: list[Event], *, started_ns: int = STARTED_NS) -> Path:
    """A live file as a killed process leaves it."""
    recorder = McapRecorder(data, plan, started_ns=started_ns)
    recorder.write(events)
    recorder.drain()
    copy = data / "copy"
    shutil.copy(recorder.segment_path.part, copy)
    log_before = recorder.segment_path.log.read_bytes() if recorder.segment_path.log.exists() else None
    recorder.close()
    recorder.segment_path.log.unlink()
    if log_before is not None:
        recorder.segment_path.log.write_bytes(log_before)
    copy.rename(recorder.segment_path.part)
    return recorder.segment_path.part


def test_a_resumed_session_ends_as_one_log_with_both_segments(tmp_path: Path) -> None:
    first, second = _first_events(), session_events(SECOND, steps=8)
    _record(tmp_path, FIRST, first)
    log = _record(tmp_path, SECOND, second, started_ns=STARTED_NS + HOUR_NS)
    assert [path.name for path in log.parent.iterdir()] == ["sub-07_ses-01.mcap"]
    assert list(read_events(log)) == first + second
    session = read_log(log)
    assert (session.clean, session.end_reason) == (True, "complete")
    assert [(episode.plan.episode, episode.segment, episode.outcome) for episode in session.episodes] == [
        (0, 1, "goal"),
        (1, 1, None),
        (0, 2, "goal"),
        (1, 2, "goal"),
        (2, 2, "goal"),
    ]
    assert [facts["segment"] for facts in session.metadata["segments"]] == ["1", "2"]
    assert [facts["reason"] for facts in session.metadata["ends"]] == ["window_closed", "complete"]


def test_a_segment_that_is_in_the_log_is_not_recorded_again(tmp_path: Path) -> None:
    _record(tmp_path, FIRST, _first_events())
    log = _record(tmp_path, SECOND, session_events(SECOND, steps=8), started_ns=STARTED_NS + HOUR_NS)
    with pytest.raises(LogError, match="has segment 2; choose another number with --session, or move the log"):
        McapRecorder(tmp_path, SECOND, started_ns=STARTED_NS + 2 * HOUR_NS)
    assert [path.name for path in log.parent.iterdir()] == [log.name]


def test_while_a_second_segment_is_live_the_first_stays_readable(tmp_path: Path) -> None:
    first, second = _first_events(), session_events(SECOND, steps=8)
    log = _record(tmp_path, FIRST, first)
    recorder = McapRecorder(tmp_path, SECOND, started_ns=STARTED_NS + HOUR_NS)
    recorder.write(second[:20])
    recorder.drain()
    assert recorder.segment_path.part.name == "sub-07_ses-01_seg-02.mcap.part"
    assert list(read_events(log)) == first
    both = read_log(log.parent)
    assert [facts["segment"] for facts in both.metadata["segments"]] == ["1", "2"]
    assert not both.clean
    recorder.close()


def test_a_cut_off_second_segment_is_recovered_into_the_log(tmp_path: Path) -> None:
    first, second = _first_events(), session_events(SECOND, steps=8)
    _record(tmp_path, FIRST, first)
    part = _left_over(tmp_path, SECOND, second[:40], started_ns=STARTED_NS + HOUR_NS)
    assert find_leftovers(tmp_path) == [part]
    finished = recover_log(part)
    assert (finished.steps, finished.end_reason) == (sum(type(e).__name__ == "Stepped" for e in second[:40]), "cut_off")
    assert list(read_events(finished.path)) == first + second[:40]
    assert find_leftovers(tmp_path) == []
    session = read_log(finished.path)
    assert (session.clean, session.end_reason) == (False, "cut_off")


def test_a_finish_that_was_cut_off_before_it_removed_the_live_file_is_not_doubled(tmp_path: Path) -> None:
    events = _first_events()
    part = _left_over(tmp_path, FIRST, events)
    copy = tmp_path / "copy"
    shutil.copy(part, copy)
    log = recover_log(part).path
    before = log.read_bytes()
    copy.rename(part)
    assert recover_log(part).path == log
    assert log.read_bytes() == before
    assert not part.exists()


def test_a_stale_half_finished_file_does_no_harm(tmp_path: Path) -> None:
    part = _left_over(tmp_path, FIRST, _first_events())
    part.with_name("sub-07_ses-01.mcap.finishing").write_bytes(b"half")
    log = recover_log(part).path
    assert list(read_events(log)) == _first_events()
    assert [path.name for path in log.parent.iterdir()] == [log.name]


def test_two_runs_of_one_segment_are_never_merged_over_each_other(tmp_path: Path) -> None:
    part = _left_over(tmp_path, FIRST, _first_events())
    copy = tmp_path / "copy"
    shutil.copy(part, copy)
    part.unlink()
    log = _record(tmp_path, FIRST, session_events(FIRST), started_ns=STARTED_NS + HOUR_NS)
    before = log.read_bytes()
    copy.rename(part)
    with pytest.raises(LogError, match="already has a different segment 1; move that log away, then recover again"):
        recover_log(part)
    assert log.read_bytes() == before
    assert part.exists()


def test_a_damaged_log_is_not_merged_into(tmp_path: Path) -> None:
    log = _record(tmp_path, FIRST, _first_events())
    part = _left_over(tmp_path, SECOND, session_events(SECOND), started_ns=STARTED_NS + HOUR_NS)
    log.write_bytes(log.read_bytes()[:-2000])
    with pytest.raises(LogError, match=r"sub-07_ses-01\.mcap is (cut off|damaged)"):
        recover_log(part)
    assert part.exists()
    assert sorted(path.name for path in log.parent.iterdir()) == [log.name, part.name]


def test_a_file_that_is_gone_or_named_otherwise_is_said(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="does not exist"):
        recover_log(tmp_path / "sub-07_ses-01.mcap.part")
    with pytest.raises(LogError, match="is not a cut-off log"):
        recover_log(tmp_path / "sub-07_ses-01.mcap")


def test_a_finished_log_has_index_checksums_and_large_chunks(tmp_path: Path) -> None:
    log = _record(tmp_path, FIRST, session_events(FIRST, steps=100))
    with log.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == sum(1 for _ in reader.iter_messages())
        assert all(chunk.compression == "zstd" for chunk in summary.chunk_indexes)
        _, *rest = summary.chunk_indexes
        assert len(rest) == 4, "one an episode, and one for what follows the last"
        assert all(chunk.uncompressed_size < CHUNK_BYTES + 1000 for chunk in rest)
        assert {record.name for record in reader.iter_metadata()} >= {END_METADATA}
        attachments = {record.name: record.data for record in reader.iter_attachments()}
    assert attachments["protocol.toml"] == FIRST.protocol_toml
    assert b"numpy==" in attachments["packages.txt"]
    assert b'"0":{"keys":{"3":"left"' in attachments["key_maps.json"]


def test_a_live_file_that_went_on_after_its_segment_was_finished_is_put_aside(tmp_path: Path) -> None:
    events = session_events(FIRST, steps=8)
    log = recover_log(_left_over(tmp_path, FIRST, events[:40])).path
    before = log.read_bytes()
    log.rename(tmp_path / "kept")
    part = _left_over(tmp_path, FIRST, events[:60])
    longer = part.read_bytes()
    (tmp_path / "kept").rename(log)
    finished = recover_log(part)
    assert log.read_bytes() == before
    aside = part.with_name(f"{part.name}.as-found-1")
    assert (finished.damaged, finished.damaged_copy_path) == (True, aside)
    assert "the file was longer than its segment in the log" in finished.describe()
    assert (part.exists(), aside.read_bytes()) == (False, longer)
    assert finished.steps == sum(type(event).__name__ == "Stepped" for event in events[:40])


def test_a_live_file_that_its_log_holds_and_goes_on_after_is_removed(tmp_path: Path) -> None:
    """It was resumed elsewhere from an earlier state: the log has all of it, and more."""
    events = session_events(FIRST, steps=8)
    log = recover_log(_left_over(tmp_path, FIRST, events[:60])).path
    before = log.read_bytes()
    log.rename(tmp_path / "kept")
    part = _left_over(tmp_path, FIRST, events[:40])
    (tmp_path / "kept").rename(log)
    assert not recover_log(part).damaged
    assert [path.name for path in log.parent.iterdir()] == [log.name]
    assert log.read_bytes() == before


def test_a_log_has_its_name_only_once_it_was_published(tmp_path: Path) -> None:
    part = _left_over(tmp_path, FIRST, _first_events())
    log = part.with_suffix("")
    seen = []

    def refuse(unfinished: Path) -> None:
        seen.append(unfinished.name)
        raise NotPublishedError("the database is away")

    with pytest.raises(NotPublishedError, match="the database is away"):
        recover_log(part, refuse)
    assert seen == [f"{log.name}.finishing"]
    assert [path.name for path in log.parent.iterdir()] == [part.name]
    found = []
    recover_log(part, lambda unfinished: found.append((unfinished.read_bytes(), log.exists())))
    assert found == [(log.read_bytes(), False)]


def test_a_recorder_whose_log_was_not_published_can_be_closed_again(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, FIRST, started_ns=STARTED_NS)
    recorder.write(_first_events())

    def refuse(_: Path) -> None:
        raise NotPublishedError("the database is away")

    recorder.publish = refuse
    for _ in range(2):
        with pytest.raises(NotPublishedError):
            recorder.close()
    assert find_leftovers(tmp_path) == [], "it is still locked"
    assert recorder.segment_path.part.exists()
    recorder.publish = lambda _: None
    log = recorder.close()
    assert log is not None
    assert (list(read_events(log)), read_log(log).clean) == (_first_events(), True)
    assert recorder.close() == log


def test_a_recorder_whose_log_was_not_published_can_leave_it(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, FIRST, started_ns=STARTED_NS)
    recorder.write(_first_events())

    def refuse(_: Path) -> None:
        raise NotPublishedError("the database is away")

    recorder.publish = refuse
    with pytest.raises(NotPublishedError):
        recorder.close()
    recorder.leave()
    assert find_leftovers(tmp_path) == [recorder.segment_path.part]
    assert list(read_events(recover_log(recorder.segment_path.part).path)) == _first_events()
