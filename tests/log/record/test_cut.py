"""Damaged live files: recovery keeps every complete step and never raises."""

import shutil
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Attachment

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Event, Stepped
from minihuman.log.paths import SegmentPath
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import McapRecorder, resume_segment
from minihuman.log.salvage.scan import LogScanner
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan

pytestmark = pytest.mark.nightly(sample=True)

TAIL_BYTES = 4096
EVENTS = session_events(session_plan(episodes=2), steps=12)


class Live:
    """A live file, and how many steps it held at each size it had on its way."""

    def __init__(self, part: Path, steps_at: dict[int, int]) -> None:
        self.part = part
        self.bytes = part.read_bytes()
        self.steps_at = steps_at

    def steps_within(self, size: int) -> int:
        return max((steps for at, steps in self.steps_at.items() if at <= size), default=0)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    recorder = McapRecorder(tmp_path_factory.mktemp("live"), session_plan(episodes=2), started_ns=STARTED_NS)
    steps_at = {}
    for event in EVENTS:
        recorder.write([event])
        recorder.drain()
        steps_at[recorder.segment_path.part.stat().st_size] = recorder.durable_steps
    copy = recorder.segment_path.part.with_name("copy.mcap.part")
    shutil.copy(recorder.segment_path.part, copy)
    recorder.close()
    return Live(copy, steps_at)


def test_a_file_cut_anywhere_in_its_tail_keeps_every_complete_step(live: Live, tmp_path: Path) -> None:
    size = len(live.bytes)
    for cut in range(size - TAIL_BYTES, size + 1, count(193, 1)):
        kept = _recovered(live.bytes[:cut], tmp_path)
        assert _steps(kept) == live.steps_within(cut), cut


def test_a_file_cut_before_its_plan_is_put_aside_as_it_is(live: Live, tmp_path: Path) -> None:
    for cut in (0, 1, 8, 9, 40, 200, 1000):
        part = _part(live.bytes[:cut], tmp_path)
        finished = recover_log(part)
        assert not finished.readable
        assert finished.path.read_bytes() == live.bytes[:cut]
        assert not part.exists()


@pytest.mark.parametrize(
    "tail",
    [
        b"\0" * 4096,
        b"\xff" * 100,
        b"\x05" + b"\xff" * 8,
        b"\x06" + (50).to_bytes(8, "little") + b"\x07" * 50,
        b"\x0c" + (30).to_bytes(8, "little") + b"\xf0" * 30,
        b"\x09" + (30).to_bytes(8, "little") + b"\xf0" * 30,
        b"\x0f" + (4).to_bytes(8, "little") + b"\0" * 4,
    ],
    ids=["zeros", "ones", "endless", "chunk of garbage", "metadata of garbage", "attachment of garbage", "false end"],
)
def test_a_garbage_tail_costs_no_step(live: Live, tmp_path: Path, tail: bytes) -> None:
    assert _recovered(live.bytes + tail, tmp_path) == EVENTS


def test_a_file_that_cannot_be_read_to_its_end_is_kept_as_it_was_found(live: Live, tmp_path: Path) -> None:
    found = live.bytes + b"\xff" * 100
    part = _part(found, tmp_path)
    assert recover_log(part).damage == f"cut off at byte {len(live.bytes)}"
    assert part.with_name(f"{part.name}.as-found-1").read_bytes() == found
    assert not part.exists()


def test_a_tail_of_zeros_is_a_write_that_a_power_cut_tore_and_the_session_resumes_before_it(
    live: Live, tmp_path: Path
) -> None:
    whole = live.bytes[: sorted(live.steps_at)[20]]
    for length in (1, 8, 9, 400):
        part = _part(whole + bytes(length), tmp_path)
        left = resume_segment(part)
        left.close()
        assert list(left.events) == EVENTS[: len(left.events)]
        assert part.read_bytes() == whole
        part.unlink()


def test_random_tails_cost_no_step(live: Live, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    for length in rng.integers(1, 3000, count(10, 500)):
        assert _recovered(live.bytes + rng.bytes(int(length)), tmp_path) == EVENTS


def test_a_flipped_bit_costs_its_own_write_and_nothing_behind_it(live: Live, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    for at in rng.integers(len(live.bytes) - TAIL_BYTES, len(live.bytes), count(10, 500)):
        flipped = bytearray(live.bytes)
        flipped[at] ^= 1 << int(rng.integers(8))
        part = _part(bytes(flipped), tmp_path)
        finished = recover_log(part)
        kept = list(read_events(finished.path))
        assert [event for event in EVENTS if event in kept] == kept
        assert len(kept) >= len(EVENTS) - 1
        assert finished.damage
        assert not read_log(finished.path).clean
        assert part.with_name(f"{part.name}.as-found-1").read_bytes() == flipped


def test_a_chunk_that_is_taken_for_something_else_is_missed(live: Live, tmp_path: Path) -> None:
    at = max(size for size in live.steps_at if size < len(live.bytes) - 1000)
    taken = bytearray(live.bytes)
    assert taken[at] == 0x06, "a chunk starts where the one before ended"
    taken[at] = 0x07  # an index record, which a reader may skip
    finished = recover_log(_part(bytes(taken), tmp_path))
    kept = list(read_events(finished.path))
    (lost,) = [number for number, event in enumerate(EVENTS, 1) if event not in kept]
    assert finished.damage.endswith(f"; without messages {lost} to {lost}")


@pytest.mark.parametrize("hurt", ["the segment's facts", "the plan", "the copy of the plan"])
def test_a_damaged_start_is_read_from_its_copy(live: Live, tmp_path: Path, hurt: str) -> None:
    flipped = bytearray(live.bytes)
    at = {
        "the segment's facts": flipped.index(b"minihuman.segment"),
        "the plan": flipped.index(b"Find the green square."),
        "the copy of the plan": flipped.index(b"session_plan.zst") + 60,
    }[hurt]
    flipped[at] ^= 1
    finished = recover_log(_part(bytes(flipped), tmp_path))
    assert list(read_events(finished.path)) == EVENTS
    assert read_log(finished.path).metadata["segments"][0]["study"] == "fourrooms"
    assert finished.damage.startswith("damaged at bytes")


def _part(content: bytes, folder: Path) -> Path:
    part = folder / "sub-07_ses-01.mcap.part"
    for old in folder.iterdir():
        old.unlink()
    part.write_bytes(content)
    return part


def _recovered(content: bytes, folder: Path) -> list[Event]:
    finished = recover_log(_part(content, folder))
    events = list(read_events(finished.path))
    assert not read_log(finished.path).clean
    assert finished.steps == _steps(events)
    return events


def _steps(events: list[Event]) -> int:
    return sum(isinstance(event, Stepped) for event in events)


def test_a_live_file_torn_in_its_first_write_has_all_that_belongs_to_its_plan_or_no_plan(tmp_path: Path) -> None:
    plan = session_plan(episodes=1)
    recorder = McapRecorder(tmp_path / "whole", plan, started_ns=STARTED_NS)
    recorder.write(session_events(plan, steps=1)[:1])
    recorder.leave()
    whole = recorder.segment_path.part.read_bytes()
    part = SegmentPath.of_plan(tmp_path / "torn", plan).part
    part.parent.mkdir(parents=True)
    resumed = 0
    for size in range(0, len(whole), 97):
        part.write_bytes(whole[:size])
        with suppress(LogError):
            resume_segment(part).close()
            resumed += 1
            names = {record.name for record in LogScanner(part) if isinstance(record, Attachment)}
            assert {"protocol.toml", "key_maps.json", "packages.txt"} <= names, size
    assert resumed


def test_a_live_file_of_which_a_power_cut_left_only_the_size_is_put_aside(tmp_path: Path) -> None:
    part = SegmentPath.of_plan(tmp_path, session_plan(episodes=1)).part
    part.parent.mkdir(parents=True)
    part.write_bytes(bytes(20_000))
    assert not recover_log(part).readable
    assert not part.exists()
