"""Guests: other programs' topics in a log, their files beside it, and topics that a newer version adds."""

from pathlib import Path

import pytest
from mcap.writer import Writer

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.admin.verify.log import find_log_differences, verify_session
from minihuman.dataset.log_files import list_readable_logs
from minihuman.errors import LogError
from minihuman.log.paths import list_sessions
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import find_leftovers, recover_log
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from minihuman.worlds.adapters.world import World
from tests.golden.guests import Guest, again
from tests.golden.make import segment, study

PLAIN = Path(__file__).parents[1] / "golden/v1/resumed/sub-01/ses-01/sub-01_ses-01.mcap"
GUESTS: dict[str, Guest] = {
    "uncounted": lambda ours: 0,
    "counting for itself": lambda ours: ours % 7,
    "now and then": lambda ours: None if ours % 5 else 1,
    "a newer version's own": lambda ours: ours + 1 if ours % 3 == 0 else None,
}


@pytest.mark.parametrize("guest", GUESTS.values(), ids=GUESTS)
def test_a_guests_topic_changes_nothing(tmp_path, guest):
    log = again(PLAIN, tmp_path / "sub-01_ses-01.mcap", guest, version="1.7")
    assert list(read_events(log)) == list(read_events(PLAIN))
    assert verify_episodes(read_log(log)) == verify_episodes(read_log(PLAIN))


@pytest.mark.parametrize("guest", [GUESTS["uncounted"], GUESTS["now and then"]])
def test_a_message_of_ours_that_is_missing_is_still_noticed(tmp_path, guest):
    log = again(PLAIN, tmp_path / "sub-01_ses-01.mcap", guest, leave_out=40)
    with pytest.raises(LogError, match="without messages 40 to 40"):
        read_log(log)


def test_a_session_with_guests_goes_on_and_keeps_them(tmp_path):
    log = segment(tmp_path, study("resumed"), after_steps=6, key="escape")
    again(log, tmp_path / "with", GUESTS["uncounted"]).replace(log)
    gaze = log.with_name("gaze.mcap")
    with gaze.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="gazer")
        writer.finish()
    recording = log.with_name("gaze.mcap.part")  # another recorder's, still writing or broken off
    recording.write_bytes(gaze.read_bytes()[:40])
    before = gaze.read_bytes()
    assert find_leftovers(tmp_path) == []
    assert plan_next_session(study("resumed"), tmp_path, participant="sub-01").segment == 2
    assert segment(tmp_path, study("resumed")) == log
    assert list_sessions(log.parent) == {log: [log]}
    assert list_readable_logs(tmp_path)[0] == [log]
    assert read_log(log.parent).end_reason == "complete"
    guests = [
        record for record in LogScanner(log) if isinstance(record, LogMessage) and record.channel.topic == "/ext/gaze"
    ]
    assert len(guests) > 20
    assert gaze.read_bytes() == before


@pytest.mark.program
@pytest.mark.parametrize("name", ["uncounted", "counting for itself", "now and then"])
def test_a_log_with_guests_proves_whole(tmp_path, name):
    log = segment(tmp_path, study("resumed"), after_steps=6, key="escape")
    again(log, tmp_path / "with", GUESTS[name]).replace(log)
    segment(tmp_path, study("resumed"))
    assert list(find_log_differences(log, World)) == []
    assert list(verify_session(log))[-1][1]


def test_a_recovered_log_keeps_its_guests(tmp_path):
    part = tmp_path / "sub-01_ses-01.mcap.part"
    again(PLAIN, part, GUESTS["uncounted"])
    part.write_bytes(part.read_bytes()[:-2000])
    log = recover_log(part).path
    guests = [
        record for record in LogScanner(log) if isinstance(record, LogMessage) and record.channel.topic == "/ext/gaze"
    ]
    assert len(guests) > 20
    assert read_log(log).episodes


def test_a_renamed_log_of_ours_is_still_one(tmp_path):
    (tmp_path / "copy.mcap").write_bytes(PLAIN.read_bytes())
    assert list_readable_logs(tmp_path)[0] == [tmp_path / "copy.mcap"]
