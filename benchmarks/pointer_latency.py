"""How late clicks, taps and a gamepad are stamped: at the desk and in the page.

    python -m benchmarks.pointer_latency [--clicks 100] [--only pygame pyglet page]

At the desk the X server (Xvfb) itself clicks (XTEST) on a question in a window; the error is the press's time minus the
moment it was sent, and what lies outside of the time between sending and the server's taking it is the window's own.
In the page, Chromium's protocol sends mouse presses, then touches on the buttons of a touch screen, each with the time
that a device would have stamped it with, and the error is the log's time minus that; the log's times are brought onto
this machine's clock by the log's own links. A gamepad is one that the page is made to see, whose time of change is
known by the page's own clock. Prints milliseconds; judges nothing.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.display.drawing.screen import find_spot
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import AxisMoved, KeyPressed, Linked, PointerUsed
from minihuman.experiment.machine.inputs import PointerPressed
from minihuman.experiment.machine.screens import OptionList, QuestionScreen
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.read.session_reader import read_events
from tests.web.browser import browsing
from tests.web.serving import serving
from tests.window_host import HostedWindow
from tests.xserver import Typist, xvfb

SIZE_PX = (640, 360)
_BOARD = """
[study]
name = "clicks"
version = "1"
seed = 3
closing = ""
[keys]
pool = ["1", "2", {pad}]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["board"]
[[blocks]]
name = "board"
world = "tests.worlds.levers:tests/Levers-v0"
options = {{ kind = "{kind}" }}
episodes = 1
actions = {actions}
key_map = "fixed"
fixed_keys = {{ 1 = "{first}" }}
max_steps = {steps}
final_frame_ms = 0
{more}
[web]
require_keyboard = false
"""
_PAD = """
window.pad = { id: "Stub pad", mapping: "standard", connected: true, axes: [0, 0, 0, 0], timestamp: 0,
  buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0 })) };
Object.defineProperty(navigator, "getGamepads", { value: () => [null, window.pad] });
"""
_MOVE = """(value) => new Promise((done) => setTimeout(() => {
  window.pad.axes = [value, 0, 0, 0];
  window.pad.timestamp = performance.now();
  done(window.pad.timestamp);
}, 20 + 60 * Math.random()))"""


def at_the_desk(window: str, clicks: int) -> None:
    """Click on a question in a window, and say how late."""
    screen = QuestionScreen("", "Which one?", OptionList(("this", "that"), (), 0), "")
    grid = [(x / 160, y / 90) for x in range(160) for y in range(90)]
    x, y = np.mean([place for place in grid if find_spot(screen, SIZE_PX, *place)[0] == "option:1"], axis=0)
    errors, outside = [], []
    with xvfb() as display:
        typist, hosted = Typist(display), HostedWindow(window, display, size_px=SIZE_PX)
        hosted.show(screen)
        typist.focus(TITLE)
        typist.point(TITLE, float(x), float(y))
        for _ in range(clicks):
            sent_ns = time.monotonic_ns()
            typist.button(True)
            taken_ns = time.monotonic_ns()
            typist.button(False)
            heard = []
            while not heard:
                arrived = hosted.wait(time.monotonic_ns() + 2_000_000_000)
                heard = [one for one in arrived if isinstance(one, PointerPressed)]
            errors.append((heard[0].t_ns - sent_ns) / 1e6)
            outside.append(max(0.0, (heard[0].t_ns - taken_ns) / 1e6, (sent_ns - heard[0].t_ns) / 1e6))
            hosted.wait(time.monotonic_ns() + 30_000_000)
        hosted.end()
        typist.close()
    say(f"{window}, mouse", errors)
    say(f"{window}, mouse, outside", outside)


def in_the_page(folder: Path, kind: str, clicks: int) -> None:
    """Click, tap or move the stick in Chromium."""
    touched, pad = kind == "touch", kind == "gamepad"
    board = "board" if kind == "mouse" else "choices" if touched else "box"
    actions = {"board": ["choice_0_1"], "choices": ["choice_0_1"], "box": ["axis_1_plus"]}[board]
    held = 'pace = "real_time"\nstep_period_ms = 50\nnoop_action = "rest"\nhold = "repeat"\n'
    axes = f"{held}axes = {{ pad_left_x = {{ component = 0 }} }}"
    protocol = folder / "clicks.toml"
    protocol.write_text(
        _BOARD.format(
            kind=board,
            actions=actions,
            first=actions[0],
            steps=10_000 if pad else clicks,
            more='spot = { x = 1, y = 2, action = "choice_0_2" }' if kind == "mouse" else axes if pad else "",
            pad='"pad_south"' if pad else '"3"',
        )
    )
    sent: list[float] = []
    options: dict[str, Any] = {"has_touch": True, "is_mobile": True} if touched else {}
    with (
        serving(protocol, folder, options=("--trust",)) as served,
        browsing(size=(390, 844) if touched else (1280, 720)) as sit,
    ):
        person = sit(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}", **options)
        page = person.page
        if pad:
            page.get_by_text("gamepad").wait_for()
            page.evaluate(_PAD + "dispatchEvent(new Event('gamepadconnected'));")
        person.until("s.welcomed && s.kind === 'text'")
        while not person.state["playing"]:
            if touched:
                page.locator("#touch [data-key=enter]").tap()
            else:
                page.keyboard.press("Enter")
            page.wait_for_timeout(300)
        page.wait_for_timeout(12_000)  # links
        driver = page.context.new_cdp_session(page)
        where = page.locator("#touch [data-key='1']" if touched else "canvas").bounding_box()
        x, y = where["x"] + where["width"] / 2, where["y"] + where["height"] / 2
        for number in range(clicks):
            if pad:
                sent.append(page.evaluate(_MOVE, 0.5 if number % 2 else 1.0))
                continue
            sent.append(time.time())
            at = {"timestamp": sent[-1]}  # when a device would have stamped it: how long it travels here is not ours
            if touched:
                touch = {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
                driver.send("Input.dispatchTouchEvent", touch | at)
                driver.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            else:
                press = {"x": x, "y": y, "button": "left", "clickCount": 1}
                driver.send("Input.dispatchMouseEvent", {"type": "mousePressed", **press, **at})
                driver.send("Input.dispatchMouseEvent", {"type": "mouseReleased", **press})
            if number < clicks - 1:
                person.until(f"s.confirmed === {number + 1}")
        if pad:
            page.wait_for_timeout(300)
            page.keyboard.press("Escape")
            zero_ns = page.evaluate("performance.now() * 1e6 - minihuman.state.now")
        else:
            person.until("s.finished")
        served.stop()
    [log] = folder.rglob("*.mcap*")
    events = list(read_events(log))
    if pad:
        axis_ns = [event.t_ns - event.waited_ns for event in events if isinstance(event, AxisMoved)]
        say("page, gamepad", (np.array(axis_ns[:clicks]) - np.array(sent) * 1e6 + zero_ns) / 1e6)
        return
    best = min((event for event in events if isinstance(event, Linked)), key=lambda event: event.least_rtt_ns)
    start_ns = int(read_segment_starts(log)[1]) + best.offset_ns
    used = [
        event.t_ns - event.waited_ns
        for event in events
        if (isinstance(event, PointerUsed) and event.what == "pressed" and event.target == "picture")
        or (isinstance(event, KeyPressed) and event.down and event.key == "1" and event.symbol == "touch")
    ]
    assert len(used) == clicks, f"{clicks} were sent, {len(used)} are in the log"
    say(f"page, {kind}", (np.array(used) + start_ns - np.array(sent) * 1e9) / 1e6)
    print(f"{'':24} clocks right to {best.error_ns / 1e6:.2f}")


def say(name: str, errors: Any) -> None:
    """One line: the median, 95 %, and the worst."""
    median, late, worst = np.percentile(np.asarray(errors), (50, 95, 100))
    print(f"{name:24} {median:8.2f} {late:8.2f} {worst:8.2f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clicks", type=int, default=100)
    parser.add_argument("--only", nargs="+", default=["pygame", "pyglet", "mouse", "touch", "gamepad"])
    asked = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; ms{'median':>14} {'95 %':>8} {'worst':>8}")
    for kind in asked.only:
        if kind in ("pygame", "pyglet"):
            at_the_desk(kind, asked.clicks)
            continue
        with tempfile.TemporaryDirectory() as name:
            in_the_page(Path(name), kind, asked.clicks)


if __name__ == "__main__":
    main()
