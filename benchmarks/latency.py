"""From a key to changed pixels, and how late keys are stamped, in a real session in a real window.

    python -m benchmarks.latency [--keys 100] [--window pygame] [--world minihuman/MiniWorld-FourRooms-v0]
                                 [--size 1920x1080] [--as-of CHECKOUT] [--watched] [--rounds 3] [--fsync-ms 200]

Starts an X server of its own (Xvfb), runs `minihuman run` in it, full screen, with the log on disk and one press one
step, sends key events that the server itself makes (XTEST), and reads the window's pixels back until they change.
Then it sends as many more, 60 to 150 ms apart and rolled over each other, whether or not a picture is being drawn.
Prints distributions; judges nothing. Xvfb refreshes nothing, so the display's own period is 0: what is printed is all
the software's. `--as-of` measures another checkout of minihuman too, in turns with this one, on the same machine in the
same minutes: its ratios hold where others use the machine too. `--watched` measures each session once more, with
`minihuman watch` beside it and its page asked every second, as a browser does. `--rounds` does all of it so many times,
in turns, and tells of all rounds together. `--fsync-ms` makes each fsync take so much longer, as a slow disk does.
"""

import argparse
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path

import numpy as np

from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.recording_quality import list_key_to_flip_ms
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.seats.session_typist import enter_at, until
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
keyboard_check = false

[[groups]]
name = "everyone"
blocks = ["turning"]

[[blocks]]
name = "turning"
world = "{world}"
episodes = 2
actions = {actions}
max_steps = {keys}
key_map = "shown"
"""
SLOWER = """
import os, runpy, sys, time
really, later_s = os.fsync, float(sys.argv[1])
def fsync(fd):
    time.sleep(later_s)
    really(fd)
os.fsync = fsync
sys.argv[:2] = ["minihuman"]
runpy.run_module("minihuman", run_name="__main__", alter_sys=True)
"""
Sent = tuple[str, bool, int, int]  # key, down, sent, answered by the server: ns since 1970


@dataclass(frozen=True, slots=True)
class Measured:
    """One session's keys; times in ms."""

    facts: dict[str, str]
    key_to_flip: list[float]  # as the log has it
    key_to_pixels: list[float]
    unseen: int
    waiting: list[float]  # stamp error of keys sent while the session waits for one
    rolling: list[float]  # of keys sent whatever it does
    answered: list[float]  # and how long the X server took to take those
    beyond: list[float]  # how long after the server had taken a key its stamp is: what is ours of the error
    same: int  # events of the latter that have the stamp of the one before


@contextmanager
def watching(study: Path) -> Iterator[None]:
    """`minihuman watch` beside a session, and what a browser asks of its page, every second."""
    command = [sys.executable, "-m", "minihuman", "watch", str(study)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        url, done = program.stdout.readline().split()[1], threading.Event()

        def look() -> None:
            while not done.wait(1.0):
                with urllib.request.urlopen(url + "state", timeout=30) as answer:
                    running = json.load(answer)["sessions"]
                for name in running:
                    urllib.request.urlopen(f"{url}picture?session={name}", timeout=30).close()

        browser = threading.Thread(target=look)
        browser.start()
        yield
        done.set()
        browser.join()
        program.kill()


def measure(
    window: str, world: str, keys: int, size_px: tuple[int, int], checkout: Path, *, watched: bool, fsync_s: float
) -> Measured:
    with xvfb(size_px) as display, tempfile.TemporaryDirectory() as folder:
        protocol = Path(folder) / "latency.toml"
        protocol.write_text(PROTOCOL.format(world=world, actions=turns(world), keys=keys))
        program = ["-c", SLOWER, str(fsync_s)] if fsync_s else ["-m", "minihuman"]
        command = [sys.executable, *program, "run", str(protocol), "--data", folder, "--window", window]
        station = subprocess.Popen(
            command,
            env={**os.environ, "DISPLAY": display, "PYTHONPATH": str(checkout)},
            cwd=checkout,
            stdout=subprocess.PIPE,
        )
        typist = Typist(display)
        typist.focus(TITLE)
        begin_episode(typist, Path(folder))
        study = read_protocol(protocol)
        pressed = list(expand_protocol(study, enrol_participant(study, 0)).episodes[0].key_map.keys)
        with watching(Path(folder) / "latency") if watched else nullcontext():
            seen_ms, waiting = one_by_one(typist, pressed, keys)
            begin_episode(typist, Path(folder))
            rolling = rolled(typist, pressed, keys)
        enter_at(typist, Path(folder), "closing", "page")
        station.communicate(timeout=120)
        log = read_log(next(Path(folder).rglob("*.mcap")))
    began_ns = log.segments[0].started_unix_ns
    stamped = [
        (key.key, key.down, began_ns + key.t_ns - key.waited_ns)
        for key in log.keys
        if key.key in pressed and key.verdict in ("accepted", "release", "not_playing")
    ]
    sent = [*waiting, *rolling]
    assert [one[:2] for one in stamped] == [one[:2] for one in sent], "keys were lost, or came in another order"
    errors_ms = [(at_ns - one[2]) / 1e6 for (_, _, at_ns), one in zip(stamped, sent, strict=True)]
    seen = [ms for ms in seen_ms if ms < UNSEEN_S * 1000]
    stamps = [at_ns for _, _, at_ns in stamped[len(waiting) :]]
    return Measured(
        facts=dict(log.facts),
        key_to_flip=list_key_to_flip_ms(log).tolist(),
        key_to_pixels=seen,
        unseen=len(seen_ms) - len(seen),
        waiting=errors_ms[: len(waiting)],
        rolling=errors_ms[len(waiting) :],
        answered=[(answered - sent) / 1e6 for _, _, sent, answered in rolling],
        beyond=[max(0.0, (at_ns - one[3]) / 1e6) for at_ns, one in zip(stamps, rolling, strict=True)],
        same=sum(one == other for one, other in pairwise(stamps)),
    )


def begin_episode(typist: Typist, folder: Path) -> None:
    enter_at(typist, folder, "ready")
    until(folder, "playing")
    time.sleep(2)  # the log is written before the picture is shown


def send(typist: Typist, key: str, down: bool) -> Sent:
    sent_ns = time.time_ns()
    (typist.press if down else typist.release)(key)
    return key, down, sent_ns, time.time_ns()


def one_by_one(typist: Typist, pressed: list[str], keys: int) -> tuple[list[float], list[Sent]]:
    """Press a key when the picture of the one before is there; say how long each picture took, and what was sent."""
    look = typist.watch(TITLE, ROWS)
    seen_ms, sent = [], []
    for number in range(keys):
        before = look()
        time.sleep(random.uniform(0.05, 0.12))
        started_s = time.monotonic()
        sent.append(send(typist, pressed[number % 2], True))
        while look() == before and time.monotonic() - started_s < UNSEEN_S:
            time.sleep(0.0003)
        seen_ms.append((time.monotonic() - started_s) * 1000)
        sent.append(send(typist, pressed[number % 2], False))
    return seen_ms, sent


def rolled(typist: Typist, pressed: list[str], keys: int) -> list[Sent]:
    """Press keys 60 to 150 ms apart, each coming up after the next went down, as fingers roll; say what was sent."""
    sent = [send(typist, pressed[0], True)]
    for number in range(1, keys):
        time.sleep(random.uniform(0.06, 0.15))
        sent.append(send(typist, pressed[number % 2], True))
        time.sleep(random.uniform(0.005, 0.03))
        sent.append(send(typist, pressed[(number - 1) % 2], False))
    sent.append(send(typist, pressed[(keys - 1) % 2], False))
    return sent


def turns(world: str) -> str:
    """Two actions that undo each other and change the picture, as TOML."""
    names = World(world).action_names
    return str([name for name in names if name.endswith(("left", "right"))][:2]).replace("'", '"')


def distribution(values_ms: list[float]) -> str:
    median, p95, p99 = np.percentile(values_ms, (50, 95, 99))
    return f"median {median:6.2f} ms   95 % {p95:6.2f} ms   99 % {p99:6.2f} ms   worst {max(values_ms):6.2f} ms"


def difference(values_ms: list[float], others_ms: list[float]) -> str:
    """By how much the median of the first exceeds that of the others, with a 95 % bootstrap interval.

    A key waits for the next refresh, so medians of fifty keys each differ by a millisecond or two by chance alone.
    """
    rng = np.random.default_rng(1)
    medians = [
        np.median(rng.choice(np.array(each), (10_000, len(each))), axis=1)  # of as many keys, drawn again
        for each in (values_ms, others_ms)
    ]
    low, high = np.percentile(medians[0] - medians[1], (2.5, 97.5))
    return f"{np.median(values_ms) - np.median(others_ms):+.2f} ms ({low:+.2f} to {high:+.2f}) by the medians"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=100, help="at most the steps that the world allows an episode")
    parser.add_argument("--window", action="append", help="pygame or pyglet; both if absent")
    parser.add_argument("--world", default="minihuman/MiniGrid-FourRooms-v0")
    parser.add_argument("--size", default="1280x720", help="of the screen, which the window fills")
    parser.add_argument("--as-of", type=Path, help="another checkout of minihuman to measure beside this one")
    parser.add_argument("--watched", action="store_true", help="measure with the experimenter's page beside, too")
    parser.add_argument("--rounds", type=int, default=1, help="so many sessions of each, in turns")
    parser.add_argument("--fsync-ms", type=float, default=0.0, help="how much longer each fsync takes")
    settings = parser.parse_args()
    width, height = map(int, settings.size.split("x"))
    checkouts = [path.resolve() for path in (settings.as_of, Path(__file__).parents[1]) if path is not None]
    for window in settings.window or ("pygame", "pyglet"):
        compared = list(product(checkouts, (False, True) if settings.watched else (False,)))
        found: dict[tuple[Path, bool], list[Measured]] = {one: [] for one in compared}
        for number in range(settings.rounds):
            for checkout, watched in compared if number % 2 == 0 else reversed(compared):
                how = {"watched": watched, "fsync_s": settings.fsync_ms / 1000}
                measured = measure(window, settings.world, settings.keys, (width, height), checkout, **how)
                found[checkout, watched].append(measured)
        for checkout, watched in compared:
            print("watched" if watched else "not watched") if settings.watched else None
            tell(together(found[checkout, watched]), settings.world)


def together(found: list[Measured]) -> Measured:
    """All rounds as one."""
    lists = {
        name: [value for one in found for value in getattr(one, name)]
        for name in ("key_to_flip", "key_to_pixels", "waiting", "rolling", "answered", "beyond")
    }
    return Measured(
        facts=found[0].facts, unseen=sum(one.unseen for one in found), same=sum(one.same for one in found), **lists
    )


def tell(measured: Measured, world: str) -> None:
    facts = measured.facts
    commit = facts.get("git_commit", "")[:7]
    print(f"{facts['window_version']}, {facts['window_size_px']}, vsync {facts['vsync']}, {world}, {commit}")
    print(f"  load average           {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(f"  key to flip            {distribution(measured.key_to_flip)}   ({len(measured.key_to_flip)} keys)")
    print(f"  key to pixels          {distribution(measured.key_to_pixels)}   ({measured.unseen} changed nothing seen)")
    print(f"  stamp error, waiting   {distribution(measured.waiting)}")
    print(f"  stamp error, rolling   {distribution(measured.rolling)}   ({measured.same} with the stamp before)")
    print(f"  X server took the key  {distribution(measured.answered)}")
    print(f"  stamp after that       {distribution(measured.beyond)}", flush=True)


if __name__ == "__main__":
    main()
