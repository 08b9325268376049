"""From a key to changed pixels, and how late keys are stamped, in a real session in a real window.

    python -m benchmarks.latency [--keys 100] [--window pygame] [--world minihuman/MiniGrid-FourRooms-v0]

Starts an X server of its own (Xvfb), runs `minihuman run` in it with the log on disk and one press one step, sends key
events that the server itself makes (XTEST), and reads the window's pixels back until they change. Prints distributions;
judges nothing. Xvfb refreshes nothing, so the display's own period is 0: what is printed is all the software's.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np

from minihuman.errors import LogError
from minihuman.lab.protocol_file import read_protocol
from minihuman.log.read.open_log import open_log
from minihuman.study.expand import enrol, expand
from minihuman.windows.blocking import TITLE
from minihuman.worlds.adapt.world import World
from tests.xserver import Typist, xvfb

UNSEEN_S = 2.0  # a step that changed nothing in the stripes looked at
ROWS = (0.3, 0.5)  # of the window's height; each costs a round trip, and the change is seen half a look late
PROTOCOL = """
[study]
name = "latency"
version = "1.0"
seed = 1
participants = 1

[keys]
pool = ["1", "2"]
check = false

[[groups]]
name = "everyone"
blocks = ["turning"]

[[blocks]]
name = "turning"
world = "{world}"
episodes = 1
actions = {actions}
max_steps = {keys}
key_map = "shown"
"""


@dataclass(frozen=True, slots=True)
class Measured:
    """One session's keys; times in ms."""

    facts: dict[str, str]
    key_to_pixels: list[float]
    stamp_error: list[float]
    unseen: int


def measure(window: str, world: str, keys: int) -> Measured:
    with xvfb() as display, tempfile.TemporaryDirectory() as folder:
        protocol = Path(folder) / "latency.toml"
        protocol.write_text(PROTOCOL.format(world=world, actions=turns(world), keys=keys))
        command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", folder]
        station = subprocess.Popen(
            [*command, "--window", window, "--windowed"], env={**os.environ, "DISPLAY": display}, stdout=subprocess.PIPE
        )
        typist = Typist(display)
        typist.focus(TITLE)
        typist.tap("enter")
        while not begun(Path(folder)):
            time.sleep(0.1)
        time.sleep(2)  # the log is written before the picture is shown
        study = read_protocol(protocol)
        pressed = list(expand(study, enrol(study, 0)).episodes[0].key_map.keys)
        look = typist.watch(TITLE, ROWS)
        sent_ns, seen_ms = [], []
        for number in range(keys):
            before = look()
            time.sleep(random.uniform(0.05, 0.12))
            sent_ns.append(time.time_ns())
            started_s = time.monotonic()
            typist.press(pressed[number % 2])
            while look() == before and time.monotonic() - started_s < UNSEEN_S:
                time.sleep(0.0003)
            seen_ms.append((time.monotonic() - started_s) * 1000)
            typist.release(pressed[number % 2])
        typist.tap("enter")
        said, _ = station.communicate(timeout=60)
        log = open_log(Path(said.decode().splitlines()[-1]))
    began_ns = datetime.fromisoformat(log.started_at).timestamp() * 1e9
    stamped_ns = [
        began_ns + key.t_ns for key in log.keys if key.down and key.key in pressed and key.verdict == "accepted"
    ]
    errors_ms = [(stamped - sent) / 1e6 for stamped, sent in zip(stamped_ns, sent_ns, strict=True)]
    seen = [ms for ms in seen_ms if ms < UNSEEN_S * 1000]
    return Measured(dict(log.facts), seen, errors_ms, len(seen_ms) - len(seen))


def begun(folder: Path) -> bool:
    """Whether the live log holds an episode: from then on keys act."""
    try:
        return any(open_log(part).episodes for part in folder.rglob("*.part"))
    except LogError:  # nothing of the session is written yet
        return False


def turns(world: str) -> str:
    """Two actions that undo each other and change the picture, as TOML."""
    names = World(world).action_names
    return str([name for name in names if name.endswith(("left", "right"))][:2]).replace("'", '"')


def distribution(values_ms: list[float]) -> str:
    median, p95, p99 = np.percentile(values_ms, (50, 95, 99))
    return f"median {median:6.2f} ms   95 % {p95:6.2f} ms   99 % {p99:6.2f} ms   worst {max(values_ms):6.2f} ms"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=100, help="at most the steps that the world allows an episode")
    parser.add_argument("--window", action="append", help="pygame or pyglet; both if absent")
    parser.add_argument("--world", default="minihuman/MiniGrid-FourRooms-v0")
    settings = parser.parse_args()
    for window in settings.window or ("pygame", "pyglet"):
        measured = measure(window, settings.world, settings.keys)
        facts = measured.facts
        print(f"{facts['window_version']}, {facts['window_size_px']}, vsync {facts['vsync']}, {settings.world}")
        print(f"  load average     {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
        print(f"  key to pixels    {distribution(measured.key_to_pixels)}   ({measured.unseen} changed nothing seen)")
        print(f"  key stamp error  {distribution(measured.stamp_error)}", flush=True)


if __name__ == "__main__":
    main()
