"""A process that ends because an fsync failed leaves bytes that can be read and are not on the disk."""

from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

from minihuman.errors import LogError
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder, resume_segment
from minihuman.storage.file_journal import FileJournal
from minihuman.storage.system import System, use_system
from tests.fault_simulation.schedule import MachineClock, ProcessKilled, Schedule
from tests.fault_simulation.volume import ProcessDisk, Volume
from tests.log.samples import STARTED_NS, session_events, session_plan


class Machine:
    """A disk whose processes come and go."""

    def __init__(self, folder: Path) -> None:
        schedule = Schedule(1)
        self.clock = MachineClock(schedule)
        self.volume = Volume(folder, schedule, self.clock)

    def start(self) -> tuple[ProcessDisk, System]:
        disk = ProcessDisk(self.volume)
        return disk, System(disk, self.clock)


@pytest.fixture
def machine(tmp_path: Path) -> Machine:
    return Machine(tmp_path)


def _journal(folder: Path) -> FileJournal[str]:
    return FileJournal(folder / "said.jsonl", lambda line, number: msgspec.json.decode(line, type=str))


def _say(folder: Path, word: str) -> None:
    with _journal(folder).hold() as held:
        held.append(word)


def test_a_line_that_was_not_taken_back_is_durable_once_another_is(machine: Machine, tmp_path: Path) -> None:
    disk, system = machine.start()
    with use_system(system):
        journal = _journal(tmp_path)
        with journal.hold() as held:
            held.append("a")
        disk.sync_folder(tmp_path)
        disk.unsynced, disk.ops_left = True, 3  # opens, writes, syncs; killed before it takes the line back
        with pytest.raises(ProcessKilled), journal.hold() as held:
            held.append("b")
        disk.kill()
    disk, system = machine.start()
    with use_system(system):
        assert list(_journal(tmp_path).read()) == ["a", "b"]
        _say(tmp_path, "c")
        disk.kill()
    machine.volume.power_cut()
    assert list(_journal(tmp_path).read()) == ["a", "b", "c"]


def test_a_session_that_resumes_behind_a_failed_fsync_makes_durable_what_it_resumes_from(
    machine: Machine, tmp_path: Path
) -> None:
    plan = session_plan(episodes=2)
    events = session_events(plan, steps=6)
    disk, system = machine.start()
    with use_system(system):
        recorder = McapRecorder(
            tmp_path, plan, started_ns=STARTED_NS, settings=RecorderSettings(put=disk.write, sync=disk.sync)
        )
        recorder.write(events[:10])
        recorder.drain()
        disk.unsynced = True
        with suppress(LogError):  # as soon as it is noticed
            recorder.write(events[10:14])
        with pytest.raises(LogError, match="recording stopped"):
            recorder.drain()
        disk.kill()
    part = recorder.segment_path.part
    disk, system = machine.start()
    with use_system(system):
        left = resume_segment(part)
        disk.kill()
    assert len(left.events) == 14
    whole = part.read_bytes()
    machine.volume.power_cut()
    assert part.read_bytes() == whole
