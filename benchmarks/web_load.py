"""How many people one core serves in a browser: steps, bytes, latency and the server's CPU, worlds in turn in one run.

    python -m benchmarks.web_load --people 40 --seconds 60

`grid` is computed in the pages, `ahead` is the same world sent ahead by the server. The people are pages without a
browser in this process, over a line that is delayed here; the server is a process of its own, whose CPU is what counts.
A core is taken as full at 70 %. Joins are timed with a list of 1,000 slots, 500 taken.
"""

import argparse
import asyncio
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np

from minihuman.admin.recruitment import Recruitment
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.web.arrivals import Arrival, Arrivals
from tests.web.typed_page import TypedPage

FULL = 0.7  # of a core
TOML = """
[study]
name = "load"
version = "1"
seed = 1
participants = 1000
[keys]
keyboard_check = false
[web]
image_size_px = {size}
max_concurrent_sessions = 1000
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "{world}"
episodes = 1000
max_steps = 100
final_frame_ms = 100
actions = {actions}
computed = "{computed}"
"""
GRID, ROOMS = '["left", "right", "forward"]', '["turn_left", "turn_right", "move_forward"]'
KINDS = {
    "grid": ("minihuman/MiniGrid-FourRooms-v0", "[400, 300]", GRID, "page"),
    "ahead": ("minihuman/MiniGrid-FourRooms-v0", "[400, 300]", GRID, "server"),
    "80x60": ("minihuman/MiniWorld-FourRooms-v0", "[80, 60]", ROOMS, "server"),
    "400x300": ("minihuman/MiniWorld-FourRooms-v0", "[400, 300]", ROOMS, "server"),
}


@dataclass
class Served:
    """A server that runs."""

    host: str
    pid: int

    def cpu_s(self) -> float:
        """CPU seconds that it and its workers have taken."""
        return sum(_cpu_s(pid) for pid in (self.pid, *_children(self.pid)))


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _children(pid: int) -> list[int]:
    found = [int(word) for word in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]
    return found + [one for child in found for one in _children(child)]


@contextmanager
def served(toml: str, folder: Path) -> Iterator[Served]:
    """A study served from a folder."""
    path = folder / "load.toml"
    path.write_text(toml)
    command = [sys.executable, "-m", "minihuman", "serve", str(path), "--data", str(folder), "--port", "0"]
    with subprocess.Popen([*command, "--links", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        host = next(line for line in process.stdout if "http://" in line).split("http://")[1].strip().rstrip("/")
        try:
            yield Served(host, process.pid)
        finally:
            process.terminate()
            process.wait(timeout=60)


async def _take_part(
    pages: list[TypedPage], server: Served, seconds: float, settle_s: float
) -> tuple[float, float, int]:
    """Let people come one after the other, then watch; the server's CPU seconds, steps and the pages that broke."""
    tasks = []
    for page in pages:
        tasks.append(asyncio.create_task(page.take_part()))
        await asyncio.sleep(0.1)
    await asyncio.sleep(settle_s)
    for page in pages:
        page.counts.acked_s.clear()
    cpu_s, steps = server.cpu_s(), sum(page.counts.presses for page in pages)
    await asyncio.sleep(seconds)
    cpu_s, steps = server.cpu_s() - cpu_s, sum(page.counts.presses for page in pages) - steps
    broken = sum(task.done() for task in tasks)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return cpu_s, steps, broken


def load(kind: str, *, people: int, seconds: float, rtt_s: float, settle_s: float, keys_per_s: float) -> str:
    """A line of what one world costs."""
    world, size, actions, computed = KINDS[kind]
    computes = world if computed == "page" else ""
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name:
        folder = Path(name)
        tokens = Recruitment(folder / "load").issue(people)
        with served(TOML.format(world=world, size=size, actions=actions, computed=computed), folder) as server:
            pages = [
                TypedPage(server.host, token, keys_per_s=keys_per_s, rtt_s=rtt_s, rng=rng, computes=computes)
                for rng, token in zip(map(random.Random, range(people)), tokens, strict=True)
            ]
            cpu_s, steps, broken = asyncio.run(_take_part(pages, server, seconds, settle_s))
    counts = [page.counts for page in pages]
    presses = sum(count.presses for count in counts)
    acked_ms = [s * 1e3 for count in counts for s in count.acked_s] or [float("nan")]
    median, p95, p99 = np.percentile(acked_ms, (50, 95, 99))
    cpu_ms = cpu_s / max(1, steps) * 1e3
    down, up = (sum(getattr(count, way) for count in counts) / max(1, presses) for way in ("bytes", "sent_bytes"))
    ahead = 100 * sum(count.ahead for count in counts) / max(1, presses)
    return (
        f"{kind:8} {people:6} {steps / seconds:8.1f} {cpu_s / seconds:6.2f} {cpu_ms:9.2f} "
        f"{FULL / (keys_per_s * cpu_ms / 1e3):11.0f} {up:8.0f} {down:8.0f} "
        f"{ahead:7.1f} {median:8.0f} {p95:6.0f} {p99:6.0f} {broken:7}"
    )


def joins(protocol: Protocol, *, taken: int, times: int) -> str:
    """What a join costs where many came before."""
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name:
        arrivals = Arrivals(protocol, Path(name))
        tokens = arrivals.recruits.issue(taken + times)
        for token in tokens[:taken]:
            arrivals.arrive(Arrival(token))
        cpu_ms = []
        for token in tokens[taken:]:
            began_s = time.process_time()
            arrivals.arrive(Arrival(token))
            cpu_ms.append((time.process_time() - began_s) * 1e3)
    median, p95 = np.percentile(cpu_ms, (50, 95))
    return (
        f"a join with {taken} of {protocol.study.participants} slots taken: median {median:.1f} ms CPU, 95 % {p95:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*", default=list(KINDS), help=f"of {', '.join(KINDS)}")
    parser.add_argument("--people", type=int, default=20)
    parser.add_argument("--keys", type=float, default=2.0, help="per second, of each")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--settle", type=float, default=10.0)
    parser.add_argument("--rtt-ms", type=float, default=100.0)
    parser.add_argument("--taken", type=int, default=500)
    asked = parser.parse_args()
    packages = ", ".join(f"{name} {version(name)}" for name in ("minihuman", "uvicorn", "starlette", "websockets"))
    print(f"{packages}; Python {sys.version.split()[0]}; {asked.keys:g} keys/s each, line {asked.rtt_ms:g} ms")
    print(
        "world    people  steps/s  cores  ms/step  people/core  bytes up     down  shown%  acked: p50    p95    p99"
        "  broken",
        flush=True,
    )
    for kind in asked.kinds:
        line_s, settle_s = asked.rtt_ms / 1e3, asked.settle
        times = {"seconds": asked.seconds, "rtt_s": line_s, "settle_s": settle_s, "keys_per_s": asked.keys}
        print(load(kind, people=asked.people, **times), flush=True)
    grid = {"world": KINDS["grid"][0], "size": "[400, 300]", "actions": GRID, "computed": "page"}
    protocol = decode_protocol(TOML.format(**grid).encode())
    print(joins(protocol, taken=asked.taken, times=20))
    longer = msgspec.structs.replace(protocol, study=msgspec.structs.replace(protocol.study, participants=5000))
    print(joins(longer, taken=asked.taken, times=20))


if __name__ == "__main__":
    main()
