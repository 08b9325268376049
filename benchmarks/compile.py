"""What compiling costs the first time: seconds and CPU-seconds of each part, with nothing in the cache and again after.

    python -m benchmarks.compile [--kernels N] [PART ...]

Each part runs in fresh processes with a cache folder of its own; a second process that a part starts is counted with
it. ``--kernels`` lists the N functions that took longest, without what they call in turn.
"""

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

STUDY = """
from pathlib import Path
from msgspec.structs import replace
from minihuman.lab.protocol_file import read_protocol
from minihuman.seats.warm_up import warm_up
study = read_protocol(Path("protocols/fourrooms-transfer.toml"))
warm_up(replace(study, blocks=[block for block in study.blocks if "{}" in block.world]))
"""
PLAN = """
from minihuman.worlds.adapt.world import World
world = World("minihuman/{}-FourRooms-v0")
world.reset(0)
world.way()
"""
PARTS = {
    # as `minihuman run` and `minihuman demo` do it
    "grid": STUDY.format("MiniGrid"),
    "first person": STUDY.format("MiniWorld"),
    "session": STUDY.format(""),  # both
    "grid, planned": PLAN.format("MiniGrid"),
    "first person, planned": PLAN.format("MiniWorld"),
}
LISTEN = """
import atexit, time
from numba.core import event

class Times(event.Listener):
    def __init__(self):
        self.inner, self.lines = [], []
    def on_start(self, event):
        self.inner.append([time.process_time(), 0.0])
    def on_end(self, event):
        start, inner = self.inner.pop()
        seconds = time.process_time() - start
        if self.inner:
            self.inner[-1][1] += seconds
        self.lines.append((seconds - inner, event.data["dispatcher"].py_func))

def show():
    for seconds, function in sorted(times.lines, key=lambda line: -line[0])[:{count}]:
        print(f"    {{seconds:6.2f}} {{function.__module__}}.{{function.__qualname__}}")

times = Times()
event.register("numba:compile", times)
atexit.register(show)
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], metavar="PART", help=f"of {', '.join(PARTS)}")
    parser.add_argument("--kernels", type=int, default=0, metavar="N")
    asked = parser.parse_args()
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{'':22} {'cold: s':>8} {'CPU s':>7} {'again: s':>9} {'CPU s':>7}")
    for part in asked.parts or PARTS:
        with tempfile.TemporaryDirectory() as cache:
            listen = LISTEN.format(count=asked.kernels) if asked.kernels else ""
            cold, cold_cpu, slowest = run(listen + PARTS[part], Path(cache))
            again, again_cpu, _ = run(PARTS[part], Path(cache))
        print(f"{part:22} {cold:8.1f} {cold_cpu:7.1f} {again:9.1f} {again_cpu:7.1f}\n{slowest}", end="", flush=True)


def run(code: str, cache: Path) -> tuple[float, float, str]:
    """Seconds, CPU-seconds with those of its own processes, and what it printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    printed = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=True,
    ).stdout
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, cpu, printed


if __name__ == "__main__":
    main()
