"""A recorder that takes what devices give between a session's events: the same log, the same rules for what is safe."""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from minihuman.errors import DeviceError, LogError
from minihuman.log.record.recorder import Recorder
from minihuman.seats.devices.port import Device, make_device
from minihuman.study.devices import Device as Wanted
from minihuman.study.events import Event, Sampled, SessionEnded, SessionStarted
from minihuman.windows.port import Clock

EVERY_S = 0.02  # how often devices are asked
ALONE_S = 0.5  # samples wait so long for an event to go along with, before they are written by themselves


@contextmanager
def open_devices(wanted: Sequence[Wanted], clock: Clock) -> Iterator[tuple[dict[str, Device], dict[str, str]]]:
    """Open a protocol's devices; give them by name, and what the log is to know of them.

    Raises:
        DeviceError: if one that the session cannot do without is not there.
    """
    devices: dict[str, Device] = {}
    facts: dict[str, str] = {}
    try:
        for one in wanted:
            try:
                device = make_device(one.source)
                devices[one.name] = device
                told = device.open(clock)
            except DeviceError as error:
                if one.required:
                    raise DeviceError(f"device {one.name!r}: {error}") from error
                gone = devices.pop(one.name, None)
                if gone is not None:
                    gone.close()
                told = {"missing": str(error)}
            facts |= {f"device_{one.name}_{name}": value for name, value in (told or {"source": one.source}).items()}
        yield devices, facts
    finally:
        for device in devices.values():
            device.close()


class SamplingRecorder(Recorder):
    """Writes what a session says, and before it what devices gave meanwhile.

    Args:
        recorder: the log; closed with this one.
        devices: open ones, by their names in the protocol.
        from_ns: what they gave before that is left out.
    """

    def __init__(self, recorder: Recorder, devices: Mapping[str, Device], *, from_ns: int = 0) -> None:
        self._recorder = recorder
        self._devices = devices
        self._from_ns = from_ns
        self._lock = threading.Lock()  # of the recorder and of what waits: the session's thread and the devices' write
        self._waiting: list[Sampled] = []
        self._since_s = 0.0  # when the first of those came
        self._last_ns: dict[str, int] = {}  # of each device
        self._running = False  # the session has begun and has not ended
        self._failure: Exception | None = None
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="minihuman-devices", daemon=True)
        self._thread.start()

    def write(self, events: Sequence[Event]) -> None:
        """As the port says. A device that failed stops the session as a full disk does: what it gives is data.

        Raises:
            LogError: as the recorder's; or if a device failed.
        """
        if self._failure is not None:
            raise LogError(f"a device failed: {self._failure}; see to it, then go on with the session")
        with self._lock:
            if events and isinstance(events[0], SessionStarted):
                self._recorder.write(events[:1])  # a log begins with its plan
                self._running, events = True, events[1:]
            if events:
                self._recorder.write([*self._taken(), *events])
            if any(isinstance(event, SessionEnded) for event in events):
                self._running = False

    @property
    def durable_steps(self) -> int:
        """As the recorder says."""
        return self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """How many writes are fsynced."""
        return self._recorder.durable_writes

    def close(self) -> Path | None:
        """Stop asking the devices, and finish the log."""
        self._stopped.set()
        self._thread.join()
        return self._recorder.close()

    def _taken(self) -> list[Sampled]:
        """What waits, if it may be written; what came before the session or after it is no part of it."""
        waiting, self._waiting = self._waiting, []
        return waiting if self._running else []

    def _run(self) -> None:
        while not self._stopped.wait(EVERY_S):
            try:
                fresh = [sampled for name in self._devices for sampled in self._fresh(name)]
                with self._lock:
                    self._since_s = self._since_s if self._waiting else time.monotonic()
                    self._waiting += fresh
                    if self._running and self._waiting and time.monotonic() - self._since_s > ALONE_S:
                        self._recorder.write(self._taken())
            except Exception as error:  # whatever a device's own code raises is told where the session can stop for it
                self._failure = error
                return

    def _fresh(self, name: str) -> Iterator[Sampled]:
        for sample in self._devices[name].read():
            last_ns = self._last_ns.get(name, 0)
            if sample.t_ns < self._from_ns:
                continue  # before the session, or before its consent
            self._last_ns[name] = max(last_ns, sample.t_ns)  # a device's time never goes back
            yield Sampled(self._last_ns[name], name, tuple(map(float, sample.values)), sample.text)
