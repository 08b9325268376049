"""The device interface, and the recorder that adds devices' samples to a session's log between its events.

A protocol names a device under ``[[devices]]``; a laboratory registers its own through an entry point. Samples follow
the same durability rules as events.
"""

import abc
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from minihuman.display.windows.window import Clock
from minihuman.errors import DeviceError, LogError
from minihuman.experiment.machine.events import Event, Sampled, SessionEnded, SessionStarted
from minihuman.experiment.protocol.specs import DeviceSpec
from minihuman.log.record.recorder import Recorder, WrappedRecorder
from minihuman.plugins import make_plugin

DEVICE_GROUP = "minihuman.devices"


@dataclass(frozen=True, slots=True)
class DeviceSample:
    """A device's measurement at one time."""

    t_ns: int  # when it was taken, on the session's clock
    values: tuple[float, ...] = ()  # one per channel; NaN for a channel without a measurement
    text: str = ""  # a measurement that is a text


class Device(abc.ABC):
    """A source of samples. A thread of its own calls it, one call at a time, so that no call delays a picture."""

    @abc.abstractmethod
    def open(self, clock: Clock) -> dict[str, str]:
        """Start sampling by the session's clock; return facts about the device for the log.

        Raises:
            DeviceError: if the device is missing or cannot be used.
        """

    @abc.abstractmethod
    def read(self) -> Sequence[DeviceSample]:
        """Return the samples since the last call, oldest first, without waiting."""

    @abc.abstractmethod
    def close(self) -> None:
        """Release the device. This is called once, also after a failure."""


def make_device(source: str) -> Device:
    """Make a device from its plug-in's name and, after a colon, the device's own argument ("lsl:EyeTracker").

    Raises:
        DeviceError: if there is no such plug-in, it cannot be imported, or the argument is not valid.
    """
    return make_plugin(DEVICE_GROUP, source, Device, DeviceError, noun="device")  # type: ignore[type-abstract]


POLL_INTERVAL_S = 0.02  # how often devices are polled
MAX_SAMPLE_DELAY_S = 0.5  # how long samples wait to be written together with an event


@contextmanager
def open_devices(specs: Sequence[DeviceSpec], clock: Clock) -> Iterator[tuple[dict[str, Device], dict[str, str]]]:
    """Open a protocol's devices; yield them by name, together with facts about them for the log.

    A device that is missing and not required is left out; a fact says why. All devices are closed at the end.

    Raises:
        DeviceError: if a required device is missing.
    """
    devices: dict[str, Device] = {}
    facts: dict[str, str] = {}
    try:
        for spec in specs:
            try:
                devices[spec.name] = make_device(spec.plugin)
                device_facts = devices[spec.name].open(clock) or {"source": spec.plugin}
            except DeviceError as error:
                if spec.required:
                    raise DeviceError(f"device {spec.name!r}: {error}") from error
                if (failed_device := devices.pop(spec.name, None)) is not None:
                    failed_device.close()
                device_facts = {"missing": str(error)}
            facts |= {f"device_{spec.name}_{name}": value for name, value in device_facts.items()}
        yield devices, facts
    finally:
        for device in devices.values():
            device.close()


class DeviceRecorder(WrappedRecorder):
    """Writes a session's events, preceded by the samples that arrived since the last write.

    Args:
        recorder: the recorder of the log; it is closed with this one.
        devices: the open devices, by their names in the protocol.
        from_ns: the session time before which samples are dropped.
    """

    def __init__(self, recorder: Recorder, devices: Mapping[str, Device], *, from_ns: int = 0) -> None:
        super().__init__(recorder)
        self._devices = devices
        self._from_ns = from_ns
        self._lock = threading.Lock()  # for the recorder and the waiting samples, which two threads write
        self._waiting: list[Sampled] = []
        self._since_s = 0.0  # arrival of the first waiting sample
        self._last_ns: dict[str, int] = {}  # time of the last sample, by device
        self._running = False  # whether the session has begun and has not ended
        self._failure: Exception | None = None
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._record_samples, name="minihuman-devices", daemon=True)
        self._thread.start()

    def begin(self, events: Sequence[Event]) -> None:
        """Forward the waiting samples, then the events. A failed device stops the session, as a full disk does.

        Raises:
            LogError: as the wrapped recorder does, or if a device failed.
        """
        if self._failure is not None:
            raise LogError(f"a recording device failed: {self._failure}; fix it, then resume the session")
        with self._lock:
            if events and isinstance(events[0], SessionStarted):
                self._recorder.begin(events[:1])  # a log begins with its plan
                self._running = True
                events = events[1:]
            if events:
                self._recorder.begin([*self._take_waiting(), *events])
            if any(isinstance(event, SessionEnded) for event in events):
                self._running = False

    def close(self) -> Path | None:
        """Stop polling the devices, finish the log, and return its path; None if there is no file."""
        self._stopped.set()
        self._thread.join()
        return self._recorder.close()

    def _take_waiting(self) -> list[Sampled]:
        """Return the samples that arrived since the last call, without those from before or after the session."""
        waiting = self._waiting
        self._waiting = []
        if not self._running:
            return []
        return waiting

    def _record_samples(self) -> None:
        """Poll the devices until the session ends, and write samples that have waited too long for an event."""
        while not self._stopped.wait(POLL_INTERVAL_S):
            try:
                new_samples = list(chain.from_iterable(map(self._read_samples, self._devices)))
                with self._lock:
                    now_s = time.monotonic()
                    if not self._waiting:
                        self._since_s = now_s
                    self._waiting += new_samples
                    is_late = now_s - self._since_s > MAX_SAMPLE_DELAY_S
                    if self._running and self._waiting and is_late:
                        # without settle(), which only the session's thread calls
                        self._recorder.begin(self._take_waiting())
            except Exception as error:  # of a device's own code: raised at the next write, where the session can stop
                self._failure = error
                return

    def _read_samples(self, name: str) -> Iterator[Sampled]:
        """Yield the new samples of the device ``name``, without those before ``from_ns``; their times never go back."""
        for sample in self._devices[name].read():
            last_ns = self._last_ns.get(name, 0)
            if sample.t_ns < self._from_ns:
                continue  # before the session, or before its consent
            self._last_ns[name] = max(last_ns, sample.t_ns)
            yield Sampled(self._last_ns[name], name, tuple(map(float, sample.values)), sample.text)
