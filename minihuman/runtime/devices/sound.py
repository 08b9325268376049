"""Sound at this machine: plays a session's sounds on the sound device, and reports when each sound began.

The running part of a session names its sounds and their times (`Activity.sound_cues`). The device has a clock of its
own, to which a line is fitted by the session's clock, so that neither jitter nor a step of the wall clock moves an
onset.
"""

import abc
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.display.windows.window import Clock
from minihuman.errors import DeviceError
from minihuman.experiment.machine.inputs import SoundStarted
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.plan.trials import list_protocol_sounds, list_sounds
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.sounds import EXTRA, SoundContent, SoundCue, compute_digest, render_sound

LATENCY_S = 0.04  # requested from the device; with less, a busy machine interrupts the sound
RATE_HZ = 48_000
INSTALL_PORTAUDIO = "apt-get install libportaudio2"
_FITTED_BUFFERS = 512  # to whose times the device's clock is fitted, some 5 to 20 s
_LEAST_BUFFERS = 16  # before the clock is known
_LATEST_BUFFERS = 64  # whose median shows an interruption
_NEWEST_BUFFERS = 9  # whose median shows that there may have been an interruption
_FADE_S = 0.005  # in which a stopped sound fades out
_STEP_S = 0.002  # a larger difference of the latest buffers' median shows an interruption
_LEAST_UNCERTAINTY_S = 0.001  # the periods in which device and sound server count, which a fit does not show
_SPREAD_TO_UNCERTAINTY = 3.0  # robust standard deviations of the fitted times
_MAD_TO_SD = 1.4826  # the standard deviation of normal values, in median absolute deviations
_STUDY_HAS_SOUND = "the study has sound"  # why the device is opened, for errors
_NS_PER_S = 1_000_000_000
_LONGEST_START_NS = 5 * _NS_PER_S
_START_CHECK_S = 0.02


class SoundOutput(abc.ABC):
    """Plays a session's sounds, and reports when each began."""

    @abc.abstractmethod
    def follow(self, cues: Sequence[SoundCue]) -> None:
        """Play these sounds at their times, and stop all others; those of these sounds that have begun go on."""

    @abc.abstractmethod
    def read(self) -> Sequence[SoundStarted]:
        """Return the sounds that have begun since the last call, in order."""

    @property
    def next_report_ns(self) -> int | None:
        """Return the time from which `read` has a sound to return, if that is known; None otherwise."""
        return None

    def close(self) -> None:  # noqa: B027 - not every output has something to release
        """Release the device."""


class SimulatedOutput(SoundOutput):
    """A device without sound, for simulated participants: every sound begins exactly when it is due.

    Args:
        clock: the session's clock.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._waiting: dict[int, SoundCue] = {}
        self._begun: set[int] = set()

    def follow(self, cues: Sequence[SoundCue]) -> None:
        """Schedule these sounds, except those that have begun, and forget every other."""
        self._begun &= {cue.number for cue in cues}
        self._waiting = {cue.number: cue for cue in cues if cue.number not in self._begun}

    def read(self) -> Sequence[SoundStarted]:
        """Return the sounds that are due by now."""
        now_ns = self._clock()
        due = sorted((cue.due_ns, cue.number) for cue in self._waiting.values() if cue.due_ns <= now_ns)
        for _, number in due:
            self._begun.add(number)
            del self._waiting[number]
        return [SoundStarted(now_ns, number, due_ns, due_ns, 0) for due_ns, number in due]

    @property
    def next_report_ns(self) -> int | None:
        """Return the time at which the next sound is due; None if no sound is waiting."""
        return min((cue.due_ns for cue in self._waiting.values()), default=None)


class ClockFit:
    """Estimates the session's time at which a frame of the stream is heard.

    The device reports with each buffer when its first frame will be heard. These times jitter, though frames follow
    each other evenly. The line through them has the rate's slope; its offset is the latest buffers' median offset.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._offsets_s: deque[float] = deque(maxlen=_FITTED_BUFFERS)  # the time of frame 0, by buffer

    def add(self, frame: int, heard_s: float) -> None:
        """Add the number of a buffer's first frame, and the session's time in seconds at which it will be heard.

        If the latest times differ from the earlier ones, the stream was interrupted, and the earlier ones are dropped.
        """
        self._offsets_s.append(heard_s - frame / self._rate_hz)
        latest = [*self._offsets_s][-_LATEST_BUFFERS:]
        if abs(float(np.median(latest)) - self.offset_s) > _STEP_S:
            self._offsets_s = deque(latest, maxlen=_FITTED_BUFFERS)

    @property
    def is_ready(self) -> bool:
        """Return whether there are enough buffers for an estimate."""
        return len(self._offsets_s) >= _LEAST_BUFFERS

    @property
    def offset_s(self) -> float:
        """Return the session's time in seconds at which frame 0 was heard."""
        return float(np.median(self._offsets_s))

    @property
    def uncertainty_s(self) -> float:
        """Return a bound in seconds below which 99 % of the errors lie, apart from a constant delay.

        It is at least twice the newest times' difference from the line, as the stream may have been interrupted.
        """
        offsets_s = np.array(self._offsets_s)
        offset_s = float(np.median(offsets_s))
        spread_s = _MAD_TO_SD * float(np.median(np.abs(offsets_s - offset_s)))
        step_s = abs(float(np.median(offsets_s[-_NEWEST_BUFFERS:])) - offset_s)
        return max(_LEAST_UNCERTAINTY_S, _SPREAD_TO_UNCERTAINTY * spread_s, 2 * step_s)

    def find_time_s(self, frame: float) -> float:
        """Return the session's time in seconds at which a frame is heard."""
        return self.offset_s + frame / self._rate_hz

    def find_frame(self, time_s: float) -> int:
        """Return the frame that is heard at a session time in seconds."""
        return round((time_s - self.offset_s) * self._rate_hz)


@dataclass(slots=True)
class _Voice:
    """A sound that is waiting or playing."""

    samples: NDArray[np.float32]
    due_ns: int
    next_sample: int = 0
    first_frame: int | None = None  # the stream's frame at which it began; None before
    is_wanted: bool = True  # whether the session still names it
    is_cut: bool = False  # whether its samples end with a fade-out

    @property
    def is_over(self) -> bool:
        """Return whether all of the sound was played."""
        return self.first_frame is not None and self.next_sample >= len(self.samples)


class PortAudioOutput(SoundOutput):
    """Plays sounds through PortAudio.

    Args:
        clock: the session's clock.
        contents: the sounds of the session, which are decoded now.
        files: the protocol's files.
        purpose: why sounds are played, for errors.

    Raises:
        DeviceError: if PortAudio or a device is missing.
        WorldError: if a file cannot be decoded.
    """

    def __init__(
        self,
        clock: Clock,
        contents: Sequence[SoundContent],
        files: Mapping[str, bytes],
        *,
        purpose: str = _STUDY_HAS_SOUND,
    ) -> None:
        self._clock = clock
        self._files = files
        self._lock = threading.Lock()
        self._voices: dict[int, _Voice] = {}
        self._reports: list[SoundStarted] = []
        self._frame = 0  # number of the next buffer's first frame
        self._interruptions = 0
        self._stream = _open_stream(self._fill, purpose)
        self._rate_hz = float(self._stream.samplerate)
        self._fit = ClockFit(self._rate_hz)
        self._samples = {self._compute_digest(content): self._render(content) for content in contents}
        self._stream.start()
        self._await_clock()

    def facts(self) -> dict[str, str]:
        """Return facts about the device for the log."""
        import sounddevice

        device = sounddevice.query_devices(self._stream.device)
        return {
            "sound_device": f"{device['name']}, {sounddevice.query_hostapis(device['hostapi'])['name']}",
            "sound_rate_hz": f"{self._rate_hz:g}",
            "sound_latency_ms": f"{1000 * self._stream.latency:.1f}",
            "sound_library": sounddevice.get_portaudio_version()[1],
        }

    @property
    def interruptions(self) -> int:
        """Return how often the device ran out of samples."""
        return self._interruptions

    @property
    def uncertainty_ms(self) -> float | None:
        """Return the bound below which 99 % of the onsets' errors lie, apart from a constant delay; None if unknown."""
        if not self._fit.is_ready:
            return None
        return 1000 * self._fit.uncertainty_s

    def follow(self, cues: Sequence[SoundCue]) -> None:
        """Play these sounds at their times, and fade out all others."""
        numbers = {cue.number for cue in cues}
        new_voices = {cue.number: self._prepare(cue) for cue in cues if cue.number not in self._voices}
        with self._lock:
            for number, voice in self._voices.items():
                voice.is_wanted = number in numbers
            self._voices |= new_voices

    def read(self) -> Sequence[SoundStarted]:
        """Return the sounds that have begun since the last call.

        Raises:
            DeviceError: if the device has stopped.
        """
        if not self._stream.active:
            raise DeviceError("the sound device has stopped; connect it again, then resume the session")
        now_ns = self._clock()
        with self._lock:
            reports = [report for report in self._reports if report.onset_ns <= now_ns]
            self._reports = [report for report in self._reports if report.onset_ns > now_ns]
        return [SoundStarted(now_ns, *_list_times(report)) for report in reports]

    @property
    def next_report_ns(self) -> int | None:
        """Return the time at which the next sound that the device has taken is heard; None if there is none."""
        with self._lock:
            return min((report.onset_ns for report in self._reports), default=None)

    def close(self) -> None:
        """Stop the stream."""
        self._stream.close()

    def _await_clock(self) -> None:
        """Wait until the device's clock is known, without which no sound begins; close the stream if that fails.

        Raises:
            DeviceError: if the device plays nothing.
        """
        until_ns = self._clock() + _LONGEST_START_NS
        while not self._fit.is_ready:
            if self._clock() > until_ns:
                self._stream.close()
                raise DeviceError("the sound device opens, but plays nothing; start the system's sound server again")
            time.sleep(_START_CHECK_S)

    def _prepare(self, cue: SoundCue) -> _Voice:
        """Return a voice that is to begin when a cue is due, after rendering its sound if necessary."""
        digest = self._compute_digest(cue.content)
        if digest not in self._samples:
            self._samples[digest] = self._render(cue.content)
        return _Voice(self._samples[digest], cue.due_ns)

    def _compute_digest(self, content: SoundContent) -> str:
        return compute_digest(content, self._files)

    def _render(self, content: SoundContent) -> NDArray[np.float32]:
        return render_sound(content, self._files, round(self._rate_hz))

    # In the device's own thread

    def _fill(self, buffer: NDArray[np.float32], count: int, times: Any, status: Any) -> None:
        """Fill a buffer that the device is about to play, float32[count, 2], and add its time to the fit.

        ``times`` has PortAudio's times of the buffer, and ``status`` says whether the device ran out of samples.
        """
        now_s = self._clock() / _NS_PER_S
        self._fit.add(self._frame, now_s + times.outputBufferDacTime - times.currentTime)
        self._interruptions += bool(status.output_underflow)
        buffer.fill(0.0)
        with self._lock:
            for number, voice in self._voices.items():
                self._mix(number, voice, buffer)
            self._voices = {number: voice for number, voice in self._voices.items() if self._is_kept(voice)}
        np.clip(buffer, -1.0, 1.0, out=buffer)
        self._frame += count

    def _mix(self, number: int, voice: _Voice, buffer: NDArray[np.float32]) -> None:
        """Add a sound to a buffer if it has begun or begins there; report its onset, and fade it if it is unwanted."""
        offset = 0  # of the sound in the buffer
        if voice.first_frame is None:
            if not voice.is_wanted or not self._fit.is_ready:
                return
            offset = max(0, self._fit.find_frame(voice.due_ns / _NS_PER_S) - self._frame)
            if offset >= len(buffer):
                return
            voice.first_frame = self._frame + offset
            self._reports.append(self._describe(number, voice))
        if not voice.is_wanted and not voice.is_cut:
            voice.samples = self._fade_out(voice)
            voice.is_cut = True
        samples = voice.samples[voice.next_sample : voice.next_sample + len(buffer) - offset]
        buffer[offset : offset + len(samples)] += samples
        voice.next_sample += len(samples)

    @staticmethod
    def _is_kept(voice: _Voice) -> bool:
        """Return whether a sound is still needed: it fades out, or the session names it and it must not begin again."""
        return voice.is_wanted or (voice.first_frame is not None and not voice.is_over)

    def _fade_out(self, voice: _Voice) -> NDArray[np.float32]:
        """Return a sound's samples up to now, followed by a short fade-out."""
        ahead = voice.samples[voice.next_sample : voice.next_sample + round(_FADE_S * self._rate_hz)]
        fade = np.linspace(1.0, 0.0, len(ahead), dtype=np.float32)[:, None]
        return np.concatenate([voice.samples[: voice.next_sample], ahead * fade])

    def _describe(self, number: int, voice: _Voice) -> SoundStarted:
        """Return the report that a sound began; the time of the report itself is set when it is read."""
        assert voice.first_frame is not None
        onset_ns = round(self._fit.find_time_s(voice.first_frame) * _NS_PER_S)
        uncertainty_ns = round(self._fit.uncertainty_s * _NS_PER_S)
        return SoundStarted(0, number, voice.due_ns, onset_ns, uncertainty_ns)


def list_sound_cues(session: SessionMachine) -> tuple[SoundCue, ...]:
    """Return the sounds that a session plays now or schedules; none while a pause or a question covers the part."""
    part = session.part
    if session.over or session.phase is not part.phase:
        return ()
    return part.sound_cues


@contextmanager
def open_sound(plan: SessionPlan, clock: Clock) -> Iterator[tuple[PortAudioOutput | None, dict[str, str]]]:
    """Open the sound device for a session, with its sounds decoded; yield it with facts about it for the log.

    It yields None if the session has no sounds.

    Raises:
        DeviceError: if PortAudio or a device is missing.
        WorldError: if a sound's file cannot be decoded.
    """
    contents = list_sounds(plan)
    if not contents:
        yield None, {}
        return
    with closing(PortAudioOutput(clock, contents, plan.files)) as output:
        yield output, output.facts()


def require_sound_device(protocol: Protocol) -> None:
    """Refuse a protocol with sounds if no sound device opens.

    Raises:
        DeviceError: if the protocol has sounds, and PortAudio or a device is missing.
    """
    if list_protocol_sounds(protocol):
        _open_stream(lambda *_: None).close()


def _list_times(report: SoundStarted) -> tuple[int, int, int, int]:
    """Return the number of a sound's cue, its due time, its onset and the onset's uncertainty."""
    return report.cue, report.scheduled_ns, report.onset_ns, report.uncertainty_ns


def import_sounddevice(purpose: str) -> Any:
    """Return the module ``sounddevice``.

    Args:
        purpose: what needs it, such as "the study has sound", for the errors.

    Raises:
        DeviceError: if the package or PortAudio is missing.
    """
    try:
        import sounddevice
    except ImportError as error:
        raise DeviceError(f"{purpose}, for which the package sounddevice is missing; {EXTRA}") from error
    except OSError as error:
        raise DeviceError(f"{purpose}, for which PortAudio is missing; {INSTALL_PORTAUDIO}") from error
    return sounddevice


def _open_stream(fill: Callable[..., None], purpose: str = _STUDY_HAS_SOUND) -> Any:
    """Open the default sound device.

    Raises:
        DeviceError: if PortAudio or a device is missing; it names the purpose.
    """
    sounddevice = import_sounddevice(purpose)
    try:
        return sounddevice.OutputStream(
            samplerate=RATE_HZ, channels=2, dtype="float32", latency=LATENCY_S, callback=fill
        )
    except (sounddevice.PortAudioError, ValueError) as error:
        reason = explain_failure(error, sounddevice.default.device[1])
        raise DeviceError(
            f"{purpose}, but no sound device opens ({reason}); connect one and start the sound server"
        ) from error


def explain_failure(error: Exception, device: int) -> str:
    """Return why PortAudio did not open a device, by its error and the device's number; below 0: there is none."""
    if device < 0:
        return "there is none"
    return str(error.args[0]) if error.args else type(error).__name__
