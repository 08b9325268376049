"""Writes a session's events, and knows by that which of the page's messages are safe. No disk of its own, no clock."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import awaits_allocation
from minihuman.log.record.recorder import Recorder


@dataclass(slots=True)
class _PendingMessage:
    """A message of the page's that was taken, and the write that has to be on the disk for it to be safe."""

    number: int
    write: int


class SessionWriter:
    """Writes the events of a session and a few of the page's own.

    Args:
        session: whose events they are.
        recorder: where they go.
    """

    def __init__(self, session: SessionMachine, recorder: Recorder) -> None:
        self.count = 0  # writes of events
        self._session = session
        self._recorder = recorder
        self._before_plan: list[Event] = []  # of the page's own, until the group is drawn
        self._unwritten: list[Event] = []  # of messages that others came with
        self._pending: deque[_PendingMessage] = deque()
        self._settled = 0  # the last message of the page's that is safe

    def write(self, events: Sequence[Event]) -> None:
        """Write what the session says; what the page says of itself before there is a plan comes with it."""
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
        """Write events together with the next ones."""
        self._unwritten += events

    # Which messages are safe

    def begin_stream(self, settled: int) -> None:
        """Begin with another stream of the page's, whose messages up to a number were acknowledged."""
        self._settled = settled
        self._pending.clear()

    def record_taken(self, number: int, *, with_next: bool = False) -> None:
        """Take note of a message of the page's whose events were handed in.

        Args:
            number: the message's.
            with_next: it is safe once the next write is.
        """
        is_unwritten = with_next or bool(self._unwritten) or awaits_allocation(self._session)
        self._pending.append(_PendingMessage(number, self.count + is_unwritten))

    def safe(self, durable: int | None = None) -> int:
        """Return the last of the page's messages that may be acknowledged, and all before it: those on the disk.

        Args:
            durable: how many of the recorder's writes count, if not all on the disk; -1: not even those before it.
        """
        if durable is None:
            durable = self._recorder.durable_writes
        while self._pending and self._pending[0].write <= durable:
            self._settled = self._pending.popleft().number
        return self._settled
