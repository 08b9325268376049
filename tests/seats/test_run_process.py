import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, ScreenShown
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.study.sessions import MS, corridor_plan, key_of
from tests.worlds import corridor  # noqa: F401  # a log's word imports nothing; this process knows the world

pytestmark = pytest.mark.program

ROOT = Path(__file__).parents[2]


def started(tmp_path: Path, action: str) -> subprocess.Popen[bytes]:
    protocol = tmp_path / "corridor.toml"
    protocol.write_bytes(corridor_plan(episodes=1, max_steps=100_000).protocol_toml)
    command = [sys.executable, "-m", "tests.seats.session_process", protocol, tmp_path / "data", action]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def the_log(tmp_path: Path):
    [path] = (tmp_path / "data").rglob("*.mcap")
    assert list((tmp_path / "data").rglob("*.part")) == []
    return read_log(path)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_leaves_a_finished_log_that_says_abandoned(tmp_path, number):
    with started(tmp_path, "back") as station:
        assert station.stdout.readline() == b"playing\n"
        station.send_signal(number)
        assert station.wait(timeout=PATIENCE_S) == 0
    log = the_log(tmp_path)
    assert log.clean
    assert log.end_reason == "signal"
    assert [played.outcome for played in log.episodes] == ["abandoned"]
    assert len(log.episodes[0].actions) >= 20
    assert verify_episodes(log).difference == ""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_signals_while_the_log_is_being_finished_wait(tmp_path, number):
    with started(tmp_path, "back") as station:
        assert station.stdout.readline() == b"playing\n"
        for _ in range(40):  # for as long as it takes to end
            station.send_signal(number)
            time.sleep(0.005)
        assert station.wait(timeout=PATIENCE_S) in (0, -number), station.stderr.read()  # one may come when all is done
        assert b"Traceback" not in station.stderr.read()
    assert the_log(tmp_path).clean


def test_an_exception_inside_a_world_leaves_a_finished_log(tmp_path):
    with started(tmp_path, "crash") as station:
        assert station.wait(timeout=PATIENCE_S) != 0
        said = station.stderr.read().decode()
    assert "the world failed (RuntimeError: the corridor has collapsed); what was recorded up to then is in" in said
    log = the_log(tmp_path)
    assert log.clean
    assert log.end_reason == "world_error"
    assert [played.outcome for played in log.episodes] == ["abandoned"]


def test_the_frame_loop_never_waits_for_a_slow_disk(tmp_path):
    """A sync is still running when sixty pictures have been shown: one that waited for it would wait for ever."""
    plan = corridor_plan(episodes=1, max_steps=60)
    syncs: list[int] = []

    all_shown = threading.Event()

    def slow_sync(fd: int) -> None:
        if syncs_over_at_picture:
            assert all_shown.wait(PATIENCE_S)
        syncs.append(fd)

    class Watchful(ScriptedWindow):
        def show(self, screen: Screen) -> ScreenShown:
            syncs_over_at_picture.append(len(syncs))
            if len(syncs_over_at_picture) == 60:
                all_shown.set()
            return super().show(screen)

    back = key_of(plan, "back")
    script: list[Input] = [KeyDown(50 * MS, "enter")]
    for step in range(60):
        script += [KeyDown((100 + 20 * step) * MS, back), KeyUp((110 + 20 * step) * MS, back)]
    syncs_over_at_picture: list[int] = []
    clock = VirtualClock()
    recorder = McapRecorder(tmp_path, plan, started_ns=1, settings=RecorderSettings(sync=slow_sync))
    path = run_session(SessionMachine(plan, World, {}), Watchful(script, clock, frame_ns=16 * MS), recorder, clock)
    frames = read_log(path).episodes[0].frames
    assert [frame.step for frame in frames] == list(range(60))
    assert {frame.flip_ns - frame.submit_ns for frame in frames} == {16 * MS}
    assert syncs_over_at_picture[59] <= syncs_over_at_picture[0] + 1, "what had begun before the first picture"
    assert recorder.durable_steps == 60
