"""Markers by the Lab Streaming Layer: recorded back beside the log, none lost, at the log's own times."""

import json
import sys
import time

import numpy as np
import pytest

from minihuman.errors import DeviceError
from minihuman.experiment.machine.events import EpisodeStarted, FrameShown, KeyPressed, SessionStarted, Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.devices.lsl import (
    MARKER_STREAM_NAME,
    LslMarkerRecorder,
    build_marker,
    measure_lsl_at_zero_s,
    pylsl as library,
)
from minihuman.runtime.machine import SessionClock
from tests.counts import PATIENCE_S, count
from tests.study.sessions import corridor_plan

pylsl = pytest.importorskip("pylsl")
pytestmark = pytest.mark.program


def played(clock, plan, recorder, wanted):
    """So many steps at a hundred a second, each with its key and its picture, on a real clock."""
    from tests.log.samples import session_events, session_plan

    several = session_events(session_plan(episodes=1))
    start = next(event for event in several if isinstance(event, EpisodeStarted))
    recorder.write([SessionStarted(clock(), plan, {})])
    recorder.write([start])
    for number in range(1, wanted // 3 + 1):
        now_ns = clock()
        recorder.write(
            [
                KeyPressed(now_ns, "3", "3", True, 0, "accepted", "playing"),
                Stepped(now_ns, 0, number, 0, "3", now_ns, 0.0, 0.0, False, False, None, None, number, number),
            ]
        )
        recorder.write([FrameShown(clock(), 0, number, now_ns, clock())])
        time.sleep(0.001)
    return start.action_names


@pytest.mark.nightly(sample=True)
def test_markers_recorded_back_are_the_logs_events_at_its_times(tmp_path):
    wanted = count(600, 10_000)
    plan, clock = corridor_plan(), SessionClock()
    recorder = LslMarkerRecorder(McapRecorder(tmp_path, plan, started_ns=clock.started_unix_ns), plan, clock)
    [info] = pylsl.resolve_byprop("source_id", f"minihuman-{plan.study}-sub-01-ses-1-seg-1", timeout=PATIENCE_S)
    inlet = pylsl.StreamInlet(info)
    inlet.open_stream(timeout=PATIENCE_S)
    assert recorder.has_listener(PATIENCE_S)
    names = played(clock, plan, recorder, wanted)
    markers = []
    log = recorder.close()
    until_s = time.monotonic() + PATIENCE_S
    while len(markers) < wanted and time.monotonic() < until_s:
        rows, stamps = inlet.pull_chunk(timeout=1.0)
        markers += [(stamp, json.loads(row[0])) for row, stamp in zip(rows, stamps, strict=True)]
    expected = [marker for event in read_events(log) if (marker := build_marker(event, names)) is not None]
    assert [words for _, words in markers] == [words for _, words in expected]
    at_zero_s = measure_lsl_at_zero_s(clock)  # measured once more, after everything
    stamps_s, times_s = np.array([stamp for stamp, _ in markers]), np.array([t_ns / 1e9 for t_ns, _ in expected])
    apart_ms = 1e3 * np.abs(stamps_s - at_zero_s - times_s)
    median, most = np.median(apart_ms), np.quantile(apart_ms, 0.99)
    print(f"{len(markers)} markers, none lost: median {median:.4f} ms, 99 % {most:.4f} ms")  # shown by pytest -s
    assert np.quantile(apart_ms, 0.99) < 1.0
    assert {"episode", "step", "flip", "key"} <= {words["trial_type"] for _, words in markers}


def test_a_stream_says_whose_session_it_is():
    plan, clock = corridor_plan(segment=3), SessionClock()
    recorder = LslMarkerRecorder(MemoryRecorder(), plan, clock)
    [info] = pylsl.resolve_byprop("source_id", f"minihuman-{plan.study}-sub-01-ses-1-seg-3", timeout=PATIENCE_S)
    session = pylsl.StreamInlet(info).info().desc().child("session")
    assert (info.name(), info.type()) == (MARKER_STREAM_NAME, "Markers")
    assert (session.child_value("participant"), session.child_value("segment")) == ("sub-01", "3")
    recorder.close()


def test_without_a_listener_the_session_is_the_same(tmp_path):
    plan, clock = corridor_plan(), SessionClock()
    recorder = LslMarkerRecorder(MemoryRecorder(), plan, clock)
    names = played(clock, plan, recorder, 30)
    recorder.close()
    assert len(names) > 0
    assert sum(isinstance(event, Stepped) for event in recorder._recorder.events) == 10


def test_without_the_library_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    with pytest.raises(DeviceError, match=r"pip install 'pylsl>=1.18'"):
        library()
