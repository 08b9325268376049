"""A stand-in for a photodiode at a sound input: looks at a window's middle all the time, and plays what it sees.

    python -m tests.photodiode :12

The samples go to the default sound server's sink through `pacat`; they follow the brightness as behind an AC-coupled
input, where a steady level fades away. A long buffer delays them by at least LEAST_DELAY_S, so that a busy machine does
not interrupt them.
"""

import subprocess
import sys
import time

import numpy as np
from numpy.typing import NDArray
from Xlib.error import BadDrawable, BadMatch, BadWindow

from minihuman.display.windows.blocking_window import TITLE
from tests.programs import running, stop
from tests.xserver import Typist

RATE_HZ = 48_000
LEAST_DELAY_S = 0.05
_LATENCY_S = 0.25  # asked of the sound server, which divides it among its buffers
_FADE_S = 0.02  # the time constant of the coupling
_LOUDEST = 12_000  # of 32,767
_PAUSE_S = 0.001  # between looks


class Diode:
    """An AC-coupled photodiode, whose level follows a step of the brightness and then fades."""

    def __init__(self) -> None:
        self._brightness = 0.0
        self._level = 0.0

    def sample(self, brightness: float, count: int) -> NDArray[np.float64]:
        """Return the next samples, float64[count], -1 to 1, at a brightness of 0 to 1."""
        self._level += brightness - self._brightness
        self._brightness = brightness
        fading = np.exp(-np.arange(count + 1) / (_FADE_S * RATE_HZ))
        samples = self._level * fading[:-1]
        self._level *= float(fading[-1])
        return samples


def watch(display: str) -> None:
    """Play what a diode in the middle of the window sees, until the window goes."""
    player = ["pacat", "--raw", "--format=s16le", f"--rate={RATE_HZ}", "--channels=1"]
    look = Typist(display).watch(TITLE, (0.5,))
    diode = Diode()
    written = 0
    begun_s = time.monotonic()
    with running([*player, f"--latency-msec={1000 * _LATENCY_S:.0f}"], stdin=subprocess.PIPE) as program:
        assert program.stdin is not None
        try:
            while True:
                rows = np.frombuffer(look(), np.uint8).reshape(2, -1, 4)
                due = round((time.monotonic() - begun_s) * RATE_HZ)
                samples = diode.sample(float(rows[0, rows.shape[1] // 2, 0]) / 255, due - written)
                program.stdin.write(np.round(_LOUDEST * samples).astype("<i2").tobytes())
                program.stdin.flush()
                written = due
                time.sleep(_PAUSE_S)
        except (BadDrawable, BadMatch, BadWindow):  # BadMatch: it is hidden, as it is about to go
            stop(program)


if __name__ == "__main__":
    watch(sys.argv[1])
