from pathlib import Path

import pytest

from minihuman.study.phases import TRANSITIONS, Cause, Phase, mermaid

DOCS = Path(__file__).parents[2] / "docs" / "session.md"


def test_every_phase_can_be_reached_and_left():
    reached = {target for target in TRANSITIONS.values() if target}
    left = {phase for phase, _ in TRANSITIONS}
    assert reached == set(Phase) - {Phase.START}
    assert left == set(Phase) - {Phase.OVER}


@pytest.mark.parametrize("phase", [phase for phase in Phase if phase is not Phase.OVER])
def test_a_session_can_be_ended_from_every_phase(phase):
    assert TRANSITIONS[phase, Cause.END] is Phase.OVER


def test_the_documented_diagram_is_drawn_from_the_table():
    assert f"```mermaid\n{mermaid()}\n```" in DOCS.read_text()
