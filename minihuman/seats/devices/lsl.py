"""The Lab Streaming Layer: a stream's samples as a device. Needs the extra ``lsl``."""

import time
from collections.abc import Sequence
from typing import Any

from minihuman.errors import DeviceError
from minihuman.seats.devices.port import Device, Sample
from minihuman.windows.port import Clock

LOOK_S = 5.0  # for a stream, before it counts as missing
_MOST = 4096  # samples a call


class LslDevice(Device):
    """Samples of one LSL stream: numbers as values, texts as text. Times are the sender's, corrected by LSL.

    Args:
        name: the stream's name; "" takes the only stream that is not one of markers of ours.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._inlet: Any = None
        self._offset_s = 0.0  # LSL's clock at session time 0

    def open(self, clock: Clock) -> dict[str, str]:
        """Find the stream and begin."""
        lsl = pylsl()
        if self._name:
            found = lsl.resolve_byprop("name", self._name, timeout=LOOK_S)
        else:
            found = [one for one in lsl.resolve_streams(wait_time=LOOK_S) if one.name() != "minihuman"]
        if len(found) != 1:
            told = ", ".join(one.name() for one in found) or "none"
            raise DeviceError(f"one LSL stream {self._name!r} was looked for, there is {told}; start it, or name it")
        info = found[0]
        self._inlet = lsl.StreamInlet(info, processing_flags=lsl.proc_clocksync | lsl.proc_monotonize)
        self._inlet.open_stream(timeout=LOOK_S)
        self._offset_s = lsl_at_zero(clock)
        return {"stream": info.name(), "type": info.type(), "rate_hz": f"{info.nominal_srate():g}"}

    def read(self) -> Sequence[Sample]:
        """What arrived."""
        rows, stamps = self._inlet.pull_chunk(timeout=0.0, max_samples=_MOST)
        return [self._sample(row, stamp_s) for row, stamp_s in zip(rows or (), stamps or (), strict=True)]

    def close(self) -> None:
        """Leave the stream."""
        if self._inlet is not None:
            self._inlet.close_stream()

    def _sample(self, row: Sequence[Any], stamp_s: float) -> Sample:
        t_ns = round((stamp_s - self._offset_s) * 1e9)
        if row and isinstance(row[0], str):
            return Sample(t_ns, text=" ".join(row))
        return Sample(t_ns, tuple(float(value) for value in row))


def pylsl() -> Any:
    """The library.

    Raises:
        DeviceError: if it is not installed.
    """
    try:
        import pylsl as library
    except (ImportError, RuntimeError) as error:  # RuntimeError: it is there, liblsl is not
        raise DeviceError(f"there is no Lab Streaming Layer ({error}): pip install 'minihuman[lsl]'") from error
    return library


def lsl_at_zero(clock: Clock) -> float:
    """LSL's clock, seconds, when the session's was 0: from the closest pair of looks at both."""
    library = pylsl()
    looks = []
    for _ in range(20):
        before_ns = time.monotonic_ns()
        session_ns, lsl_s = clock(), library.local_clock()
        looks.append((time.monotonic_ns() - before_ns, lsl_s - session_ns / 1e9))
    return float(min(looks)[1])
