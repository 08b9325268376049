"""Sound that reaches this machine: records the default sound input, and when each sample was taken.

Only measurements record, such as `minihuman doctor --loopback`; sessions do not. The times at which PortAudio says that
each buffer was taken are fitted to the session's clock as those of the output are.
"""

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.display.windows.window import Clock
from minihuman.errors import DeviceError
from minihuman.runtime.devices.sound import LATENCY_S, RATE_HZ, ClockFit, explain_failure, import_sounddevice

_NS_PER_S = 1_000_000_000
_LEAST_BUFFERS = 16  # before the recording is used
_LONGEST_START_NS = 5 * _NS_PER_S
_START_CHECK_S = 0.02
_LARGEST_AGE_S = 10.0  # of a buffer; some systems state the time 0


class _Buffer(NamedTuple):
    """A buffer of samples from the device."""

    first_frame: int
    taken_s: float  # the session's time in seconds at which its first frame was taken, as the device says
    samples: NDArray[np.float32]  # float32[n, channels]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """What an input recorded, on the session's clock.

    Attributes:
        samples: float32[n], -1 to 1, of the channel with the largest change.
        rate_hz: the number of samples per second.
        first_frames: the number of each buffer's first sample, int64[b].
        offsets_s: the session's time in seconds at which sample 0 was taken, as each buffer's time was fitted,
            float64[b]; it changes as the clocks drift apart.
    """

    samples: NDArray[np.float32]
    rate_hz: float
    first_frames: NDArray[np.int64]
    offsets_s: NDArray[np.float64]

    def find_times_s(self, frames: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the session's times in seconds at which samples were taken, by their numbers, float64[n]."""
        buffers = np.searchsorted(self.first_frames, frames, side="right") - 1
        return self.offsets_s[np.maximum(buffers, 0)] + frames / self.rate_hz

    @property
    def peak(self) -> float:
        """Return the largest distance of a sample from the median, as a share of full scale."""
        return float(np.abs(self.samples - np.median(self.samples)).max())


def fit_offsets_s(first_frames: NDArray[np.int64], taken_s: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """Return the time in seconds at which sample 0 was taken, as it is estimated with each buffer, float64[b].

    Args:
        first_frames: the number of each buffer's first sample, int64[b].
        taken_s: when that was taken, as the device says, in seconds of the session's clock, float64[b].
        rate_hz: the number of samples per second.
    """
    fit = ClockFit(rate_hz)
    offsets_s = []
    for frame, time_s in zip(first_frames, taken_s, strict=True):
        fit.add(int(frame), float(time_s))
        offsets_s.append(fit.offset_s)
    return np.array(offsets_s)


class SoundInput:
    """Records the default sound input through PortAudio from when it is made until it is closed.

    Args:
        clock: the session's clock.

    Raises:
        DeviceError: if PortAudio or an input is missing, or if the input records nothing.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._buffers: list[_Buffer] = []
        self._frame = 0  # number of the next buffer's first frame
        self._interruptions = 0
        self._stream = _open_input(self._take)
        self._rate_hz = float(self._stream.samplerate)
        self._stream.start()
        self._await_buffers()

    def describe(self) -> str:
        """Return the device's name, its rate and its latency, and how often samples were lost."""
        import sounddevice

        device = sounddevice.query_devices(self._stream.device)
        host = sounddevice.query_hostapis(device["hostapi"])["name"]
        latency_ms = 1000 * self._stream.latency
        interruptions = f"interrupted {self._interruptions} times"
        return f"{device['name']}, {host}, {self._rate_hz:g} Hz, {latency_ms:.1f} ms latency, {interruptions}"

    def read(self) -> Recording:
        """Return all that was recorded up to now."""
        buffers = list(self._buffers)
        samples = np.concatenate([buffer.samples for buffer in buffers])
        channel = int(np.argmax(np.ptp(samples, axis=0)))
        first_frames = np.array([buffer.first_frame for buffer in buffers], np.int64)
        taken_s = np.array([buffer.taken_s for buffer in buffers])
        offsets_s = fit_offsets_s(first_frames, taken_s, self._rate_hz)
        return Recording(samples[:, channel], self._rate_hz, first_frames, offsets_s)

    def close(self) -> None:
        """Stop the stream."""
        self._stream.close()

    def _await_buffers(self) -> None:
        """Wait until the device's clock is known; close the stream if that fails.

        Raises:
            DeviceError: if the device records nothing, or does not state when it took its samples.
        """
        until_ns = self._clock() + _LONGEST_START_NS
        while len(self._buffers) < _LEAST_BUFFERS:
            if self._clock() > until_ns:
                self._stream.close()
                raise DeviceError("the sound input opens, but records nothing; start the system's sound server again")
            time.sleep(_START_CHECK_S)
        age_s = self._clock() / _NS_PER_S - self._buffers[-1].taken_s
        if abs(age_s) > _LARGEST_AGE_S:
            self._stream.close()
            raise DeviceError(
                f"the sound input says that it took its samples {age_s:.0f} s ago, so onsets in them have no times; "
                "choose another input as the system's"
            )

    # In the device's own thread

    def _take(self, buffer: NDArray[np.float32], count: int, times: Any, status: Any) -> None:
        """Keep a buffer that the device recorded, float32[count, channels], with its time.

        ``times`` has PortAudio's times of the buffer, and ``status`` says whether samples were lost before it.
        """
        now_s = self._clock() / _NS_PER_S
        taken_s = now_s + times.inputBufferAdcTime - times.currentTime
        self._interruptions += bool(status.input_overflow)
        self._buffers.append(_Buffer(self._frame, taken_s, buffer.copy()))
        self._frame += count


def _open_input(take: Any) -> Any:
    """Open the default sound input, with two channels if it has them.

    Raises:
        DeviceError: if PortAudio or an input is missing.
    """
    sounddevice = import_sounddevice("sound is to be recorded")
    try:
        channels = min(2, sounddevice.query_devices(kind="input")["max_input_channels"])
        return sounddevice.InputStream(
            samplerate=RATE_HZ, channels=channels, dtype="float32", latency=LATENCY_S, callback=take
        )
    except (sounddevice.PortAudioError, ValueError) as error:
        reason = explain_failure(error, sounddevice.default.device[0])
        raise DeviceError(
            f"sound is to be recorded, but no sound input opens ({reason}); connect one, choose it as the system's "
            "input, and let this program use the microphone"
        ) from error
