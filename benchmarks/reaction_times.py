"""Response times of a go/no-go task compared with when keys were sent: what a log's reaction times are worth.

    python -m benchmarks.reaction_times [--trials 200] [--window pygame]

Runs `protocols/trials/go-no-go.toml`, with short intervals, in a window of an X server of its own (Xvfb), and sends
the space bar by XTEST every 250 to 450 ms, whatever is shown. Of each trial with a press: its `response_ms` in the log,
and the time from the stimulus's flip to when the key was sent. Prints their differences; judges nothing.

A keyboard interrupts whatever runs; a key that a program sends waits for two processes to be scheduled, the sender and
the X server, which takes longer on a busy machine than the bound that is looked for. Where the system permits it, both
run before everything else (SCHED_FIFO), and the program under test does not. `--ordinary` leaves them as they are;
`--injection` sends the keys with no program there: what the sending alone takes.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from bisect import bisect_right
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.display.windows.blocking_window import TITLE
from minihuman.log.read.session_reader import read_log
from tests.seats.session_typist import enter_at, until
from tests.xserver import Typist, xvfb

PROTOCOL = Path(__file__).parents[1] / "protocols/trials/go-no-go.toml"


def write_protocol(folder: Path, trials: int) -> Path:
    text = PROTOCOL.read_text()
    for old, new in (("episodes = 40", f"episodes = {trials}"), ("[800, 1200]", "[100, 200]")):
        assert old in text
        text = text.replace(old, new)
    path = folder / "go-no-go.toml"
    path.write_text(text)
    return path


def be_urgent(urgent: bool) -> bool:
    """Run this process, and what it starts, before all others, or as usual; whether that was permitted."""
    try:
        policy = os.SCHED_FIFO if urgent else os.SCHED_OTHER
        os.sched_setscheduler(0, policy, os.sched_param(10 if urgent else 0))
    except (AttributeError, PermissionError):
        return False
    return urgent


def describe_sending(sent_ns: list[tuple[int, int]]) -> str:
    took_ms: NDArray[np.float64] = np.diff(sent_ns, axis=1).ravel() / 1e6
    middle, most = np.quantile(took_ms, (0.5, 0.95))
    share = 100 * np.mean(took_ms > 2)
    return f"{middle:.2f} ms (median), {most:.2f} ms (95 %), {took_ms.max():.2f} ms (worst); {share:.1f} % over 2 ms"


def inject(display: str, presses: int) -> list[tuple[int, int]]:
    """Send keys to a server that shows nothing."""
    draw, sent_ns, typist = random.Random(1), [], Typist(display)
    for _ in range(presses):
        before_ns = time.perf_counter_ns()
        typist.press("space")
        sent_ns.append((before_ns, time.perf_counter_ns()))
        typist.release("space")
        time.sleep(draw.uniform(0.05, 0.15))
    return sent_ns


def play(data: Path, protocol: Path, window: str, display: str, *, urgent: bool) -> list[tuple[int, int]]:
    """Play a session; when each press was sent and the X server had taken it, ns of the machine's monotonic clock."""
    command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", str(data), "--window", window]
    draw, sent_ns = random.Random(1), []
    with subprocess.Popen([*command, "--windowed"], env={**os.environ, "DISPLAY": display}) as program:
        typist = Typist(display)
        typist.focus(TITLE)
        enter_at(typist, data, "instructions")
        enter_at(typist, data, "ready")
        until(data, "playing")
        be_urgent(urgent)
        while program.poll() is None and not any(data.rglob("*.mcap")):
            before_ns = time.perf_counter_ns()
            typist.press("space")
            sent_ns.append((before_ns, time.perf_counter_ns()))
            typist.release("space")
            time.sleep(draw.uniform(0.25, 0.45))
            if len(sent_ns) % 25 == 0:
                typist.tap("enter")  # the last words
        typist.close()
    return sent_ns


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--window", default="pygame")
    parser.add_argument("--ordinary", action="store_true")
    parser.add_argument("--injection", action="store_true")
    asked = parser.parse_args()
    urgent = not asked.ordinary and be_urgent(True)  # the X server inherits it
    with tempfile.TemporaryDirectory() as folder, xvfb() as display:
        print(f"the X server and the sender run {'before everything else' if urgent else 'as every process does'}")
        if asked.injection:
            print(f"a key sent to a server without windows: {describe_sending(inject(display, asked.trials))}")
            return
        be_urgent(False)  # what is tested runs as usual
        data = Path(folder)
        sent_ns = play(data, write_protocol(data, asked.trials), asked.window, display, urgent=urgent)
        [path] = data.rglob("*.mcap")
        log = read_log(path)
        with StudyStore(StudySessions(data / "go-no-go"), with_shortest=False) as store:
            steps = store.tables.query("select * from steps where response_ms is not null").to_pylist()
        began_ns = log.segments[0].started_monotonic_ns
        sent, taken = ([times[side] - began_ns for times in sent_ns] for side in (0, 1))
        onsets_ns = {
            one.start.plan.episode + 1: int(one.frames.column("flip_ns")[0]) for one in log.episodes if len(one.frames)
        }
        errors, beyond = [], []
        for row in steps:
            press = bisect_right(sent, row["t_ns"]) - 1  # the step is made after its key
            key_ns = onsets_ns[row["episode"]] + row["response_ms"] * 1e6
            errors.append((key_ns - sent[press]) / 1e6)
            beyond.append(max(0.0, key_ns - taken[press], sent[press] - key_ns) / 1e6)
        found = np.abs(errors)
    print(f"{len(steps)} of {asked.trials} trials with a press, window {asked.window}, load {os.getloadavg()[0]:.1f}")
    print(f"|response_ms - (sent - flip)|: median {np.median(found):.2f} ms, 95 % {np.quantile(found, 0.95):.2f} ms")
    print(f"within 2 ms: {100 * np.mean(found <= 2):.1f} %; worst {found.max():.2f} ms")
    print(f"outside of [sent, taken by the server]: median {np.median(beyond):.2f} ms, worst {max(beyond):.2f} ms")
    print(f"and within 2 ms of it: {100 * np.mean(np.array(beyond) <= 2):.1f} %")
    print(f"the server took a key in {describe_sending(sent_ns)}")


if __name__ == "__main__":
    main()
