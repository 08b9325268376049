"""Train job files with several seeds, and count in how many runs the policy solves the last of its worlds.

    python analysis/job_runs.py analysis/ppo --jobs door-key-8x8-stages key-corridor-s3r3-stages --seeds 5

Adds to `job_runs.csv` (success in fresh episodes, CPU-seconds) and `job_runs_curves.csv` (a curve of at most 200 points
a run) in the folder; what is there is not run again. Prints a table: a run counts if 0.9 of its fresh episodes in the
job's last world succeed.
"""

import argparse
import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd

from minihuman.learn.training import train
from minihuman.learn.training_settings import TrainingJob, read_job
from ppo_curves import LEARNED
from warm_start import add_rows

RUNS = "job_runs.csv"
CURVES = "job_runs_curves.csv"
MOST_POINTS = 200


def run_job(folder: Path, name: str, seed: int) -> None:
    """Train with a job file and a seed; add the curve and the success in fresh episodes to the folder's tables."""
    job = read_job(folder / f"{name}.toml")
    job = TrainingJob(job.worlds, replace(job.settings, seed=seed))
    with tempfile.TemporaryDirectory() as made:
        report = train(job, Path(made, "policy.pt"))
    run = {"job": name, "seed": seed}
    step = -(-len(report.points) // MOST_POINTS)  # rounded up
    last = report.points[-1]
    rows = [run | asdict(point) for point in (*report.points[:-1:step], last)]
    add_rows(folder / CURVES, rows)
    used = {"steps": last.steps, "cpu_s": round(last.cpu_s, 1)}
    for world, fresh in zip(job.worlds, report.evaluations, strict=True):
        add_rows(folder / RUNS, [run | used | {"world": world.id, "episodes": fresh.episodes, "success": fresh.rate}])


def describe(runs: pd.DataFrame) -> str:
    """The table in Markdown: for each job its last world, and success there in fresh episodes."""
    lines = ["| job | last world | solved | success, each run | steps | CPU-seconds |", "|---|---|---|---|---|---|"]
    for name, rows in runs.groupby("job"):
        last = rows[rows["world"] == rows["world"].iloc[-1]]
        solved = f"{(last['success'] >= LEARNED).sum()} of {len(last)}"
        each = ", ".join(f"{rate:.3g}" for rate in last["success"])
        cpu_s = f"{last['cpu_s'].min():.0f} to {last['cpu_s'].max():.0f}"
        lines.append(f"| {name} | {last['world'].iloc[0]} | {solved} | {each} | {last['steps'].max():,} | {cpu_s} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", nargs="+", required=True, help="names of job files, without .toml")
    parser.add_argument("--seeds", type=int, default=5)
    asked = parser.parse_args()
    table = asked.folder / RUNS
    for seed in range(1, asked.seeds + 1):
        for name in asked.jobs:
            done = pd.read_csv(table) if table.exists() else pd.DataFrame({"job": [], "seed": []})
            if not ((done["job"] == name) & (done["seed"] == seed)).any():
                run_job(asked.folder, name, seed)
    print(describe(pd.read_csv(table)))


if __name__ == "__main__":
    main()
