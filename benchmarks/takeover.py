"""From a key that takes over to changed pixels, beside a key of plain play; and how late takeovers are stamped.

    python -m benchmarks.takeover [--keys 50] [--window pygame] [--world minihuman/MiniGrid-FourRooms-v0]

Starts an X server of its own (Xvfb) and runs `minihuman run` in it, full screen, with the log on disk: a block of plain
play, then one in which an agent plays and every second key takes over from it, the other hands back. Keys are events
that the server itself makes (XTEST); the window's pixels are read back until they change. Every takeover has to be in
the log. Prints distributions; judges nothing.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.latency import ROWS, UNSEEN_S, difference, distribution, send, turns
from minihuman.admin.protocol_file import read_protocol
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.model.teaching_events import TeachingRecord
from minihuman.log.read.session_reader import read_log
from tests.seats.session_typist import enter_at, until
from tests.xserver import Typist, xvfb

PROTOCOL = """
[study]
name = "takeover"
version = "1.0"
seed = 1
participants = 1

[keys]
pool = ["1", "2"]
keyboard_check = false

[[groups]]
name = "everyone"
blocks = ["plain", "beside"]

[[blocks]]
name = "plain"
world = "{world}"
episodes = 1
actions = {actions}
max_steps = {keys}
key_map = "shown"

[[blocks]]
name = "beside"
kind = "takeover"
world = "{world}"
episodes = 1
actions = {actions}
max_steps = {keys}
key_map = "shown"
agent = {{ policy = "random", step_ms = 60000 }}
"""


def press_and_see(typist: Typist, key: str) -> tuple[float, int, int]:
    """How long it took until the picture was another, ms, and when the key was sent and taken, ns since 1970."""
    look = typist.watch(TITLE, ROWS)
    before = look()
    time.sleep(random.uniform(0.05, 0.12))
    started_s = time.monotonic()
    sent = send(typist, key, True)
    while look() == before and time.monotonic() - started_s < UNSEEN_S:
        time.sleep(0.0003)
    seen_ms = (time.monotonic() - started_s) * 1000
    send(typist, key, False)
    return seen_ms, sent[2], sent[3]


def measure(window: str, world: str, keys: int) -> None:
    with xvfb((1280, 720)) as display, tempfile.TemporaryDirectory() as folder:
        protocol = Path(folder) / "takeover.toml"
        protocol.write_text(PROTOCOL.format(world=world, actions=turns(world), keys=keys))
        command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", folder, "--window", window]
        station = subprocess.Popen(command, env={**os.environ, "DISPLAY": display}, stdout=subprocess.PIPE)
        typist = Typist(display)
        typist.focus(TITLE)
        study = read_protocol(protocol)
        episodes = expand_protocol(study, enrol_participant(study, 0)).episodes
        plain, beside = (list(episode.key_map.keys) for episode in episodes)
        enter_at(typist, Path(folder), "ready")
        until(folder := Path(folder), "playing")
        time.sleep(2)  # the log is written before the picture is shown
        of_play = [press_and_see(typist, plain[number % 2]) for number in range(keys)]
        enter_at(typist, folder, "ready")
        until(folder, "playing")
        time.sleep(2)
        of_takeover = []
        for number in range(keys):
            of_takeover.append(press_and_see(typist, beside[number % 2]))
            if number + 1 < keys:
                press_and_see(typist, "space")
        enter_at(typist, folder, "closing", "page")
        station.communicate(timeout=120)
        log = read_log(next(folder.rglob("*.mcap")))
    taught = log.episodes[1].taught
    assert isinstance(taught, TeachingRecord)
    assert taught.interventions == keys, f"{taught.interventions} of {keys} takeovers are in the log"
    began_ns = log.segments[0].started_unix_ns
    taken = [change.pressed_ns + began_ns for change in taught.controls if change.reason == "key"]
    stamped = [(at_ns - sent_ns) / 1e6 for at_ns, (_, sent_ns, _) in zip(taken, of_takeover, strict=True)]
    beyond = [max(0.0, (at_ns - took_ns) / 1e6) for at_ns, (*_, took_ns) in zip(taken, of_takeover, strict=True)]
    print(f"{log.facts['window_version']}, {log.facts['window_size_px']}, {world}")
    print(f"  load average           {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"  play: key to pixels    {distribution([ms for ms, *_ in of_play])}")
    print(f"  takeover to pixels     {distribution([ms for ms, *_ in of_takeover])}")
    print(f"  takeover minus play    {difference([ms for ms, *_ in of_takeover], [ms for ms, *_ in of_play])}")
    print(f"  takeovers in the log   {len(taken)} of {keys}")
    print(f"  stamp after it was sent {distribution(stamped)}")
    print(f"  after the server took it {distribution(beyond)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=50)
    parser.add_argument("--window", default="pygame")
    parser.add_argument("--world", default="minihuman/MiniGrid-FourRooms-v0")
    settings = parser.parse_args()
    measure(settings.window, settings.world, settings.keys)


if __name__ == "__main__":
    main()
