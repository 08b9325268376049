"""How long a study's tables take, from logs to Parquet and CSV, and whether memory grows with the study.

    python -m benchmarks.tables [SESSIONS]

Makes one study of 200 sessions of ten episodes each (or as many as asked), reads it on two cores, and prints the time
and the highest memory. The logs are copies of eight different sessions, each under its own name.
"""

import resource
import sys
import tempfile
import time
from pathlib import Path

from minihuman.report.study import Reading, Session, read_study
from minihuman.report.writing import write_tables
from tests.builders import session, write_log

DIFFERENT = 8


def make_study(folder: Path, sessions: int) -> Path:
    """A study's folder with that many finished logs."""
    first = [
        write_log(session(participant=f"sub-{index:05}", index=index, seed=index), folder)
        for index in range(min(DIFFERENT, sessions))
    ]
    study = folder / "transfer"
    for index in range(len(first), sessions):
        where = study / f"sub-{index:05}" / "ses-01"
        where.mkdir(parents=True)
        (where / f"sub-{index:05}_ses-01.mcap").hardlink_to(first[index % len(first)])
    return study


def main() -> None:
    """Time the tables and print them."""
    sessions = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    with tempfile.TemporaryDirectory() as folder:
        study = make_study(Path(folder), sessions)
        steps = 0

        def rows():
            nonlocal steps
            for one in read_study(study, Reading(with_shortest=False), processes=2):
                if not isinstance(one, Session):
                    raise SystemExit(f"{one.path}: {one.reason}")
                steps += one.rows["steps"].num_rows
                yield one.rows

        began = time.perf_counter()
        write_tables(rows(), Path(folder) / "out")
        took = time.perf_counter() - began
    mine, workers = (
        resource.getrusage(who).ru_maxrss / 1024 for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print(f"{sessions} sessions, {steps} steps: {took:.2f} s to Parquet and CSV on two cores")
    print(f"highest memory: {mine:.0f} MiB in the writer, {workers:.0f} MiB in a reader")


if __name__ == "__main__":
    main()
