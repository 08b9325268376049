"""Trials whose pictures are read from the display by another program, and compared with what the log says of them.

A thread of this process looks at one pixel, in the square that a timeline has for a photodiode.
"""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from Xlib import X
from Xlib.display import Display

from minihuman.activities.trials.events import StimuliShown
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S
from tests.programs import running
from tests.web.browser import launch_on_display
from tests.web.serving import serving

FRAME_MS = 1000 / 60
TARGET_MS = 100
_LOOK_S = 0.0003  # between two looks; each takes a round trip besides
_MARGIN_PX = 12  # from the display's corner to the pixel, within a square of at least 40
_WHITE, _BLACK = 245, 10  # of 255; the background is between them
_TOML = """
study = {{ name = "pictures", version = "1.0", seed = 1, closing = "" }}
keys = {{ pool = ["space"], keyboard_check = false }}
groups = [{{ name = "everyone", blocks = ["discs"] }}]
[[blocks]]
name = "discs"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = {{ responses = ["press"] }}
episodes = {trials}
actions = ["press"]
noop_action = "none"
response_deadline_ms = 250
max_steps = 1
ready = "{ready}"
final_frame_ms = 0
inter_trial_interval_ms = [100, 150]
[blocks.timeline]
ends = "time"
photodiode = "bottom left"
target = "disc"
stimuli = [
  {{ name = "fixation", text = "+", duration_ms = [150, 250] }},
  {{ name = "disc", shape = "circle", duration_ms = {target_ms} }},
]
"""
PICTURES = 3  # of a trial: white with the fixation, black with the disc, white after it


def write_study(folder: Path, *, trials: int, ready: str = "none") -> Path:
    """Write a study whose trials show a fixation and a disc, with a square for a photodiode; return its protocol."""
    path = folder / "pictures.toml"
    path.write_text(_TOML.format(trials=trials, ready=ready, target_ms=TARGET_MS))
    return path


class PixelWatcher:
    """Looks at a pixel of a display and notes when it turns white or black.

    Args:
        display: the X display.
        place_px: the pixel, from the left and from the top.
    """

    def __init__(self, display: str, place_px: tuple[int, int]) -> None:
        self.turns: list[tuple[bool, int]] = []  # whether it is white, and the wall clock's ns
        self._display = Display(display)
        self._root = self._display.screen().root
        self._place_px = place_px
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)

    def __enter__(self) -> "PixelWatcher":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join()
        self._display.close()

    def _look(self) -> None:
        previous = ""
        while not self._is_over.is_set():
            level = max(self._root.get_image(*self._place_px, 1, 1, X.ZPixmap, 0xFFFFFFFF).data[:3])
            state = _name_state(level)
            if state != previous and state:
                self.turns.append((state == "white", time.time_ns()))
            previous = state
            time.sleep(_LOOK_S)


def _name_state(level: int) -> str:
    """Return what a pixel shows of the square, by its brightest channel: "white", "black", or "" for the background."""
    if level >= _WHITE:
        return "white"
    if level <= _BLACK:
        return "black"
    return ""


@dataclass(frozen=True)
class PictureTimes:
    """When pictures were seen, beside the log; a row for each trial, a column for each picture; times are ms."""

    seen: NDArray[np.float64]
    flips: NDArray[np.float64]
    dues: NDArray[np.float64]  # since the flip of the trial's first picture

    @property
    def claim_errors(self) -> NDArray[np.float64]:
        """What is left of the times seen when the log's are known; the clocks may drift apart evenly."""
        flips, seen = self.flips.ravel(), self.seen.ravel()
        line = np.polynomial.Polynomial.fit(flips, seen, 1)
        return seen - line(flips)

    @property
    def lateness(self) -> NDArray[np.float64]:
        """By how much later than intended pictures were seen, all but the first of each trial, which sets the time."""
        return (self.seen - self.seen[:, :1] - self.dues)[:, 1:]

    @property
    def durations(self) -> NDArray[np.float64]:
        """How long each trial's disc was seen."""
        return self.seen[:, 2] - self.seen[:, 1]

    def describe(self) -> str:
        """Return the figures in a line."""
        errors, lateness = self.claim_errors, self.lateness
        in_frame = np.abs(lateness) <= FRAME_MS / 2
        claimed = np.abs((self.flips - self.flips[:, :1] - self.dues)[:, 1:]) <= FRAME_MS / 2
        lasted = np.abs(self.durations - TARGET_MS) <= FRAME_MS
        return (
            f"{len(self.seen)} trials; seen minus logged: SD {errors.std():.3f} ms, at most "
            f"{np.abs(errors).max():.2f}; seen minus intended: median {np.median(lateness):.2f} ms, "
            f"SD {lateness.std():.2f}, "
            f"{100 * in_frame.mean():.2f} % in the intended frame of 60 Hz, {int((~in_frame & claimed).sum())} misses "
            f"that the log does not have; {TARGET_MS} ms lasted {np.median(self.durations):.2f} ms (median), "
            f"{100 * lasted.mean():.2f} % within a frame"
        )


def compare_pictures(log: Path, turns: Sequence[tuple[bool, int]]) -> PictureTimes:
    """Compare the pictures of a session's log with those that were seen; both have to be complete."""
    session = read_log(log)
    began_ns = session.segments[0].started_unix_ns
    events = [event for segment in session.segments for event in segment.part_events]
    shown = [event for event in events if isinstance(event, StimuliShown) and event.frame >= 0]
    assert [event.frame for event in shown] == list(range(PICTURES)) * (len(shown) // PICTURES)
    flips_ns = np.array([event.flip_ns for event in shown]).reshape(-1, PICTURES)
    dues_ns = np.array([event.due_ns for event in shown]).reshape(-1, PICTURES)
    dues_ns[:, 0] = flips_ns[:, 0]
    seen_ns = np.array([at_ns for _, at_ns in _drop_others(turns, began_ns + int(flips_ns[0, 0]), flips_ns.size)])
    return PictureTimes(
        (seen_ns.reshape(-1, PICTURES) - began_ns) / 1e6, flips_ns / 1e6, (dues_ns - flips_ns[:, :1]) / 1e6
    )


def _drop_others(turns: Sequence[tuple[bool, int]], first_ns: int, count: int) -> list[tuple[bool, int]]:
    """Return the turns from the first trial on, which have to be white, black and white in each."""
    begin = min(range(len(turns)), key=lambda place: abs(turns[place][1] - first_ns))
    of_trials = [*turns[begin : begin + count]]
    expected = [frame % 2 == 0 for frame in range(PICTURES)] * (count // PICTURES)
    states = [is_white for is_white, _ in of_trials]
    assert states == expected, f"{len(turns)} turns were seen; {count} pictures are in the log"
    return of_trials


@contextmanager
def look_at_corner(display: str) -> Iterator[PixelWatcher]:
    """Look at the bottom left corner of a display for as long as a block lasts."""
    screen = Display(display)
    height = screen.screen().height_in_pixels
    screen.close()
    with PixelWatcher(display, (_MARGIN_PX, height - _MARGIN_PX)) as watcher:
        yield watcher


def show_at_desk(protocol: Path, data: Path, display: str, window: str) -> PictureTimes:
    """Play a study that asks for nothing in a full-screen window, and look at it."""
    command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", str(data), "--window", window]
    with look_at_corner(display) as watcher:
        environment = {**os.environ, "DISPLAY": display}
        with running(command, env=environment, stdout=subprocess.PIPE, text=True) as program:
            program.communicate(timeout=100 * PATIENCE_S)
    [log] = data.rglob("*.mcap")
    return compare_pictures(log, watcher.turns)


_FIND_CORNER = """() => {
  const box = document.querySelector("canvas").getBoundingClientRect();
  const top = outerHeight - innerHeight;
  return [screenX + box.left, screenY + top + box.bottom];
}"""


def show_in_chromium(protocol: Path, data: Path, display: str) -> PictureTimes:
    """Play a study that asks for Enter alone in a window of Chromium, and look at it."""
    with serving(protocol, data) as served, launch_on_display(display) as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.welcomed && s.kind !== ''")
        while somebody.state["kind"] not in ("trial", "blank", "play"):
            somebody.press("enter")
            somebody.page.wait_for_timeout(50)
        somebody.until("document.querySelector('canvas')")
        left, bottom = somebody.page.evaluate(_FIND_CORNER)
        with PixelWatcher(display, (round(left) + _MARGIN_PX, round(bottom) - _MARGIN_PX)) as watcher:
            somebody.sit_through()
        assert somebody.errors == []
    [log] = data.rglob("*.mcap")
    return compare_pictures(log, watcher.turns)
