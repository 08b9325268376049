"""Groups drawn after an answer: the log is as if the group had been known, and before the draw there is none."""

import random
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.enrolment_entries import ParticipantReplaced, read_enrolled
from minihuman.admin.enrolment_log import draw_slot, record_departure, take_slot
from minihuman.admin.next_session import plan_drawn_session, plan_next_session
from minihuman.admin.verify.log import find_log_differences
from minihuman.errors import AllocationError
from minihuman.experiment.machine.events import Answered, Event, SessionStarted
from minihuman.experiment.machine.inputs import FocusChanged, Input, KeyDown, KeyUp, ScreenShown, TextInput, Tick
from minihuman.experiment.machine.screens import QuestionScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import PendingAllocationSession, SlotDrawn, SlotRequest
from minihuman.experiment.plan.allocation import build_allocation_list, find_slot
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.host import host_session
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.seats.test_consent_first import Onlooker, StillClock, files
from tests.study.sessions import MS

TOML = """
[study]
name = "handed"
version = "1"
seed = 11
participants = 30
consent = "May we?"
closing = ""
[keys]
pool = ["1", "2", "3", "4"]
keyboard_check = false
[allocation]
stratify_by = "you.hand"
[[groups]]
name = "a"
allocation_ratio = 2
replace_parts = { tip = "" }
[[groups]]
name = "b"
[[sessions]]
name = "day-1"
parts = ["you", "tip", "corridor"]
[[sessions]]
name = "day-2"
parts = ["corridor"]
[[questions]]
name = "you"
[[questions.items]]
name = "hand"
kind = "choice"
ask = "Which hand do you write with?"
options = ["Left", "Right"]
codes = ["left", "right"]
[[questions.items]]
name = "age"
kind = "number"
ask = "How old are you?"
[[pages]]
name = "tip"
text = "Go forward."
[[blocks]]
name = "corridor"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 2
max_steps = 5
actions = ["back", "forward", "dive"]
key_map = "constant"
final_frame_ms = 0
"""
STUDY = decode_protocol(TOML.encode())
PLAN = expand_protocol(STUDY, enrol_participant(STUDY, 0, stratum="right"))  # of the first who says right
LEFT = expand_protocol(STUDY, enrol_participant(STUDY, 0, stratum="left"))
KEYS = {action: key for key, action in PLAN.episodes[0].key_map.keys.items()}
AGREES = ["enter"]
SAYS_RIGHT = ["1", "2", "enter", "4", "2", "enter"]  # and is 42
READS = ["enter"] if PLAN.participant.group == "b" else []


def seated(data: Path, *keys: str, study_keys: list[str] | None = None):
    """Sit down, press these keys and close the window; the log and the window."""
    plan, clock = plan_next_session(STUDY, data), StillClock()
    taps = (event for key in keys for event in typed(key))
    script = [replace(event, t_ns=number * 10 * MS) for number, event in enumerate(taps, 1)]
    window = Onlooker(script, clock, data)
    return host_session(plan, window, clock, data, agent=make_agent_host(STUDY, plan, data)), window


def typed(key: str) -> list[Input]:
    digits = [TextInput(0, key)] if key.isdigit() else []
    return [KeyDown(0, key), *digits, KeyUp(0, key)]


def forward(episodes: int = 2) -> list[str]:
    return [key for _ in range(episodes) for key in ("enter", *[KEYS["forward"]] * 3)]


def test_the_log_of_who_was_drawn_is_as_if_the_group_had_been_known(tmp_path: Path) -> None:
    log, window = seated(tmp_path, *AGREES, *SAYS_RIGHT, *READS, *forward())
    assert log is not None
    session = read_log(log)
    assert session.plan == PLAN
    assert (session.plan.participant.stratum, session.plan.participant.group) == ("right", PLAN.participant.group)
    assert session.end_reason == "complete"
    assert list(find_log_differences(log, World)) == []
    (line,) = read_enrolled(tmp_path / "handed")
    assert (line.stratum, line.group, line.slot) == ("right", PLAN.participant.group, PLAN.participant.slot)
    asked = [there for screen, there in window.seen if isinstance(screen, QuestionScreen)]
    assert asked == [[]] * len(asked)


@pytest.mark.parametrize("keys", [[], AGREES, [*AGREES, "2"], [*AGREES, "2", "enter"]])
def test_who_leaves_before_the_draw_leaves_no_file_and_a_free_slot(tmp_path: Path, keys: list[str]) -> None:
    log, _ = seated(tmp_path, *keys)
    assert log is None
    assert files(tmp_path) == []
    assert read_enrolled(tmp_path / "handed") == ()


def test_a_session_cut_short_after_the_draw_goes_on_in_its_group(tmp_path: Path) -> None:
    seated(tmp_path, *AGREES, *SAYS_RIGHT, *READS, *forward(1))
    again = plan_next_session(STUDY, tmp_path, participant="sub-01")
    assert (again.participant, again.segment, again.first_episode) == (PLAN.participant, 2, 1)
    assert again.episodes == PLAN.episodes


def test_a_plan_of_another_stratum_than_the_answers_is_told(tmp_path: Path) -> None:
    log, _ = seated(tmp_path, *AGREES, *SAYS_RIGHT, *READS, *forward())
    assert log is not None
    events = [
        SessionStarted(event.t_ns, LEFT, event.facts) if isinstance(event, SessionStarted) else event
        for event in read_events(log)
    ]
    recorder = McapRecorder(tmp_path / "other", LEFT, started_ns=1)
    recorder.write(events)
    changed = recorder.close()
    assert changed is not None
    told = list(find_log_differences(changed, World))
    assert any("stratum 'left', by the answer to you.hand 'right'" in line for line in told)
    moved = msgspec.structs.replace(PLAN.participant, slot=1 - PLAN.participant.place % 2)
    recorder = McapRecorder(tmp_path / "moved", msgspec.structs.replace(PLAN, participant=moved), started_ns=1)
    plan = msgspec.structs.replace(PLAN, participant=moved)
    recorder.write([SessionStarted(0, plan, {}), *events[1:]])
    changed = recorder.close()
    assert changed is not None
    assert any("in the allocation list 'left'" in line for line in find_log_differences(changed, World))


def some_inputs(seed: int) -> list[Input]:
    rng = random.Random(seed)
    inputs: list[Input] = [Tick(0)]
    keys = ["enter", "enter", "1", "2", "up", "down", "page_up", "escape", "f8", *KEYS.values()]
    for number in range(1, 150):
        t_ns, key = number * 50 * MS, rng.choice(keys)
        some = [KeyDown(t_ns, key), KeyUp(t_ns, key), TextInput(t_ns, key), ScreenShown(t_ns, t_ns - 1, t_ns)]
        inputs.append(rng.choice([*some, *some[:1] * 8, FocusChanged(t_ns, bool(rng.getrandbits(1)))]))
    return inputs


def test_whatever_is_pressed_the_events_are_those_of_a_session_that_knew() -> None:
    waiting = expand_protocol(
        STUDY, msgspec.structs.replace(enrol_participant(STUDY, 0), group="", stratum="", slot=None)
    )
    drawn = 0
    for seed in range(20):
        undrawn, plan, inputs = PendingAllocationSession(waiting, World, {}), None, some_inputs(seed)
        told: list[Event] = []
        for happened in inputs:
            told += undrawn.receive(happened)
            if isinstance(want := undrawn.request, SlotRequest):
                assert told == []
                plan = PLAN if want.stratum == "right" else LEFT
                told += undrawn.receive(SlotDrawn(happened.t_ns, plan))
        if plan is None:
            assert told == []
            continue
        known = SessionMachine(plan, World, {})
        assert told == [event for happened in inputs for event in known.receive(happened)]
        assert (undrawn.phase, type(undrawn.screen)) == (known.phase, type(known.screen))
        drawn += 1
    assert drawn > 5


def test_strata_are_filled_each_from_its_own_list_and_a_place_is_offered_again_in_its_stratum(tmp_path: Path) -> None:
    study = tmp_path / "handed"
    said = ["left", "right", "right", "left", "right"]
    drawn = []
    for stratum in said:
        who, _ = take_slot(STUDY, study)
        assert who.group == ""
        drawn.append(draw_slot(STUDY, study, who.id, stratum))
    places = {name: [who.slot for who in drawn if who.stratum == name] for name in ("left", "right")}
    for name, slots in places.items():
        assert slots == [find_slot(STUDY, place, name).index for place in range(len(slots))]
    assert [who.group for who in drawn] == [build_allocation_list(STUDY)[who.place].group for who in drawn]
    record_departure(study, ParticipantReplaced("sub-02", "2026-01-01T00:00:00Z"))
    left, _ = take_slot(STUDY, study)
    assert left.id == "sub-100002"  # the first who comes has the code that is next to hers
    assert draw_slot(STUDY, study, left.id, "left").slot == find_slot(STUDY, 2, "left").index
    right, _ = take_slot(STUDY, study)
    assert draw_slot(STUDY, study, right.id, "right") == msgspec.structs.replace(drawn[1], id=right.id, index=5)


def test_a_draw_that_a_kill_cut_off_is_made_again(tmp_path: Path) -> None:
    study = tmp_path / "handed"
    who, _ = take_slot(STUDY, study)
    first = draw_slot(STUDY, study, who.id, "right")
    assert draw_slot(STUDY, study, who.id, "right") == first
    plan = plan_next_session(STUDY, tmp_path, participant=who.id)
    assert plan.participant.group == ""
    other = plan_drawn_session(STUDY, tmp_path, plan, "left").participant
    assert (other.stratum, other.slot) == ("left", find_slot(STUDY, 0, "left").index)
    following, _ = take_slot(STUDY, study)
    assert draw_slot(STUDY, study, following.id, "right").slot == first.slot


def test_a_group_chosen_by_hand_stays_and_the_slot_is_the_answers(tmp_path: Path) -> None:
    other = next(group.name for group in STUDY.groups if group.name != PLAN.participant.group)
    plan = plan_next_session(STUDY, tmp_path, group=other)
    assert (plan.participant.group, plan.overridden) == ("", True)
    drawn = plan_drawn_session(STUDY, tmp_path, plan, "right")
    assert (drawn.participant.group, drawn.participant.slot) == (other, PLAN.participant.slot)
    with pytest.raises(AllocationError, match="sub-09 has no slot in"):
        draw_slot(STUDY, tmp_path / "handed", "sub-09", "right")


def test_stations_that_draw_at_once_never_share_a_slot(tmp_path: Path) -> None:
    study = tmp_path / "handed"

    def come(number: int) -> int | None:
        who, _ = take_slot(STUDY, study)
        return draw_slot(STUDY, study, who.id, ("left", "right")[number % 2]).slot

    with ThreadPoolExecutor(6) as stations:
        slots = list(stations.map(come, range(24)))
    both = [find_slot(STUDY, place, name).index for place in range(12) for name in ("left", "right")]
    assert sorted(slots) == sorted(both)


def test_simulated_people_fill_the_strata_as_they_answer_and_keep_their_group(tmp_path: Path) -> None:
    logs = [read_log(path) for path in simulate(STUDY, tmp_path, participants=8, seed=1, player="random")]
    first = [log for log in logs if log.plan.session == 1]
    second = {log.plan.participant.id: log.plan.participant for log in logs if log.plan.session == 2}
    by_stratum = Counter(log.plan.participant.stratum for log in first)
    assert sum(by_stratum.values()) == 8
    for log in first:
        (said,) = [event.value for event in log.part_events if isinstance(event, Answered) and event.item == "hand"]
        assert said == f'"{log.plan.participant.stratum}"'
        assert second.get(log.plan.participant.id, log.plan.participant) == log.plan.participant
        assert list(find_log_differences(log.path, World)) == []
    assert second
    for name, many in by_stratum.items():
        held = sorted(log.plan.participant.place for log in first if log.plan.participant.stratum == name)
        assert held == [find_slot(STUDY, place, name).index for place in range(many)]
