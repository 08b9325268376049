"""CPU of a key in a browser session, by this checkout's server and by another's, side by side in one run.

    python -m benchmarks.web_builds ../earlier ../earlier/.venv/bin/python grid ahead --rounds 3

Each checkout's own `benchmarks.web_load` starts its server and its pages, which speak the messages of that checkout;
both run at the same time, the one that starts first changing with each round, so that what slows the machine down slows
both. In turn, the ratio of a build to itself varied by a tenth. CPU seconds of the server count.
"""

import argparse
import os
import re
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

HERE = Path(__file__).parents[1]
MEASURED = re.compile(r"^(?P<kind>\S+) +\d+ +(?P<steps>[\d.]+) +[\d.]+ +(?P<cpu_ms>[\d.]+) +(?P<people>[\d.]+) ")


def measure(checkout: Path, python: str, kind: str, options: list[str]) -> tuple[float, float]:
    """Return the CPU milliseconds of a step and the people that a core serves, by a checkout's own benchmark."""
    # without slots taken, `joins` measures nothing
    command = [python, "-m", "benchmarks.web_load", kind, *options, "--taken", "1"]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    process = subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True)
    if process.returncode != 0:
        raise SystemExit(f"{checkout} failed:\n{process.stderr[-3000:]}")
    for line in process.stdout.splitlines():
        measured = MEASURED.match(line)
        if measured and measured["kind"] == kind:
            return float(measured["cpu_ms"]), float(measured["people"])
    raise SystemExit(f"{checkout} printed no line of {kind}:\n{process.stdout}")


def describe_commit(checkout: Path) -> str:
    """Return a checkout's commit in short."""
    command = ["git", "-C", str(checkout), "rev-parse", "--short", "HEAD"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="of an earlier commit")
    parser.add_argument("python", help="that has the packages of that checkout")
    parser.add_argument("kinds", nargs="*", default=["grid", "ahead"], help="as of benchmarks.web_load")
    parser.add_argument("--people", default="20")
    parser.add_argument("--seconds", default="30")
    parser.add_argument("--settle", default="10")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    options = ["--people", asked.people, "--seconds", asked.seconds, "--settle", asked.settle]
    builds = {"ours": (HERE, sys.executable), "earlier": (asked.checkout.resolve(), asked.python)}
    print(f"ours {describe_commit(HERE)}, earlier {describe_commit(asked.checkout)}; {' '.join(options)}", flush=True)
    for kind in asked.kinds:
        ratios = []
        for number in range(asked.rounds):
            order = [*builds] if number % 2 == 0 else [*reversed(builds)]
            with ThreadPoolExecutor() as pool:
                started = {name: pool.submit(measure, *builds[name], kind, options) for name in order}
                figures = {name: measured.result() for name, measured in started.items()}
            ratios.append(figures["ours"][0] / figures["earlier"][0])
            texts = [
                f"{name} {cpu_ms:.2f} ms a step, {people:.0f} a core" for name, (cpu_ms, people) in figures.items()
            ]
            print(f"{kind:8} {'; '.join(texts)}; CPU ratio {ratios[-1]:.3f}", flush=True)
        ratio = statistics.median(ratios)
        print(f"{kind:8} CPU a step, ours by earlier: median {ratio:.3f}; people a core: {1 / ratio:.3f}", flush=True)


if __name__ == "__main__":
    main()
