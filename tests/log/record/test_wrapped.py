"""Every recorder that wraps another: a picture is drawn while the log is written, nothing is lost, order is kept."""

import os
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from minihuman.log.read.session_reader import read_events
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import BufferedRecorder, DeferredRecorder, Recorder, WrappedRecorder
from minihuman.runtime.devices.device import DeviceRecorder
from minihuman.runtime.machine import SessionClock
from tests.counts import PATIENCE_S
from tests.log.samples import STARTED_NS, session_events, session_plan

PLAN = session_plan(episodes=1)
EVENTS = session_events(PLAN, steps=300)


def with_markers(recorder: Recorder) -> Recorder:
    pytest.importorskip("pylsl")
    from minihuman.runtime.devices.lsl import LslMarkerRecorder

    return LslMarkerRecorder(recorder, PLAN, SessionClock())


WRAPPERS: dict[str, Callable[[Recorder], Recorder]] = {
    "forwarding": WrappedRecorder,
    "buffered": BufferedRecorder,
    "deferred": lambda recorder: DeferredRecorder(PLAN, lambda: recorder),
    "devices": lambda recorder: DeviceRecorder(recorder, {}),
    "markers": with_markers,
    "all": lambda recorder: BufferedRecorder(
        DeviceRecorder(DeferredRecorder(PLAN, lambda: WrappedRecorder(recorder)), {})
    ),
}


class SlowDisk:
    """Takes nothing before ``is_free`` is set."""

    def __init__(self) -> None:
        self.is_free = threading.Event()

    def put(self, fd: int, data: memoryview) -> int:
        assert self.is_free.wait(PATIENCE_S)
        return os.write(fd, data)


@pytest.fixture(params=WRAPPERS)
def wrap(request: pytest.FixtureRequest) -> Callable[[Recorder], Recorder]:
    return WRAPPERS[request.param]


def test_begin_returns_before_a_slow_disk_has_written(tmp_path: Path, wrap: Callable[[Recorder], Recorder]) -> None:
    disk = SlowDisk()
    log = McapRecorder(
        tmp_path, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(put=disk.put, bound_s=PATIENCE_S)
    )
    recorder = wrap(log)
    recorder.begin(EVENTS[:280])  # more than a buffer holds
    assert log.segment_path.part.stat().st_size == 0
    disk.is_free.set()
    recorder.settle()
    assert list(read_events(log.segment_path.part)) == EVENTS[:280]
    recorder.write(EVENTS[280:])
    path = recorder.close()
    assert path is not None
    assert list(read_events(path)) == EVENTS
    assert log.late_writes == 0


def test_nothing_is_lost_and_order_is_kept(tmp_path: Path, wrap: Callable[[Recorder], Recorder]) -> None:
    recorder = wrap(McapRecorder(tmp_path, PLAN, started_ns=STARTED_NS))
    for number, event in enumerate(EVENTS):
        (recorder.begin if number % 2 else recorder.write)([event])
    path = recorder.close()
    assert path is not None
    assert list(read_events(path)) == EVENTS
    assert recorder.durable_steps == 300
