"""How many people one core serves in a browser: steps, bytes, latency and the server's CPU, worlds in turn in one run.

    python -m benchmarks.web_load --people 40 --seconds 60
    python -m benchmarks.web_load turns ticks --people 40 --keys 3    # pairs in one kitchen; two people are a pair

`grid` is computed in the pages, `ahead` is the same world sent ahead by the server. The people are pages without a
browser in this process, over a line that is delayed here; the server is a process of its own, whose CPU is what counts.
A core is taken as full at 70 %. Joins are timed with 500 and 100,000 slots taken; `joins` alone runs nothing else.
"""

import argparse
import asyncio
import math
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

from minihuman.admin.enrolment_entries import open_enrolment_log, read_enrolled
from minihuman.admin.recruitment import ParticipantArrived, Recruitment, hash_link_token
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.web.arrivals import Admission, Arrival, Arrivals
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
TEAM = """
kind = "team"
pace = {pace}
view = "full"
[blocks.team]
seats = ["person", "person"]
partner_disclosure = "debrief"
late_ms = 100
"""
PACES = {"turns": '"on_key"', "ticks": '"real_time"\nstep_period_ms = 100'}
COOK = '["up", "down", "left", "right", "interact"]'
GRID, ROOMS = '["left", "right", "forward"]', '["turn_left", "turn_right", "move_forward"]'
KINDS = {
    "grid": ("minihuman/MiniGrid-FourRooms-v0", "[400, 300]", GRID, "page"),
    "ahead": ("minihuman/MiniGrid-FourRooms-v0", "[400, 300]", GRID, "server"),
    "turns": ("minihuman/Team-CrampedRoom-v0", "[400, 300]", COOK, "server"),
    "ticks": ("minihuman/Team-CrampedRoom-v0", "[400, 300]", COOK, "server"),
    "80x60": ("minihuman/MiniWorld-FourRooms-v0", "[80, 60]", ROOMS, "server"),
    "first-person": ("minihuman/MiniWorld-FourRooms-v0", "[400, 300]", ROOMS, "page"),
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
        toml = TOML.format(world=world, size=size, actions=actions, computed=computed)
        toml += TEAM.format(pace=PACES[kind]) if kind in PACES else ""
        with served(toml, folder) as server:
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
        f"{FULL / (keys_per_s * cpu_ms / 1e3) if cpu_ms else math.nan:11.0f} {up:8.0f} {down:8.0f} "
        f"{ahead:7.1f} {median:8.0f} {p95:6.0f} {p99:6.0f} {broken:7}"
    )


def joins(protocol: Protocol, *, taken: int, times: int) -> str:
    """What a join costs where many came before; those are written down in one piece."""
    with tempfile.TemporaryDirectory(prefix="minihuman-") as name:
        arrivals, study_dir = Arrivals(protocol, Path(name)), Path(name) / protocol.study.name
        tokens = arrivals.recruits.issue(taken + times)
        arrivals.arrive(Arrival(tokens[0]))
        first = read_enrolled(study_dir)[0]
        codes = [format_participant_code(index) for index in range(1, taken)]
        with open_enrolment_log(study_dir).hold() as register:
            slots = (msgspec.structs.replace(first, index=n, participant=code) for n, code in enumerate(codes, 1))
            register.append(*slots)
        with arrivals.recruits.exclusive() as file:
            keys = map(hash_link_token, tokens[1:])
            file.journal.append(
                *(ParticipantArrived(key, code, first.at) for key, code in zip(keys, codes, strict=False))
            )
        arrivals.arrive(Arrival(tokens[taken]))  # the first of a process reads them all
        cpu_ms = []
        for token in tokens[taken + 1 :]:
            began_s = time.process_time()
            assert isinstance(arrivals.arrive(Arrival(token)), Admission)
            cpu_ms.append((time.process_time() - began_s) * 1e3)
    median, p95 = np.percentile(cpu_ms, (50, 95))
    return (
        f"a join with {taken} of {protocol.study.participants} slots taken: median {median:.1f} ms CPU, 95 % {p95:.1f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "kinds", nargs="*", choices=[*KINDS, "joins"], default=list(KINDS), help=f"of {', '.join(KINDS)}"
    )
    parser.add_argument("--people", type=int, default=20)
    parser.add_argument("--keys", type=float, default=2.0, help="per second, of each")
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--settle", type=float, default=10.0)
    parser.add_argument("--rtt-ms", type=float, default=100.0)
    parser.add_argument("--taken", type=int, nargs="+", default=[500, 100_000], help="slots, when people join")
    asked = parser.parse_args()
    packages = ", ".join(f"{name} {version(name)}" for name in ("minihuman-lab", "uvicorn", "starlette", "websockets"))
    print(f"{packages}; Python {sys.version.split()[0]}; {asked.keys:g} keys/s each, line {asked.rtt_ms:g} ms")
    print(
        "world    people  steps/s  cores  ms/step  people/core  bytes up     down  shown%  acked: p50    p95    p99"
        "  broken",
        flush=True,
    )
    for kind in [kind for kind in KINDS if kind in asked.kinds]:
        line_s, settle_s = asked.rtt_ms / 1e3, asked.settle
        times = {"seconds": asked.seconds, "rtt_s": line_s, "settle_s": settle_s, "keys_per_s": asked.keys}
        print(load(kind, people=asked.people, **times), flush=True)
    grid = {"world": KINDS["grid"][0], "size": "[400, 300]", "actions": GRID, "computed": "page"}
    protocol = decode_protocol(TOML.format(**grid).encode())
    for taken in asked.taken:
        study = msgspec.structs.replace(protocol.study, participants=taken + 1_000)
        print(joins(msgspec.structs.replace(protocol, study=study), taken=taken, times=40), flush=True)


if __name__ == "__main__":
    main()
