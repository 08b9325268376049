import runpy
from pathlib import Path

import pytest

from minihuman.activities.play import activity as play
from minihuman.experiment.machine import transitions
from minihuman.experiment.machine.transitions import Phase, TransitionCause
from tests.study.sessions import Desk, corridor_plan

DOCS = Path(__file__).parents[2] / "docs" / "session.md"
TABLES = {
    "session": (transitions.SESSION_TRANSITIONS, Phase.START, Phase.OVER),
    "play": (play.PLAY_TRANSITIONS, Phase.START, Phase.OVER),
}


def causes_from(start):
    """What can lead away from a phase of the session."""
    return {row.cause for row in transitions.SESSION_TRANSITIONS.rows if row.start is start}


@pytest.mark.parametrize(("moves", "first", "last"), TABLES.values(), ids=TABLES)
def test_every_phase_of_a_table_can_be_reached_and_left(moves, first, last):
    left = {row.start for row in moves.rows}
    reached = {row.end for row in moves.rows if row.end}
    assert reached - {last} == left - {first}


def test_a_session_can_be_ended_from_every_phase():
    for start in {row.start for row in transitions.SESSION_TRANSITIONS.rows}:
        assert TransitionCause.END in causes_from(start)


def test_the_documented_diagrams_are_drawn_from_the_tables():
    diagrams = runpy.run_path(str(DOCS.with_name("diagrams.py")))
    said = DOCS.read_text(encoding="utf-8")
    for name, diagram in diagrams["DIAGRAMS"].items():
        assert DOCS.with_name("images").joinpath(name).read_text(encoding="utf-8") == diagrams["draw_diagram"](diagram)
        assert f"](images/{name})" in said
    assert diagrams["list_dialog_moves"]() in said


@pytest.mark.parametrize("cause", [cause for cause in TransitionCause if cause not in causes_from(Phase.PAUSED)])
def test_an_impossible_move_is_refused_and_changes_nothing(cause):
    desk = Desk(corridor_plan(instruction="Walk."))
    session = desk.session
    desk.press("enter", "enter", "f8")
    before = (session.phase, session.screen, len(desk.events))
    assert session._move(cause) is False
    assert (session.phase, session.screen, len(desk.events)) == before
