"""The Lab Streaming Layer: a stream as a device, and a session's markers as a stream. It needs the extra ``lsl``.

EEG systems, eye trackers and LabRecorder record the markers together with their own data. A marker is one JSON text
with the terms of the tables and of ``export bids``: ``{"trial_type": "step", "episode": 3}``. Its time is the event's
own time in the log, converted to LSL's clock, not the time of sending.
"""

import queue
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from minihuman.dataset.table_columns import table_key_name
from minihuman.display.windows.window import Clock
from minihuman.errors import DeviceError
from minihuman.experiment.machine.events import (
    EpisodeEnded,
    EpisodeStarted,
    Event,
    FrameShown,
    KeyPressed,
    Paused,
    Resumed,
    SessionEnded,
    SessionStarted,
    Stepped,
)
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.record.recorder import Recorder, WrappedRecorder
from minihuman.runtime.devices.device import Device, DeviceSample

STREAM_TIMEOUT_S = 5.0  # for a stream, before it counts as missing
_MAX_SAMPLES = 4096  # per call
_CLOCK_READINGS = 20  # of which the fastest counts


class LslDevice(Device):
    """Samples one LSL stream: numbers as values, texts as text. Times are the sender's, corrected by LSL.

    Args:
        name: the stream's name; "" for the only stream that is not minihuman's own marker stream.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._inlet: Any = None
        self._offset_s = 0.0  # LSL's clock at session time 0

    def open(self, clock: Clock) -> dict[str, str]:
        """Find the stream and start receiving it; return facts about it.

        Raises:
            DeviceError: if LSL is not installed, or there is no such stream or more than one.
        """
        lsl = pylsl()
        if self._name:
            streams = lsl.resolve_byprop("name", self._name, timeout=STREAM_TIMEOUT_S)
        else:
            streams = lsl.resolve_streams(wait_time=STREAM_TIMEOUT_S)
            streams = [stream for stream in streams if stream.name() != MARKER_STREAM_NAME]
        if len(streams) != 1:
            names = ", ".join(stream.name() for stream in streams) or "none"
            raise DeviceError(
                f"LSL stream {self._name!r}: expected one stream but found {names}; start it, or give its exact name"
            )
        info = streams[0]
        self._inlet = lsl.StreamInlet(info, processing_flags=lsl.proc_clocksync | lsl.proc_monotonize)
        self._inlet.open_stream(timeout=STREAM_TIMEOUT_S)
        self._offset_s = measure_lsl_at_zero_s(clock)
        return {"stream": info.name(), "type": info.type(), "rate_hz": f"{info.nominal_srate():g}"}

    def read(self) -> Sequence[DeviceSample]:
        """Return the samples that have arrived since the last call, at most `_MAX_SAMPLES`."""
        rows, stamps = self._inlet.pull_chunk(timeout=0.0, max_samples=_MAX_SAMPLES)
        return [self._convert_sample(row, stamp_s) for row, stamp_s in zip(rows or (), stamps or (), strict=True)]

    def close(self) -> None:
        """Stop receiving the stream."""
        if self._inlet is not None:
            self._inlet.close_stream()

    def _convert_sample(self, row: Sequence[Any], stamp_s: float) -> DeviceSample:
        """Convert a sample from LSL's clock, in seconds, to the session's."""
        t_ns = round((stamp_s - self._offset_s) * 1e9)
        if row and isinstance(row[0], str):
            return DeviceSample(t_ns, text=" ".join(row))
        return DeviceSample(t_ns, tuple(map(float, row)))


def pylsl() -> Any:
    """Import and return the library pylsl.

    Raises:
        DeviceError: if it is not installed.
    """
    try:
        import pylsl as library
    except (ImportError, RuntimeError) as error:  # RuntimeError: it is there, liblsl is not
        raise DeviceError(
            f"the Lab Streaming Layer is not available ({error}); run: pip install 'pylsl>=1.18'"
        ) from error
    return library


def measure_lsl_at_zero_s(clock: Clock) -> float:
    """Return LSL's time in seconds at session time 0, from the fastest of several readings of both clocks."""
    library = pylsl()
    readings = []
    for _ in range(_CLOCK_READINGS):
        before_ns = time.perf_counter_ns()
        session_ns = clock()
        lsl_s = library.local_clock()
        readings.append((time.perf_counter_ns() - before_ns, lsl_s - session_ns / 1e9))
    return float(min(readings)[1])


MARKER_STREAM_NAME = "minihuman"
_S_PER_NS = 1e-9


class LslMarkerRecorder(WrappedRecorder):
    """Forwards events to a recorder, and sends them as LSL markers from a thread of its own.

    Args:
        recorder: the recorder of the log; it is closed with this one. Events that it refuses get no markers.
        plan: the session's plan; the stream's description has the participant's code.
        clock: the session's clock.

    Raises:
        DeviceError: if the Lab Streaming Layer is not installed.
    """

    def __init__(self, recorder: Recorder, plan: SessionPlan, clock: Clock) -> None:
        lsl = pylsl()
        super().__init__(recorder)
        self._at_zero_s = measure_lsl_at_zero_s(clock)
        source_id = f"minihuman-{plan.study}-{plan.participant.id}-ses-{plan.session}-seg-{plan.segment}"
        info = lsl.StreamInfo(MARKER_STREAM_NAME, "Markers", 1, lsl.IRREGULAR_RATE, lsl.cf_string, source_id)
        description = info.desc().append_child("session")
        session_fields = {
            "study": plan.study,
            "participant": plan.participant.id,
            "session": plan.session,
            "segment": plan.segment,
        }
        for name, content in session_fields.items():
            description.append_child_value(name, str(content))
        self._outlet = lsl.StreamOutlet(info)
        self._queue: queue.SimpleQueue[Sequence[Event] | None] = queue.SimpleQueue()
        self._action_names: tuple[str, ...] = ()
        self._thread = threading.Thread(target=self._send_markers, name="minihuman-markers", daemon=True)
        self._thread.start()

    def begin(self, events: Sequence[Event]) -> None:
        """Forward the events and queue their markers.

        Raises:
            LogError: as the wrapped recorder does; these events then have no markers.
        """
        self._recorder.begin(events)
        self._queue.put(tuple(events))

    def close(self) -> Path | None:
        """Send the remaining markers, finish the log, and return its path; None if there is no file."""
        self._queue.put(None)
        self._thread.join()
        return self._recorder.close()

    def has_listener(self, timeout_s: float) -> bool:
        """Wait for a program that receives the stream; return whether there is one within ``timeout_s`` seconds."""
        return bool(self._outlet.wait_for_consumers(timeout_s))

    def _send_markers(self) -> None:
        """Send the markers of queued events until the queue holds None."""
        while (events := self._queue.get()) is not None:
            for event in events:
                if isinstance(event, EpisodeStarted):
                    self._action_names = event.action_names
                marker = build_marker(event, self._action_names)
                if marker is not None:
                    t_ns, terms = marker
                    text = msgspec.json.encode(terms).decode()
                    self._outlet.push_sample([text], self._at_zero_s + t_ns * _S_PER_NS)


def build_marker(event: Event, action_names: Sequence[str]) -> tuple[int, dict[str, Any]] | None:
    """Return an event's time in nanoseconds since the segment's start, and the terms of its marker.

    Return None if the event has no marker. Episodes are counted from 1.

    Args:
        event: the event.
        action_names: the names of the actions in the world of the running episode.
    """
    match event:
        case SessionStarted():
            return event.t_ns, {"trial_type": "session", "segment": event.plan.segment}
        case EpisodeStarted(plan=plan):
            return event.t_ns, {"trial_type": "episode", "episode": plan.episode + 1, "block": plan.block_name}
        case Stepped():
            terms = {"trial_type": "step", "episode": event.episode + 1, "step": event.step}
            return event.t_ns, terms | {"action": action_names[event.action], "reward": event.reward}
        case FrameShown():
            return event.flip_ns, {"trial_type": "flip", "episode": event.episode + 1, "step": event.step}
        case KeyPressed(down=True):
            return event.t_ns, {"trial_type": "key", "key": table_key_name(event.key), "verdict": event.verdict}
        case Paused():
            return event.t_ns, {"trial_type": "pause", "detail": event.reason}
        case Resumed():
            return event.t_ns, {"trial_type": "resume"}
        case EpisodeEnded():
            terms = {"trial_type": "episode_end", "episode": event.episode + 1}
            return event.t_ns, terms | {"outcome": event.outcome}
        case SessionEnded():
            return event.t_ns, {"trial_type": "session_end", "detail": event.reason}
    return None
