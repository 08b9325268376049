from pathlib import Path

import pytest

from minihuman.study import phases
from minihuman.study.activities import play_moves
from minihuman.study.phases import Cause, Phase
from tests.study.sessions import Desk, corridor_plan

DOCS = Path(__file__).parents[2] / "docs" / "session.md"
TABLES = {"session": (phases.MOVES, Phase.START, Phase.OVER), "play": (play_moves.MOVES, Phase.START, Phase.OVER)}


@pytest.mark.parametrize(("moves", "first", "last"), TABLES.values(), ids=TABLES)
def test_every_phase_of_a_table_can_be_reached_and_left(moves, first, last):
    left = {row.start for row in moves.rows}
    reached = {row.end for row in moves.rows if row.end}
    assert reached - {last} == left - {first}


def test_a_session_can_be_ended_from_every_phase():
    for start in {row.start for row in phases.MOVES.rows}:
        assert Cause.END in phases.MOVES.causes(start)


@pytest.mark.parametrize("draw", [phases.mermaid, play_moves.mermaid])
def test_the_documented_diagrams_are_drawn_from_the_tables(draw):
    assert f"```mermaid\n{draw()}\n```" in DOCS.read_text()


@pytest.mark.parametrize("cause", [cause for cause in Cause if cause not in phases.MOVES.causes(Phase.PAUSED)])
def test_an_impossible_move_is_refused_and_changes_nothing(cause):
    desk = Desk(corridor_plan(instruction="Walk."))
    session = desk.session
    desk.press("enter", "enter", "f8")
    before = (session.phase, session.screen, len(desk.events))
    assert session._move(cause) is False
    assert (session.phase, session.screen, len(desk.events)) == before
