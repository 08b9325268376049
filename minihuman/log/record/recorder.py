"""The recorder port, a recorder in memory, and recorders that wrap another one. Knows no file format.

``BufferedRecorder`` joins many writes into one where no frame waits for its log (simulated sessions; the finished log
is the same). ``DeferredRecorder`` keeps events in memory until the participant has consented or the group is
allocated: a participant who declines, closes the window or stays away before that leaves nothing on disk. One
contract suite runs every recorder.
"""

import abc
from collections.abc import Callable, Sequence
from pathlib import Path

from minihuman.experiment.machine.events import Event, Noted, Stepped
from minihuman.experiment.machine.part_sequence import asks_consent_before_play
from minihuman.experiment.pending_session import is_allocation_pending
from minihuman.experiment.plan.session_plan import SessionPlan


class Recorder(abc.ABC):
    """Takes a session's events as they happen and makes them last."""

    def write(self, events: Sequence[Event]) -> None:
        """Take the events of one input, in order, and wait until they outlive the process.

        Raises:
            LogError: as ``begin`` and ``settle``.
        """
        self.begin(events)
        self.settle()

    @abc.abstractmethod
    def begin(self, events: Sequence[Event]) -> None:
        """Take the events of one input, in order, without waiting for them: a picture is drawn meanwhile.

        Raises:
            LogError: if an earlier write failed (disk full, device gone); nothing more is taken.
        """

    def settle(self) -> None:
        """Wait until what was begun outlives the process.

        Raises:
            LogError: if it could not be written.
        """
        return

    @property
    @abc.abstractmethod
    def durable_steps(self) -> int:
        """The number of Stepped events of this segment that are fsynced."""

    @property
    @abc.abstractmethod
    def durable_writes(self) -> int:
        """The number of writes with events that are fsynced, each with all before it."""

    @abc.abstractmethod
    def close(self) -> Path | None:
        """Write what is queued, finish the log, and say where it is (None: in memory). A second call does nothing."""


class MemoryRecorder(Recorder):
    """Keeps events in a list: for tests and for simulated play that needs no file."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._writes = 0

    def begin(self, events: Sequence[Event]) -> None:
        """Take the events."""
        self.events.extend(events)
        self._writes += bool(events)

    @property
    def durable_steps(self) -> int:
        """The number of steps taken; memory is as durable as it gets."""
        return sum(isinstance(event, Stepped) for event in self.events)

    @property
    def durable_writes(self) -> int:
        """The number of writes."""
        return self._writes

    def close(self) -> None:
        """Do nothing: there is nothing to finish."""


class WrappedRecorder(Recorder):
    """Forwards to another recorder; a subclass overrides ``begin`` or another method.

    Args:
        recorder: takes the events; closed with this one.
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
        """Wait as the wrapped recorder does.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._recorder.settle()

    @property
    def durable_steps(self) -> int:
        """The number of steps that the wrapped recorder has made durable."""
        return self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """The number of writes that the wrapped recorder has made durable."""
        return self._recorder.durable_writes

    def close(self) -> Path | None:
        """Close the wrapped recorder."""
        return self._recorder.close()


MAX_BUFFERED_EVENTS = 256  # events that may wait


class BufferedRecorder(WrappedRecorder):
    """Joins many writes into one, on ``flush`` or when enough events wait; the finished log is the same.

    A live file takes a chunk per write, and finishing it reads each: a write per step would cost as much as its play.
    ``durable_writes`` counts the joined writes.
    """

    def __init__(self, recorder: Recorder) -> None:
        super().__init__(recorder)
        self._waiting: list[Event] = []

    def begin(self, events: Sequence[Event]) -> None:
        """Take the events; hand over all that wait where they are enough.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._waiting += events
        if len(self._waiting) >= MAX_BUFFERED_EVENTS:
            self._begin_waiting()

    def flush(self) -> None:
        """Write what waits.

        Raises:
            LogError: as the wrapped recorder does.
        """
        self._begin_waiting()
        self.settle()

    def _begin_waiting(self) -> None:
        waiting = self._waiting
        self._waiting = []
        if waiting:
            self._recorder.begin(waiting)

    def close(self) -> Path | None:
        """Write what waits and finish the log."""
        try:
            self.flush()
        finally:
            path = self._recorder.close()
        return path


class _NullRecorder(MemoryRecorder):
    """Stands for a recorder that is not open yet: nothing is recorded."""

    def begin(self, events: Sequence[Event]) -> None:
        """Take nothing."""


class DeferredRecorder(WrappedRecorder):
    """Opens a recorder at the consent and hands it all that came before, with the times that it had.

    A session that does not begin with a consent, or that is resumed after one, is recorded from its first event.

    Args:
        plan: what is about to be played.
        open_recorder: makes the recorder; called once, or never.

    Raises:
        LogError: as ``open_recorder`` does, where there is nothing to wait for.
    """

    def __init__(self, plan: SessionPlan, open_recorder: Callable[[], Recorder]) -> None:
        self._open_recorder = open_recorder
        self._waiting: list[Sequence[Event]] = []  # per write
        self._asks = asks_consent_before_play(plan)
        self._waits = self._asks or is_allocation_pending(plan)
        self._closed = False
        super().__init__(_NullRecorder() if self._waits else open_recorder())

    @property
    def opened(self) -> bool:
        """Whether anything is recorded."""
        return not self._waits

    def begin(self, events: Sequence[Event]) -> None:
        """Take the events; with those that waited, if the consent is among them.

        Raises:
            LogError: as the wrapped recorder does; also if it cannot be opened.
        """
        if not self._waits:
            self._recorder.begin(events)
        elif not self._closed:
            self._waiting.append(events)
            agreed = any(isinstance(event, Noted) and event.kind == "consent" for event in events)
            if events and (agreed or not self._asks):
                self._recorder = self._open_recorder()
                self._waits = False
                waiting = self._waiting
                self._waiting = []
                for batch in waiting:
                    self._recorder.begin(batch)

    def close(self) -> Path | None:
        """Finish the log, if there is one; else forget what waited."""
        self._closed = True
        self._waiting = []
        return self._recorder.close()
