"""What a study costs once it is large: status, tables, report, figures and partitioned tables of many sessions, in
processor-seconds.

    python -m benchmarks.store [SESSIONS] [--against CHECKOUT] [--only-gather]

Eight sessions of the shipped study are played by simulated people, by the other checkout's software if one is given,
and each is written again as many other people's: the same messages in a log of its own. Every command then runs in a
process of its own, first with nothing kept and once more, and, where it can be had, with the other checkout beside it.
Processor-seconds are those of the command and all that it started; the other number is the highest memory of the
largest of its processes.
"""

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from minihuman.dataset.caches import list_caches
from tests.copied import as_another

HERE = Path(__file__).parents[1]
DIFFERENT = 8
FIGURES = 20  # sessions; drawing every one's takes seconds each


def run(checkout: Path, *arguments: object) -> tuple[float, float]:
    """Run a command of a checkout's; processor-seconds and MiB."""
    return measure(checkout, "-m", "minihuman", *arguments)


def measure(checkout: Path, *arguments: object) -> tuple[float, float]:
    """Run Python with a checkout's software; processor-seconds and MiB."""
    code = (
        "import resource, runpy, sys; kind, what = sys.argv[1:3]; sys.argv = sys.argv[2:]\n"
        "try: runpy.run_module(what, run_name='__main__') if kind == '-m' else exec(what)\n"
        "finally: print(max(resource.getrusage(who).ru_maxrss for who in (0, -1)), file=sys.stderr)"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=os.environ | {"PYTHONPATH": str(checkout)}, cwd=checkout, capture_output=True, text=True, check=True,
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, int(done.stderr.split()[-1]) / 1024


def make(study: Path, played: list[Path], sessions: int) -> Path:
    """A study of that many people, whose logs say at their end what today's do."""
    for number in range(sessions):
        as_another(played[number % len(played)], f"sub-{number:05}", study, with_end=True)
    return study


def forget(study: Path) -> None:
    """Leave nothing kept."""
    for cache in list_caches(study):
        shutil.rmtree(cache) if cache.is_dir() else cache.unlink()


def compare(folder: Path, studies: dict[int, Path], against: Path | None) -> None:
    """Time every command on every study, here and, if there is one, in the other checkout."""
    commands = {
        "status": lambda study, out: ("status", study),
        "export parquet": lambda study, out: ("export", "parquet", study, out),
        "report": lambda study, out: ("report", study, "--out", out),
        "plot": lambda study, out: ("plot", study, "--out", out),
    }
    for name, command in commands.items():
        for sessions, study in studies.items():
            out = folder / "out"
            forget(study)
            times = []
            for _ in ("first", "again"):
                shutil.rmtree(out, ignore_errors=True)
                times.append(run(HERE, *command(study, out)))
            said = [f"{spent:.1f} s {mib:.0f} MiB" for spent, mib in times]
            if against is not None and (name != "plot" or sessions <= FIGURES):
                forget(study)
                shutil.rmtree(out, ignore_errors=True)
                spent, mib = run(against, *command(study, out))
                said.append(f"{against.name}: {spent:.1f} s {mib:.0f} MiB, {spent / times[1][0]:.1f} times the second")
            print(f"{name:15} {sessions:6} sessions: {'; '.join([', again '.join(said[:2]), *said[2:]])}", flush=True)


def gather(folder: Path, study: Path, log: Path) -> None:
    """Store a study's partitioned tables: first all, then nothing new, then one session more."""
    tables = folder / "tables"
    tables.mkdir()
    (study.parent / "tables.url").write_text(f"{tables}\n", encoding="utf-8")
    forget(study)
    for what in ("all sessions", "nothing new", "one session more"):
        if what == "one session more":
            as_another(log, "sub-99999", study, with_end=True)
        before = len(list(tables.rglob("*.parquet")))
        spent, mib = run(HERE, "gather", study)
        files = list(tables.rglob("*.parquet"))
        size = sum(file.stat().st_size for file in files) / 2**20
        print(
            f"gather, {what}: {spent:.1f} s {mib:.0f} MiB; {len(files) - before} files written, now {len(files)} of "
            f"{size:.1f} MiB",
            flush=True,
        )


def main() -> None:
    """Make the studies and time them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sessions", nargs="?", type=int, default=1_000)
    parser.add_argument("--against", type=Path, default=None)
    parser.add_argument("--only-gather", action="store_true")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        protocol = HERE / "protocols" / "fourrooms-transfer.toml"
        how = ("--participants", DIFFERENT, "--data", folder / "played")
        run(asked.against or HERE, "simulate", protocol, *how)
        played = sorted((folder / "played").rglob("*.mcap"))
        sizes = sorted({FIGURES, asked.sessions // 10, asked.sessions} - {0})
        studies = {size: make(folder / str(size) / "fourrooms-transfer", played, size) for size in sizes}
        if not asked.only_gather:
            compare(folder, studies, asked.against)
        gather(folder, studies[asked.sessions], played[0])


if __name__ == "__main__":
    main()
