import multiprocessing
import os
from pathlib import Path

import pytest

from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.status import format_status
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.errors import AllocationError
from minihuman.experiment.machine.inputs import Input, KeyDown, Stop
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.study.sessions import MS, key_of

PROTOCOL = decode_protocol(b"""
[study]
name = "corridor"
version = "1"
seed = 11
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "one"
blocks = ["walk"]
[[groups]]
name = "two"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
success = "terminated and reward > 0"
episodes = 3
actions = ["back", "forward", "dive"]
max_steps = 9
final_frame_ms = 0
""")


def play(plan, data: Path, *, episodes: int, cut: bool = False) -> None:
    """Play some episodes by diving at once; then close the window, or be cut off without a word."""
    keys = ["enter", key_of(plan, "forward"), key_of(plan, "dive")] * episodes + ["enter", key_of(plan, "forward")]
    script: list[Input] = [KeyDown((10 + number) * MS, key) for number, key in enumerate(keys)]
    clock = VirtualClock()
    recorder = McapRecorder(data, plan, started_ns=1)
    if cut:
        session = SessionMachine(plan, World, {})
        for happened in script:
            recorder.write(session.receive(happened))
        recorder.drain()
        os.close(recorder._fd)  # what the end of a process does: the lock is gone, the live file stays
        return
    window = ScriptedWindow([*script, Stop(10**9, "window_closed")], clock)
    run_session(SessionMachine(plan, World, {}), window, recorder, clock, finished=record_log_end)


def test_an_unfinished_session_goes_on_at_the_first_episode_not_completed(tmp_path):
    plan = plan_next_session(PROTOCOL, tmp_path)
    play(plan, tmp_path, episodes=1)
    rest = plan_next_session(PROTOCOL, tmp_path, participant="sub-01")
    assert (rest.first_episode, rest.segment) == (1, 2)
    assert rest.episodes == plan.episodes
    play(rest, tmp_path, episodes=2)
    log = read_log(tmp_path / "corridor/sub-01/ses-01")
    assert [(played.plan.episode, played.outcome) for played in log.episodes] == [
        (0, "failure"),
        (1, "abandoned"),
        (1, "failure"),
        (2, "failure"),
    ]
    assert verify_episodes(log).difference == ""
    with pytest.raises(AllocationError, match="sub-01 has completed session 1"):
        plan_next_session(PROTOCOL, tmp_path, participant="sub-01")


def test_a_session_that_was_cut_off_is_recovered_and_gone_on_with(tmp_path):
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=2, cut=True)
    rest = plan_next_session(PROTOCOL, tmp_path, participant="sub-01")
    assert (rest.first_episode, rest.segment) == (2, 2)
    log = read_log(tmp_path / "corridor/sub-01/ses-01/sub-01_ses-01.mcap")
    assert not log.clean
    assert len(log.episodes) == 3


def test_a_resumed_session_keeps_the_plan_it_began_with_when_the_protocol_has_changed(tmp_path):
    plan = plan_next_session(PROTOCOL, tmp_path)
    play(plan, tmp_path, episodes=1)
    edited = decode_protocol(PROTOCOL.toml.replace(b"max_steps = 9", b"max_steps = 5"))
    rest = plan_next_session(edited, tmp_path, participant="sub-01")
    assert rest.episodes == plan.episodes
    assert rest.protocol_sha256 == plan.protocol_sha256


def test_without_a_code_the_next_free_slot_is_taken_and_a_code_by_hand_is_said(tmp_path):
    first, second = plan_next_session(PROTOCOL, tmp_path), plan_next_session(PROTOCOL, tmp_path)
    assert [first.participant.id, second.participant.id] == ["sub-01", "sub-02"]
    assert not first.overridden
    by_hand = plan_next_session(PROTOCOL, tmp_path, participant="sub-07", group="two")
    assert (by_hand.participant.group, by_hand.overridden) == ("two", True)


def test_the_status_of_a_study_says_who_came_and_how_far(tmp_path):
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=1)
    plan_next_session(PROTOCOL, tmp_path)
    _, first, second, third, flow = format_status(tmp_path / "corridor")
    assert "sub-01" in first
    assert "3/3" in first
    assert "complete" in first
    assert "1/3" in second
    assert "unfinished: window_closed" in second
    assert third.startswith("sub-03")
    assert flow == (
        "flow: came 3; allocated to a group 3 (then no data recorded so far 1); "
        "began 2 (then not finished 1); finished 1"
    )
    assert "nothing recorded" in third


def _station(data: Path, told) -> None:
    told.put(plan_next_session(PROTOCOL, data).participant.id)


@pytest.mark.program
def test_stations_that_start_at_once_never_share_a_participant(tmp_path):
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    told = context.Queue()
    stations = [context.Process(target=_station, args=(tmp_path, told)) for _ in range(6)]
    for station in stations:
        station.start()
    taken = {told.get(timeout=PATIENCE_S) for _ in stations}
    for station in stations:
        station.join()
    assert taken == {f"sub-{number:02d}" for number in range(1, 7)}
