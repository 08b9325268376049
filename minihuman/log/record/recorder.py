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

    @property
    @abc.abstractmethod
    def durable_steps(self) -> int:
        """How many Stepped events of this segment are fsynced."""

    @abc.abstractmethod
    def close(self) -> Path | None:
        """Write what is queued, finish the log, and say where it is (None: in memory). A second call does nothing."""


class MemoryRecorder(Recorder):
    """Keeps events in a list: for tests and for simulated play that needs no file."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def write(self, events: Sequence[Event]) -> None:
        """Take the events."""
        self.events.extend(events)

    @property
    def durable_steps(self) -> int:
        """How many steps were taken; memory is as durable as it gets."""
        return sum(isinstance(event, Stepped) for event in self.events)

    def close(self) -> None:
        """Nothing to finish."""
