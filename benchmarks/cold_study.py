"""What a large study costs: when nobody has read it, then with what was kept, then with one session more.

    python -m benchmarks.cold_study [SESSIONS ...] [--episodes N] [--study FOLDER]

Makes a study of that many sessions as ``benchmarks.store`` does, with N episodes in a block if that is given, or takes
one that is there. Every command runs in a process of its own; "cold" has no cache of the study's, "then" those that the
commands above it left, "one more" a session that was added. Prints processor-seconds of the command and all that it
started, and the highest memory of the largest of its processes; of several sizes, what a straight line through the
last two says of 100,000. Of more than 1,000 sessions, query and report are not measured cold.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.store import DIFFERENT, HERE, forget, make, measure, run
from tests.copied import as_another

COUNT = "select count(*) from steps"
MEDIANS = "select participant, median(response_ms) from steps group by participant"
ONE = "import sys, minihuman; print(len(minihuman.open_study(sys.argv[1])['sub-00003']))"
MOST_COLD = 1_000  # sessions
AIM = 100_000


def compare(study: Path, out: Path, sessions: int) -> Iterator[tuple[str, tuple[float, float]]]:
    """Measure every command."""
    again = {
        "query, a count": ("query", study, COUNT),
        "query, medians": ("query", study, MEDIANS),
        "report": ("report", study, "--out", out / "report"),
        "report of the same": ("report", study, "--out", out / "report"),
    }
    more = {"status": ("status", study), **again}
    forget(study)
    yield "cold: status", run(HERE, "status", study)
    yield "then: status", run(HERE, "status", study)
    forget(study)
    yield "cold: study['sub-00003']", measure(HERE, "-c", ONE, study)
    yield "cold: export parquet", run(HERE, "export", "parquet", study, out / "parquet")
    for name, command in again.items():
        yield f"then: {name}", run(HERE, *command)
    run(HERE, "status", study)  # whose index was forgotten above
    log = min(study.rglob("*.mcap"))
    for number, name in enumerate(("status", "query, medians", "report"), sessions):
        as_another(log, f"sub-{number:05}", study, with_end=True)
        yield f"one more: {name}", run(HERE, *more[name])
    if sessions <= MOST_COLD:
        forget(study)
        yield "cold: query, a count", run(HERE, "query", study, COUNT)
        forget(study)
        yield "cold: report", run(HERE, "report", study, "--out", out / "another")


def main() -> None:
    """Make the studies and measure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sessions", nargs="*", type=int, default=[1_000])
    parser.add_argument("--episodes", type=int, default=10)
    parser.add_argument("--study", type=Path, default=None)
    asked = parser.parse_args()
    spent: dict[str, list[tuple[int, float]]] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        protocol = folder / "fourrooms-transfer.toml"
        shipped = (HERE / "protocols" / protocol.name).read_text(encoding="utf-8")
        protocol.write_text(shipped.replace("episodes = 10", f"episodes = {asked.episodes}"), encoding="utf-8")
        if asked.study is None:
            run(HERE, "simulate", protocol, "--participants", DIFFERENT, "--data", folder / "played")
        played = sorted((folder / "played").rglob("*.mcap"))
        for sessions in asked.sessions:
            study = asked.study or make(folder / str(sessions) / protocol.stem, played, sessions)
            print(f"{sessions} sessions", flush=True)
            for what, (cpu_s, mib) in compare(study, folder / f"{sessions}-out", sessions):
                print(f"{what:34} {cpu_s:7.1f} CPU-s {mib:7.0f} MiB", flush=True)
                spent.setdefault(what, []).append((sessions, cpu_s))
    for what, points in spent.items():
        if len(points) > 1 and points[-1][0] > points[-2][0]:
            (few, less), (many, more) = points[-2:]
            print(f"{what:34} {more + (more - less) / (many - few) * (AIM - many):7.0f} CPU-s at {AIM}, by its slope")


if __name__ == "__main__":
    main()
