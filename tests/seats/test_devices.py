"""Devices of a protocol: what they give is in the log and in a table, and a session goes on or stops as it says."""

import math
import threading
import time

import numpy as np
import pytest

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import DeviceError, LogError
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import Sampled
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import DeviceSpec as Wanted
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.devices.device import Device, DeviceRecorder, DeviceSample, make_device, open_devices
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.golden.make import study

DEVICES = """
[[devices]]
name = "gaze"
source = "eye-tracker"
channels = ["x", "y"]
units = ["px", "px"]
[[devices]]
name = "box"
source = "trigger-box"
"""


class EyeTracker(Device):
    """A gaze on a circle, as many samples as are asked for; the second of the session is lost."""

    def __init__(self, fails_after: int = 10**9) -> None:
        self._given, self._fails_after = 0, fails_after

    def open(self, clock):
        self._clock = clock
        return {"model": "circle"}

    def read(self):
        t_ns = self._clock.asked() - 5_000_000
        self._given += t_ns >= 0  # what comes before is left out of the log, however often it is asked for
        if self._given > self._fails_after:
            raise OSError("the cable is out")
        values = (math.nan, math.nan) if self._given == 2 else (self._given, -self._given)
        return [DeviceSample(t_ns, values)]

    def close(self):
        self.closed = True


class TriggerBox(EyeTracker):
    """A word now and then."""

    def read(self):
        return [DeviceSample(self._clock.asked(), text="S1")]


class OnTheClock:
    """A simulated participant's virtual clock that goes on once devices were asked, however busy the machine is."""

    def __init__(self):
        self.now_ns = 0
        self._asked = threading.Semaphore(0)
        self._waits = 20  # enough samples; the rest of the session need not wait

    def __call__(self):
        return self.now_ns

    def asked(self):
        """The time, for a device."""
        self._asked.release()
        return self.now_ns

    def advance_to(self, t_ns):
        self.now_ns = max(self.now_ns, t_ns)
        if self._waits > 0:
            self._waits -= 1
            while self._asked.acquire(blocking=False):
                pass
            self._asked.acquire(timeout=2)  # nobody asks any more where a device has failed


def sat(data, devices, clock):
    from minihuman.simulation.participant import make_participant

    protocol = decode_protocol(study("resumed").toml + DEVICES.encode())
    plan = plan_next_session(protocol, data, participant="sub-01")
    session = SessionMachine(plan, World, {"player": "optimal"}, picture_px=None)
    recorder = DeviceRecorder(McapRecorder(data, plan, started_ns=1_790_000_000_000_000_000), devices)
    window = SimulatedWindow(make_participant("random", np.random.default_rng(1)), session, clock)
    return run_session(session, window, recorder, clock)


@pytest.fixture
def log(tmp_path):
    clock = OnTheClock()
    devices = {"gaze": EyeTracker(), "box": TriggerBox()}
    for device in devices.values():
        device.open(clock)
    return sat(tmp_path, devices, clock)


def test_samples_lie_between_the_events_of_a_session_that_still_proves(log):
    events = list(read_events(log))
    samples = [event for event in events if isinstance(event, Sampled)]
    assert {one.device for one in samples} == {"gaze", "box"}
    assert len(samples) > 5
    assert find_violations(events) == []
    assert verify_episodes(read_log(log)).difference == ""


def test_samples_are_a_table_with_the_protocols_words(log):
    [rows] = StudySessions(log, Selection()).rows(with_shortest=False)
    table = rows.rows["samples"].to_pandas()
    gaze = table[table["device"] == "gaze"]
    assert set(gaze["channel"]) == {"x", "y"}
    assert gaze["value"].isna().sum() == 2  # the lost one
    assert set(table[table["device"] == "box"]["said"]) == {"S1"}
    segment = read_log(log).segments[0]
    assert len(segment.samples) == len(gaze) // 2 + (table["device"] == "box").sum()
    assert segment.samples[0].t_ns >= 0


@pytest.mark.program
def test_a_device_that_fails_stops_the_session_and_says_so(tmp_path):
    clock = OnTheClock()
    device = EyeTracker(fails_after=3)
    device.open(clock)
    with pytest.raises(LogError, match="a recording device failed: the cable is out"):
        sat(tmp_path, {"gaze": device}, clock)
    [part_or_log] = tmp_path.rglob("*.mcap*")
    assert len(read_log(part_or_log).segments[0].samples) <= 3


def test_a_device_that_is_not_there_is_named(monkeypatch):
    needed = Wanted(name="gaze", plugin="nobody")
    with (
        pytest.raises(DeviceError, match="device 'gaze': device 'nobody' is unknown; it is one of lsl"),
        open_devices([needed], SessionClock()),
    ):
        pass
    with open_devices([Wanted(name="gaze", plugin="nobody", required=False)], SessionClock()) as (devices, facts):
        assert devices == {}
        assert "is unknown" in facts["device_gaze_missing"]


@pytest.mark.program
def test_a_stream_of_the_lab_streaming_layer_is_a_device():
    pylsl = pytest.importorskip("pylsl")
    outlet = pylsl.StreamOutlet(pylsl.StreamInfo("Eyes", "Gaze", 2, 100, pylsl.cf_float32, "eyes-of-a-test"))
    clock = SessionClock()
    device = make_device("lsl:Eyes")
    assert device.open(clock) == {"stream": "Eyes", "type": "Gaze", "rate_hz": "100"}
    assert outlet.wait_for_consumers(PATIENCE_S)
    sent = []
    for number in range(20):
        before_ns = clock()
        outlet.push_sample([number, -number])
        sent.append((before_ns, clock()))  # this process may be stopped for long between the two
        time.sleep(0.005)
    got = []
    until_s = time.monotonic() + PATIENCE_S
    while len(got) < 20 and time.monotonic() < until_s:
        got += device.read()
        time.sleep(0.01)
    device.close()
    assert [sample.values for sample in got] == [(number, -number) for number in range(20)]
    near_ns = 50_000_000
    assert all(a - near_ns < sample.t_ns < b + near_ns for sample, (a, b) in zip(got, sent, strict=True))
