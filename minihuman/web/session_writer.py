"""Writes a session's events, and derives from the durable writes which of the page's messages are safe.

It has no disk of its own and no clock.
"""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import awaits_allocation
from minihuman.log.record.recorder import Recorder


@dataclass(slots=True)
class _PendingMessage:
    """A received message of the page, which is safe once the write with a given number is on the disk."""

    number: int
    write_number: int


class SessionWriter:
    """Writes the events of a session and a few events of the page.

    Args:
        session: the session.
        recorder: the recorder to which the events are written.
    """

    def __init__(self, session: SessionMachine, recorder: Recorder) -> None:
        self.count = 0  # number of writes
        self._session = session
        self._recorder = recorder
        self._before_plan: list[Event] = []  # events to be written once the group is drawn
        self._unwritten: list[Event] = []  # events to be written with those of the next message
        self._pending: deque[_PendingMessage] = deque()
        self._settled = 0  # number of the page's last safe message

    def write(self, events: Sequence[Event]) -> None:
        """Write events, after those that ``write_later`` kept.

        Until the participant's group is drawn, events are kept; afterwards they are written in order of time.
        """
        events = [*self._unwritten, *events]
        self._unwritten = []
        if awaits_allocation(self._session):
            self._before_plan += events
            return
        if events and self._before_plan:
            events = sorted([*events, *self._before_plan], key=lambda event: event.t_ns)
            self._before_plan = []
        if events:
            self.count += 1
            self._recorder.write(events)

    def write_later(self, events: Sequence[Event]) -> None:
        """Keep events until the next write, and write them together with it."""
        self._unwritten += events

    # Which messages are safe

    def begin_stream(self, settled: int) -> None:
        """Begin another stream of the page, whose messages up to ``settled`` were acknowledged."""
        self._settled = settled
        self._pending.clear()

    def record_taken(self, number: int, *, with_next: bool = False) -> None:
        """Record that a message of the page was taken, and its events were given to ``write`` or ``write_later``.

        Args:
            number: the message's number.
            with_next: whether the message is safe only once the next write is.
        """
        write_number = self.count
        if with_next or self._unwritten or awaits_allocation(self._session):
            write_number += 1
        self._pending.append(_PendingMessage(number, write_number))

    def safe(self, durable: int | None = None) -> int:
        """Return the number up to which all of the page's messages are on the disk and can be acknowledged.

        Args:
            durable: how many of the recorder's writes count as durable; None for all on the disk, -1 for none at all.
        """
        if durable is None:
            durable = self._recorder.durable_writes
        while self._pending and self._pending[0].write_number <= durable:
            self._settled = self._pending.popleft().number
        return self._settled
