"""Reading: a session as it was played, and one clear sentence about every file that is not one."""

import dataclasses
import gc
import itertools
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
import numpy as np
import pytest
from mcap.records import Metadata
from mcap.writer import Writer

from minihuman.errors import LogError
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyPressed,
    Noted,
    Paused,
    Resumed,
    SessionStarted,
    Stepped,
)
from minihuman.log import topics
from minihuman.log.model.session_log import pose_as_row
from minihuman.log.names import SEGMENT_METADATA
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner
from tests.log.played import record
from tests.log.samples import STARTED_NS, session_events, session_plan

PLAN = session_plan(episodes=3)
EVENTS = session_events(PLAN, steps=20)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return record(tmp_path, PLAN, EVENTS)


def test_a_session_reads_as_it_was_played(log: Path) -> None:
    session = read_log(log)
    assert session.plan == PLAN
    assert (session.player, session.clean, session.end_reason) == ("human", True, "complete")
    assert session.started_at == "2026-09-21T14:13:20.000000000Z"
    assert [episode.outcome for episode in session.episodes] == ["goal"] * 3
    assert sum(isinstance(note, Paused) for note in session.notes) == 3
    assert sum(isinstance(note, Resumed) for note in session.notes) == 3
    assert sum(isinstance(note, Noted) for note in session.notes) == 1
    assert len(session.keys) == 3 * 20 * 2


def test_a_session_that_was_read_is_freed_without_the_collector(log: Path) -> None:
    assert len(read_log(log).episodes[0].frames.column("flip_ns")) > 0  # what is made once is made
    gc.collect()
    gc.disable()
    try:
        session = read_log(log)
        assert len(session.keys) + len(session.episodes[0].frames.column("flip_ns")) > 0
        del session
        assert gc.collect() == 0
    finally:
        gc.enable()


def test_an_episode_reads_as_columns_of_equal_length(log: Path) -> None:
    episode = read_log(log).episodes[1]
    steps = [event for event in EVENTS if isinstance(event, Stepped) and event.episode == 1]
    assert episode.poses.shape == (21, 4)
    assert np.array_equal(episode.poses[0], [1, 0, 1, 0])
    assert episode.t_ns[1:].tolist() == [step.t_ns for step in steps]
    assert episode.actions.tolist() == [2] * 20
    assert episode.rewards.tolist() == [0.0] * 19 + [0.9]
    assert episode.terminated.tolist() == [False] * 19 + [True]
    assert episode.rt_ms.tolist() == [290.5] * 20
    assert episode.state_hashes.tolist() == [11, *(2**64 - number for number in range(1, 21))]
    assert episode.step_keys == ("7",) * 20
    assert len(episode.frames) == 20
    assert len(episode.keys) == 40


def test_a_live_file_reads_up_to_now(tmp_path: Path) -> None:
    recorder = McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS)
    recorder.write(EVENTS[:30])
    recorder.drain()
    session = read_log(recorder.segment_path.part)
    assert (session.clean, session.end_reason, session.episodes[0].outcome) == (False, "cut_off", None)
    assert list(read_events(recorder.segment_path.part)) == EVENTS[:30]
    recorder.close()


def test_a_session_folder_reads_as_its_session(log: Path) -> None:
    assert len(read_log(log.parent).episodes) == 3


def test_a_path_may_be_text(log: Path) -> None:
    assert read_log(str(log)).path == read_log(log).path


def test_reading_changes_nothing(log: Path) -> None:
    before = (log.read_bytes(), log.stat().st_mtime_ns)
    read_log(log)
    assert (log.read_bytes(), log.stat().st_mtime_ns) == before
    assert [path.name for path in log.parent.iterdir()] == [log.name]


def test_a_cut_off_finished_log_is_named(log: Path) -> None:
    whole = log.read_bytes()
    for cut in (10, 1000, len(whole) // 2, len(whole) - 1):
        log.write_bytes(whole[:cut])
        with pytest.raises(LogError, match=r"sub-07_ses-01\.mcap is .*cut off (at byte|within its index)"):
            read_log(log)


def test_a_damaged_finished_log_is_named(log: Path) -> None:
    whole = log.read_bytes()
    (end,) = struct.unpack_from("<Q", whole, len(whole) - 8 - 20)  # the footer: where the index starts
    rng = np.random.default_rng(3)
    for at in rng.integers(9, end - 13, 30):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        log.write_bytes(damaged)
        with pytest.raises(LogError, match=r"sub-07_ses-01\.mcap is (damaged|cut off)"):
            read_log(log)


def test_an_empty_file_is_named(tmp_path: Path) -> None:
    empty = tmp_path / "empty.mcap"
    empty.touch()
    with pytest.raises(LogError, match=r"empty\.mcap is empty; to keep the intact part"):
        read_log(empty)
    part = tmp_path / "empty.mcap.part"
    part.touch()
    with pytest.raises(LogError, match=r"empty\.mcap\.part was cut off before its session started"):
        read_log(part)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"none\.mcap cannot be opened: No such file"):
        read_log(tmp_path / "none.mcap")


def test_a_file_that_is_no_mcap_is_named(tmp_path: Path) -> None:
    text = tmp_path / "notes.mcap"
    text.write_text("dear diary")
    with pytest.raises(LogError, match=r"notes\.mcap is not a session log"):
        read_log(text)


def test_another_programs_mcap_is_named(tmp_path: Path) -> None:
    foreign = tmp_path / "robot.mcap"
    _foreign(foreign, metadata=None)
    with pytest.raises(LogError, match=r"robot\.mcap is not a minihuman log"):
        read_log(foreign)


@pytest.mark.parametrize("version", ["4", "4.1"])
def test_another_schema_version_is_refused_in_one_sentence(tmp_path: Path, version: str) -> None:
    other = tmp_path / "other.mcap"
    _foreign(other, metadata={"schema_version": version, "minihuman": "9.9"})
    with pytest.raises(LogError, match=rf"minihuman \(9\.9, log schema version {version}; .* up to 3\)"):
        read_log(other)


@pytest.mark.parametrize("version", ["0", "one", "1.x"])
def test_a_version_that_never_was_is_named(tmp_path: Path, version: str) -> None:
    other = tmp_path / "other.mcap"
    _foreign(other, metadata={"schema_version": version, "minihuman": "9.9"})
    with pytest.raises(LogError, match=rf"log schema version {version}, which is not valid"):
        read_log(other)


def _foreign(path: Path, *, metadata: dict[str, str] | None) -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        if metadata is not None:
            writer.add_metadata(SEGMENT_METADATA, metadata)
        schema = writer.register_schema("robot", "jsonschema", b"{}")
        writer.add_message(writer.register_channel("/robot", "json", schema), 0, b"{}", 0)
        writer.finish()


def test_a_second_segment_that_has_no_plan_yet_changes_nothing(log: Path) -> None:
    recorder = McapRecorder(log.parents[3], session_plan(episodes=3, segment=2), started_ns=STARTED_NS)
    recorder.write(session_events(session_plan(episodes=3, segment=2))[:1])
    recorder.drain()
    part = log.with_name("sub-07_ses-01_seg-02.mcap.part")
    start = part.read_bytes()[:900]
    recorder.close()
    log = record(log.parents[3] / "other", PLAN, EVENTS)
    log.with_name(part.name).write_bytes(start)
    session = read_log(log.parent)
    assert (session.clean, len(session.episodes)) == (True, 3)


def test_a_missing_step_is_named(tmp_path: Path) -> None:
    gap: list[Event] = [e for e in EVENTS if not (isinstance(e, Stepped) and (e.episode, e.step) == (1, 5))]
    log = record(tmp_path, PLAN, gap)
    with pytest.raises(LogError, match="episode 2 step 6 follows episode 2 step 4"):
        read_log(log)


@pytest.mark.parametrize(("topic", "opens"), [(topics.STEP, False), (topics.KEY, False), (topics.FRAME, True)])
def test_a_message_that_cannot_be_read_is_named(log: Path, tmp_path: Path, topic: str, opens: bool) -> None:
    """Pictures are not looked at before somebody asks for them."""
    foreign = tmp_path / "foreign.mcap.part"
    with foreign.open("wb") as file:
        _with_garbage(log, topic, file)
    with pytest.raises(LogError, match=f"a message on {topic} cannot be read: .* is truncated"):
        list(read_log(foreign).episodes[1].frames)
    if opens:
        assert len(read_log(foreign).episodes[1].frames) == 20
    else:
        with pytest.raises(LogError):
            read_log(foreign)


def _with_garbage(log: Path, topic: str, file: BinaryIO) -> None:
    """The same log, but one message on a topic is cut off."""
    scan, writer = LogScanner(log), Writer(file)
    writer.start()
    channels: dict[str, int] = {}
    for message in scan:
        if isinstance(message, Metadata):
            writer.add_metadata(message.name, message.metadata)
        if isinstance(message, LogMessage):
            name = message.channel.topic
            data = message.data[:-1] if name == topic and topic in channels else message.data
            if name not in channels:
                schema = scan.schemas[message.channel.schema_id]
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[name] = writer.register_channel(name, message.channel.message_encoding, number)
            writer.add_message(channels[name], message.log_time, data, message.publish_time, message.sequence)
    writer.finish()


def test_a_folder_with_no_session_or_several_is_named(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="contains 0 session logs"):
        read_log(tmp_path)
    for name in ("a.mcap", "b.mcap"):
        (tmp_path / name).touch()
    with pytest.raises(LogError, match="contains 2 session logs"):
        read_log(tmp_path)


def in_session_time(events: Iterable[Event], starts_ns: list[int]) -> Iterator[Event]:
    """Events as they were logged, each segment's times from 0, told on the session's clock."""
    segment = -1
    for event in events:
        segment += isinstance(event, SessionStarted)
        times = [name for name in ("t_ns", "key_t_ns", "submit_ns", "flip_ns") if hasattr(event, name)]
        yield dataclasses.replace(event, **{name: getattr(event, name) + starts_ns[segment] for name in times})


def test_columns_hold_what_the_events_say(tmp_path: Path) -> None:
    """The quick way, by columns, against the plain one: a session in two segments, a missing pose, keys in between."""
    between = KeyPressed(0, "x", "x", True, None, "not_playing", "rest")
    first: list[Event] = []
    for event in session_events(PLAN, steps=20):
        blind = isinstance(event, Stepped) and event.step % 7 == 3
        first.append(dataclasses.replace(event, pose=None, rt_ms=None) if blind else event)
        if isinstance(event, EpisodeEnded):
            first.append(dataclasses.replace(between, t_ns=event.t_ns))
    (cut,) = (at for at, e in enumerate(first) if isinstance(e, Stepped) and (e.episode, e.step) == (1, 9))
    record(tmp_path, PLAN, first[: cut + 1])
    again = msgspec.structs.replace(session_plan(episodes=3, segment=2), first_episode=1)
    log = record(tmp_path, again, session_events(again, steps=6))
    session = read_log(log)
    events = list(in_session_time(read_events(log), [segment.start_ns for segment in session.segments]))
    assert list(session.keys) == [event for event in events if isinstance(event, KeyPressed)]
    assert [episode.segment for episode in session.episodes] == [1, 1, 2, 2]
    assert [(episode.number, episode.attempt) for episode in session.episodes] == [(1, 1), (2, 1), (2, 2), (3, 1)]
    assert session.segments[1].start_ns == session.segments[0].end_ns + 1  # as the wall clock had not moved
    assert (np.diff(np.concatenate([episode.t_ns for episode in session.episodes])) > 0).all()
    assert [episode.outcome for episode in session.episodes] == ["goal", None, "goal", "goal"]
    starts = [place for place, event in enumerate(events) if isinstance(event, EpisodeStarted)]
    assert len(starts) == len(session.episodes)
    for episode, begin in zip(session.episodes, starts, strict=True):
        within = list(itertools.takewhile(lambda e: not isinstance(e, EpisodeEnded | SessionStarted), events[begin:]))
        steps = [event for event in within if isinstance(event, Stepped)]
        moments: list[Any] = [within[0], *steps]
        assert episode.start == within[0]
        assert list(episode.keys) == [event for event in within if isinstance(event, KeyPressed)]
        assert list(episode.frames) == [event for event in within if isinstance(event, FrameShown)]
        assert episode.keys.column("verdict") == [key.verdict for key in episode.keys]
        assert episode.step_keys == tuple(step.key for step in steps)
        assert np.array_equal(episode.poses, [pose_as_row(event.pose) for event in moments], equal_nan=True)
        assert np.array_equal(episode.rt_ms, [s.rt_ms or np.nan for s in steps], equal_nan=True)
        assert episode.t_ns.tolist() == [event.t_ns for event in moments]
        assert episode.state_hashes.tolist() == [event.state_hash for event in moments]
        assert episode.observation_hashes.tolist() == [event.observation_hash for event in moments]
        for name, field in (("actions", "action"), ("key_t_ns", "key_t_ns"), ("rewards", "reward")):
            assert getattr(episode, name).tolist() == [getattr(step, field) for step in steps]
        assert episode.terminated.tolist() == [step.terminated for step in steps]
        assert episode.truncated.tolist() == [step.truncated for step in steps]
