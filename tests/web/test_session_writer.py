"""What of a page's messages is safe, by what of its session is on the disk."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from minihuman.experiment.machine.events import Event, Noted
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.web.session_writer import SessionWriter
from minihuman.worlds.adapters.world import World
from tests.web.protocols import GRID, study


@pytest.fixture
def recorder() -> MemoryRecorder:
    return MemoryRecorder()


@pytest.fixture
def writer(recorder: MemoryRecorder, tmp_path: Path) -> SessionWriter:
    protocol = decode_protocol(study(tmp_path, GRID).read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    return SessionWriter(SessionMachine(plan, World, {}, picture_px=None), recorder)


def notes(*times_ns: int) -> Sequence[Event]:
    return [Noted(t_ns, "phase", "play") for t_ns in times_ns]


def test_a_message_is_safe_once_its_write_is_on_the_disk_and_not_before(writer: SessionWriter) -> None:
    for number in (1, 2):
        writer.write(notes(number))
        writer.record_taken(number)
    assert writer.safe(0) == 0
    assert writer.safe(1) == 1
    assert writer.safe() == 2


def test_a_message_that_led_to_nothing_is_safe_with_those_before_it(writer: SessionWriter) -> None:
    writer.record_taken(1)
    assert writer.safe(-1) == 0, "not even what was before the first write, without a lease"
    assert writer.safe(0) == 1


def test_a_picture_that_was_shown_early_is_safe_with_the_write_behind_it(writer: SessionWriter) -> None:
    writer.record_taken(1, with_next=True)
    assert writer.safe() == 0
    writer.write(notes(5))
    assert writer.safe() == 1


def test_what_waits_for_others_of_its_text_is_one_write_with_them(
    writer: SessionWriter, recorder: MemoryRecorder
) -> None:
    writer.write_later(notes(1))
    writer.record_taken(1)
    assert (writer.safe(), recorder.events) == (0, [])
    writer.write(notes(2))
    writer.record_taken(2)
    assert (writer.safe(), writer.count) == (2, 1)
    assert recorder.events == notes(1, 2)


def test_what_another_tab_sent_is_not_acknowledged_to_the_one_that_leads(writer: SessionWriter) -> None:
    writer.write(notes(1))
    writer.record_taken(9)
    writer.begin_stream(4)
    assert writer.safe() == 4
