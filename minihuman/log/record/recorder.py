"""The port every recorder implements: MCAP on disk, a list in memory. One contract suite runs them both."""

import abc
from collections.abc import Sequence
from pathlib import Path

from minihuman.study.events import Event, Stepped


class Recorder(abc.ABC):
    """Takes a session's events as they happen and makes them last. ``write`` never waits for the disk."""

    @abc.abstractmethod
    def write(self, events: Sequence[Event]) -> None:
        """Take the events of one input, in order.

        Raises:
            LogError: if an earlier write failed (disk full, device gone); nothing more is taken.
        """

    def begin(self, events: Sequence[Event]) -> None:
        """Take events as ``write`` does, but perhaps not wait for them: a picture is drawn meanwhile.

        Raises:
            LogError: as ``write``.
        """
        self.write(events)

    def settle(self) -> None:
        """Wait until what was begun is where ``write`` would have left it.

        Raises:
            LogError: if it could not be written.
        """
        return

    @property
    @abc.abstractmethod
    def durable_steps(self) -> int:
        """How many Stepped events of this segment are fsynced."""

    @property
    @abc.abstractmethod
    def durable_writes(self) -> int:
        """How many of the writes that had events are fsynced, each with all before it."""

    @abc.abstractmethod
    def close(self) -> Path | None:
        """Write what is queued, finish the log, and say where it is (None: in memory). A second call does nothing."""


class MemoryRecorder(Recorder):
    """Keeps events in a list: for tests and for simulated play that needs no file."""

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._writes = 0

    def write(self, events: Sequence[Event]) -> None:
        """Take the events."""
        self.events.extend(events)
        self._writes += bool(events)

    @property
    def durable_steps(self) -> int:
        """How many steps were taken; memory is as durable as it gets."""
        return sum(isinstance(event, Stepped) for event in self.events)

    @property
    def durable_writes(self) -> int:
        """How many there were."""
        return self._writes

    def close(self) -> None:
        """Nothing to finish."""
