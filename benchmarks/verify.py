"""What it costs to verify a session, beside another checkout, in turn and in one run.

    python -m benchmarks.verify [--against CHECKOUT] [--sessions N] [--rounds N] [--played FOLDER] [--out FILE]

People are simulated in four studies: grid and first person (fourrooms-transfer), instructed grids (BabyAI), first
person alone, and teams; the other checkout's software simulates them if one is given. A folder of ``--played`` has
these studies already. In each round, each checkout verifies every log once, in a process of its own, after one log that
does not count. Prints the processor-milliseconds of a session, the least of all rounds, and how many times as many the
other checkout needs; ``--out`` stores the same as JSON.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from pathlib import Path

from benchmarks.store import HERE

PROTOCOLS = ("fourrooms-transfer", "instructions", "baseline-first-person", "team")
CODE = """
import json, sys, time
from pathlib import Path
from minihuman.admin.verify.log import verify_session
logs = [Path(name) for name in json.load(sys.stdin)]
list(verify_session(logs[0]))
began = time.process_time()
findings = [finding for log in logs for finding in verify_session(log)]
spent = time.process_time() - began
print(json.dumps({"cpu_s": spent, "failed": [text for text, ok in findings if not ok]}))
"""


def run_python(checkout: Path, *arguments: object, stdin: str = "") -> str:
    """Run Python with a checkout's software; what it prints."""
    interpreter = checkout / ".venv" / "bin" / "python"  # an older checkout needs other releases of its libraries
    done = subprocess.run(
        [interpreter if interpreter.exists() else sys.executable, *map(str, arguments)],
        input=stdin,
        env=os.environ | {"PYTHONPATH": str(checkout)},
        cwd=checkout,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


def simulate(checkout: Path, protocol: Path, people: int, data: Path) -> None:
    """Simulate the participants of a study."""
    run_python(checkout, "-m", "minihuman", "simulate", protocol, "--participants", people, "--data", data)


def verify(checkout: Path, logs: list[Path]) -> float:
    """Verify logs with a checkout's software in a process of its own; processor-seconds of a session."""
    measured = json.loads(
        run_python(checkout, "-c", CODE, stdin=json.dumps([str(log) for log in logs])).splitlines()[-1]
    )
    assert not measured["failed"], measured["failed"][:3]
    return float(measured["cpu_s"]) / len(logs)


def compare(study: Path, checkouts: dict[str, Path], *, sessions: int, rounds: int) -> dict[str, float]:
    """Verify a study's first sessions in turn; the least processor-milliseconds of a session, by checkout."""
    logs = sorted(study.rglob("*.mcap"))[:sessions]
    spent_s: dict[str, list[float]] = {name: [] for name in checkouts}
    for _ in range(rounds):
        for name, checkout in checkouts.items():
            spent_s[name].append(verify(checkout, logs))
    return {"sessions": len(logs), **{name: round(1000 * min(times_s), 1) for name, times_s in spent_s.items()}}


def main() -> None:
    """Simulate the studies and verify them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--against", type=Path, default=None)
    parser.add_argument("--sessions", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--played", type=Path, default=None)
    parser.add_argument("--out", type=Path, default=None)
    arguments = parser.parse_args()
    checkouts = {"here": HERE} | ({"against": arguments.against} if arguments.against else {})
    record: dict[str, object] = {
        "date": datetime.now(UTC).date().isoformat(),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "unit": "CPU-ms per session, least of the rounds",
        "rounds": arguments.rounds,
    }
    with tempfile.TemporaryDirectory() as name:
        played = arguments.played or Path(name)
        for protocol in PROTOCOLS:
            if arguments.played is None:
                path = HERE / "protocols" / f"{protocol}.toml"
                simulate(arguments.against or HERE, path, arguments.sessions, played)
            study = min(path for path in played.rglob(f"{protocol}*") if path.is_dir())
            measured = compare(study, checkouts, sessions=arguments.sessions, rounds=arguments.rounds)
            record[protocol] = measured
            times = f", {measured['against'] / measured['here']:.2f} times" if "against" in measured else ""
            print(f"{protocol}: {measured}{times}", flush=True)
    if arguments.out:
        arguments.out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
