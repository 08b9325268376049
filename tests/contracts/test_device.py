"""The contract of devices: the one that the documentation prints keeps it, and each broken promise is found."""

import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from minihuman.errors import DeviceError
from minihuman.ext import Clock, Device, DeviceSample
from minihuman.testing import ContractError, check_device

DOCS = Path(__file__).parents[2] / "docs" / "devices.md"


class Counter(Device):
    """A sound device: one sample per read."""

    def open(self, clock: Clock) -> dict[str, str]:
        self.clock = clock
        return {"model": "counter"}

    def read(self) -> Sequence[DeviceSample]:
        return [DeviceSample(self.clock(), (1.0,))]

    def close(self) -> None:
        pass


class Stopwatch:
    """The tests' own time, which passes by being read and by waiting, however busy the machine is."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 0.001
        return self.now_s

    def wait(self, seconds: float) -> list[DeviceSample]:
        """Let time pass, as a device does that waits for its next sample."""
        self.now_s += seconds
        return []


STOPWATCH = Stopwatch()


def broken(method: str, result: Any) -> type[Counter]:
    return type("Broken", (Counter,), {method: lambda self, *_: result(self)})


BROKEN = {
    "the log takes a dict of texts": broken("open", lambda self: setattr(self, "clock", time.monotonic_ns)),
    "its time is the session clock's": broken("read", lambda self: [DeviceSample(time.time_ns(), (1.0,))]),
    "the oldest is first": broken("read", lambda self: [DeviceSample(9, (1.0,)), DeviceSample(8, (1.0,))]),
    "is not a minihuman.ext.DeviceSample": broken("read", lambda self: [(1, 2)]),
    "a time is an integer": broken("read", lambda self: [DeviceSample(0.5, (1.0,))]),
    "2 values for 1 channels": broken("read", lambda self: [DeviceSample(1, (1.0, 2.0))]),
    "a tuple of numbers": broken("read", lambda self: [DeviceSample(1, ("a",))]),
    "0 of 1 samples arrived": broken("read", lambda self: []),
    "never waits": broken("read", lambda self: STOPWATCH.wait(1.1)),
}


@pytest.mark.parametrize("promise", BROKEN)
def test_a_broken_promise_is_named(promise: str) -> None:
    with pytest.raises(ContractError, match=promise):
        check_device(BROKEN[promise], n_channels=1, timeout_s=0.1, now_s=STOPWATCH)


def test_a_device_that_takes_half_a_second_to_answer_has_not_waited() -> None:
    class Slow(Counter):
        def read(self) -> Sequence[DeviceSample]:
            STOPWATCH.wait(0.5)
            return super().read()

    check_device(Slow, n_channels=1, now_s=STOPWATCH)


def test_a_device_must_be_one() -> None:
    with pytest.raises(ContractError, match=r"dict is not a minihuman\.ext\.Device"):
        check_device(dict)  # type: ignore[arg-type]


def test_a_device_is_opened_and_closed_for_each_session() -> None:
    calls = []

    class Counted(Counter):
        def open(self, clock: Clock) -> dict[str, str]:
            calls.append("open")
            return super().open(clock)

        def close(self) -> None:
            calls.append("close")

    check_device(Counted, n_channels=1, n_samples=3, now_s=STOPWATCH)
    assert calls == ["open", "close"] * 2


def test_a_device_that_is_not_installed_is_named() -> None:
    with pytest.raises(DeviceError, match="no-such-device"):
        check_device("no-such-device")


def test_the_device_in_the_documentation_runs_as_printed() -> None:
    (code,) = re.findall(r"```python\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    exec(compile(code, str(DOCS), "exec"), found := {"__name__": "my_lab.devices"})
    found["test_system_load"]()
    with pytest.raises(DeviceError, match="load:1, load:5 or load:15"):
        found["SystemLoad"]("7")
