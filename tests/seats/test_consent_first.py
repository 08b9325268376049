"""Consent first: before somebody has agreed there is no file of theirs, and who declines leaves none."""

from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.errors import LogError
from minihuman.experiment.machine.events import SessionEnded
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, PointerPressed, PointerReleased
from minihuman.experiment.machine.screens import PageScreen, Screen
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import DeferredRecorder, MemoryRecorder
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from tests.log.samples import session_events, session_plan
from tests.study.sessions import MS, Desk, corridor_plan, key_of

PLAN = corridor_plan(episodes=1, consent="May we?")


class StillClock(VirtualClock, SessionClock):
    """A session's clock that a script moves."""

    def __init__(self) -> None:
        SessionClock.__init__(self)
        VirtualClock.__init__(self)


class Onlooker(ScriptedWindow):
    """Remembers which files there were at each screen."""

    def __init__(self, script: list[Input], clock: VirtualClock, folder: Path) -> None:
        super().__init__(script, clock)
        self._folder = folder
        self.seen: list[tuple[Screen, list[str]]] = []

    def show(self, screen: Screen):
        self.seen.append((screen, files(self._folder)))
        return super().show(screen)


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.rglob("*") if path.is_file() and path.name != "register.jsonl")


def press(*keys: str) -> list[Input]:
    taps = enumerate(keys)
    return [way(number * 20 * MS + up * MS, key) for number, key in taps for up, way in ((10, KeyDown), (15, KeyUp))]


def seated(data: Path, *keys: str, script: list[Input] | None = None):
    """Take a slot and press these keys; the plan, the log and the window."""
    plan = plan_next_session(decode_protocol(PLAN.protocol_toml), data)
    clock = StillClock()
    pressed = [key_of(plan, key) if key in ("forward", "dive") else key for key in keys]
    window = Onlooker(press(*pressed) if script is None else script, clock, data)
    return plan, host_session(plan, window, clock, data), window


def test_nothing_is_on_the_disk_until_there_is_a_consent(tmp_path):
    plan, log, window = seated(tmp_path, "enter", "enter", "forward", "forward", "forward")
    before = [there for screen, there in window.seen if isinstance(screen, PageScreen)]
    after = [there for screen, there in window.seen if not isinstance(screen, PageScreen)]
    assert before == [[]]
    assert after[0] == ["sub-01_ses-01.mcap.part"]
    assert log is not None
    assert verify_episodes(read_log(log)).difference == ""
    assert read_log(log).end_reason == "complete"
    assert plan.participant.id == "sub-01"


@pytest.mark.parametrize(
    "script",
    [
        pytest.param([], id="the window is closed"),
        pytest.param([*press("escape"), KeyDown(50 * MS, "escape"), KeyDown(3000 * MS, "x")], id="Escape is held"),
        pytest.param(
            [PointerPressed(9 * MS, 0, 0, "decline"), PointerReleased(12 * MS, 0, 0, "decline")],
            id="the button is used",
        ),
    ],
)
def test_who_does_not_agree_leaves_no_file_and_a_free_slot(tmp_path, script):
    plan, log, _ = seated(tmp_path, script=script)
    assert log is None
    assert [path.name for path in (tmp_path / "corridor").rglob("*")] == ["register.jsonl"]
    assert read_enrolled(tmp_path / "corridor") == ()
    again = plan_next_session(decode_protocol(PLAN.protocol_toml), tmp_path)
    assert again.participant == plan.participant


def test_declining_ends_the_session_and_says_so():
    desk = Desk(PLAN)
    assert isinstance(desk.session.screen, PageScreen)
    assert [button.name for button in desk.session.screen.buttons] == ["decline", "go_on"]
    desk.give(PointerPressed(5 * MS, 0.5, 0.5, "decline"))
    assert desk.of(SessionEnded)[0].reason == "declined"
    assert desk.session.over


def test_the_log_of_who_agrees_is_the_one_there_would_have_been(tmp_path):
    plan = session_plan()
    events = session_events(plan)
    held = DeferredRecorder(plan, lambda: McapRecorder(tmp_path / "held", plan, started_ns=5))
    at_once = McapRecorder(tmp_path / "at_once", plan, started_ns=5)
    for event in events:
        held.write([event])
        at_once.write([event])
    first, second = held.close(), at_once.close()
    assert first is not None
    assert second is not None
    assert list(read_events(first)) == list(read_events(second)) == events


@pytest.mark.parametrize(
    "plan", [corridor_plan(), corridor_plan(consent="May we?", segment=2), session_plan(segment=2)]
)
def test_without_a_consent_to_come_everything_is_written_at_once(plan: SessionPlan):
    recorder = DeferredRecorder(plan, MemoryRecorder)
    assert recorder.opened


def test_a_second_station_is_refused_before_anybody_reads_a_consent(tmp_path):
    plan = plan_next_session(decode_protocol(PLAN.protocol_toml), tmp_path)
    McapRecorder(tmp_path, plan, started_ns=1)
    clock = StillClock()
    with pytest.raises(LogError, match="already exists"):
        host_session(plan, ScriptedWindow(press("enter"), clock), clock, tmp_path)
