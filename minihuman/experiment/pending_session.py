"""A session whose participant has no group yet, because an answer decides the allocation."""

from collections.abc import Mapping
from dataclasses import dataclass

from minihuman.experiment.machine.activity import ActivityRequest, WorldFactory
from minihuman.experiment.machine.events import (
    Answered,
    Event,
    PartEnded,
)
from minihuman.experiment.machine.inputs import (
    ActivityInput,
    Input,
)
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.experiment.protocol.strata import build_strata


@dataclass(frozen=True, slots=True)
class SlotRequest(ActivityRequest):
    """A request to draw an allocation slot of a stratum, made once the deciding answer is given."""

    stratum: str


@dataclass(frozen=True, slots=True)
class SlotDrawn(ActivityInput):
    """The answer to a `SlotRequest`: the plan with the group that was drawn."""

    plan: SessionPlan


def is_allocation_pending(plan: SessionPlan) -> bool:
    """Return whether the participant of a plan has not been assigned to a group yet."""
    return not plan.participant.group


def build_session(
    plan: SessionPlan,
    make_world: WorldFactory,
    facts: Mapping[str, str],
    *,
    picture_px: tuple[int, int] | None,
    renders_steps: bool = True,
) -> SessionMachine:
    """Build the session of a plan: a `PendingAllocationSession` if the participant has no group yet.

    The arguments are those of `SessionMachine`.
    """
    session_class = PendingAllocationSession if is_allocation_pending(plan) else SessionMachine
    return session_class(plan, make_world, facts, picture_px=picture_px, renders_steps=renders_steps)


def awaits_allocation(session: SessionMachine) -> bool:
    """Return whether a session emits no events yet because its group has not been drawn."""
    return isinstance(session, PendingAllocationSession) and not session.is_allocated


class PendingAllocationSession(SessionMachine):
    """A session that emits no events until the group is drawn, and none at all if it ends before that.

    The arguments are those of `SessionMachine`; ``plan`` is valid up to the draw.
    """

    def __init__(
        self,
        plan: SessionPlan,
        make_world: WorldFactory,
        facts: Mapping[str, str],
        *,
        picture_px: tuple[int, int] | None = (640, 480),
        renders_steps: bool = True,
    ) -> None:
        super().__init__(plan, make_world, facts, picture_px=picture_px, renders_steps=renders_steps)
        strata = build_strata(decode_logged_protocol(plan.protocol_toml))
        assert strata is not None, "only a study with strata has plans without a group"
        self._strata = strata
        self._past: list[tuple[Input, int]] | None = []  # inputs and their arrivals; None once the group is drawn
        self._answers: list[Event] = []  # events that determine the stratum
        self._stratum: str | None = None

    @property
    def is_allocated(self) -> bool:
        """Return whether the group has been drawn."""
        return self._past is None

    @property
    def request(self) -> ActivityRequest | None:
        """Return the request for a slot once the stratum is known; after the draw, the request of the running part.

        None if there is no request.
        """
        if self.is_allocated or self.over:
            return super().request
        if self._stratum is None:
            return None
        return SlotRequest(self._stratum)

    def receive(self, happened: Input, *, at_ns: int = 0, draws: bool = True) -> list[Event]:
        """Handle one input and return its events: none before the group is drawn, and at the draw those of all inputs.

        The arguments are those of `SessionMachine.receive`.
        """
        if self._past is None:
            return super().receive(happened, at_ns=at_ns, draws=draws)
        if isinstance(happened, SlotDrawn):
            return self._replay_inputs(happened.plan, self._past)
        self._past.append((happened, at_ns))
        if self._stratum is None:
            previous_screen = self._screen
            events = super().receive(happened, at_ns=at_ns)
            self._answers += (event for event in events if isinstance(event, Answered | PartEnded))
            self._stratum = self._strata.find_stratum(self._answers)
            if self._stratum is not None and not self.over:
                self._screen = previous_screen  # not the next part's, which may depend on the group
        return []

    def _replay_inputs(self, plan: SessionPlan, past: list[tuple[Input, int]]) -> list[Event]:
        """Restart the session with the drawn plan, and return the events of all inputs so far."""
        self._past = None
        self.close()
        self._reset(plan)
        events: list[Event] = []
        for happened, at_ns in past:
            events += super().receive(happened, at_ns=at_ns)
        return events
