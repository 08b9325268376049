"""What a long line costs in the browser: key to picture, keys lost, bytes and CPU, stepped in the page and not.

Headless Chromium, through a TCP proxy that makes the line as long as asked. Four rules in turn: stepped and drawn in
the page, one step ahead by the server with every key kept, the same with keys ignored until the next pictures are there
(the rule of NiceWebRL's client, commit c794269), and no look-ahead. Times are the log's own: the picture's flip minus
the key's time stamp. Bytes are those of the TCP connection from an episode's first key on, by key, pings and all: up to
the episode's end, with what was kept for a second, and down to its last key.
With ``--loss 0.01`` one chunk in a hundred is sent again after 200 ms or a round trip, and all behind it wait.

    python -m benchmarks.web_line [--keys 60] [--rtt 0 150 300] [--loss 0] [--px 400x300] [--world grid first-person]
    python -m benchmarks.web_line --first 5     # with an empty cache: from the link to the first picture, and all bytes
"""

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import minihuman
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import FrameShown, KeyPressed, Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.machine import need
from tests.web.browser import Somebody, browsing
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import line, serving

WORLDS = {"grid": (GRID, 6.0), "first-person": (FIRST_PERSON, 4.0)}
LOOKS_AHEAD = {"page": True, "ahead": True, "one-step": True, "none": False}
IGNORED = """
globalThis.ignored = 0;
addEventListener('keydown', (event) => {
  const state = globalThis.minihuman?.state;
  if (!event.repeat && state?.playing && !(state.ready && state.confirmed === state.step)) {
    globalThis.ignored += 1;
    event.stopImmediatePropagation();
  }
}, true);
"""


@dataclass
class Found:
    """Of one run."""

    pressed: int
    logged: int
    flips_ms: np.ndarray
    bytes_a_key: tuple[float, float]  # up and down, means
    kb_a_step: float
    cpu_ms_a_step: float
    complaints: list[str]

    def line(self) -> str:
        quick = np.mean(self.flips_ms < 50) if len(self.flips_ms) else 0.0
        shares = np.percentile(self.flips_ms, (50, 95, 99)) if len(self.flips_ms) else (np.nan,) * 3
        return (
            f"{self.pressed:5} {self.pressed - self.logged:5} {100 * quick:6.0f} % "
            + " ".join(f"{share:7.1f}" for share in shares)
            + " {:6.0f} {:7.0f}".format(*self.bytes_a_key)
            + f" {self.kb_a_step:8.1f} {self.cpu_ms_a_step:8.1f}   {self.complaints or 'proven'}"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=60)
    parser.add_argument("--rtt", type=float, nargs="+", default=[0.0, 150.0, 300.0])
    parser.add_argument("--first", type=int, default=0, help="Open the link so often, and measure the first picture.")
    parser.add_argument("--loss", type=float, default=0.0)
    parser.add_argument("--px", default="400x300", help="The picture's size.")
    parser.add_argument("--world", nargs="+", default=list(WORLDS), choices=WORLDS)
    parser.add_argument("--rule", nargs="+", default=list(LOOKS_AHEAD), choices=LOOKS_AHEAD)
    parser.add_argument("--serve", nargs=3, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.serve:
        return serve(Path(asked.serve[0]), Path(asked.serve[1]), bool(int(asked.serve[2])))
    version = subprocess.run([need("chromium"), "--version"], capture_output=True, text=True).stdout.strip()
    print(f"minihuman {minihuman.__version__}, {version}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    if asked.first:
        for name in asked.world:
            print(f"{name:12} {asked.px} {first_picture(WORLDS[name][0], asked.first, asked.px)}", flush=True)
        return None
    print(" " * 32, " keys  lost  < 50 ms  median    95 %    99 % B up/key    down  kB/step   CPU ms")
    for name in asked.world:
        world, keys_hz = WORLDS[name]
        for rtt_ms in asked.rtt:
            for rule in asked.rule:
                found = measure(world, keys_hz, rtt_ms, rule, asked.keys, loss=asked.loss, px=asked.px)
                print(f"{name:12} {rtt_ms:4.0f} ms {keys_hz:.0f}/s {rule:8} {found.line()}", flush=True)
    return None


def measure(
    world: tuple[str, tuple[str, ...]],
    keys_hz: float,
    rtt_ms: float,
    rule: str,
    keys: int,
    *,
    loss: float = 0.0,
    px: str = "400x300",
) -> Found:
    """Two episodes of one person."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        block = f'computed = "{"page" if rule == "page" else "server"}"'
        web = f"image_size_px = {[int(side) for side in px.split('x')]}"
        protocol = study(folder, world, episodes=2, max_steps=keys // 2, block=block, web=web)
        own = ["--serve", str(protocol), name, str(int(LOOKS_AHEAD[rule]))]
        command = [sys.executable, "-m", "benchmarks.web_line", *own]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        port = int(re.search(r":(\d+)/", url)[1])  # type: ignore[index]
        try:
            with line(port, rtt_ms=rtt_ms, loss=loss) as wire, browsing() as sit_down:
                somebody = sit_down("about:blank")
                if rule == "one-step":
                    somebody.page.add_init_script(IGNORED)
                somebody.page.goto(url.replace(f":{port}/", f":{wire.port}/"))
                pressed = 0
                cpu_s, down = 0.0, 0
                bytes_up = bytes_down = 0  # from an episode's first key
                for _ in range(2):
                    somebody.to_play()
                    somebody.page.wait_for_timeout(1500)  # the first scenes are there when somebody has looked around
                    cpu_s, down = cpu_s - cpu_of(server.pid), down - wire.bytes_down
                    last_down = wire.bytes_down
                    bytes_up, bytes_down = bytes_up - wire.bytes_up, bytes_down - last_down
                    while True:
                        began_s = time.monotonic()
                        state = somebody.state
                        if not state["playing"] or state["ended"]:
                            break
                        last_down = wire.bytes_down
                        somebody.press("123"[pressed * 7 % 11 % 3])
                        pressed += 1
                        somebody.page.wait_for_timeout(max(0.0, 1000 * (began_s + 1 / keys_hz - time.monotonic())))
                    bytes_down += last_down
                    cpu_s, down = cpu_s + cpu_of(server.pid), down + wire.bytes_down
                    somebody.until("!s.playing")
                    bytes_up += wire.bytes_up
                somebody.until("s.unsafe === 0")
                assert somebody.errors == [], somebody.errors
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait()
        [log] = folder.rglob("*.mcap*")
        events = list(read_events(log))
        steps = [event for event in events if isinstance(event, Stepped)]
        logged = sum(isinstance(e, KeyPressed) and e.down and e.key in "123" for e in events)
        flips = {(e.episode, e.step): e.flip_ns for e in reversed(events) if isinstance(e, FrameShown)}
        took = [(flips[s.episode, s.step] - s.key_t_ns) / 1e6 for s in steps if (s.episode, s.step) in flips]
        count = max(1, len(steps))
        return Found(
            pressed,
            logged,
            np.array(took),
            (bytes_up / pressed, bytes_down / pressed),
            down / 1000 / count,
            1000 * cpu_s / count,
            list(find_log_differences(log, World)),
        )


def first_picture(world: tuple[str, tuple[str, ...]], times: int, px: str) -> str:
    """From a link that a browser with an empty cache opens to the first screen, and on to the world's picture."""
    screens_s, pictures_s, down = [], [], []
    for _ in range(times):
        with tempfile.TemporaryDirectory() as name:
            web = f"image_size_px = {[int(side) for side in px.split('x')]}"
            served = serving(study(Path(name), world, web=web), Path(name))
            with served as server, line(server.port) as wire, browsing() as sit_down:
                somebody = sit_down("about:blank")
                somebody.page.goto(f"http://127.0.0.1:{wire.port}/#t={server.tokens[0]}", wait_until="commit")
                _poll(somebody, "globalThis.minihuman?.state.kind")
                screens_s.append(somebody.page.evaluate("performance.now()") / 1000)
                while not somebody.state["playing"]:
                    somebody.press("enter")
                    began_s = time.monotonic()
                    while not somebody.state["playing"] and time.monotonic() < began_s + 0.3:
                        somebody.page.wait_for_timeout(10)
                _poll(somebody, "minihuman.state.known && document.querySelector('#screen canvas')?.width > 100")
                pictures_s.append(time.monotonic() - began_s)
                down.append(wire.bytes_down)
    screen_s, picture_s, kb = np.median(screens_s), np.median(pictures_s), np.median(down) / 1000
    return f"first screen {screen_s:.2f} s, Enter to picture {picture_s:.2f} s, {kb:.0f} kB in all, median of {times}"


def _poll(somebody: Somebody, condition: str) -> None:
    while not somebody.page.evaluate(condition):
        somebody.page.wait_for_timeout(5)


def cpu_of(pid: int) -> float:
    """CPU seconds of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def serve(protocol: Path, data: Path, looks_ahead: bool) -> None:
    """As `minihuman serve`, but with look-ahead or without."""
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.experiment.plan.dry_run import check_worlds
    from minihuman.web.outbox import Outbox
    from minihuman.web.server.process import open_listening_socket, run_server

    if not looks_ahead:
        Outbox.grow = lambda self, rtt_ns: False  # type: ignore[method-assign]
    read = read_protocol(protocol)
    check_worlds(read)
    run_server(read, data, open_listening_socket(0), links=1, say=lambda said: print(said, flush=True))


if __name__ == "__main__":
    main()
