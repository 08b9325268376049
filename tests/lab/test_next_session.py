import multiprocessing
import os
from pathlib import Path

import pytest

from minihuman.errors import AllocationError
from minihuman.lab.next_session import next_session
from minihuman.lab.status import status_lines
from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.seats.run import run_session
from minihuman.study.inputs import Input, KeyDown, Stop
from minihuman.study.protocol import decode
from minihuman.study.session import Session
from minihuman.windows.scripted import ScriptedWindow, VirtualClock
from minihuman.worlds.adapt.world import World
from tests.study.sessions import MS, key_of

PROTOCOL = decode(b"""
[study]
name = "corridor"
version = "1"
seed = 11
closing = ""
[keys]
check = false
[[groups]]
name = "one"
blocks = ["walk"]
[[groups]]
name = "two"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "tests.worlds.corridor:tests/Corridor-v0"
episodes = 3
actions = ["back", "forward", "dive"]
max_steps = 9
hold_ms = 0
""")


def play(plan, data: Path, *, episodes: int, cut: bool = False) -> None:
    """Play some episodes by diving at once; then close the window, or be cut off without a word."""
    keys = ["enter", key_of(plan, "forward"), key_of(plan, "dive")] * episodes + ["enter", key_of(plan, "forward")]
    script: list[Input] = [KeyDown((10 + number) * MS, key) for number, key in enumerate(keys)]
    clock = VirtualClock()
    recorder = McapRecorder(data, plan, started_ns=1)
    if cut:
        session = Session(plan, World, {})
        for happened in script:
            recorder.write(session.receive(happened))
        recorder.drain()
        os.close(recorder._fd)  # what the end of a process does: the lock is gone, the live file stays
        return
    window = ScriptedWindow([*script, Stop(10**9, "window_closed")], clock)
    run_session(Session(plan, World, {}), window, recorder, clock)


def test_an_unfinished_session_goes_on_at_the_first_episode_not_completed(tmp_path):
    plan = next_session(PROTOCOL, tmp_path)
    play(plan, tmp_path, episodes=1)
    rest = next_session(PROTOCOL, tmp_path, participant="sub-01")
    assert (rest.first_episode, rest.segment) == (1, 2)
    assert rest.episodes == plan.episodes
    play(rest, tmp_path, episodes=2)
    log = open_log(tmp_path / "corridor/sub-01/ses-01")
    assert [(played.plan.episode, played.outcome) for played in log.episodes] == [
        (0, "failure"),
        (1, "abandoned"),
        (1, "failure"),
        (2, "failure"),
    ]
    assert verify(log).difference == ""
    with pytest.raises(AllocationError, match="sub-01 has completed session 1"):
        next_session(PROTOCOL, tmp_path, participant="sub-01")


def test_a_session_that_was_cut_off_is_recovered_and_gone_on_with(tmp_path):
    play(next_session(PROTOCOL, tmp_path), tmp_path, episodes=2, cut=True)
    rest = next_session(PROTOCOL, tmp_path, participant="sub-01")
    assert (rest.first_episode, rest.segment) == (2, 2)
    log = open_log(tmp_path / "corridor/sub-01/ses-01/sub-01_ses-01.mcap")
    assert not log.clean
    assert len(log.episodes) == 3


def test_a_resumed_session_keeps_the_plan_it_began_with_when_the_protocol_has_changed(tmp_path):
    plan = next_session(PROTOCOL, tmp_path)
    play(plan, tmp_path, episodes=1)
    edited = decode(PROTOCOL.toml.replace(b"max_steps = 9", b"max_steps = 5"))
    rest = next_session(edited, tmp_path, participant="sub-01")
    assert rest.episodes == plan.episodes
    assert rest.protocol_sha256 == plan.protocol_sha256


def test_without_a_code_the_next_free_slot_is_taken_and_a_code_by_hand_is_said(tmp_path):
    first, second = next_session(PROTOCOL, tmp_path), next_session(PROTOCOL, tmp_path)
    assert [first.participant.id, second.participant.id] == ["sub-01", "sub-02"]
    assert not first.overridden
    by_hand = next_session(PROTOCOL, tmp_path, participant="sub-07", group="two")
    assert (by_hand.participant.group, by_hand.overridden) == ("two", True)


def test_the_status_of_a_study_says_who_came_and_how_far(tmp_path):
    play(next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    play(next_session(PROTOCOL, tmp_path), tmp_path, episodes=1)
    next_session(PROTOCOL, tmp_path)
    _, first, second, third = status_lines(tmp_path / "corridor")
    assert "sub-01" in first
    assert "3/3" in first
    assert "complete" in first
    assert "1/3" in second
    assert "unfinished: window_closed" in second
    assert third.startswith("sub-03")
    assert "nothing recorded" in third


def _station(data: Path, told) -> None:
    told.put(next_session(PROTOCOL, data).participant.id)


@pytest.mark.program
def test_stations_that_start_at_once_never_share_a_participant(tmp_path):
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    told = context.Queue()
    stations = [context.Process(target=_station, args=(tmp_path, told)) for _ in range(6)]
    for station in stations:
        station.start()
    taken = {told.get(timeout=60) for _ in stations}
    for station in stations:
        station.join()
    assert taken == {f"sub-{number:02d}" for number in range(1, 7)}
