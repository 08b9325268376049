"""The recorder interface, a recorder in memory, and recorders that wrap another one. It knows no file format.

``BufferedRecorder`` joins many writes into one if no frame waits for its log, as in simulated sessions; the finished
log is the same. ``DeferredRecorder`` keeps events in memory until the participant has consented or the group is
allocated, so that a participant who declines, closes the window or stays away before that leaves nothing on disk. One
contract test suite covers every recorder.
"""

import abc
from collections.abc import Callable, Sequence
from pathlib import Path

from minihuman.experiment.machine.events import Event, Noted, Stepped
from minihuman.experiment.machine.part_sequence import asks_consent_before_play
from minihuman.experiment.pending_session import is_allocation_pending
from minihuman.experiment.plan.session_plan import SessionPlan


class Recorder(abc.ABC):
    """Receives a session's events as they occur and makes them durable."""

    def write(self, events: Sequence[Event]) -> None:
        """Write the events of one input, in order, and wait until they survive the process.

        Raises:
            LogError: as ``begin`` and ``settle`` do.
        """
        self.begin(events)
        self.settle()

    @abc.abstractmethod
    def begin(self, events: Sequence[Event]) -> None:
        """Begin to write the events of one input, in order, without waiting, so that a picture can be drawn meanwhile.

        Raises:
            LogError: if an earlier write failed (disk full, device gone); no more events are accepted.
        """

    def settle(self) -> None:
        """Wait until the begun write survives the process.

        Raises:
            LogError: if it could not be written.
        """
        return

    @property
    @abc.abstractmethod
    def durable_steps(self) -> int:
        """Return the number of Stepped events of this segment that are fsynced."""

    @property
    @abc.abstractmethod
    def durable_writes(self) -> int:
        """Return the number of writes with events that are fsynced, each together with all before it."""

    @abc.abstractmethod
    def close(self) -> Path | None:
        """Finish the log and return its path; None if it is in memory. A second call does nothing more."""


class MemoryRecorder(Recorder):
    """Keeps events in a list, for tests and for simulated play that needs no file."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._writes = 0

    def begin(self, events: Sequence[Event]) -> None:
        """Add the events to the list."""
        self.events.extend(events)
        self._writes += bool(events)

    @property
    def durable_steps(self) -> int:
        """Return the number of recorded steps, all of which count as durable in memory."""
        return sum(isinstance(event, Stepped) for event in self.events)

    @property
    def durable_writes(self) -> int:
        """Return the number of writes with events."""
        return self._writes

    def close(self) -> None:
        """Do nothing, since there is no log to finish."""


class WrappedRecorder(Recorder):
    """Forwards to another recorder; a subclass overrides ``begin`` or another method.

    Args:
        recorder: the recorder that receives the events; it is closed with this one.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def begin(self, events: Sequence[Event]) -> None:
        """Forward the events without waiting for the disk.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._recorder.begin(events)

    def settle(self) -> None:
        """Wait until the wrapped recorder's begun write survives the process.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._recorder.settle()

    @property
    def durable_steps(self) -> int:
        """Return the number of steps that the wrapped recorder has made durable."""
        return self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """Return the number of writes that the wrapped recorder has made durable."""
        return self._recorder.durable_writes

    def close(self) -> Path | None:
        """Close the wrapped recorder and return the path of its log; None if it has none."""
        return self._recorder.close()


MAX_BUFFERED_EVENTS = 256  # events that are buffered before a write


class BufferedRecorder(WrappedRecorder):
    """Joins many writes into one, on ``flush`` or when enough events are buffered; the finished log is the same.

    A live file gets a chunk per write, and finishing it reads each chunk, so a write per step would cost as much as
    playing. ``durable_writes`` counts the joined writes.
    """

    def __init__(self, recorder: Recorder) -> None:
        super().__init__(recorder)
        self._waiting: list[Event] = []

    def begin(self, events: Sequence[Event]) -> None:
        """Buffer the events, and forward the whole buffer if it holds enough.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._waiting += events
        if len(self._waiting) >= MAX_BUFFERED_EVENTS:
            self._forward_buffered()

    def flush(self) -> None:
        """Write the buffered events.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._forward_buffered()
        self.settle()

    def _forward_buffered(self) -> None:
        waiting = self._waiting
        self._waiting = []
        if waiting:
            self._recorder.begin(waiting)

    def close(self) -> Path | None:
        """Write the buffered events, finish the log and return its path; None if there is none."""
        try:
            self.flush()
        finally:
            path = self._recorder.close()
        return path


class _NullRecorder(MemoryRecorder):
    """A placeholder for a recorder that is not open yet; it records nothing."""

    def begin(self, events: Sequence[Event]) -> None:
        """Ignore the events."""


class DeferredRecorder(WrappedRecorder):
    """Opens a recorder at the consent and passes it all earlier events, with their original times.

    A session that does not begin with a consent, or that is resumed after one, is recorded from its first event. A
    session whose group is not allocated yet is recorded from its first later event.

    Args:
        plan: the session's plan.
        open_recorder: opens the recorder; it is called once, or never.

    Raises:
        LogError: as ``open_recorder`` does, if there is nothing to wait for.
    """

    def __init__(self, plan: SessionPlan, open_recorder: Callable[[], Recorder]) -> None:
        self._open_recorder = open_recorder
        self._waiting: list[Sequence[Event]] = []  # the events of each write before the consent
        self._asks_consent = asks_consent_before_play(plan)
        self._is_deferred = self._asks_consent or is_allocation_pending(plan)
        self._closed = False
        super().__init__(self._make_first_recorder())

    def _make_first_recorder(self) -> Recorder:
        """Open the recorder, or return a placeholder if the session has to wait for a consent or an allocation."""
        if self._is_deferred:
            return _NullRecorder()
        return self._open_recorder()

    @property
    def opened(self) -> bool:
        """Return whether the session is being recorded."""
        return not self._is_deferred

    def begin(self, events: Sequence[Event]) -> None:
        """Keep the events, or record them; the kept events are recorded first once the participant consents.

        Raises:
            LogError: as the wrapped recorder does, or if it cannot be opened.
        """
        if not self._is_deferred:
            self._recorder.begin(events)
        elif not self._closed:
            self._waiting.append(events)
            has_consent = any(isinstance(event, Noted) and event.kind == "consent" for event in events)
            if events and (has_consent or not self._asks_consent):
                self._recorder = self._open_recorder()
                self._is_deferred = False
                waiting = self._waiting
                self._waiting = []
                for batch in waiting:
                    self._recorder.begin(batch)

    def close(self) -> Path | None:
        """Finish the log and return its path.

        The result is None if nothing is recorded; the kept events are then discarded.
        """
        self._closed = True
        self._waiting = []
        return self._recorder.close()
