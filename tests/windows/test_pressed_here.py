"""One script of a hand on the keyboard and the mouse, over changes of focus, in both windows and in Chromium.

The X server makes the acts (XTEST), under a window manager; what the logs say of them is the same in all three.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from Xlib import X

from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Event, KeyPressed, Noted, PointerUsed, Stepped
from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.desktop import Desktop, desktop
from tests.machine import needs
from tests.web.browser import launch_on_display
from tests.web.protocols import study
from tests.web.serving import serving
from tests.window_host import HostedWindow, hosted
from tests.xserver import Typist

pytestmark = [pytest.mark.program, needs("openbox", "xvfb")]
MS = 1_000_000
LOOK_S = 0.25  # until an act has reached every window
REPEAT_S = 0.9  # until the system repeats a key that is held
FORGET_S = 2.1  # within 2 s Chromium calls a press a repeat of one whose release it did not see


class Hand:
    """A hand before a screen with two windows: the study's, and another."""

    def __init__(self, desk: Desktop, part_of_title: str, look: Callable[[float], None]) -> None:
        self.typist = Typist(desk.name)
        display: Any = self.typist._display
        self._display = display
        self._look = look
        self._study = display.create_resource_object("window", desk.find(part_of_title))
        self._other = display.screen().root.create_window(1100, 600, 200, 100, 0, X.CopyFromParent)
        self._other.map()
        display.sync()
        while self._other.get_attributes().map_state != X.IsViewable:
            self.look()

    def look(self, seconds: float = LOOK_S) -> None:
        """Wait, as people do between acts."""
        self._look(seconds)

    def leave(self) -> None:
        """Go to the other window."""
        self._focus(self._other)

    def come(self) -> None:
        """Come to the study's window."""
        self._focus(self._study)

    def _focus(self, window: Any) -> None:
        self._display.set_input_focus(window, X.RevertToParent, X.CurrentTime)
        self._display.sync()
        self.look()

    def tap(self, key: str) -> None:
        self.typist.tap(key)
        self.look()

    def down(self, key: str) -> None:
        self.typist.press(key)
        self.look()

    def up(self, key: str) -> None:
        self.typist.release(key)
        self.look()

    def close(self) -> None:
        self._other.destroy()
        self.typist.close()


Act = Callable[[Hand], None]


def hold_enter_elsewhere(hand: Hand) -> None:
    """On the consent page: hold Enter in another window, come back, let go; then agree."""
    hand.leave()
    hand.down("enter")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("enter")
    hand.tap("enter")  # agrees
    hand.tap("enter")  # ready


def hold_a_key_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("1")


def leave_with_a_key_held(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.up("1")
    hand.come()
    hand.look(FORGET_S)


def roll_over(hand: Hand) -> None:
    hand.down("1")
    hand.down("2")
    hand.up("1")
    hand.up("2")


def press_beside_modifiers(hand: Hand) -> None:
    for modifier in ("left_ctrl", "left_alt", "left_shift"):
        hand.down(modifier)
        hand.tap("2")
        hand.up(modifier)


def come_and_go_with_two_keys_held(hand: Hand) -> None:
    hand.leave()
    hand.down("1")
    hand.down("2")
    hand.come()
    hand.look(REPEAT_S)
    hand.up("2")
    hand.up("1")


def hold_a_key_until_it_repeats(hand: Hand) -> None:
    hand.down("2")
    hand.look(REPEAT_S)
    hand.up("2")


def leave_and_come_with_a_key_held(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.come()
    hand.look(REPEAT_S)
    hand.up("1")


def come_beside_a_modifier(hand: Hand) -> None:
    """As by Alt+Tab: the modifier is still down when the window has the focus."""
    hand.leave()
    hand.down("left_alt")
    hand.come()
    hand.tap("1")
    hand.up("left_alt")
    hand.tap("1")


SAMPLE: tuple[Act, ...] = (
    hold_enter_elsewhere,
    hold_a_key_elsewhere,
    leave_with_a_key_held,
    roll_over,
    press_beside_modifiers,
)
ALL: tuple[Act, ...] = (
    *SAMPLE,
    come_and_go_with_two_keys_held,
    hold_a_key_until_it_repeats,
    leave_and_come_with_a_key_held,
    come_beside_a_modifier,
)


@dataclass
class Desk:
    """A session in a window, run by hand."""

    window: HostedWindow
    session: SessionMachine
    events: list[Event] = field(default_factory=list)

    def look(self, seconds: float) -> None:
        """Let the session take what comes in so many seconds."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            for given in self.window.wait(time.monotonic_ns() + 20 * MS):
                self.events += self.session.receive(given)
            self.events += self.session.receive(self.window.show(self.session.screen))


def write_study(folder: Path) -> Path:
    """Write a protocol that asks for consent."""
    path = study(folder, max_steps=100)
    path.write_text(path.read_text().replace("[study]", '[study]\nconsent = "May we?"'))
    return path


def play_at_desk(desk: Desktop, kind: str, folder: Path, acts: Sequence[Act]) -> list[Event]:
    protocol = decode_protocol(write_study(folder).read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    with hosted(kind, desk.name, size_px=(640, 360)) as window:
        session = SessionMachine(plan, World, {"key_rules": KEY_RULES}, picture_px=window.picture_px)
        at_desk = Desk(window, session)
        with using_hand(desk, TITLE, at_desk.look) as hand:
            for act in acts:
                act(hand)
        session.close()
    return at_desk.events


def play_in_chromium(desk: Desktop, folder: Path, acts: Sequence[Act]) -> list[Event]:
    path = write_study(folder)
    with serving(path, folder) as served, launch_on_display(desk.name) as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        person.until("s.welcomed && s.kind !== ''")
        with using_hand(desk, "Chromium", lambda seconds: person.page.wait_for_timeout(1000 * seconds)) as hand:
            for act in acts:
                act(hand)
            person.until("s.unsafe === 0")
            assert person.errors == []
    (log,) = folder.rglob("*.mcap*")
    return list(read_events(log))


@contextmanager
def using_hand(desk: Desktop, part_of_title: str, look: Callable[[float], None]) -> Iterator[Hand]:
    hand = Hand(desk, part_of_title, look)
    try:
        hand.leave()
        hand.come()
        yield hand
    finally:
        hand.close()


def list_rows(events: Sequence[Event]) -> list[tuple[str, bool, str, str]]:
    """What the log says of keys, but for times: key, down, verdict, phase."""
    return [
        (event.key, event.down, event.verdict, event.phase)
        for event in events
        if isinstance(event, KeyPressed) and event.verdict != "repeat"
    ]


def find_causeless(events: Sequence[Event]) -> list[tuple[str, str]]:
    """Presses that did something, and were down before the window had the focus last."""
    found_ns, causeless = 0, []
    for event in events:
        if isinstance(event, Noted) and (event.kind, event.text) == ("focus", "found"):
            found_ns = event.t_ns
        acted = isinstance(event, KeyPressed) and event.down and event.verdict in ("accepted", "queued")
        if acted and event.t_ns - event.waited_ns < found_ns:
            causeless.append((event.key, event.verdict))
    return causeless


EXPECTED_OF_SAMPLE = (
    "consent enter+held_before_focus enter- enter+accepted enter- enter+accepted enter- 1+held_before_focus 1- "
    "1+accepted 1-release_at_focus_loss 1+accepted 2+accepted 1- 2- left_ctrl+ 2+shortcut 2- left_ctrl- "
    "left_alt+ 2+shortcut 2- left_alt- left_shift+ 2+accepted 2- left_shift-"
)


@pytest.fixture(scope="module")
def desk() -> Iterator[Desktop]:
    with desktop() as one:
        yield one


def spell(rows: Sequence[tuple[str, bool, str, str]]) -> str:
    """One word a row; the plainest verdicts are left out."""
    plain = {"unmapped", "release"}
    words = [f"{key}{'+' if down else '-'}{'' if verdict in plain else verdict}" for key, down, verdict, _ in rows]
    return " ".join([rows[0][3] if rows else "", *words])


@pytest.mark.parametrize("kind", ["pygame", "pyglet"])
def test_at_the_desk_a_press_counts_that_was_made_in_this_window(kind: str, desk: Desktop, tmp_path: Path) -> None:
    events = play_at_desk(desk, kind, tmp_path, SAMPLE)
    assert spell(list_rows(events)) == EXPECTED_OF_SAMPLE
    assert find_causeless(events) == []
    assert sum(isinstance(event, Stepped) for event in events) == 4


@needs("chromium")
def test_in_the_page_the_same_acts_leave_the_same_rows(desk: Desktop, tmp_path: Path) -> None:
    events = play_in_chromium(desk, tmp_path, SAMPLE)
    assert spell(list_rows(events)) == EXPECTED_OF_SAMPLE
    assert sum(isinstance(event, Stepped) for event in events) == 4


@pytest.mark.nightly
@needs("chromium")
def test_every_act_leaves_the_same_rows_in_all_three(desk: Desktop, tmp_path: Path) -> None:
    rows = {}
    for kind in ("pygame", "pyglet"):
        (tmp_path / kind).mkdir()
        events = play_at_desk(desk, kind, tmp_path / kind, ALL)
        assert find_causeless(events) == []
        rows[kind] = list_rows(events)
    (tmp_path / "page").mkdir()
    rows["page"] = list_rows(play_in_chromium(desk, tmp_path / "page", ALL))
    assert rows["pygame"] == rows["pyglet"] == rows["page"]
    assert not any(isinstance(event, PointerUsed) for event in events)
