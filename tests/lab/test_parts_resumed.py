"""A session of parts that was cut short goes on where it stood: part, points, criterion, tries, never over again."""

from pathlib import Path

import pytest

from minihuman.admin.due import list_due_sessions
from minihuman.admin.next_session import is_session_complete, plan_next_session
from minihuman.admin.status import count_participant_flow, format_status
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.errors import AllocationError
from minihuman.experiment.machine.events import Answered, EndReason, PartStarted
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, Stop
from minihuman.experiment.machine.session import SessionMachine
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.host import describe_ending
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World
from tests.study.sessions import MS, key_of
from tests.study.studies import protocol

STUDY = protocol(
    """
[[groups]]
name = "all"
[[sessions]]
name = "one"
parts = ["consent", "quiz", "walk", "after", "end"]
[[sessions]]
name = "two"
parts = ["after"]
days_after_previous = [1, 2]
[[pages]]
name = "consent"
asks_consent = true
text = "May we?"
[[pages]]
name = "end"
closing = true
text = "{points} points"
[[questions]]
name = "quiz"
max_attempts = 3
return_to = "consent"
[[questions.items]]
name = "a"
kind = "choice"
ask = "?"
options = ["x", "y"]
right = 1
[[questions]]
name = "after"
[[questions.items]]
name = "b"
kind = "likert"
ask = "?"
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 5
actions = ["back", "forward", "dive"]
max_steps = 9
final_frame_ms = 0
stop_criterion = { successes = 2, of = 3 }
points = { goal = 10, failure = -1 }
"""
)


def sit(data: Path, *keys: str, session: int = 1, end: EndReason = "window_closed"):
    """Press these keys, then close the window; the session's plan and log."""
    plan = plan_next_session(STUDY, data, participant="sub-01", session=session, any_day=True)
    named = {"forward": "forward", "dive": "dive"}
    script: list[Input] = []
    for number, key in enumerate(keys):
        pressed = key_of(plan, named[key]) if key in named else key
        t_ns = (10 + 2 * number) * MS
        script += [KeyDown(t_ns, pressed), KeyUp(t_ns + MS, pressed)]
    clock = VirtualClock()
    recorder = McapRecorder(data, plan, started_ns=plan.segment * 10**12)
    window = ScriptedWindow([*script, Stop(10**10, end)], clock)
    path = run_session(SessionMachine(plan, World, {}), window, recorder, clock)
    assert path is not None
    return plan, read_log(path)


GOAL = ("enter", "forward", "forward", "forward")
FAIL = ("enter", "dive")


def begun(log, segment: int) -> list[str]:
    [its] = [part for part in log.segments if part.number == segment]
    return [event.name for event in its.part_events if isinstance(event, PartStarted)]


def test_a_session_goes_on_at_the_part_where_it_stood(tmp_path):
    sit(tmp_path, "enter", "1", "enter", *GOAL)
    plan, log = sit(tmp_path, *FAIL, *GOAL, "4", "enter", "enter")
    assert (plan.standing.part, plan.standing.points, plan.standing.outcomes) == (2, 10.0, ("goal",))
    assert begun(log, 2) == ["walk", "after", "end"]
    outcomes = [episode.outcome for episode in log.episodes if episode.outcome != "abandoned"]
    assert outcomes == ["goal", "failure", "goal"]
    assert (log.end_reason, is_session_complete(log)) == ("complete", True)
    assert verify_episodes(log).difference == ""
    with pytest.raises(AllocationError, match="has completed session 1"):
        plan_next_session(STUDY, tmp_path, participant="sub-01")


def test_tries_that_were_used_are_used(tmp_path):
    sit(tmp_path, "enter", "2", "enter", "enter")  # wrong, and back at the consent
    plan, log = sit(tmp_path, "enter", "2", "enter", "enter", "enter", "1", "enter")
    assert (plan.standing.part, plan.standing.tries) == (0, {"quiz": 1})
    assert [event.attempt for event in log.part_events if isinstance(event, Answered)] == [1, 2, 3]


def test_closing_the_window_over_the_last_words_leaves_nothing_to_do(tmp_path):
    _, log = sit(tmp_path, "enter", "1", "enter", *GOAL, *GOAL, "4", "enter")
    assert is_session_complete(log)
    with pytest.raises(AllocationError, match="has completed session 1"):
        plan_next_session(STUDY, tmp_path, participant="sub-01")


def told(study: Path) -> tuple[str, str, int]:
    """What status says of the first session, what is expected, and how many have completed the first session."""
    _, line, *_ = format_status(study)
    [expected] = list_due_sessions(study)
    return (
        line.split("  ")[-1],
        f"{expected.session} {expected.state}",
        sum(count_participant_flow(study).courses[1].complete.values()),
    )


def test_questions_after_the_last_episode_are_left_to_do_and_everybody_says_so(tmp_path):
    plan, log = sit(tmp_path, "enter", "1", "enter", *GOAL, *GOAL)
    study = tmp_path / plan.study
    assert told(study) == ("unfinished: window_closed, unknown", "1 unfinished", 0)
    assert "goes on with: minihuman run x.toml --participant sub-01" in describe_ending(log.path, Path("x.toml"))
    with pytest.raises(AllocationError, match="sub-01 has not ended session 1; finish it first"):
        plan_next_session(STUDY, tmp_path, participant="sub-01", session=2, any_day=True)
    sit(tmp_path, "4", "enter", "enter")
    assert told(study)[1:] == ("2 overdue", 1)


def test_only_the_last_words_left_is_complete_and_the_second_day_may_come(tmp_path):
    plan, _ = sit(tmp_path, "enter", "1", "enter", *GOAL, *GOAL, "4", "enter", end="timed_out")
    assert told(tmp_path / plan.study) == ("complete, unknown", "2 overdue", 1)
    assert plan_next_session(STUDY, tmp_path, participant="sub-01", session=2, any_day=True).session == 2


def test_the_second_day_is_refused_at_the_wrong_time_and_may_be_asked_for_even_so(tmp_path):
    sit(tmp_path, "enter", "1", "enter", *GOAL, *GOAL, "4", "enter", "enter")
    with pytest.raises(AllocationError, match=r"session 2 is due 1 to 2 days after session 1.*--any-day"):
        plan_next_session(STUDY, tmp_path, participant="sub-01", session=2)
    _, log = sit(tmp_path, "7", "enter", session=2)
    assert log.end_reason == "complete"
    assert [event.item for event in log.part_events if isinstance(event, Answered)] == ["b"]


def test_the_second_session_waits_for_the_first(tmp_path):
    sit(tmp_path, "enter", "1", "enter")
    with pytest.raises(AllocationError, match="of session 1 left to play"):
        plan_next_session(STUDY, tmp_path, participant="sub-01", session=2, any_day=True)
