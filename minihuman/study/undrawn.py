"""A session whose participant has no group yet: it is drawn after an answer, and then all is as if it had been known.

The parts before the draw run by a plan that is right for everybody so far. Nothing is said of them. Once the draw has
given the real plan, the same inputs are fed again, and what they lead to is said at once.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from minihuman.study.activities.port import Want
from minihuman.study.events import Answered, Event, PartEnded
from minihuman.study.inputs import ForPart, Input
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import decode_logged
from minihuman.study.session import Session
from minihuman.study.stage import MakeWorld
from minihuman.study.strata import strata_of


@dataclass(frozen=True, slots=True)
class WantsSlot(Want):
    """Somebody has answered: a slot of their stratum is to be drawn."""

    stratum: str


@dataclass(frozen=True, slots=True)
class SlotDrawn(ForPart):
    """The plan of whoever has been drawn into a group."""

    plan: SessionPlan


def is_undrawn(plan: SessionPlan) -> bool:
    """Whether a plan is of somebody whose group is still to be drawn."""
    return not plan.participant.group


def session_of(
    plan: SessionPlan,
    make_world: MakeWorld,
    facts: Mapping[str, str],
    *,
    picture_px: tuple[int, int] | None,
    draws_steps: bool = True,
) -> Session:
    """A session by a plan; one that waits for its draw where the plan is of somebody without a group."""
    kind = UndrawnSession if is_undrawn(plan) else Session
    return kind(plan, make_world, facts, picture_px=picture_px, draws_steps=draws_steps)


def waits_for_draw(session: Session) -> bool:
    """Whether a session says nothing yet, since its group is not drawn."""
    return isinstance(session, UndrawnSession) and not session.drawn


class UndrawnSession(Session):
    """A session that says nothing until the group is drawn. It ends without a word if it ends before.

    Args:
        plan: right up to the draw.
        make_world: as a session's.
        facts: as a session's.
        picture_px: as a session's.
        draws_steps: as a session's.
    """

    def __init__(
        self,
        plan: SessionPlan,
        make_world: MakeWorld,
        facts: Mapping[str, str],
        *,
        picture_px: tuple[int, int] | None = (640, 480),
        draws_steps: bool = True,
    ) -> None:
        super().__init__(plan, make_world, facts, picture_px=picture_px, draws_steps=draws_steps)
        strata = strata_of(decode_logged(plan.protocol_toml))
        assert strata is not None, "only a study with strata has plans without a group"
        self._strata = strata
        self._past: list[tuple[Input, int]] | None = []  # what came in, and when; None once the group is drawn
        self._answers: list[Event] = []  # what the stratum follows from
        self._stratum: str | None = None

    @property
    def drawn(self) -> bool:
        """Whether the plan is the real one."""
        return self._past is None

    @property
    def wants(self) -> Want | None:
        """The draw, once there is an answer; then what a session wants."""
        if self.drawn or self.over:
            return super().wants
        return None if self._stratum is None else WantsSlot(self._stratum)

    def receive(self, happened: Input, *, at_ns: int = 0) -> list[Event]:
        """Take one input; at the draw, say what came of all since the start."""
        if self._past is None:
            return super().receive(happened, at_ns=at_ns)
        if isinstance(happened, SlotDrawn):
            return self._begin_again(happened.plan, self._past)
        self._past.append((happened, at_ns))
        if self._stratum is None:
            before = self._screen
            events = super().receive(happened, at_ns=at_ns)
            self._answers += (event for event in events if isinstance(event, Answered | PartEnded))
            self._stratum = self._strata.drawn(self._answers)
            if self._stratum is not None and not self.over:
                self._screen = before  # what follows may be another group's
        return []

    def _begin_again(self, plan: SessionPlan, past: list[tuple[Input, int]]) -> list[Event]:
        self._past = None
        self.close()
        self._set_out(plan)
        events: list[Event] = []
        for happened, at_ns in past:
            events += super().receive(happened, at_ns=at_ns)
        return events
