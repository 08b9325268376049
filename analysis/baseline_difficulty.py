"""Step limits of the baseline sets, from simulated people: so many steps that eight in ten episodes reach the goal.

    python analysis/baseline_difficulty.py OUT [--people 10] [--levels 20] [--quick]

The people play levels of another seed than the committed sets, with 500 steps for each. A family's
limit is the 80 % quantile of the steps that they took, rounded up to five; an episode without success counts as longer
than any. Writes `baseline_difficulty.csv` into OUT, and keeps the logs in OUT/people.
"""

import argparse
import csv
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from minihuman import open_study
from minihuman.planning.benchmark import FAMILIES, compose_baseline
from minihuman.statistics.scores import wilson_interval

SEED = 20261126
SHARE = 0.8  # of simulated people's episodes that are to reach the goal
MANY = 500  # steps: more than any of them is to take


def simulate_people(kind: str, out: Path, *, people: int, levels: int) -> Path:
    """The study's folder, with people who play where there are none."""
    study = out / "people" / f"baseline-{kind}-{SEED}"
    left = people - len(list(study.rglob("*.mcap")))
    if left > 0:
        path = out / f"people-{kind}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        text = compose_baseline(kind, SEED, levels=levels)
        options = "" if "\noptions = { " in text else f"\noptions = {{ max_steps = {MANY} }}"
        text = text.replace("\noptions = { ", f"\noptions = {{ max_steps = {MANY}, ")
        path.write_text(re.sub(r"\nmax_steps = \d+", f"\nmax_steps = {MANY}{options}", text))
        run = ["simulate", str(path), "--participants", str(left), "--seed", "1", "--data", str(study.parent)]
        subprocess.run([sys.executable, "-m", "minihuman", *run], check=True, stdout=subprocess.DEVNULL)
    return study


def main(out: Path, *, people: int, levels: int) -> None:
    """Write a row for each family of worlds."""
    rows = []
    for kind, families in FAMILIES.items():
        episodes = open_study(simulate_people(kind, out, people=people, levels=levels)).table()
        for family in families:
            its = episodes[episodes["block"] == family.name]
            steps = np.where(its["success"], its["steps"], np.inf)
            wanted = float(np.quantile(steps, SHARE, method="inverted_cdf"))
            limit = int(-(-wanted // 5) * 5) if np.isfinite(wanted) else int(its["steps"].max())
            reached = int((steps <= limit).sum())
            low, high = wilson_interval(reached, len(its))
            rows.append(
                {
                    "family": family.name,
                    "episodes": len(its),
                    "successes": int(its["success"].sum()),
                    "median_steps": float(np.median(steps)),
                    "max_steps": limit,
                    "limit_in_use": family.max_steps,
                    "success_at_limit": round(reached / len(its), 3),
                    "low": round(low, 3),
                    "high": round(high, 3),
                }
            )
    with (out / "baseline_difficulty.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    print(out / "baseline_difficulty.csv")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--levels", type=int, default=20, help="of each family")
    parser.add_argument("--quick", action="store_true", help="tiny, to see that it runs")
    given = parser.parse_args()
    if given.quick:
        given.people, given.levels = 2, 1
    main(given.out, people=given.people, levels=given.levels)
