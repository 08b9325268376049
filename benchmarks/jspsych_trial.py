"""A FourRooms trial in jsPsych beside jsPsych alone: bytes, the first picture, and from a key to the picture.

    pip install -e ".[web,test]"
    python -m benchmarks.jspsych_trial [--starts 12] [--trials 30]

jsPsych 8.3.0 and its html-keyboard-response come from npm, into a temporary folder. Both pages are opened in turn, each
in a browser that is started anew, from a static server on this machine; a page's bytes are what the server sent. In the
third part both kinds of trial are in one timeline, in turn. A key counts from its event's stamp to the animation frame
after the picture was changed: for html-keyboard-response the next trial's text, for FourRooms the drawn canvas.
"""

import argparse
import functools
import random
import runpy
import statistics
import subprocess
import tempfile
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.machine import where

ROOT = Path(__file__).parents[1]
PACKAGES = ("jspsych@8.3.0", "@jspsych/plugin-html-keyboard-response@2.2.0")
EPISODE_KEYS = 12
_HEAD = """<!doctype html><meta charset="utf-8"><title>study</title><link rel="icon" href="data:,">
<link rel="stylesheet" href="node_modules/jspsych/css/jspsych.css"><body></body>
<script src="node_modules/jspsych/dist/index.browser.min.js"></script>
<script src="node_modules/@jspsych/plugin-html-keyboard-response/dist/index.browser.min.js"></script>
<script>
const stamp = (name) => requestAnimationFrame(() => { window[name] = performance.now(); });
const text = (stimulus) => ({ type: jsPsychHtmlKeyboardResponse, stimulus, choices: ["f", "j", "d"] });
</script>"""
ALONE = f"""{_HEAD}<script>
const jsPsych = jsPsychModule.initJsPsych();
jsPsych.run([{{ ...text("X"), on_load: () => stamp("first_ms") }}]);
</script>"""
WITH_WORLD = f"""{_HEAD}<script type="module">
import Episode from "./minihuman/jspsych.js";
const jsPsych = jsPsychModule.initJsPsych();
jsPsych.run([{{ type: Episode, world: "MiniGrid-FourRooms-v0", seed: 3, on_load: () => stamp("first_ms") }}]);
</script>"""
IN_TURN = f"""{_HEAD}<script type="module">
import Episode from "./minihuman/jspsych.js";
const n = Number(location.hash.slice(1)), delays = window.delays = {{ text: [], world: [] }}, presses = {EPISODE_KEYS};
let pressed = null, kind = "", isReady = false; // isReady: the trial's first picture was drawn, so that keys act
addEventListener("keydown", (event) => {{ pressed = isReady ? event.timeStamp : null; }}, true);
const drawn = (what) => {{
  const since = pressed;
  pressed = null;
  const isAnswer = isReady && since !== null && what === kind;
  if (isAnswer) requestAnimationFrame(() => delays[what].push(performance.now() - since));
  isReady = true;
  kind = what;
}};
for (const name of ["putImageData", "drawImage"]) {{
  const draw = CanvasRenderingContext2D.prototype[name];
  CanvasRenderingContext2D.prototype[name] = function (...given) {{
    draw.apply(this, given);
    drawn("world");
  }};
}}
const jsPsych = window.jsPsych = jsPsychModule.initJsPsych({{ on_finish: () => {{ window.isOver = true; }} }});
const settings = {{ world: "MiniGrid-FourRooms-v0", max_steps: presses, feedback_duration: 0 }};
const key_map = {{ f: "left", j: "right", d: "forward" }}, timeline = [];
for (let seed = 0; seed < n; seed++) {{
  timeline.push({{ type: Episode, ...settings, seed, key_map, on_start: () => {{ isReady = false; }} }});
  for (let press = 0; press < presses; press++) {{
    const on_start = () => {{ isReady &&= press > 0; }};
    timeline.push({{ ...text(String(press)), on_load: () => drawn("text"), on_start }});
  }}
}}
jsPsych.run(timeline);
</script>"""
PAGES = {"alone": ALONE, "world": WITH_WORLD, "turn": IN_TURN}


@contextmanager
def counted_server(folder: Path) -> Iterator[tuple[str, Counter[str]]]:
    """Serve a folder; yields the address and the bytes sent of each path, which the caller may clear."""
    sent: Counter[str] = Counter()

    class Handler(SimpleHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def send_header(self, keyword: str, value: str) -> None:
            if keyword.lower() == "content-length":
                sent[urlsplit(self.path).path] += int(value)
            super().send_header(keyword, value)

    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/", sent
    finally:
        server.shutdown()
        server.server_close()


def write_study(folder: Path) -> None:
    """Install jsPsych, build the package and write the pages."""
    subprocess.run(
        ["npm", "install", "--no-audit", "--no-fund", *PACKAGES], cwd=folder, check=True, stdout=subprocess.PIPE
    )
    runpy.run_path(str(ROOT / "js/build.py"))["build_package"](folder / "minihuman", with_types=False)
    for name, page in PAGES.items():
        (folder / f"{name}.html").write_text(page, encoding="utf-8")


def measure_starts(launch: Callable[[], Any], address: str, sent: Counter[str], starts: int) -> None:
    """Open both pages in turn, each in a fresh browser; print bytes and the time of the first picture."""
    first_ms: dict[str, list[float]] = {"alone": [], "world": []}
    n_bytes = {}
    for start in range(starts):
        for name in ("alone", "world") if start % 2 else ("world", "alone"):
            browser = launch()
            page = browser.new_page()
            sent.clear()
            page.goto(f"{address}{name}.html")
            page.wait_for_function("window.first_ms > 0", timeout=120_000)
            first_ms[name].append(page.evaluate("window.first_ms"))
            if name == "world":
                assert page.evaluate("document.querySelector('canvas').width") > 0
            n_bytes[name] = sum(sent.values())
            browser.close()
    more_kb = (n_bytes["world"] - n_bytes["alone"]) / 1000
    medians = {name: statistics.median(times) for name, times in first_ms.items()}
    differences = [world - alone for alone, world in zip(first_ms["alone"], first_ms["world"], strict=True)]
    print(
        f"bytes: jsPsych alone {n_bytes['alone'] / 1000:.1f} kB, with FourRooms {more_kb:.1f} kB more, not compressed"
    )
    print(
        f"first picture, {starts} cold starts each: jsPsych alone {medians['alone']:.0f} ms, with FourRooms "
        f"{medians['world']:.0f} ms (medians); {statistics.median(differences):.0f} ms later (median of pairs)"
    )


def measure_keys(launch: Callable[[], Any], address: str, trials: int) -> None:
    """Press keys in both kinds of trial in turn; print from key to picture."""
    browser = launch()
    page = browser.new_page()
    page.goto(f"{address}turn.html#{trials}")
    draw = random.Random(1)
    while not page.evaluate("window.isOver"):
        page.keyboard.press(draw.choice("fj"))
        page.wait_for_timeout(draw.uniform(40, 90))
    delays: dict[str, list[float]] = page.evaluate("window.delays")
    browser.close()
    for name, title in (("text", "html-keyboard-response"), ("world", "FourRooms")):
        p95 = statistics.quantiles(delays[name], n=20)[-1]
        median = statistics.median(delays[name])
        print(f"key to picture, {title}: {median:.2f} ms (median), {p95:.2f} ms (95 %), {len(delays[name])} keys")
    print(f"ratio of medians: {statistics.median(delays['world']) / statistics.median(delays['text']):.2f}")


def main() -> None:
    from playwright.sync_api import sync_playwright

    parser = argparse.ArgumentParser()
    parser.add_argument("--starts", type=int, default=12)
    parser.add_argument("--trials", type=int, default=30)
    asked = parser.parse_args()
    chromium = where("chromium")
    assert chromium is not None, "apt-get install chromium"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        launch = functools.partial(playwright.chromium.launch, executable_path=chromium, args=["--no-sandbox"])
        write_study(Path(folder))
        with counted_server(Path(folder)) as (address, sent):
            browser = launch()
            print(f"{', '.join(PACKAGES)}, Chromium {browser.version}")
            browser.close()
            measure_starts(launch, address, sent, asked.starts)
            measure_keys(launch, address, asked.trials)


if __name__ == "__main__":
    main()
