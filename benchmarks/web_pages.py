"""What reading, answering and waiting in a browser have of the line: with screens sent ahead, and without, in one run.

    python -m benchmarks.web_pages

By the log's own times: from the key to the next page or question, and how much longer an interval and a cross took than
the protocol says, from the key that began them to the first picture. Each log is proven.
"""

import argparse
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import minihuman
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered, Event, FrameShown, KeyPressed, PageShown
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.machine import need
from tests.web.browser import Somebody, browsing
from tests.web.protocols import study
from tests.web.serving import line

DEEPEST = {"ours": 6, "none": 0}
INTERVAL_MS, FIXATION_MS = 300, 500
LOOK_MS = 700  # between two keys


def protocol_in(folder: Path, *, each: int) -> Path:
    """Pages, questions and episodes of one step, so many of each."""
    block = f"inter_trial_interval_ms = {INTERVAL_MS}\nfixation_ms = {FIXATION_MS}\nfinal_frame_ms = 0"
    path = study(folder, episodes=each, max_steps=1, block=block)
    names = ", ".join(f'"page-{number}"' for number in range(each))
    text = path.read_text().replace('blocks = ["tried"]', "").replace('feedback = "{outcome}"', "")
    text += f'\n[[sessions]]\nname = "day"\nparts = [{names}, "asked", "tried"]\n'
    text += "".join(f'[[pages]]\nname = "page-{number}"\ntext = "Page {number}."\n' for number in range(each))
    text += '[[questions]]\nname = "asked"\n'
    for number in range(each):
        text += (
            f'[[questions.items]]\nname = "item-{number}"\nkind = "likert"\nask = "Question {number}?"\npoints = 5\n'
        )
    path.write_text(text)
    return path


def take_part(somebody: Somebody) -> None:
    """Read, answer and play, at an even pace."""
    somebody.until("s.kind === 'page'")
    while not somebody.state["finished"]:
        somebody.page.wait_for_timeout(LOOK_MS)
        state = somebody.state
        if state["kind"] == "question":
            somebody.press("3")
            somebody.page.wait_for_timeout(LOOK_MS)
            somebody.press("enter")
        elif state["kind"] != "blank":
            somebody.press("1" if state["playing"] else "enter")


def waits(events: Sequence[Event]) -> Iterator[tuple[str, float]]:
    """What was waited for, and how long, ms."""
    key_ns = shown_ns = 0
    begun_ns: int | None = None
    for event in events:
        match event:
            case PageShown() if key_ns:
                yield "page", (event.flip_ns - key_ns) / 1e6
            case KeyPressed(down=True):
                key_ns = event.t_ns - event.waited_ns
                begun_ns = key_ns if event.phase == "ready" else begun_ns
            case Answered():
                if shown_ns:
                    yield "question", (event.shown_ns - shown_ns) / 1e6
                shown_ns = key_ns
            case FrameShown(step=0) if begun_ns is not None:
                yield "beyond", (event.flip_ns - begun_ns) / 1e6 - INTERVAL_MS - FIXATION_MS
                begun_ns = None


def measure(rtt_ms: float, rule: str, each: int) -> str:
    """A line of what one session had of the line."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        protocol = protocol_in(folder, each=each)
        command = [sys.executable, "-m", "benchmarks.web_line", "--serve", str(protocol), name, str(DEEPEST[rule])]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert server.stdout is not None
        url = server.stdout.readline().strip()
        port = int(re.search(r":(\d+)/", url)[1])  # type: ignore[index]
        try:
            with line(port, rtt_ms=rtt_ms) as wire, browsing() as sit_down:
                somebody = sit_down(url.replace(f":{port}/", f":{wire.port}/"))
                take_part(somebody)
                assert somebody.errors == [], somebody.errors
        finally:
            server.send_signal(signal.SIGTERM)
            server.wait()
        [log] = folder.rglob("*.mcap")
        found: dict[str, list[float]] = {"page": [], "question": [], "beyond": []}
        for what, ms in waits(list(read_events(log))):
            found[what].append(ms)
        shares = " ".join(f"{np.median(ms):9.1f} {np.percentile(ms, 95):7.1f}" for ms in found.values())
        return f"{rtt_ms:4.0f} ms {rule:5} {shares}   {list(find_log_differences(log, World)) or 'proven'}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=12, help="Pages, questions and episodes.")
    parser.add_argument("--rtt", type=float, nargs="+", default=[0.0, 300.0])
    parser.add_argument("--rule", nargs="+", default=list(DEEPEST), choices=DEEPEST)
    asked = parser.parse_args()
    browser = subprocess.run([need("chromium"), "--version"], capture_output=True, text=True).stdout.strip()
    print(f"minihuman {minihuman.__version__}, {browser}, Python {sys.version.split()[0]}; ms, median and 95 %")
    print("line    rule      to a page         to a question     beyond the interval and the cross", flush=True)
    for rtt_ms in asked.rtt:
        for rule in asked.rule:
            print(measure(rtt_ms, rule, asked.each), flush=True)


if __name__ == "__main__":
    main()
