"""Two people in front of one window, each with keys of their own."""

import time
from pathlib import Path

import numpy as np
import pytest

from minihuman.activities.team.events import JointStepped, TeamFormed
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.display.windows.window import Window
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import FrameShown, KeyPressed, SessionEnded
from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, ScreenShown
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.plan.dry_run import describe_plan
from minihuman.log.read.session_reader import read_events
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.shared_window import GAP_PX, SharedWindow, host_team
from minihuman.runtime.simulated_session import simulate
from minihuman.runtime.team_seating import count_seats_at_machine
from minihuman.worlds.adapters.world import World
from tests.activities.team.study import PEOPLE, team_study

KEYS = 'seat_keys = [{ a = "left", d = "right", s = "stay" }, { left = "left", right = "right", down = "stay" }]'
POOL = ('"1", "2", "3"', '"a", "d", "s", "left", "right", "down", "x"')


def shared_study(folder: Path, *, keys: str = KEYS, **study: object) -> Path:
    path = team_study(folder, team=f"{PEOPLE}\n{keys}", **study)  # type: ignore[arg-type]
    path.write_text(path.read_text(encoding="utf-8").replace(*POOL), encoding="utf-8")
    return path


class Table(Window):
    """A window whose people press their keys in turn while they play, and Enter whenever something is to be read."""

    def __init__(self, clock: SessionClock, pressed: str, *, quits: bool = False) -> None:
        self.screens: list[Screen] = []
        self._clock, self._quits = clock, quits
        tap = lambda now_ns: [KeyDown(now_ns, "escape"), KeyUp(now_ns, "escape")]  # noqa: E731
        self._escapes = [tap, lambda now_ns: [KeyDown(now_ns, "escape")]] if quits else []  # asks, then is held
        self._pressed, self._places = pressed.split(), 0
        self._new_screen, self._waits = False, 0

    def show(self, screen: Screen) -> ScreenShown:
        self.screens.append(screen)
        self._new_screen = True
        now_ns = self._clock()
        return ScreenShown(now_ns, now_ns, now_ns)

    def wait(self, until_ns: int | None) -> list[Input]:
        time.sleep(0.004)
        self._waits += 1
        if not self.screens or not (self._new_screen or self._waits > 50):
            return []  # people see what a key did before they press the next: some keys do nothing
        self._new_screen, self._waits = False, 0
        key, now_ns = "enter", self._clock()
        if isinstance(self.screens[-1], PlayScreen):
            self._places += 1
            key = self._pressed[self._places % len(self._pressed)]
        if self._escapes and self._places > 12:
            return self._escapes.pop(0)(now_ns)
        return [] if self._places > 12 and self._quits else [KeyDown(now_ns, key), KeyUp(now_ns, key)]

    def facts(self) -> dict[str, str]:
        return {"window": "table"}

    @property
    def picture_px(self) -> tuple[int, int]:
        return 800, 300

    def close(self) -> None:
        pass


def seated(folder: Path, window: Table, clock: SessionClock, path: Path) -> list[list[object]]:
    """Both sessions' events by seat, from logs that are proven."""
    protocol = read_protocol(path)
    assert count_seats_at_machine(protocol) == 2
    plans = [plan_next_session(protocol, folder) for _ in range(2)]
    logs = host_team(protocol, plans, SharedWindow(window, clock, 2), clock, folder)
    assert [list(find_log_differences(log, World)) for log in logs if log] == [[], []]
    events = [list(read_events(log)) for log in logs if log]
    return sorted(events, key=lambda found: next(one.seat for one in found if isinstance(one, TeamFormed)))


def test_two_people_at_one_window_each_play_by_their_own_keys(tmp_path: Path) -> None:
    clock = SessionClock()
    window = Table(clock, "a x left d right")
    both = seated(tmp_path, window, clock, shared_study(tmp_path, episodes=1, max_steps=8))
    joint = [[one.actions for one in events if isinstance(one, JointStepped)] for events in both]
    assert joint[0] == joint[1]
    assert len(joint[0]) == 8
    for events, own, others in ((both[0], {"a", "d"}, {"left", "right"}), (both[1], {"left", "right"}, {"a", "d"})):
        keys = {(one.key, one.action is not None) for one in events if isinstance(one, KeyPressed)}
        assert {(key, True) for key in own} <= keys
        assert ("x", False) in keys
        assert not {key for key, _ in keys} & others
        assert len({one.step for one in events if isinstance(one, FrameShown)}) > 1
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
    wide = next(screen for screen in window.screens if isinstance(screen, PlayScreen))
    halves = np.split(wide.picture, [half := (wide.picture.shape[1] - GAP_PX) // 2, half + GAP_PX], axis=1)
    assert halves[0].shape == halves[2].shape
    assert not np.array_equal(halves[0], halves[2])  # each has the own body marked
    titles = {screen.title.partition(":")[0] for screen in window.screens if isinstance(screen, TextScreen)}
    assert titles >= {"Person 1", "Person 2"}


def test_either_may_stop_both(tmp_path: Path) -> None:
    clock = SessionClock()
    both = seated(tmp_path, Table(clock, "a left", quits=True), clock, shared_study(tmp_path, max_steps=30))
    assert [one.reason for events in both for one in events if isinstance(one, SessionEnded)] == ["quit", "quit"]


def test_a_dry_run_says_each_seats_keys_and_simulated_people_press_them(tmp_path: Path) -> None:
    protocol = read_protocol(shared_study(tmp_path, max_steps=4))
    said = list(describe_plan(plan_next_session(protocol, tmp_path / "check")))
    assert [line for line in said if line.startswith("  keys ")] == [
        "  keys   seat 0: a left, d right, s stay",
        "  keys   seat 1: down stay, left left, right right",
    ]
    logs = list(simulate(protocol, tmp_path, participants=2, seed=1, player="random"))
    pressed = [
        {one.key for one in read_events(log) if isinstance(one, KeyPressed) and one.action is not None} for log in logs
    ]
    assert sorted(map(sorted, pressed)) == sorted((sorted("ads"), ["down", "left", "right"]))


@pytest.mark.parametrize(
    ("keys", "complaint"),
    [
        (KEYS.replace("down =", "s ="), "gives 's' to 2 seats"),
        (KEYS.replace("down =", "up ="), "names 'up', which is not in $.keys.pool"),
        (KEYS.replace(', s = "stay"', ""), "has keys for left, right; give each seat one for each action"),
    ],
)
def test_keys_that_are_not_one_seats_own_are_refused(tmp_path: Path, keys: str, complaint: str) -> None:
    with pytest.raises(ProtocolError) as refused:
        read_protocol(shared_study(tmp_path, keys=keys))
    assert complaint in str(refused.value)
