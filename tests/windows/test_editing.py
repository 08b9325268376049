"""One script of editing with keys and mouse, in both windows, Chromium and Firefox: what a field shows is logged.

What an act comes to is each system's own (where a word ends, how much is undone); what the field then shows is in the
log, the table and the export of that window, code point for code point. What an input method or an extension does in
Chromium is in `tests/web/test_field.py`.
"""

import csv
import json
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

import minihuman
from minihuman.admin.next_session import plan_next_session
from minihuman.display.drawing.screen import find_spot
from minihuman.display.drawing.text_fields import FieldView
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Answered, Event, KeyPressed, TextChanged, TextTyped
from minihuman.experiment.machine.inputs import TEXT_RULES
from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.desktop import Desktop, desktop
from tests.machine import needs
from tests.web.browser import launch_on_display
from tests.web.firefox import firefox_at
from tests.web.protocols import asking
from tests.web.serving import serving
from tests.window_host import HostedWindow, hosted
from tests.windows.physical_acts import REPEAT_S, Hand, using_hand

pytestmark = [pytest.mark.program, needs("openbox", "xvfb")]
MS = 1_000_000
SIZE_PX = (640, 360)
FIELD = "document.querySelector('[data-target=field]')"
SHOWN = f"{FIELD}?.value ?? `no field on: ${{document.querySelector('#screen').innerText}}`"
SCRIPTS = (
    "می\N{ZERO WIDTH NON-JOINER}خواهم",
    "क्\N{ZERO WIDTH JOINER}ष",
    "Quoi\N{NO-BREAK SPACE}?",
    "日本語",
    "שלום",
    "Ж é ß",
)


@dataclass
class Front:
    """A field in one of the windows."""

    hand: Hand
    shown: Callable[[], str]
    texts: Callable[[], list[TextChanged]]  # that are logged
    place: Callable[[float], tuple[int, int]]  # in the window, at a share of the field's width

    def check(self, act: str) -> str:
        """Wait until the log has what the field shows; return it."""
        until_s = time.monotonic() + PATIENCE_S
        while True:
            shown = self.shown()
            texts = self.texts()
            logged = texts[-1].text if texts else ""
            if logged == shown:
                return shown
            assert time.monotonic() < until_s, f"{act}: the field shows {shown!r}, the log has {logged!r}"
            self.hand.look(0.1)


Act = Callable[[Front], None]


def typing(text: str) -> Act:
    return lambda front: front.hand.write(text)


def tapping(*keys: str) -> Act:
    return lambda front: [front.hand.tap(key) for key in keys] and None


def chord(*keys: str) -> Act:
    """Hold all keys but the last, and tap that."""

    def act(front: Front) -> None:
        for key in keys[:-1]:
            front.hand.typist.press(key)
        front.hand.tap(keys[-1])
        for key in reversed(keys[:-1]):
            front.hand.typist.release(key)
        front.hand.look()

    return act


def clicking(along: float, times: int = 1) -> Act:
    return lambda front: front.hand.click_at(*front.place(along), times=times)


def dragging(begin: float, end: float) -> Act:
    return lambda front: front.hand.drag(front.place(begin), front.place(end))


def holding(key: str) -> Act:
    def act(front: Front) -> None:
        front.hand.down(key)
        front.hand.look(REPEAT_S)
        front.hand.up(key)

    return act


def typing_and_leaving(text: str) -> Act:
    """Leave before the text settles."""

    def act(front: Front) -> None:
        front.hand.write(text)
        front.hand.leave()
        front.hand.come()

    return act


def typing_elsewhere(key: str) -> Act:
    def act(front: Front) -> None:
        front.hand.leave()
        front.hand.tap(key)
        front.hand.come()

    return act


def doing(*acts: Act) -> Act:
    return lambda front: [act(front) for act in acts] and None


UNDO, REDO = chord("left_ctrl", "z"), chord("left_ctrl", "left_shift", "z")
ALL, COPY, CUT, PASTE = (chord("left_ctrl", key) for key in "acxv")
HOME, END = tapping("home"), tapping("end")
LONG_ACTS: dict[str, Act] = {
    "type": typing("teh cat sat"),
    "type in the middle": doing(tapping("left", "left", "left"), typing("big ")),
    "delete on both sides": tapping("backspace", "delete"),
    "replace a selection to the line's begin": doing(chord("left_shift", "home"), typing("a")),
    "undo": UNDO,
    "redo": REDO,
    "replace all": doing(ALL, typing("whole")),
    "undo twice": doing(UNDO, UNDO),
    "begin a line": doing(END, tapping("enter"), typing("second line")),
    "copy a line behind itself": doing(chord("left_shift", "home"), COPY, END, PASTE),
    "cut all": doing(ALL, CUT),
    "paste several lines": PASTE,
    "paste them again": PASTE,
    "delete at the begin": doing(chord("left_ctrl", "home"), tapping("delete", "delete")),
    "delete at the end": doing(chord("left_ctrl", "end"), tapping("backspace", "backspace")),
    "type two words back": doing(chord("left_ctrl", "left"), chord("left_ctrl", "left"), typing("-")),
    "delete a selected word": doing(chord("left_ctrl", "left_shift", "left"), tapping("backspace")),
    "delete the word before": chord("left_ctrl", "backspace"),
    "delete the word behind": doing(chord("left_ctrl", "home"), chord("left_ctrl", "delete")),
    "undo three times": doing(UNDO, UNDO, UNDO),
    "redo with Y": chord("left_ctrl", "y"),
    "type at the click": doing(clicking(0.4), typing("|")),
    "replace the word of a double click": doing(clicking(0.05, times=2), typing("word")),
    "replace what was dragged over": doing(dragging(0.02, 0.3), typing("dragged")),
    "hold a letter": holding("x"),
    "hold backspace": holding("backspace"),
    "type in a burst": typing("the quick brown fox jumps over the lazy dog"),
    "capitals": doing(tapping("caps_lock"), tapping("b"), tapping("caps_lock"), chord("left_shift", "c")),
    "type and take it back": doing(typing("no"), tapping("backspace", "backspace")),
    "leave before it settles": typing_and_leaving(" soon"),
    "type in another window": typing_elsewhere("q"),
    "six scripts": typing("\n".join(SCRIPTS)),
    "delete a letter with its marks": doing(chord("left_ctrl", "end"), tapping("backspace")),
    "blanks at the end": typing("  \n "),
}
LINE_ACTS: dict[str, Act] = {
    "type into a line": typing("one line"),
    "copy it": doing(ALL, COPY, END),
    "paste it twice": doing(PASTE, PASTE),
    "cut a word": doing(chord("left_ctrl", "left_shift", "left"), CUT),
    "paste it at the begin": doing(HOME, PASTE),
    "replace all by six scripts": doing(ALL, typing(" ".join(SCRIPTS))),
}
SAMPLE = ("type", "type in the middle", "undo", "cut all", "paste several lines", "six scripts", "type into a line")


@pytest.fixture(scope="module")
def desk() -> Iterator[Desktop]:
    with desktop() as one:
        yield one


@dataclass
class Desk:
    """A session in a window, run by hand."""

    window: HostedWindow
    session: SessionMachine
    events: list[Event] = field(default_factory=list)

    def look(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and not self.session.over:
            for given in self.window.wait(time.monotonic_ns() + 20 * MS):
                self.events += self.session.receive(given)
            if not self.session.over:
                self.events += self.session.receive(self.window.show(self.session.screen))

    def view(self) -> Any:
        """The question with the field as the window has it."""
        return self.window._ask("_field").show_current()

    def place(self, along: float) -> tuple[int, int]:
        view = self.view()
        spots = [x for x in range(0, SIZE_PX[0], 4) if self._names_field(view, x / SIZE_PX[0], 0.5)]
        heights = [y for y in range(0, SIZE_PX[1], 4) if self._names_field(view, spots[0] / SIZE_PX[0], y / SIZE_PX[1])]
        return round(spots[0] + along * (spots[-1] - spots[0])), heights[0] + 14

    @staticmethod
    def _names_field(view: Any, x: float, y: float) -> bool:
        return find_spot(view, SIZE_PX, x, y)[0] == "field"

    def shown(self) -> str:
        item = self.view().item
        assert isinstance(item, FieldView)
        return item.text


@contextmanager
def at_desk(kind: str, desk: Desktop, folder: Path) -> Iterator[Front]:
    protocol = decode_protocol(asking(folder, "long_text", "text").read_bytes())
    plan = plan_next_session(protocol, folder, participant="sub-01", session=1)
    facts = {"player": "human", "platform": "test", "key_rules": KEY_RULES, "text_rules": TEXT_RULES}
    with hosted(kind, desk.name, size_px=SIZE_PX) as window:
        session = SessionMachine(plan, World, facts, picture_px=window.picture_px)
        sitting = Desk(window, session)
        with using_hand(desk, TITLE, sitting.look) as hand:
            texts = lambda: [event for event in sitting.events if isinstance(event, TextChanged)]  # noqa: E731
            yield Front(hand, sitting.shown, texts, sitting.place)
        recorder = McapRecorder(folder, plan, started_ns=time.time_ns())
        recorder.write(sitting.events)
        recorder.close()
        session.close()


@contextmanager
def in_page(kind: str, desk: Desktop, folder: Path) -> Iterator[Front]:
    path = asking(folder, "long_text", "text")
    with serving(path, folder) as served:
        url = f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}"
        with open_page(kind, url, desk, folder) as (evaluate, look, title), using_hand(desk, title, look) as hand:
            until_s = time.monotonic() + PATIENCE_S
            while evaluate(f"{FIELD} === null"):  # Chromium may begin in its address bar, and come back to it
                assert time.monotonic() < until_s, evaluate(SHOWN)
                hand.click()

            def place(along: float) -> tuple[int, int]:
                box = evaluate(f"{FIELD}.getBoundingClientRect().toJSON()")
                top = hand.study_height - evaluate("innerHeight")
                return round(box["x"] + 8 + along * (box["width"] - 16)), round(top + box["y"] + 16)

            def texts() -> list[TextChanged]:
                logs = [*folder.rglob("*.mcap.part"), *folder.rglob("*.mcap")]
                return [event for log in logs[:1] for event in read_events(log) if isinstance(event, TextChanged)]

            yield Front(hand, lambda: str(evaluate(SHOWN)), texts, place)
        served.stop()


@contextmanager
def open_page(
    kind: str, url: str, desk: Desktop, folder: Path
) -> Iterator[tuple[Callable[[str], Any], Callable[[float], None], str]]:
    """Open a browser; yields what evaluates in its page, what lets time pass, and words of its title."""
    if kind == "Firefox":
        with firefox_at(url, folder / "profile", display=desk.name) as page:
            page.until("s.welcomed")
            yield page.find, time.sleep, "Mozilla Firefox"
        return
    with launch_on_display(desk.name) as sit_down:
        person = sit_down(url)
        person.until("s.welcomed")
        yield person.page.evaluate, lambda seconds: person.page.wait_for_timeout(1000 * seconds), "Chromium"
        assert person.errors == []


def edit(front: Front, acts: dict[str, Act]) -> dict[str, str]:
    """Do the acts, or a sample of them, and return what the field showed after each."""
    texts = {}
    for name, act in acts.items():
        if count(name in SAMPLE, True):
            act(front)
            texts[name] = front.check(name)
    return texts


@pytest.mark.nightly(by_day=["pygame"])
@pytest.mark.parametrize("kind", ["pygame", "pyglet", "Chromium", "Firefox"])
def test_what_a_field_shows_after_each_act_is_logged_tabled_and_exported(
    kind: str, desk: Desktop, tmp_path: Path
) -> None:
    open_front = at_desk if kind in ("pygame", "pyglet") else in_page
    with open_front(kind, desk, tmp_path) as front:
        front.hand.look(1.0)
        shown = edit(front, LONG_ACTS)
        front.hand.tap("tab")
        front.hand.look(1.0)
        in_line = edit(front, LINE_ACTS)
        final = [[*shown.values()][-1], front.shown()]
        front.hand.tap("enter")
        front.hand.look(1.0)
    [log] = tmp_path.rglob("*.mcap*")
    events = list(read_events(log))
    answers = [event for event in events if isinstance(event, Answered)]
    assert "\n".join(SCRIPTS) in shown["six scripts"]
    assert in_line.get("replace all by six scripts", final[1]) == final[1]
    assert [json.loads(event.value) for event in answers] == final
    assert [event.words for event in answers] == final
    keys = {event.key for event in events if isinstance(event, KeyPressed)}
    assert keys <= {"tab", "enter"}, keys
    assert not [event for event in events if isinstance(event, TextTyped)]
    minihuman.export("csv", log, tmp_path / "csv")
    [path] = (tmp_path / "csv").rglob("answers.csv")
    with path.open(encoding="utf-8", newline="") as rows:
        assert [row["answer"] for row in csv.DictReader(rows)] == [event.words for event in answers]
    print(f"{kind}: {len(shown) + len(in_line)} acts of editing, each logged as shown")
