"""One script of a hand on the keyboard and the mouse, over changes of focus, in both windows and in Chromium.

The X server makes the acts (XTEST), under a window manager; what the logs say of them is the same in all three.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pytest

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
from tests.web.firefox import firefox_at
from tests.web.protocols import study
from tests.web.serving import serving
from tests.window_host import HostedWindow, hosted
from tests.windows.physical_acts import ALL, SAMPLE, Act, Hand, using_hand

pytestmark = [pytest.mark.program, needs("openbox", "xvfb")]
MS = 1_000_000
_TIMES = "[performance.timeOrigin + performance.now(), minihuman.state.now]"


Row = tuple[str, bool, str, str]  # of the log: key, down, verdict, phase


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
            page_ms, session_ns = person.page.evaluate(_TIMES)
            person.until("s.unsafe === 0")
            assert person.errors == []
    return read_logged(folder, hand, page_ms, session_ns)


def play_in_firefox(desk: Desktop, folder: Path, acts: Sequence[Act]) -> Logged:
    path = write_study(folder)
    with serving(path, folder) as served:
        url = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        with firefox_at(url, folder / "profile", display=desk.name) as page:
            page.until("s.welcomed && s.kind !== ''")
            with using_hand(desk, "Mozilla Firefox", time.sleep) as hand:
                for act in acts:
                    act(hand)
                page_ms, session_ns = page.find(_TIMES)
                page.until("s.unsafe === 0")
        served.stop()
    return read_logged(folder, hand, page_ms, session_ns)


def read_logged(folder: Path, hand: Hand, page_ms: float, session_ns: int) -> Logged:
    """Read what a page's session logged; both times were read at once, of the page's clocks."""
    (log,) = folder.rglob("*.mcap*")
    events = list(read_events(log))
    zero_ns = round(page_ms * MS) - session_ns - (time.time_ns() - time.monotonic_ns())
    return Logged(events, find_late_ms(events, hand.injected, zero_ns))


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
@needs("firefox")
def test_in_firefox_the_same_acts_leave_the_same_rows(desk: Desktop, tmp_path: Path) -> None:
    events = play_in_firefox(desk, tmp_path, SAMPLE).events
    assert spell(list_rows(events)) == EXPECTED_OF_SAMPLE
    assert sum(isinstance(event, Stepped) for event in events) == 2


@pytest.mark.nightly
@needs("chromium", "firefox")
def test_every_act_leaves_the_same_rows_in_all_four(desk: Desktop, tmp_path: Path) -> None:
    rows = {}
    for kind in ("pygame", "pyglet", "Chromium", "Firefox"):
        folder = tmp_path / kind
        folder.mkdir()
        logged = play(kind, desk, folder, ALL)
        rows[kind] = list_rows(logged.events)
        print(describe(kind, logged, rows[kind]))
        assert find_causeless(logged.events) == []
        assert [event.text for event in logged.events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert spell(rows["pygame"]).split() == spell(rows["pyglet"]).split()
    assert rows["pygame"] == rows["pyglet"]
    in_window = split_held(rows["pygame"])
    for kind in ("Chromium", "Firefox"):
        in_page = split_held(rows[kind])
        assert spell(in_window[0]).split() == spell(in_page[0]).split(), kind
        assert in_window == in_page, kind


def describe(kind: str, logged: Logged, rows: Sequence[Row]) -> str:
    """Say what was done and logged, and how far the stamps are from the injection; a busy machine stamps late."""
    late_ms = sorted(map(abs, logged.late_ms))
    n_late = len(late_ms)
    bar_ms = 2 if kind in ("pygame", "pyglet") else 4
    share = sum(ms <= bar_ms for ms in late_ms) / n_late
    n_causeless = len(find_causeless(logged.events))
    return (
        f"{kind}: {len(ALL)} acts, {len(rows)} rows, {n_causeless} presses without a cause in this window; "
        f"{n_late} presses stamped within {late_ms[n_late // 2]:.1f} ms of injection at the median, "
        f"{late_ms[-1]:.1f} ms at most, {share:.0%} within {bar_ms} ms"
    )


def play(kind: str, desk: Desktop, folder: Path, acts: Sequence[Act]) -> Logged:
    if kind == "Chromium":
        return play_in_chromium(desk, folder, acts)
    if kind == "Firefox":
        return play_in_firefox(desk, folder, acts)
    return play_at_desk(desk, kind, folder, acts)
