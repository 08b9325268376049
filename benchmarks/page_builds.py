"""The participant's page of this checkout and of another's, in turn in one run: bytes, files, time to the first screen.

    python -m benchmarks.page_builds ../earlier ../earlier/.venv/bin/python --rounds 9

Each load is in a new profile of Chromium, so that nothing is cached. Bytes are those that came over the line, headers
included, and those that they unpack to; the time is from the navigation to the first element of a screen.
"""

import argparse
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

from benchmarks.web_builds import HERE, describe_commit
from tests.web.browser import browsing

TOML = """
[study]
name = "page"
version = "1"
seed = 1
participants = 1000
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 2
max_steps = 100
actions = ["left", "right", "forward"]
"""
_WATCH = """
new MutationObserver((_, observer) => {
  if (!document.querySelector('#screen > *')) return;
  globalThis.firstScreenMs = performance.now();
  observer.disconnect();
}).observe(document, { childList: true, subtree: true });
"""


@dataclass(frozen=True)
class Load:
    """One load of a page."""

    n_files: int
    transferred_kb: float
    unpacked_kb: float
    first_screen_ms: float


@contextmanager
def serve(checkout: Path, python: str, links: int) -> Iterator[list[str]]:
    """Serve a study by a checkout's own server; yield the participants' links."""
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name:
        path = Path(name) / "page.toml"
        path.write_text(TOML)
        command = [python, "-m", "minihuman", "serve", str(path), "--data", name, "--port", "0", "--links", str(links)]
        environment = {"PYTHONPATH": str(checkout)}
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=checkout, env=environment) as process:
            assert process.stdout is not None
            addresses: list[str] = []
            while len(addresses) < links:
                line = process.stdout.readline()
                if not line:
                    raise SystemExit(f"{checkout} did not serve")
                addresses += re.findall(r"http://\S+#t=\S+", line)
            try:
                yield addresses
            finally:
                process.terminate()


def load_page(sit_down: Any, address: str) -> Load:
    """Open a participant's link in a new profile and wait for the first screen and the last file."""
    somebody = sit_down("about:blank")
    page = somebody.page
    network = page.context.new_cdp_session(page)
    network.send("Network.enable")
    finished: list[float] = []
    unpacked: list[float] = []
    network.on("Network.loadingFinished", lambda event: finished.append(event["encodedDataLength"]))
    network.on("Network.dataReceived", lambda event: unpacked.append(event["dataLength"]))
    page.add_init_script(_WATCH)
    page.goto(address, wait_until="networkidle")
    while (first_screen_ms := page.evaluate("globalThis.firstScreenMs")) is None:  # its policy admits no other waits
        page.wait_for_timeout(50)
    page.context.close()
    return Load(len(finished), sum(finished) / 1e3, sum(unpacked) / 1e3, first_screen_ms)


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="of an earlier commit")
    parser.add_argument("python", help="that has the packages of that checkout")
    parser.add_argument("--rounds", type=int, default=9)
    asked = parser.parse_args()
    builds = {"ours": (HERE, sys.executable), "earlier": (asked.checkout.resolve(), asked.python)}
    print(f"ours {describe_commit(HERE)}, earlier {describe_commit(asked.checkout)}", flush=True)
    loads: dict[str, list[Load]] = {name: [] for name in builds}
    links = asked.rounds + 1  # the first load of each is not counted
    with serve(*builds["ours"], links) as ours, serve(*builds["earlier"], links) as earlier, browsing() as sit_down:
        for number in range(links):
            order = [("ours", ours), ("earlier", earlier)]
            if number % 2:
                order.reverse()
            for name, addresses in order:
                load = load_page(sit_down, addresses[number])
                if number:
                    loads[name].append(load)
    medians = {
        name: Load(*(statistics.median(values) for values in zip(*map(astuple, of_build), strict=True)))
        for name, of_build in loads.items()
    }
    for name, median in medians.items():
        print(
            f"{name:8} {median.n_files:.0f} files, {median.transferred_kb:.0f} kB over the line, "
            f"{median.unpacked_kb:.0f} kB unpacked, first screen after {median.first_screen_ms:.0f} ms "
            f"(median of {asked.rounds})"
        )
    ratios = [
        of_ours / of_earlier
        for of_ours, of_earlier in zip(astuple(medians["ours"]), astuple(medians["earlier"]), strict=True)
    ]
    print("ours by earlier: files {:.3f}, over the line {:.3f}, unpacked {:.3f}, first screen {:.3f}".format(*ratios))


if __name__ == "__main__":
    main()
