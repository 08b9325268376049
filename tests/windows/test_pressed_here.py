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
from Xlib import XK, X
from Xlib.ext import xtest

from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Event, KeyPressed, Noted, Stepped
from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import BROWSER_NOTE
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
        self.injected: list[tuple[str, int]] = []  # keys that went down, and when, by the monotonic clock
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
        self.tap_fast(key)

    def tap_fast(self, *keys: str) -> None:
        """Tap keys with nothing between them."""
        for key in keys:
            self.injected.append((key, time.monotonic_ns()))
            self.typist.tap(key)
        self.look()

    def down(self, key: str) -> None:
        self.injected.append((key, time.monotonic_ns()))
        self.typist.press(key)
        self.look()

    def up(self, key: str) -> None:
        self.typist.release(key)
        self.look()

    def tap_place(self, key: str) -> None:
        """Press where a key stands on a US keyboard, whatever it types."""
        self.injected.append((key, time.monotonic_ns()))
        self.typist.tap_place(key)
        self.look()

    def point(self) -> None:
        """Move the pointer to the middle of the study's window, where nothing takes a click."""
        root = self._display.screen().root
        shape = self._study.get_geometry()
        corner = self._study.translate_coords(root, 0, 0)
        x = shape.width // 2 - corner.x
        y = shape.height // 2 - corner.y
        xtest.fake_input(self._display, X.MotionNotify, x=x, y=y)
        self._display.sync()

    def click(self) -> None:
        self.point()
        self.typist.button(True)
        self.look()
        self.typist.button(False)
        self.look()

    @contextmanager
    def other_layout(self) -> Iterator[None]:
        """Let the place of 2 type what it types in France."""
        keycode = self.typist.keycode("2")
        before = self._display.get_keyboard_mapping(keycode, 1)
        french = [[XK.string_to_keysym("eacute"), XK.string_to_keysym("2"), *before[0][2:]]]
        for symbols in (french, before):
            self._display.change_keyboard_mapping(keycode, symbols)
            self._display.sync()
            self.look()
            if symbols is french:
                yield

    def close(self) -> None:
        self._other.destroy()
        self.typist.close()


Act = Callable[[Hand], None]
Row = tuple[str, bool, str, str]  # of the log: key, down, verdict, phase


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


def roll_three_over(hand: Hand) -> None:
    for key in ("1", "2", "3"):
        hand.down(key)
    for key in ("2", "1", "3"):
        hand.up(key)


def roll_back(hand: Hand) -> None:
    hand.down("1")
    hand.down("2")
    hand.up("2")
    hand.up("1")


def tap_twice(hand: Hand) -> None:
    hand.tap_fast("3", "3")


def click_into_the_window(hand: Hand) -> None:
    hand.click()
    hand.tap("1")


def click_to_come(hand: Hand) -> None:
    """The click that brings the focus, and a key behind it."""
    hand.leave()
    hand.click()
    hand.tap("1")


def click_beside_a_key(hand: Hand) -> None:
    hand.down("2")
    hand.click()
    hand.up("2")


def click_and_press_at_once(hand: Hand) -> None:
    hand.point()
    hand.typist.button(True)
    hand.tap_fast("1")
    hand.typist.button(False)
    hand.look()


def change_the_layout(hand: Hand) -> None:
    """In mid-session, to one where another symbol stands at the place of 2, and back."""
    hand.tap("2")
    with hand.other_layout():
        hand.tap_place("2")
    hand.tap("2")


def press_beside_alt_graph(hand: Hand) -> None:
    hand.down("right_alt")
    hand.tap("1")
    hand.up("right_alt")


def let_go_of_the_modifier_first(hand: Hand) -> None:
    hand.down("left_ctrl")
    hand.down("2")
    hand.up("left_ctrl")
    hand.up("2")


def press_the_modifier_last(hand: Hand) -> None:
    hand.down("1")
    hand.down("left_shift")
    hand.up("1")
    hand.up("left_shift")


def press_under_both_shifts(hand: Hand) -> None:
    hand.down("left_shift")
    hand.down("right_shift")
    hand.tap("3")
    hand.up("right_shift")
    hand.up("left_shift")


def press_under_caps_lock(hand: Hand) -> None:
    hand.tap("caps_lock")
    hand.tap("1")
    hand.tap("caps_lock")


def press_under_num_lock(hand: Hand) -> None:
    hand.tap("num_lock")
    hand.tap("2")
    hand.tap("num_lock")


def hold_a_key_over_a_pause(hand: Hand) -> None:
    hand.down("1")
    hand.tap("f8")
    hand.up("1")
    hand.tap("enter")


def press_in_a_pause(hand: Hand) -> None:
    hand.tap("f8")
    hand.tap("2")
    hand.tap("enter")
    hand.tap("2")


def hold_the_key_that_goes_on(hand: Hand) -> None:
    hand.tap("f8")
    hand.down("enter")
    hand.look(REPEAT_S)
    hand.up("enter")


def ask_to_leave_and_stay(hand: Hand) -> None:
    hand.tap("escape")
    hand.tap("1")
    hand.tap("enter")
    hand.tap("1")


def leave_with_a_modifier_held(hand: Hand) -> None:
    hand.down("left_shift")
    hand.leave()
    hand.up("left_shift")
    hand.come()
    hand.tap("3")


def tap_elsewhere(hand: Hand) -> None:
    hand.leave()
    hand.tap("1")
    hand.come()


def press_two_keys_in_two_windows(hand: Hand) -> None:
    hand.down("1")
    hand.leave()
    hand.down("2")
    hand.come()
    hand.up("2")
    hand.up("1")


def leave_in_a_pause(hand: Hand) -> None:
    hand.tap("f8")
    hand.leave()
    hand.come()
    hand.tap("enter")
    hand.tap("3")


def press_what_means_nothing(hand: Hand) -> None:
    hand.tap("x")
    hand.tap("kp_1")
    hand.tap("space")


SAMPLE: tuple[Act, ...] = (
    hold_enter_elsewhere,
    leave_with_a_key_held,
    press_beside_modifiers,
)
ALL: tuple[Act, ...] = (
    *SAMPLE,
    hold_a_key_elsewhere,
    roll_over,
    come_and_go_with_two_keys_held,
    hold_a_key_until_it_repeats,
    leave_and_come_with_a_key_held,
    come_beside_a_modifier,
    roll_three_over,
    roll_back,
    tap_twice,
    click_into_the_window,
    click_to_come,
    click_beside_a_key,
    click_and_press_at_once,
    change_the_layout,
    press_beside_alt_graph,
    let_go_of_the_modifier_first,
    press_the_modifier_last,
    press_under_both_shifts,
    press_under_caps_lock,
    press_under_num_lock,
    hold_a_key_over_a_pause,
    press_in_a_pause,
    hold_the_key_that_goes_on,
    ask_to_leave_and_stay,
    leave_with_a_modifier_held,
    tap_elsewhere,
    press_two_keys_in_two_windows,
    leave_in_a_pause,
    press_what_means_nothing,
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


@dataclass
class Logged:
    """What was logged of a script, and by how much the stamps of its presses differ from their injection."""

    events: list[Event]
    late_ms: list[float]


def find_late_ms(events: Sequence[Event], injected: Sequence[tuple[str, int]], zero_ns: int) -> list[float]:
    """By how many ms each press is stamped after its injection; presses that no finger made here are left out."""
    late_ms = []
    for press in events:
        if not isinstance(press, KeyPressed) or not press.down or press.verdict in ("repeat", "held_before_focus"):
            continue
        stamp_ns = press.t_ns - press.waited_ns + zero_ns
        nearest_ns = min((abs(stamp_ns - at_ns), at_ns) for key, at_ns in injected if key == press.key)[1]
        late_ms.append((stamp_ns - nearest_ns) / MS)
    return late_ms


def play_at_desk(desk: Desktop, kind: str, folder: Path, acts: Sequence[Act]) -> Logged:
    protocol = decode_protocol(write_study(folder).read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    with hosted(kind, desk.name, size_px=(640, 360)) as window:
        session = SessionMachine(plan, World, {"key_rules": KEY_RULES}, picture_px=window.picture_px)
        at_desk = Desk(window, session)
        with using_hand(desk, TITLE, at_desk.look) as hand:
            for act in acts:
                act(hand)
        session.close()
    return Logged(at_desk.events, find_late_ms(at_desk.events, hand.injected, 0))


def play_in_chromium(desk: Desktop, folder: Path, acts: Sequence[Act]) -> Logged:
    path = write_study(folder)
    with serving(path, folder) as served, launch_on_display(desk.name) as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        person.until("s.welcomed && s.kind !== ''")
        with using_hand(desk, "Chromium", lambda seconds: person.page.wait_for_timeout(1000 * seconds)) as hand:
            for act in acts:
                act(hand)
            page_ms, session_ns = person.page.evaluate(
                "[performance.timeOrigin + performance.now(), minihuman.state.now]"
            )
            person.until("s.unsafe === 0")
            assert person.errors == []
    (log,) = folder.rglob("*.mcap*")
    events = list(read_events(log))
    zero_ns = round(page_ms * MS) - session_ns - (time.time_ns() - time.monotonic_ns())
    return Logged(events, find_late_ms(events, hand.injected, zero_ns))


@contextmanager
def using_hand(desk: Desktop, part_of_title: str, look: Callable[[float], None]) -> Iterator[Hand]:
    hand = Hand(desk, part_of_title, look)
    try:
        hand.leave()
        hand.come()
        yield hand
    finally:
        hand.close()


def list_rows(events: Sequence[Event]) -> list[Row]:
    """What the log says of keys, but for times: key, down, verdict, phase."""
    return [
        (event.key, event.down, event.verdict, event.phase)
        for event in events
        if isinstance(event, KeyPressed) and event.verdict != "repeat"
    ]


def split_held(rows: Sequence[Row]) -> tuple[list[Row], list[Row]]:
    """Rows without those of keys that were down before the focus, and these, sorted.

    A browser tells of such a key when it repeats or comes up, an X server as the focus comes.
    """
    held = sorted(row for row in rows if row[2] == "held_before_focus")
    return [row for row in rows if row[2] != "held_before_focus"], held


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
    "consent enter+held_before_focus enter- enter+accepted enter- enter+accepted enter- "
    "1+accepted 1-release_at_focus_loss left_ctrl+ 2+shortcut 2- left_ctrl- "
    "left_alt+ 2+shortcut 2- left_alt- left_shift+ 2+accepted 2- left_shift-"
)


@pytest.fixture(scope="module")
def desk() -> Iterator[Desktop]:
    with desktop() as one:
        yield one


def spell(rows: Sequence[Row]) -> str:
    """One word a row; the plainest verdicts are left out."""
    plain = {"unmapped", "release"}
    words = [f"{key}{'+' if down else '-'}{'' if verdict in plain else verdict}" for key, down, verdict, _ in rows]
    return " ".join([rows[0][3] if rows else "", *words])


@pytest.mark.parametrize("kind", ["pygame", "pyglet"])
def test_at_the_desk_a_press_counts_that_was_made_in_this_window(kind: str, desk: Desktop, tmp_path: Path) -> None:
    events = play_at_desk(desk, kind, tmp_path, SAMPLE).events
    assert spell(list_rows(events)) == EXPECTED_OF_SAMPLE
    assert find_causeless(events) == []
    assert sum(isinstance(event, Stepped) for event in events) == 2


@needs("chromium")
def test_in_the_page_the_same_acts_leave_the_same_rows(desk: Desktop, tmp_path: Path) -> None:
    events = play_in_chromium(desk, tmp_path, SAMPLE).events
    assert spell(list_rows(events)) == EXPECTED_OF_SAMPLE
    assert sum(isinstance(event, Stepped) for event in events) == 2


@pytest.mark.nightly
@needs("chromium")
def test_every_act_leaves_the_same_rows_in_all_three(desk: Desktop, tmp_path: Path) -> None:
    rows = {}
    for kind in ("pygame", "pyglet", "page"):
        folder = tmp_path / kind
        folder.mkdir()
        logged = play_in_chromium(desk, folder, ALL) if kind == "page" else play_at_desk(desk, kind, folder, ALL)
        rows[kind] = list_rows(logged.events)
        late_ms = sorted(map(abs, logged.late_ms))
        print(f"{kind}: {len(late_ms)} presses, median {late_ms[len(late_ms) // 2]:.1f} ms, most {late_ms[-1]:.1f} ms")
        assert find_causeless(logged.events) == []
        assert [event.text for event in logged.events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert spell(rows["pygame"]).split() == spell(rows["pyglet"]).split()
    assert rows["pygame"] == rows["pyglet"]
    in_window, in_page = (split_held(rows[kind]) for kind in ("pygame", "page"))
    assert spell(in_window[0]).split() == spell(in_page[0]).split()
    assert in_window == in_page
