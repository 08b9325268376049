"""Time and memory to list a study of many sessions, the first time and again; and to read one session.

python benchmarks/log_folder.py [SESSIONS ...]
"""

import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

from minihuman.admin.session_index import read_session_index
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.log.read.session_reader import read_log
from tests.log.played import record
from tests.log.samples import session_events, session_plan

DEFAULT = (100, 1000)


def main() -> None:
    sizes = [int(size) for size in sys.argv[1:]] or DEFAULT
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plan = session_plan(episodes=10)
        log = record(folder / "one", plan, session_events(plan, steps=50))
        print(f"open_log, 10 episodes, 500 steps: {1e3 * _seconds(lambda: read_log(log)):.1f} ms")
        print(f"{'sessions':>8} {'first list s':>12} {'again s':>8} {'peak MiB':>8}")
        for size in sizes:
            study = folder / str(size)
            _study(study, size)
            first, again = _seconds(lambda study=study: _list(study)), _seconds(lambda study=study: _list(study))
            (study / TABLE_CACHE).unlink()
            print(f"{size:8} {first:12.2f} {again:8.3f} {_peak_mib(lambda study=study: _list(study)):8.2f}")


def _study(study: Path, size: int) -> None:
    """Many sessions of one short episode: one log under many names."""
    plan = session_plan(episodes=1)
    log = record(study.with_name(f"{study.name}-log"), plan, session_events(plan, steps=5))
    for number in range(size):
        path = study / f"sub-{number:05d}" / "ses-01" / f"sub-{number:05d}_ses-01.mcap"
        path.parent.mkdir(parents=True)
        path.hardlink_to(log)


def _list(study: Path) -> None:
    for row in read_session_index(study):
        assert row.summary is not None, row.problem


def _seconds(work: Callable[[], Any]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def _peak_mib(work: Callable[[], Any]) -> float:
    tracemalloc.start()
    work()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak / 2**20


if __name__ == "__main__":
    main()
