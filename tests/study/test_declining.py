"""Escape held on the consent text, as it says, declines; old logs say that it was to quit, and replay so."""

import pytest

from minihuman.experiment.machine.events import SessionEnded
from minihuman.experiment.machine.inputs import KeyDown, Tick
from minihuman.experiment.machine.session import CONSENT_RULES, SessionMachine
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS
from tests.study.studies import plan_of

CONSENT = """
[[pages]]
name = "consent"
asks_consent = true
text = "May we?"
[[pages]]
name = "after"
text = "Thanks."
"""


def held_escape(facts: dict[str, str], *before: str) -> tuple[str, str, str]:
    """The reason and detail of the end, and what stood on the question before it."""
    machine = SessionMachine(plan_of(CONSENT, ["consent", "after"]), World, facts)
    events = [*machine.receive(Tick(0))]
    for at, key in enumerate([*before, "escape", "escape"], 1):
        events += machine.receive(KeyDown(at * MS, key))
        title = machine.screen.title
    events += machine.receive(Tick(4000 * MS))
    (end,) = [event for event in events if isinstance(event, SessionEnded)]
    return end.reason, end.detail, title


def test_escape_on_the_consent_text_declines_in_its_own_words() -> None:
    declined = ("declined", "the participant did not agree", "I do not agree")
    assert held_escape({"consent_rules": CONSENT_RULES}) == declined


@pytest.mark.parametrize(("facts", "before"), [({}, ()), ({"consent_rules": CONSENT_RULES}, ("enter",))])
def test_elsewhere_and_in_old_logs_it_quits(facts: dict[str, str], before: tuple[str, ...]) -> None:
    assert held_escape(facts, *before)[::2] == ("quit", "End the session?")
