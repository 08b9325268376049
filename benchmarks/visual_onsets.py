"""Onsets and durations of pictures as another program sees them, beside the log: both windows, and Chromium.

    apt-get install xvfb chromium
    pip install -e ".[web,test]"
    python -m benchmarks.visual_onsets --trials 1000

Each runs full screen, or in a window of the browser, on an X server without a display (Xvfb), which waits for no
refresh: a picture's intended frame of 60 Hz is the half frame before and after the time at which it is due. A program
reads one pixel of the square that `photodiode` draws, some 1,500 times a second. What a monitor adds was not measured.
"""

import argparse
import os
import tempfile
from pathlib import Path

from tests.picture_times import PictureTimes, show_at_desk, show_in_chromium, write_study
from tests.xserver import xvfb

WHERE = ("pygame", "pyglet", "Chromium")


def measure(folder: Path, *, where: str, trials: int) -> PictureTimes:
    """Show so many trials in a window or in the browser, and compare the log with what was seen."""
    folder.mkdir()
    with xvfb() as display:
        if where == "Chromium":
            return show_in_chromium(write_study(folder, trials=trials, ready="first"), folder / "data", display)
        return show_at_desk(write_study(folder, trials=trials), folder / "data", display, where)


def main() -> None:
    """Print a line for each window, and one for the browser."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--where", choices=WHERE, action="append", help="all of them if absent")
    settings = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for where in settings.where or WHERE:
            times = measure(Path(folder) / where, where=where, trials=settings.trials)
            print(f"{where}, load {os.getloadavg()[0]:.1f}: {times.describe()}", flush=True)


if __name__ == "__main__":
    main()
