"""Onsets of sounds as another program records them, beside the log: a window under Xvfb, Chromium and Firefox.

    apt-get install pulseaudio pulseaudio-utils libportaudio2 libasound2-plugins xvfb chromium firefox-esr
    pip install -e ".[sound,web,test]"
    python -m benchmarks.sound_onsets --trials 100

Clicks are played into a null sink of PulseAudio, whose monitor is recorded: there is no sound device, and no cable.
What it says is how much onsets vary, and whether the log knows it; not how late they reach an ear.
"""

import argparse
import os
import tempfile
from pathlib import Path

from tests.null_sink import recorded_sink
from tests.sound_loopback import Comparison, compare, play_at_desk, play_in_chromium, play_in_firefox, write_study
from tests.xserver import xvfb

BROWSERS = {"Chromium": play_in_chromium, "Firefox": play_in_firefox}
ONSETS_MS = (0, 300)  # after a trial's first picture: with it, and counted from its flip


def measure(folder: Path, *, where: str, trials: int, onset_ms: int) -> Comparison:
    """Play a session in a window or in a browser, and compare its log with the recording."""
    folder.mkdir()
    ready = "first" if where in BROWSERS else "none"
    protocol = write_study(folder, trials=trials, onset_ms=onset_ms, ready=ready)
    with recorded_sink(folder / "sink") as sink:
        if where in BROWSERS:
            return compare(BROWSERS[where](protocol, folder / "data", sink), sink)
        with xvfb() as display:
            log = play_at_desk(protocol, folder / "data", sink, display)
        return compare(log, sink)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=100)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        for where in ("a pygame window", *BROWSERS):
            for onset_ms in ONSETS_MS:
                place = Path(folder) / f"{where.split()[-1]}-{onset_ms}"
                comparison = measure(place, where=where, trials=asked.trials, onset_ms=onset_ms)
                load = os.getloadavg()[0]
                print(f"{where}, {onset_ms} ms after the picture, load {load:.1f}: {comparison.describe()}", flush=True)


if __name__ == "__main__":
    main()
