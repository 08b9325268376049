"""What a first start costs: seconds and CPU-seconds of each part, with nothing in the cache and again after.

    python -m benchmarks.compile [--kernels N] [PART ...]

Each part runs in fresh processes with a cache folder of its own; a second process that a part starts is counted with
it. Where a platform's wheel is installed, "cold" is what its machine code makes of it. ``--kernels`` lists the N
functions that took longest to compile, without what they call in turn.
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
from minihuman.admin.protocol_file import read_protocol
from minihuman.runtime.warm_up import warm_up
study = read_protocol(Path("protocols/fourrooms-transfer.toml"))
warm_up(replace(study, blocks=[block for block in study.blocks if "{}" in block.world]))
"""
PLAN = """
from minihuman.worlds.adapters.world import World
world = World("minihuman/{}-FourRooms-v0")
world.reset(0)
world.shortest_path()
"""
COMMAND = """
import sys
sys.argv[1:] = "{}".split()
from minihuman.cli import main
main()
"""
PICTURE = """
from msgspec.structs import replace
from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.runtime.warm_up import share_compilation, warm_up
study = read_protocol(find_shipped_protocol("demo"))
first, *others = study.blocks
with share_compilation([first], others, plans=True) as process:
    warm_up(replace(study, blocks=(first,)), process=process)
"""
DEMO = "protocols/demo.toml"
SESSIONS = 10  # of the demo's study, which are plotted and reported
PARTS = {
    # as `minihuman run` and `minihuman demo` do it
    "grid": STUDY.format("MiniGrid"),
    "first person": STUDY.format("MiniWorld"),
    "session": STUDY.format(""),  # both
    "grid, planned": PLAN.format("MiniGrid"),
    "first person, planned": PLAN.format("MiniWorld"),
    "demo's first picture": PICTURE,  # what comes before its window opens
    "demo": COMMAND.format("demo --data {folder}/demo"),  # without a display: played, proved and drawn
    "help": COMMAND.format("--help"),
    "plot": COMMAND.format("plot {log} --out {folder}/figures"),
    "report": COMMAND.format("report {sessions} --out {folder}/report"),
}
PEAK = """
import atexit, pathlib, resource
peak = pathlib.Path("{}")
atexit.register(lambda: peak.write_text(str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)))
"""
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
    print(f"{'':22} {'cold: s':>8} {'CPU s':>7} {'again: s':>9} {'CPU s':>7} {'MB':>6}")
    with tempfile.TemporaryDirectory() as scratch:
        parts = asked.parts or list(PARTS)
        told = {"folder": scratch, "sessions": "", "log": ""}
        if {"plot", "report"} & set(parts):
            played = Path(scratch, "played")
            run(COMMAND.format(f"simulate {DEMO} --participants {SESSIONS} --data {played}"), Path(scratch, "cache"))
            told |= {"sessions": str(played / "demo"), "log": str(next(played.rglob("*.mcap")))}
        for number, part in enumerate(parts):
            code = PARTS[part]
            for name, value in told.items():
                code = code.replace(f"{{{name}}}", value)
            cache, peak = Path(scratch, f"cache-{number}"), Path(scratch, "peak")
            listen = LISTEN.format(count=asked.kernels) if asked.kernels else ""
            cold, cold_cpu, slowest = run(listen + code, cache)
            again, again_cpu, _ = run(PEAK.format(peak) + code, cache)
            times = f"{cold:8.1f} {cold_cpu:7.1f} {again:9.1f} {again_cpu:7.1f} {int(peak.read_text()):6}"
            print(f"{part:22} {times}\n{slowest if asked.kernels else ''}", end="", flush=True)


def run(code: str, cache: Path) -> tuple[float, float, str]:
    """Seconds, CPU-seconds with those of its own processes, and what it printed."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env={name: value for name, value in os.environ.items() if "DISPLAY" not in name}
        | {"NUMBA_CACHE_DIR": str(cache)},
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode != 0:
        sys.exit(f"{ran.stderr}\n{code}\nfailed")
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, cpu, ran.stdout


if __name__ == "__main__":
    main()
