"""The seat beside a session whose group is still to be drawn: it draws, and then lets the agent's seat answer."""

from collections.abc import Callable
from pathlib import Path

from minihuman.lab.next_session import drawn_session
from minihuman.study.activities.port import Outside, Want
from minihuman.study.inputs import ForPart
from minihuman.study.plan import SessionPlan
from minihuman.study.play import Play
from minihuman.study.protocol import Protocol
from minihuman.study.undrawn import SlotDrawn, WantsSlot


class SlotSeat(Outside):
    """Draws from the register of a study.

    Args:
        protocol: the study.
        undrawn: whose group is to be drawn.
        data: the data folder.
        then: makes the seat that answers from the draw on; None where nothing else is wanted.
    """

    def __init__(
        self, protocol: Protocol, undrawn: SessionPlan, data: Path, then: Callable[[SessionPlan], Outside | None]
    ) -> None:
        self._protocol = protocol
        self._undrawn = undrawn
        self._data = data
        self._then = then
        self._next: Outside | None = None

    def answer(self, want: Want, play: Play | None, t_ns: int) -> ForPart | None:
        """The plan of the group that was drawn; then what the next seat says.

        Raises:
            AllocationError: if there is no slot to draw.
            OSError: if the data folder cannot be read or written.
        """
        if isinstance(want, WantsSlot):
            plan = drawn_session(self._protocol, self._data, self._undrawn, want.stratum)
            self._next = self._then(plan)
            return SlotDrawn(t_ns, plan)
        return None if self._next is None else self._next.answer(want, play, t_ns)

    def close(self) -> None:
        """Let the next seat go."""
        if self._next is not None:
            self._next.close()
