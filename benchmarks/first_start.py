"""What a start costs: seconds and CPU-seconds of each part, each in a fresh process, twice.

    python -m benchmarks.first_start [PART ...]

The library of compiled worlds is used, as everywhere; "build" is what making it costs.
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
from minihuman.experiment.plan.dry_run import check_worlds
study = read_protocol(Path("protocols/fourrooms-transfer.toml"))
check_worlds(replace(study, blocks=[block for block in study.blocks if "{}" in block.world]))
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
from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.experiment.plan.dry_run import check_worlds
import minihuman.runtime.demo
check_worlds(read_protocol(find_shipped_protocol("demo")))
"""
STEPS = """
import gymnasium, minihuman
env = gymnasium.make("minihuman/MiniGrid-FourRooms-v0")
env.reset(seed=0)
for _ in range(100):
    env.step(0)
"""
BUILD = """
import os, subprocess, sys
os.environ["MINIHUMAN_BUILD_CACHE"] = ""  # none: it is made both times
subprocess.run([sys.executable, "-m", "kernel_build", "--native", "{folder}/library"], check=True)
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
    "make, reset, 100 steps": STEPS,
    "build": BUILD,
    "help": COMMAND.format("--help"),
    "plot": COMMAND.format("plot {log} --out {folder}/figures"),
    "report": COMMAND.format("report {sessions} --out {folder}/report"),
}
PEAK = """
import atexit, pathlib, resource
peak = pathlib.Path("{}")
atexit.register(lambda: peak.write_text(str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)))
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], metavar="PART", help=f"of {', '.join(PARTS)}")
    asked = parser.parse_args()
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"{'':22} {'first: s':>8} {'CPU s':>7} {'again: s':>9} {'CPU s':>7} {'MB':>6}")
    with tempfile.TemporaryDirectory() as scratch:
        parts = asked.parts or list(PARTS)
        told = {"folder": scratch, "sessions": "", "log": ""}
        if {"plot", "report"} & set(parts):
            played = Path(scratch, "played")
            run(COMMAND.format(f"simulate {DEMO} --participants {SESSIONS} --data {played}"))
            told |= {"sessions": str(played / "demo"), "log": str(next(played.rglob("*.mcap")))}
        for part in parts:
            code = PARTS[part]
            for name, value in told.items():
                code = code.replace(f"{{{name}}}", value)
            peak = Path(scratch, "peak")
            first, first_cpu = run(code)
            again, again_cpu = run(PEAK.format(peak) + code)
            times = f"{first:8.1f} {first_cpu:7.1f} {again:9.1f} {again_cpu:7.1f} {int(peak.read_text()):6}"
            print(f"{part:22} {times}", flush=True)


def run(code: str) -> tuple[float, float]:
    """Seconds, and CPU-seconds with those of its own processes."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env={name: value for name, value in os.environ.items() if "DISPLAY" not in name},
        capture_output=True,
        text=True,
        check=False,
    )
    if ran.returncode != 0:
        sys.exit(f"{ran.stderr}\n{code}\nfailed")
    seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, cpu


if __name__ == "__main__":
    main()
