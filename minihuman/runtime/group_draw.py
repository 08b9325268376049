"""The draw of a group, which precedes all other requests if an answer decides the allocation."""

from collections.abc import Callable
from pathlib import Path

from minihuman.admin.next_session import plan_drawn_session
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.pending_session import SlotDrawn, SlotRequest
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol


class GroupDrawHost(RequestHandler):
    """Draws a slot from a study's allocation list, then passes requests to the drawn plan's host.

    Args:
        protocol: the study.
        undrawn: the plan of the session whose group is to be drawn.
        data: the data folder.
        then: makes the host that answers after the draw; it returns None if none is needed.
    """

    def __init__(
        self, protocol: Protocol, undrawn: SessionPlan, data: Path, then: Callable[[SessionPlan], RequestHandler | None]
    ) -> None:
        self._protocol = protocol
        self._undrawn = undrawn
        self._data = data
        self._then = then
        self._next: RequestHandler | None = None

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        """Draw the group and return its plan; after the draw, return the next host's answer or None if it has none.

        Raises:
            AllocationError: if there is no slot to draw.
            OSError: if the data folder cannot be read or written.
        """
        if isinstance(want, SlotRequest):
            plan = plan_drawn_session(self._protocol, self._data, self._undrawn, want.stratum)
            self._next = self._then(plan)
            return SlotDrawn(t_ns, plan)
        if self._next is None:
            return None
        return self._next.answer(want, play, t_ns)

    def close(self) -> None:
        """Close the next host."""
        if self._next is not None:
            self._next.close()
