"""Damage costs what it hits: every flipped bit of a log is noticed, and all that it did not hit is recovered."""

import re
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode

from minihuman.admin.verify.log import verify_session
from minihuman.dataset.log_files import list_readable_logs
from minihuman.errors import DataLossError, LogError
from minihuman.experiment.machine.events import Event
from minihuman.log import codec, names
from minihuman.log.paths import MAGIC
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record import live_log
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.finalization import repair_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.salvage.records import RECORD_HEADER, ChunkMessages
from minihuman.log.salvage.scan import LogScanner
from minihuman.log.salvage.summary_section import read_summary
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan
from tests.promises.sessions import play, study

FLIPS = count(60, 2000)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """600 steps of 12 episodes."""
    return play(tmp_path_factory.mktemp("data"), study(episodes=12, steps=50), sync=lambda _fd: None)


def test_a_log_of_a_newer_version_is_not_taken_for_a_damaged_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as newer:
        newer.setattr(live_log, "find_schema_version", lambda plan, facts: names.SCHEMA_VERSION + 1)
        newer.setitem(codec.DECODERS, names.SCHEMA_VERSION + 1, codec.decode_event)
        log = play(tmp_path, study(episodes=1), sync=lambda _fd: None)
    data = log.read_bytes()
    with pytest.raises(LogError, match="was written by a newer minihuman"):
        repair_log(log)
    assert {path.name: path.read_bytes() for path in log.parent.iterdir()} == {log.name: data}
    log.write_bytes(data[:-20])
    assert "cut off" in repair_log(log).describe()


@pytest.mark.nightly(sample=True)
def test_a_flipped_bit_of_a_finished_log_is_noticed_and_costs_its_chunk_at_most(log: Path, tmp_path: Path) -> None:
    whole, events = log.read_bytes(), list(read_events(log))
    largest = max(len(record) for record in LogScanner(log).records() if isinstance(record, ChunkMessages))
    assert largest < len(events) / 2
    rng = np.random.default_rng(8)
    copy = tmp_path / log.name
    ends = _end_facts(whole)  # how the session ended: what a hit there costs
    lost = []
    for at in rng.integers(len(whole), size=FLIPS).tolist():
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        copy.write_bytes(damaged)
        with pytest.raises(LogError):
            read_log(copy)
        if at < 8:
            continue  # the magic bytes: no MCAP file any more, and said so
        repaired = repair_log(copy)
        kept = list(read_events(copy))
        assert _is_part(kept, events), at
        lost.append(len(events) - len(kept))
        if at in ends:
            assert lost[-1] == 0, at
        else:
            assert read_log(copy).clean == (lost[-1] == 0), at
        assert repaired.damaged_copy_path is not None
        assert repaired.damaged_copy_path.read_bytes() == damaged
        repaired.damaged_copy_path.unlink()
        with pytest.raises(LogError, match="is intact"):
            repair_log(copy)
    assert max(lost) <= largest
    assert min(lost) == 0


@pytest.mark.nightly(sample=True)
def test_a_flipped_bit_of_a_length_costs_its_chunk_at_most(log: Path, tmp_path: Path) -> None:
    """A record that is believed to be longer than it is takes those behind it with it."""
    whole = log.read_bytes()
    counts = [len(record) for record in LogScanner(log).records() if isinstance(record, ChunkMessages)]
    chunks = dict(zip([head for head in _heads(whole) if whole[head] == Opcode.CHUNK], counts, strict=True))
    flips = [(head + at, bit) for head in _heads(whole) for at in range(RECORD_HEADER.size) for bit in range(8)]
    assert len(flips) > 2000
    copy = tmp_path / log.name
    for at, bit in np.random.default_rng(10).permutation(flips)[: count(150, len(flips))].tolist():
        damaged = bytearray(whole)
        damaged[at] ^= 1 << bit
        copy.write_bytes(damaged)
        scan = LogScanner(copy)
        kept = sum(len(record) for record in scan.records() if isinstance(record, ChunkMessages))
        hit = max((begin for begin in chunks if begin <= at), default=None)
        assert sum(counts) - kept <= (0 if hit is None else chunks[hit]), (at, bit)
        assert scan.damage, (at, bit)
        assert "UnboundLocalError" not in scan.damage  # the end of the data is the end, whatever was before it


def test_a_flipped_bit_of_what_a_log_says_first_leaves_it_out_in_one_line(log: Path, tmp_path: Path) -> None:
    """Metadata have no checksum, and whose a log is comes from there before anything is read."""
    whole = log.read_bytes()
    copy = tmp_path / "promised" / "sub-01" / "ses-01" / log.name
    copy.parent.mkdir(parents=True)
    begin = next(head for head in _heads(whole) if whole[head] == Opcode.METADATA)
    end = begin + RECORD_HEADER.size + RECORD_HEADER.unpack_from(whole, begin)[1]
    for at in range(begin, end):
        damaged = bytearray(whole)
        damaged[at] ^= (0x80, 0x40, 0x01)[at % 3]
        copy.write_bytes(damaged)
        assert list_readable_logs(copy.parents[2]) == ([copy], [])
    with pytest.raises(LogError):
        read_log(copy)


def test_a_finished_log_that_is_cut_short_lost_something_and_every_look_at_it_says_so(
    log: Path, tmp_path: Path
) -> None:
    """A copy that broke off: what is left is kept, and nothing of it is then said to be wrong in itself."""
    copy = tmp_path / log.name
    copy.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    became = repair_log(copy)
    assert became.damaged
    assert "ended: cut_off; the file was cut off at byte " in became.describe()
    assert became.describe().endswith(f"; an unchanged copy is {copy}.as-found-1")
    assert 0 < became.steps < sum(len(episode.actions) for episode in read_log(log).episodes)
    lines = list(verify_session(copy))
    assert [fine for _, fine in lines] == [False]
    assert re.fullmatch(r"segment 1: the finished log was cut off at byte \d+", lines[0][0])


def test_a_finished_log_that_lost_its_end_only_still_says_how_it_ended(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / log.name
    whole = log.read_bytes()
    copy.write_bytes(whole[: _end_facts(whole).start])
    assert repair_log(copy).end_reason == "complete"
    [end], [before] = _ends(copy), _ends(log)
    assert (end["clean"], before["clean"]) == ("false", "true")
    assert end["stopped"].startswith("the finished log was cut off at byte ")
    for name in ("reason", "steps", "last_message", "planned", "completed", "lasted_ns"):
        assert end[name] == before[name], name


@pytest.mark.nightly(sample=True)
def test_a_flipped_bit_of_a_live_log_ends_as_a_failed_check(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = session_events(plan, steps=8)
    rng = np.random.default_rng(9)
    for trial in range(FLIPS // 4):
        recorder = McapRecorder(
            tmp_path / str(trial), plan, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda _fd: None)
        )
        recorder.write(events[:40])
        with recorder.segment_path.part.open("r+b") as file:
            at = int(rng.integers(8, recorder.segment_path.part.stat().st_size))
            file.seek(at)
            byte = file.read(1)[0] ^ 1 << int(rng.integers(8))
            file.seek(at)
            file.write(bytes([byte]))
        for event in events[40:]:
            recorder.write([event])
        with pytest.raises(DataLossError, match="an unchanged copy is "):
            recorder.close()
        kept = list(read_events(recorder.segment_path.log))
        assert _is_part(kept, events)
        assert len(kept) >= len(events) - 40
        assert not read_log(recorder.segment_path.log).clean


def _is_part(kept: list[Event], of: list[Event]) -> bool:
    """Whether the events kept are some of these, in their order."""
    rest = iter(of)
    return all(event in rest for event in kept)


def _heads(log: bytes) -> list[int]:
    """Where the records of a finished log begin, up to the end of its data."""
    heads, at, opcode = [], len(MAGIC), 0
    while opcode != Opcode.DATA_END:
        heads.append(at)
        opcode, length = RECORD_HEADER.unpack_from(log, at)
        at += RECORD_HEADER.size + length
    return heads


def _ends(log: Path) -> tuple[dict[str, str], ...]:
    """What a log's summary says of its segments' ends."""
    found = read_summary(log)
    assert found is not None
    return found.ends


def _end_facts(log: bytes) -> range:
    """Where the record lies that says how a log's one segment ended; its length stands before its name."""
    name = names.END_METADATA.encode()
    start = log.index(len(name).to_bytes(4, "little") + name)
    return range(start - 9, start + int.from_bytes(log[start - 8 : start], "little"))
