"""Markers out: what happens in a session, as an LSL stream that EEG, eye tracking and LabRecorder record beside theirs.

One text a marker, JSON in the words of the tables and of ``export bids``: ``{"trial_type": "step", "episode": 3}``.
Its time is the event's own, the same as in the log, told in LSL's clock: not when it was sent.
"""

import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from minihuman.data.rows import key_in_tables
from minihuman.log.record.recorder import Recorder
from minihuman.seats.devices.lsl import lsl_at_zero, pylsl
from minihuman.study.events import (
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
from minihuman.study.plan import SessionPlan
from minihuman.windows.port import Clock

STREAM = "minihuman"
_NS = 1e-9


class MarkingRecorder(Recorder):
    """Hands events to a recorder, and then, on a thread of its own, to whoever listens by LSL.

    Args:
        recorder: the log; closed with this one. What it refuses is not marked.
        plan: whose session it is; the stream says the participant's code.
        clock: the session's.

    Raises:
        DeviceError: if the Lab Streaming Layer is not installed.
    """

    def __init__(self, recorder: Recorder, plan: SessionPlan, clock: Clock) -> None:
        lsl = pylsl()
        self._recorder = recorder
        self._at_zero_s = lsl_at_zero(clock)
        whose = f"{plan.study}-{plan.participant.id}-ses-{plan.session}-seg-{plan.segment}"
        info = lsl.StreamInfo(STREAM, "Markers", 1, lsl.IRREGULAR_RATE, lsl.cf_string, f"minihuman-{whose}")
        about = info.desc().append_child("session")
        for name, value in (("study", plan.study), ("participant", plan.participant.id)):
            about.append_child_value(name, value)
        for name, number in (("session", plan.session), ("segment", plan.segment)):
            about.append_child_value(name, str(number))
        self._outlet = lsl.StreamOutlet(info)
        self._queue: queue.SimpleQueue[Sequence[Event] | None] = queue.SimpleQueue()
        self._action_names: tuple[str, ...] = ()
        self._thread = threading.Thread(target=self._run, name="minihuman-markers", daemon=True)
        self._thread.start()

    def write(self, events: Sequence[Event]) -> None:
        """As the port says; what is in the log is then marked."""
        self._recorder.write(events)
        self._queue.put(tuple(events))

    @property
    def durable_steps(self) -> int:
        """As the recorder says."""
        return self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """How many writes are fsynced."""
        return self._recorder.durable_writes

    def close(self) -> Path | None:
        """Mark what is left, and finish the log."""
        self._queue.put(None)
        self._thread.join()
        return self._recorder.close()

    def listened_to(self, timeout_s: float) -> bool:
        """Wait until somebody listens; False if nobody came."""
        return bool(self._outlet.wait_for_consumers(timeout_s))

    def _run(self) -> None:
        while (events := self._queue.get()) is not None:
            for event in events:
                if isinstance(event, EpisodeStarted):
                    self._action_names = event.action_names
                marker = marker_of(event, self._action_names)
                if marker is not None:
                    t_ns, words = marker
                    said = msgspec.json.encode(words).decode()
                    self._outlet.push_sample([said], self._at_zero_s + t_ns * _NS)


def marker_of(event: Event, action_names: Sequence[str]) -> tuple[int, dict[str, Any]] | None:
    """When an event was, ns of segment time, and its marker; None for events that are none. Episodes count from 1."""
    match event:
        case SessionStarted():
            return event.t_ns, {"trial_type": "session", "segment": event.plan.segment}
        case EpisodeStarted(plan=plan):
            return event.t_ns, {"trial_type": "episode", "episode": plan.episode + 1, "block": plan.block_name}
        case Stepped():
            words = {"trial_type": "step", "episode": event.episode + 1, "step": event.step}
            return event.t_ns, words | {"action": action_names[event.action], "reward": event.reward}
        case FrameShown():
            return event.flip_ns, {"trial_type": "flip", "episode": event.episode + 1, "step": event.step}
        case KeyPressed(down=True):
            return event.t_ns, {"trial_type": "key", "key": key_in_tables(event.key), "verdict": event.verdict}
        case Paused():
            return event.t_ns, {"trial_type": "pause", "detail": event.reason}
        case Resumed():
            return event.t_ns, {"trial_type": "resume"}
        case EpisodeEnded():
            words = {"trial_type": "episode_end", "episode": event.episode + 1}
            return event.t_ns, words | {"outcome": event.outcome}
        case SessionEnded():
            return event.t_ns, {"trial_type": "session_end", "detail": event.reason}
    return None
