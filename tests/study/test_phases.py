from pathlib import Path

import pytest

from minihuman.experiment.activities import play
from minihuman.experiment.machine import transitions
from minihuman.experiment.machine.transitions import Phase, TransitionCause
from tests.study.sessions import Desk, corridor_plan

DOCS = Path(__file__).parents[2] / "docs" / "session.md"
TABLES = {
    "session": (transitions.SESSION_TRANSITIONS, Phase.START, Phase.OVER),
    "play": (play.PLAY_TRANSITIONS, Phase.START, Phase.OVER),
}
ENDING_CAUSES = frozenset(
    {TransitionCause.ASK_QUIT, TransitionCause.ASK_ABORT, TransitionCause.STAY, TransitionCause.END}
)


def causes_from(start):
    """What can lead away from a phase of the session."""
    return {row.cause for row in transitions.SESSION_TRANSITIONS.rows if row.start is start}


def draw_diagram(table, first, last, in_notes):
    """The table as a Mermaid state diagram; causes that many phases share stand in notes."""
    lines = ["stateDiagram-v2", f"    [*] --> {first}"]
    for row in table.rows:
        condition = f", if {row.when.__name__.strip('_').replace('_', ' ')}" if row.when else ""
        if row.cause not in in_notes:
            lines.append(f"    {row.start} --> {row.end}: {row.cause}{condition}")
    for cause in dict.fromkeys(row.cause for row in table.rows if row.cause in in_notes):
        rows = [row for row in table.rows if row.cause is cause]
        starts = ", ".join(dict.fromkeys(row.start for row in rows))
        ends = ", ".join(dict.fromkeys(row.end or "back" for row in rows))
        lines.append(f"    note right of {last}: {cause} from {starts} to {ends}")
    return "\n".join([*lines, f"    {last} --> [*]"])


@pytest.mark.parametrize(("moves", "first", "last"), TABLES.values(), ids=TABLES)
def test_every_phase_of_a_table_can_be_reached_and_left(moves, first, last):
    left = {row.start for row in moves.rows}
    reached = {row.end for row in moves.rows if row.end}
    assert reached - {last} == left - {first}


def test_a_session_can_be_ended_from_every_phase():
    for start in {row.start for row in transitions.SESSION_TRANSITIONS.rows}:
        assert TransitionCause.END in causes_from(start)


@pytest.mark.parametrize(("name", "in_notes"), [("session", ENDING_CAUSES), ("play", frozenset())])
def test_the_documented_diagrams_are_drawn_from_the_tables(name, in_notes):
    assert f"```mermaid\n{draw_diagram(*TABLES[name], in_notes)}\n```" in DOCS.read_text()


@pytest.mark.parametrize("cause", [cause for cause in TransitionCause if cause not in causes_from(Phase.PAUSED)])
def test_an_impossible_move_is_refused_and_changes_nothing(cause):
    desk = Desk(corridor_plan(instruction="Walk."))
    session = desk.session
    desk.press("enter", "enter", "f8")
    before = (session.phase, session.screen, len(desk.events))
    assert session._move(cause) is False
    assert (session.phase, session.screen, len(desk.events)) == before
