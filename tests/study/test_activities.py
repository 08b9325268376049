"""A kind of activity of somebody else's: one module, a row in the registry, and a protocol can name it."""

import msgspec
import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import Activity, ActivityKind, PartEnding
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import PartEnded, PartStarted, SessionEnded
from minihuman.experiment.machine.inputs import Input, KeyDown
from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.machine.transitions import Phase
from tests.lab_package import install_lab as install_lab
from tests.study.sessions import Desk
from tests.study.studies import plan_of


class BellPlan(msgspec.Struct, frozen=True):
    """How often to ring."""

    rings: int


class Bell(Activity):
    """Wants a key pressed so often."""

    phase = Phase.PAGE

    def begin(self) -> None:
        self._rung = 0

    def receive(self, happened: Input) -> None:
        if isinstance(happened, KeyDown):
            self.context.emit_key(happened, "accepted", self.phase)
            self._rung += 1
            if self._rung == self.part.plan.rings:
                self.ended = PartEnding()

    def screen(self) -> TextScreen:
        return TextScreen("Ring", f"{self.part.plan.rings - self._rung} left", "")


PARTS = """
[[activities]]
name = "ring"
kind = "bell"
settings = {{ rings = {rings} }}
[[pages]]
name = "after"
text = "Well."
"""


BELL = ActivityKind("bell", BellPlan, Bell)


@pytest.fixture
def bell(install_lab):
    install_lab("a-lab", activities=["bell = tests.study.test_activities:BELL"])


def test_a_kind_of_ones_own_runs_in_a_session(bell):
    desk = Desk(plan_of(PARTS.format(rings=3), ["ring", "after"]))
    assert desk.session.screen.body == "3 left"
    desk.press("q", "escape", "enter", "q")
    assert desk.session.screen.body == "1 left"
    desk.press("q", "enter")
    assert [event.kind for event in desk.of(PartStarted)] == ["bell", "page"]
    assert [event.end for event in desk.of(PartEnded)] == ["done", "done"]
    assert desk.of(SessionEnded)[0].reason == "complete"
    assert find_violations(desk.events) == []


def test_a_plan_that_the_kind_cannot_read_is_said(bell):
    with pytest.raises(ProtocolError, match=r"activities\[0\].*of kind 'bell'.*rings"):
        plan_of(PARTS.format(rings='"three"'), ["ring", "after"])


def test_a_kind_that_nobody_has_is_said():
    with pytest.raises(
        ProtocolError, match="activity 'bell' is unknown; it is one of correction, debrief, keyboard_check"
    ):
        plan_of(PARTS.format(rings=3), ["ring"])
