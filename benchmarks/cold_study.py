"""What a large study costs that nobody has read yet: an export, a query, a report and one participant.

    python -m benchmarks.cold_study [SESSIONS] [--study FOLDER]

Makes a study of that many sessions as ``benchmarks.store`` does, or takes one that is there. Every command runs in a
process of its own; "cold" has no cache of the study's, "then" those that the commands above it left. Prints
processor-seconds of the command and all that it started, and the highest memory of the largest of its processes.
"""

import argparse
import tempfile
from pathlib import Path

from benchmarks.store import DIFFERENT, HERE, forget, make, measure, run

COUNT = "select count(*) from steps"
ONE = "import sys, minihuman; print(len(minihuman.open_study(sys.argv[1])['sub-00003']))"


def show(name: str, spent: tuple[float, float]) -> None:
    """Print one line."""
    print(f"{name:34} {spent[0]:7.1f} CPU-s {spent[1]:7.0f} MiB", flush=True)


def compare(study: Path, folder: Path) -> None:
    """Measure every command."""
    forget(study)
    show("cold: study['sub-00003']", measure(HERE, "-c", ONE, study))
    show("cold: export parquet", run(HERE, "export", "parquet", study, folder / "parquet"))
    show("then: query, a count", run(HERE, "query", study, COUNT))
    show("then: report", run(HERE, "report", study, "--out", folder / "report"))
    show("then: report of the same", run(HERE, "report", study, "--out", folder / "report"))
    forget(study)
    show("cold: query, a count", run(HERE, "query", study, COUNT))
    forget(study)
    show("cold: report", run(HERE, "report", study, "--out", folder / "another"))


def main() -> None:
    """Make the study and measure."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sessions", nargs="?", type=int, default=1_000)
    parser.add_argument("--study", type=Path, default=None)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        study = asked.study
        if study is None:
            protocol = HERE / "protocols" / "fourrooms-transfer.toml"
            run(HERE, "simulate", protocol, "--participants", DIFFERENT, "--data", folder / "played")
            study = make(folder / "fourrooms-transfer", sorted((folder / "played").rglob("*.mcap")), asked.sessions)
        compare(study, folder)


if __name__ == "__main__":
    main()
