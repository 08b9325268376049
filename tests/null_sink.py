"""A sound server of a test's own without a sound device: what is played into it is recorded by its clock.

PulseAudio's null sink takes samples at its rate and hands them on through its monitor.
"""

import os
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.counts import PATIENCE_S
from tests.programs import running, stop

RATE_HZ = 48_000
_SINK = "loop"
_SILENCE_S = 0.1  # before each sound
_LOUD = 2_000  # of 32,767


class NullSink:
    """A sound server whose sink is recorded.

    Args:
        folder: a folder of its own.
        environment: further environment variables of whatever plays and records.
    """

    def __init__(self, folder: Path, **environment: str) -> None:
        self.environment = {
            **os.environ,
            **environment,
            "XDG_RUNTIME_DIR": str(folder),
            "PULSE_RUNTIME_PATH": str(folder),
            "PULSE_SERVER": f"unix:{folder}/native",
            "HOME": str(folder),
        }
        self.recording = folder / "recording.raw"

    def read_onsets_ms(self) -> NDArray[np.float64]:
        """Return when sounds began in the recording, in ms of its clock."""
        samples = np.abs(np.fromfile(self.recording, "<i2").astype(np.int32))
        loud = np.flatnonzero(samples > _LOUD)
        begins = np.diff(loud, prepend=-RATE_HZ) > _SILENCE_S * RATE_HZ
        return loud[begins] * 1000 / RATE_HZ


@contextmanager
def recorded_sink(folder: Path, **environment: str) -> Iterator[NullSink]:
    """Run a sound server with a null sink and record the sink for as long as a block lasts."""
    folder.mkdir(mode=0o700)
    sink = NullSink(folder, **environment)
    server = ["pulseaudio", "-n", "--daemonize=no", "--exit-idle-time=-1", "--use-pid-file=no", "--disable-shm=yes"]
    modules = [f"module-null-sink sink_name={_SINK} rate={RATE_HZ}", "module-native-protocol-unix auth-anonymous=1"]
    loads = [word for module in modules for word in ("-L", module)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": sink.environment}
    with running([*server, *loads], **quiet) as program:
        _await_socket(folder / "native")
        with sink.recording.open("wb") as file:
            record = ["parec", "-d", f"{_SINK}.monitor", "--format=s16le", f"--rate={RATE_HZ}", "--channels=1", "--raw"]
            with running(record, stdout=file, stderr=subprocess.DEVNULL, env=sink.environment) as recorder:
                yield sink
                recorder.send_signal(signal.SIGTERM)
        stop(program)


def _await_socket(path: Path) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert time.monotonic() < until_s, "the sound server did not start"
        time.sleep(0.02)
