"""Damage costs what it hits: every flipped bit of a log is noticed, and all that it did not hit is recovered."""

from pathlib import Path

import numpy as np
import pytest

from minihuman.errors import LogError, LossError
from minihuman.log.read.chunk import Messages
from minihuman.log.read.open_log import open_log, read_events
from minihuman.log.read.scan import Scan
from minihuman.log.record.finish import repair
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.study.events import Event
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan
from tests.promises.sessions import play, study

FLIPS = count(60, 2000)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """600 steps of 12 episodes."""
    return play(tmp_path_factory.mktemp("data"), study(episodes=12, steps=50), sync=lambda _fd: None)


@pytest.mark.long
def test_a_flipped_bit_of_a_finished_log_is_noticed_and_costs_its_chunk_at_most(log: Path, tmp_path: Path) -> None:
    whole, events = log.read_bytes(), list(read_events(log))
    largest = max(len(record) for record in Scan(log).records() if isinstance(record, Messages))
    assert largest < len(events) / 2
    rng = np.random.default_rng(8)
    copy = tmp_path / log.name
    lost = []
    for at in rng.integers(len(whole), size=FLIPS).tolist():
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        copy.write_bytes(damaged)
        with pytest.raises(LogError):
            open_log(copy)
        if at < 8:
            continue  # the magic bytes: no MCAP file any more, and said so
        repaired = repair(copy)
        kept = list(read_events(copy))
        assert _is_part(kept, events), at
        lost.append(len(events) - len(kept))
        assert open_log(copy).clean == (lost[-1] == 0), at
        assert repaired.aside is not None
        assert repaired.aside.read_bytes() == damaged
        repaired.aside.unlink()
        with pytest.raises(LogError, match="is whole"):
            repair(copy)
    assert max(lost) <= largest
    assert min(lost) == 0


@pytest.mark.long
def test_a_flipped_bit_of_a_live_log_ends_as_a_failed_check(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = session_events(plan, steps=8)
    rng = np.random.default_rng(9)
    for trial in range(FLIPS // 4):
        recorder = McapRecorder(tmp_path / str(trial), plan, started_ns=STARTED_NS, sync=lambda _fd: None)
        recorder.write(events[:40])
        with recorder.where.part.open("r+b") as file:
            at = int(rng.integers(8, recorder.where.part.stat().st_size))
            file.seek(at)
            byte = file.read(1)[0] ^ 1 << int(rng.integers(8))
            file.seek(at)
            file.write(bytes([byte]))
        for event in events[40:]:
            recorder.write([event])
        with pytest.raises(LossError, match="kept as it was found: "):
            recorder.close()
        kept = list(read_events(recorder.where.log))
        assert _is_part(kept, events)
        assert len(kept) >= len(events) - 40
        assert not open_log(recorder.where.log).clean


def _is_part(kept: list[Event], of: list[Event]) -> bool:
    """Whether the events kept are some of these, in their order."""
    rest = iter(of)
    return all(event in rest for event in kept)
