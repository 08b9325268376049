"""How long the frame loop is held up by recording, on this disk and on one whose fsync takes 200 ms.

Plays a session of 600 steps at 60 frames a second through the recorder and prints the distribution of what a frame
pays for ``write``, of the frame's own period, and of this disk's fsync.

    python benchmarks/log_write.py [FOLDER]
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from minihuman.experiment.machine.events import Event, Stepped
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.log.samples import session_events, session_plan

FRAME_S = 1 / 60
STEPS = 300


def play(folder: Path, sync: Callable[[int], None]) -> tuple[list[float], list[float]]:
    """Write an episode's events in groups of a step, one group a frame: ms spent in ``write``, ms between frames."""
    plan = session_plan(episodes=2)
    groups = _by_step(session_events(plan, steps=STEPS))
    recorder = McapRecorder(folder, plan, started_ns=time.time_ns(), settings=RecorderSettings(sync=sync))
    write_ms, frame_ms = [], []
    before = next_frame = time.perf_counter()
    for group in groups:
        next_frame += FRAME_S
        time.sleep(max(0.0, next_frame - time.perf_counter()))
        start = time.perf_counter()
        recorder.write(group)
        write_ms.append(1e3 * (time.perf_counter() - start))
        frame_ms.append(1e3 * (start - before))
        before = start
    recorder.close()
    return write_ms, frame_ms[1:]


def _by_step(events: list[Event]) -> list[list[Event]]:
    groups: list[list[Event]] = [[]]
    for event in events:
        groups[-1].append(event)
        if isinstance(event, Stepped):
            groups.append([])
    return groups


def main() -> None:
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else None
    fsync_ms: list[float] = []

    def timed(fd: int) -> None:
        start = time.perf_counter()
        os.fsync(fd)
        fsync_ms.append(1e3 * (time.perf_counter() - start))

    print(f"{'':36} {'median':>8} {'95 %':>8} {'99 %':>8} {'worst':>8}  ms")
    for name, sync in (("this disk", timed), ("fsync takes 200 ms", lambda _fd: time.sleep(0.2))):
        with tempfile.TemporaryDirectory(dir=root) as folder:
            write_ms, frame_ms = play(Path(folder), sync)
        _line(f"{name}: write()", write_ms)
        _line(f"{name}: frame to frame", frame_ms)
    _line("this disk: fsync", fsync_ms)


def _line(name: str, values: list[float]) -> None:
    cells = " ".join(f"{value:8.3f}" for value in (*np.percentile(values, [50, 95, 99]), max(values)))
    print(f"{name:36} {cells}")


if __name__ == "__main__":
    main()
