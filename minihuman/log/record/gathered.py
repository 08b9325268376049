"""Many inputs in one write: for sessions that nobody sits in, where no picture waits for its log."""

from collections.abc import Sequence
from pathlib import Path

from minihuman.log.record.recorder import Recorder
from minihuman.study.events import Event

MOST = 256  # events that may wait


class GatheringRecorder(Recorder):
    """Hands on what it was given when it is asked to, or has enough; the finished log is the same.

    A live file takes a chunk a write, and finishing it reads each: a step a write costs as much as playing the step.

    Args:
        recorder: takes the events.
    """

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self._waiting: list[Event] = []

    def write(self, events: Sequence[Event]) -> None:
        """Take the events.

        Raises:
            LogError: as the recorder does.
        """
        self._waiting += events
        if len(self._waiting) >= MOST:
            self.hand_on()

    def hand_on(self) -> None:
        """Write what waits.

        Raises:
            LogError: as the recorder does.
        """
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._recorder.write(waiting)

    @property
    def durable_steps(self) -> int:
        """As the recorder says."""
        return self._recorder.durable_steps

    @property
    def durable_writes(self) -> int:
        """How many writes the recorder has made durable: fewer than were made here."""
        return self._recorder.durable_writes

    def close(self) -> Path | None:
        """Write what waits and finish the log."""
        try:
            self.hand_on()
        finally:
            path = self._recorder.close()
        return path
