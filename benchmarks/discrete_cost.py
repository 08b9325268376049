"""What a session in a classic grid costs, beside an earlier commit: the same messages, and the ratio of CPU-seconds.

    python -m benchmarks.discrete_cost CHECKOUT [--pairs 30] [--steps 600]

CHECKOUT is a folder with the earlier commit (`git worktree add CHECKOUT b689fe6`). Each run is a process of its own
that plays a scripted session of FourRooms, a key every 100 ms of a virtual clock, with pictures composed, through
machine, window, log and file; the CPU-seconds are those of its threads from the first input to the finished log. The
two take turns, which goes first by turns, too. Prints the ratio of each pair's CPU-seconds: the geometric mean and its
upper 95 % limit (Student's t of the logarithms). The messages of both logs' records are decoded and compared but for
the plan, which says what was run; a difference is an error.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

HERE = Path(__file__).parents[1]
_TOML = """
[study]
name = "cost"
version = "1"
seed = 7
closing = ""
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
options = {{ max_steps = {steps} }}
episodes = 1
actions = ["left", "right", "forward"]
key_map = "fixed"
fixed_keys = {{ 1 = "left", 2 = "right", 3 = "forward" }}
max_steps = {steps}
final_frame_ms = 0
"""
_EXCLUDED = ("/session/plan",)  # versions and facts of the machine


def play(folder: Path, steps: int) -> None:
    """Play a session in this process; print its CPU-seconds and a digest of each topic's messages."""
    import hashlib

    from google.protobuf.json_format import MessageToDict
    from mcap.reader import make_reader

    from minihuman.display.drawing.screen import compose_screen
    from minihuman.display.windows.window import ScriptedWindow, VirtualClock
    from minihuman.experiment.machine.inputs import KeyDown, KeyUp, ScreenShown
    from minihuman.experiment.machine.session import SessionMachine
    from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
    from minihuman.experiment.protocol.protocol import decode_protocol
    from minihuman.log import topics
    from minihuman.log.record.mcap_recorder import McapRecorder
    from minihuman.runtime.session_loop import run_session
    from minihuman.worlds.adapters.world import World

    class DrawingWindow(ScriptedWindow):
        """Composes each screen, as a window does."""

        @property
        def picture_px(self) -> tuple[int, int]:
            return (640, 480)

        def show(self, screen: Any) -> ScreenShown:
            compose_screen(screen, (1280, 720))
            self.screens.clear()
            return super().show(screen)

    def run(steps: int, data: Path) -> tuple[float, Path]:
        ms, draw = 1_000_000, np.random.default_rng(1)
        inputs: list[Any] = [KeyDown(60 * ms, "enter"), KeyUp(70 * ms, "enter")]
        for number in range(steps):
            at_ns, key = (200 + 100 * number) * ms, str(draw.integers(1, 4))
            inputs += [KeyDown(at_ns, key, key), KeyUp(at_ns + 40 * ms, key, key)]
        inputs.append(KeyUp((2_000 + 100 * steps) * ms, "f7"))
        protocol = decode_protocol(_TOML.format(steps=steps).encode())
        plan, clock = expand_protocol(protocol, enrol_participant(protocol, 0)), VirtualClock()
        session = SessionMachine(plan, World, {"machine": "script"})
        recorder = McapRecorder(data, plan, started_ns=0)
        began_s = time.process_time()
        path = run_session(session, DrawingWindow(inputs, clock, frame_ns=2 * ms), recorder, clock)
        assert session.failure is None
        assert path is not None
        return time.process_time() - began_s, path

    run(10, folder / "first")  # what is loaded and compiled once
    cpu_s, path = run(steps, folder / "measured")
    found: dict[str, Any] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            row = topics.BY_NAME.get(channel.topic)
            if channel.topic in _EXCLUDED or row is None or row.is_preview:
                continue
            text = json.dumps(MessageToDict(row.message.FromString(message.data)), sort_keys=True)
            digest = found.setdefault(channel.topic, hashlib.sha256())
            digest.update(f"{message.log_time} {text}\n".encode())
    print(json.dumps({"cpu_s": cpu_s, "topics": {name: digest.hexdigest() for name, digest in found.items()}}))


def run(checkout: Path, steps: int) -> dict[str, Any]:
    """One run of a checkout's package by this script."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, str(Path(__file__).resolve()), "--play", folder, "--steps", str(steps)]
        env = {**os.environ, "PYTHONPATH": str(checkout)}
        done = subprocess.run(command, capture_output=True, text=True, env=env, check=False)
        if done.returncode:
            raise SystemExit(done.stderr)
        found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
        return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", nargs="?", type=Path, default=HERE, help="the earlier commit; this one by default")
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--steps", type=int, default=600)
    parser.add_argument("--play", type=Path, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.play is not None:
        play(asked.play, asked.steps)
        return
    logs: list[float] = []
    for each in (asked.checkout, HERE):
        run(each, asked.steps)  # compiles what is not
    for number in range(asked.pairs):
        order = (asked.checkout, HERE) if number % 2 else (HERE, asked.checkout)
        found = {folder: run(folder, asked.steps) for folder in order}
        before, now = found[asked.checkout], found[HERE]
        if before["topics"] != now["topics"]:
            wrong = [name for name, digest in now["topics"].items() if before["topics"].get(name) != digest]
            raise SystemExit(f"the messages differ on {', '.join(wrong)}")
        logs.append(math.log(now["cpu_s"] / before["cpu_s"]))
        print(f"pair {number + 1}: {before['cpu_s']:.3f} s before, {now['cpu_s']:.3f} s now", flush=True)
    mean, error = statistics.fmean(logs), statistics.stdev(logs) / math.sqrt(len(logs)) if len(logs) > 1 else 0.0
    limit = mean + float(stats.t.ppf(0.95, max(1, len(logs) - 1))) * error
    messages = f"the same messages on {len(now['topics'])} topics"
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores; {asked.pairs} pairs, {asked.steps} steps")
    print(messages)
    print(f"CPU-seconds now over before: {math.exp(mean):.4f}, upper 95 % limit {math.exp(limit):.4f}")


if __name__ == "__main__":
    main()
