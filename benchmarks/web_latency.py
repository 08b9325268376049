"""From a key to changed pixels, and how late keys are stamped, in a real browser; beside it pygame's window.

    python -m benchmarks.web_latency [--keys 60] [--rtt 0 300] [--world minihuman/MiniGrid-FourRooms-v0]

Starts an X server of its own (Xvfb) and Chromium in it with a head, sends key events that the server itself makes
(XTEST) over a TCP proxy that makes the line as long as asked, and reads the screen's pixels back until they change. A
stamp's error is the key's time in the log minus the moment it was sent; the log's clock is the browser's, brought onto
this machine's by the log's own links (`/link`), which are right to half the quickest way there and back.
"""

import argparse
import os
import random
import tempfile
import time
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from Xlib import X
from Xlib.display import Display

import minihuman
from benchmarks.latency import ROWS, UNSEEN_S, measure
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import FrameShown, KeyPressed, Linked, Stepped
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.web.browser import browsing
from tests.web.protocols import study
from tests.web.serving import line, serving
from tests.xserver import Typist, xvfb

SCREEN_PX = (1280, 720)


@dataclass(frozen=True, slots=True)
class Measured:
    """One session's keys, in ms."""

    stamps: np.ndarray  # how much later than it was sent a key is stamped
    pixels: np.ndarray  # from the key to changed pixels
    flips: np.ndarray  # from the key to the flip, as the log has it
    error: float  # of the clocks' offset
    complaints: list[str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=60)
    parser.add_argument("--rtt", type=float, nargs="+", default=[0.0, 300.0])
    parser.add_argument("--world", default="minihuman/MiniGrid-FourRooms-v0")
    parser.add_argument("--computed", nargs="+", default=["page", "server"], help="by the page, by the server, or both")
    parser.add_argument("--without-pygame", action="store_true")
    asked = parser.parse_args()
    print(f"minihuman {minihuman.__version__}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; ms")
    print(" " * 22, "stamp error: median    95 %     SD    key to pixels: median    95 %   to flip")
    for rtt_ms, computed in product(asked.rtt, asked.computed):
        found = in_browser(asked.world, asked.keys, rtt_ms, computed)
        said(f"by the {computed}, {rtt_ms:.0f} ms", found.stamps, found.pixels, np.median(found.flips))
        print(f"{'':22} clocks right to {found.error:.2f}; {found.complaints or 'proven'}", flush=True)
    if not asked.without_pygame:
        window = measure("pygame", asked.world, asked.keys, SCREEN_PX, Path.cwd(), watched=False, fsync_s=0.0)
        said("pygame", np.array(window.waiting), np.array(window.key_to_pixels), float(np.median(window.key_to_flip)))


def said(name: str, stamps: Any, pixels: Any, flip: float) -> None:
    median, late = np.percentile(stamps, (50, 95))
    seen, seen_late = np.percentile(pixels, (50, 95))
    print(f"{name:22} {median:20.2f} {late:7.2f} {np.std(stamps):6.2f}   {seen:22.1f} {seen_late:7.1f}   {flip:7.1f}")


def in_browser(world: str, keys: int, rtt_ms: float, computed: str) -> Measured:
    """Turn left and right as often, each key when the picture of the one before is there."""
    names = [name for name in World(world).action_names if name.endswith(("left", "right"))][:2]
    with tempfile.TemporaryDirectory() as name, xvfb(SCREEN_PX) as display:
        folder = Path(name)
        block = f'key_map = "shown"\ncomputed = "{computed}"'
        protocol = study(folder, (world, tuple(names)), episodes=1, max_steps=keys, block=block)
        options = {
            "headless": False,
            "env": {"DISPLAY": display},
            "size": None,
            "more": ("--kiosk", "--start-fullscreen"),
        }
        with serving(protocol, folder) as served, line(served.port, rtt_ms=rtt_ms) as wire, browsing(**options) as sit:
            somebody = sit(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
            typist, looking = Typist(display), Display(display)
            focus(looking)
            somebody.until("s.welcomed && s.kind !== ''")
            for _ in range(200):
                if somebody.state["playing"]:
                    break
                typist.tap("enter")
                somebody.page.wait_for_timeout(300 + 2 * rtt_ms)
            somebody.until("s.known")
            somebody.page.wait_for_timeout(12_000 + 4 * rtt_ms)  # links, and the first scenes
            mapped = pressed_keys(somebody)
            look, seen_ms, sent = watch(looking), [], []
            for number in range(keys - 1):
                before = look()
                time.sleep(random.uniform(0.08, 0.2))
                began_s = time.monotonic()
                sent.append(time.time_ns())
                typist.press(mapped[number % len(mapped)])
                while look() == before and time.monotonic() - began_s < UNSEEN_S:
                    time.sleep(0.0003)
                seen_ms.append((time.monotonic() - began_s) * 1000)
                typist.release(mapped[number % len(mapped)])
            somebody.until("s.unsafe === 0")
            served.stop()
        [log] = folder.rglob("*.mcap*")
        events = list(read_events(log))
        linked = [event for event in events if isinstance(event, Linked)]
        best = min(linked, key=lambda event: event.least_rtt_ns)
        zero_ns = int(read_segment_starts(log)[1]) + best.offset_ns
        presses = [
            zero_ns + event.t_ns - event.waited_ns
            for event in events
            if isinstance(event, KeyPressed) and event.down and event.key in "123" and event.verdict != "repeat"
        ]
        assert len(presses) == len(sent), f"{len(sent)} keys were sent, {len(presses)} are in the log"
        flips = {(e.episode, e.step): e.flip_ns for e in reversed(events) if isinstance(e, FrameShown)}
        steps = [e for e in events if isinstance(e, Stepped) and (e.episode, e.step) in flips]
        return Measured(
            stamps=(np.array(presses) - np.array(sent)) / 1e6,
            pixels=np.array(seen_ms),
            flips=np.array([(flips[e.episode, e.step] - e.key_t_ns) / 1e6 for e in steps]),
            error=best.error_ns / 1e6,
            complaints=list(find_log_differences(log, World)),
        )


def pressed_keys(somebody: Any) -> list[str]:
    """The keys that do something, by the legend on the page."""
    return somebody.page.locator(".legend .cap span").all_inner_texts()


def focus(display: Any) -> None:
    """Give the keyboard to the largest window: there is no window manager that would."""
    root = display.screen().root
    for _ in range(200):
        shown = [w for w in root.query_tree().children if w.get_attributes().map_state == X.IsViewable]
        if shown:
            largest = max(shown, key=lambda window: window.get_geometry().width * window.get_geometry().height)
            display.set_input_focus(largest, X.RevertToParent, X.CurrentTime)
            display.sync()
            return
        time.sleep(0.05)
    raise AssertionError("the browser has no window")


def watch(display: Any) -> Any:
    """Rows of the screen's pixels: enough to see that a picture changed, soon."""
    root = display.screen().root
    rows = [round(height * SCREEN_PX[1]) for height in ROWS]
    return lambda: b"".join(root.get_image(0, row, SCREEN_PX[0], 2, X.ZPixmap, 0xFFFFFFFF).data for row in rows)


if __name__ == "__main__":
    main()
