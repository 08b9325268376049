"""PPO from a clone of people beside PPO alone: steps until 0.9 of the latest 100 episodes succeeded.

    python analysis/warm_start.py analysis/ppo --worlds door-key-5x5 --seeds 5

Runs the job files `WORLD-plain.toml`, `WORLD-people.toml` and `WORLD-people-kl.toml` of a folder with each seed, in
turn, and adds to `warm_start.csv` (curves) and `warm_start_fresh.csv` (success in fresh episodes) there; what is there
is not run again. Draws the curves as `warm_start.svg`. A run that did not reach 0.9 counts with all of its steps. The
study that is cloned is simulated first if it is missing.
"""

import argparse
import csv
import math
import tempfile
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

from minihuman import simulate
from minihuman.learn.batch_ppo import CurvePoint
from minihuman.learn.training import TrainingStoppedError, train
from minihuman.learn.training_settings import TrainingJob, change_settings, read_job
from ppo_curves import JUDGED, LEARNED, summarise

ARMS = ("plain", "people", "people-kl")
NAMES = {"plain": "PPO alone", "people": "from a clone of people", "people-kl": "from a clone, held near it"}
CURVES = "warm_start.csv"
FRESH = "warm_start_fresh.csv"


def train_arm(folder: Path, world: str, arm: str, changes: dict[str, Any], *, until: float = math.inf) -> None:
    """Train with a job file and changed settings, and add the curve and the evaluation to the folder's tables.

    The training ends once a share ``until`` of the latest 100 episodes succeeded, or with the steps.
    """
    job = read_job(folder / f"{world}-{arm}.toml")
    job = TrainingJob(job.worlds, change_settings(job.settings, changes))
    study = Path(job.settings.from_people)
    if job.settings.from_people and not study.exists():
        list(simulate(folder / f"{study.name}.toml", participants=20, seed=3, data=study.parent))

    def follow(point: CurvePoint, curriculum: object) -> None:
        if point.success >= until and point.episodes >= JUDGED:
            raise TrainingStoppedError

    with tempfile.TemporaryDirectory() as made:
        report = train(job, Path(made, "policy.pt"), follow=follow)
    run = {"world": world, "arm": arm, "seed": job.settings.seed}
    add_rows(folder / CURVES, [run | asdict(point) for point in report.points])
    for fresh in report.evaluations:
        by_clone = "" if report.clone is None else report.clone.rate
        add_rows(folder / FRESH, [run | {"episodes": fresh.episodes, "success": fresh.rate, "clone": by_clone}])


def add_rows(path: Path, rows: list[dict[str, Any]]) -> None:
    """Add rows to a CSV file, with a header if it is new."""
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerows(rows)


def read_steps(path: Path) -> dict[tuple[str, str], dict[int, tuple[int, bool]]]:
    """By world and arm, for each seed the steps until 0.9, and whether it was reached; else the run's steps."""
    reached: dict[tuple[str, str], dict[int, tuple[int, bool]]] = defaultdict(dict)
    if path.exists():
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                runs = reached[row["world"], row["arm"]]
                seed = int(row["seed"])
                if not runs.get(seed, (0, False))[1]:
                    learned = float(row["success"]) >= LEARNED and int(row["episodes"]) >= JUDGED
                    runs[seed] = int(row["steps"]), learned
    return dict(reached)


def draw(folder: Path) -> None:
    """Draw success over steps, a panel for each world and a line for each run."""
    curves = pd.read_csv(folder / CURVES)
    worlds = sorted(curves["world"].unique())
    figure, axes = plt.subplots(1, len(worlds), figsize=(4.5 * len(worlds), 3.2), squeeze=False, sharey=True)
    for axis, world in zip(axes[0], worlds, strict=True):
        for number, arm in enumerate(ARMS):
            runs = curves[(curves["world"] == world) & (curves["arm"] == arm)].groupby("seed")
            for run, (_, curve) in enumerate(runs):
                shown = curve[curve["episodes"] >= JUDGED]  # of the first that end, hardly any failed: those are long
                label = NAMES[arm] if run == 0 else None
                style = {"color": f"C{number}", "linewidth": 1, "alpha": 0.7, "label": label}
                axis.plot(
                    shown["steps"], shown["success"], marker="o" if len(shown) == 1 else "", markersize=4, **style
                )
        axis.set(title=world, xlabel="steps", ylim=(0, 1.03))
        axis.set_xlim(left=0)
        axis.locator_params(axis="x", nbins=5)
        axis.legend(fontsize=8, loc="center right")
    axes[0][0].set_ylabel("success of the latest 100 episodes")
    figure.tight_layout()
    figure.savefig(folder / "warm_start.svg")
    plt.close(figure)


def describe(reached: dict[tuple[str, str], dict[int, tuple[int, bool]]]) -> str:
    """The table in Markdown; a ratio is of means over the seeds that both arms have, with a 95 % bootstrap interval."""
    rng = np.random.default_rng(1)
    lines = [
        "| world | start | reached 0.9 | steps to 0.9, interquartile mean | ratio to PPO alone |",
        "|---|---|---|---|---|",
    ]
    for (world, arm), runs in sorted(reached.items(), key=lambda pair: (pair[0][0], ARMS.index(pair[0][1]))):
        steps = [float(count) for count, _ in runs.values()]
        mean, low, high = summarise(steps, rng)
        plain = reached.get((world, "plain"), {})
        shared = sorted(set(runs) & set(plain))
        ratio = "1" if arm == "plain" else "-"
        if arm != "plain" and shared:
            pairs = np.array([(runs[seed][0], plain[seed][0]) for seed in shared], np.float64)
            drawn = pairs[rng.integers(len(pairs), size=(10_000, len(pairs)))].mean(axis=1)
            below, above = np.quantile(drawn[:, 0] / drawn[:, 1], (0.025, 0.975))
            ratio = f"{pairs[:, 0].mean() / pairs[:, 1].mean():.2f} ({below:.2f} to {above:.2f})"
        learned = sum(is_reached for _, is_reached in runs.values())
        lines.append(
            f"| {world} | {arm} | {learned} of {len(runs)} | {mean:,.0f} ({low:,.0f} to {high:,.0f}) | {ratio} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--worlds", nargs="*", default=["door-key-5x5"])
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--steps", type=int, help="of each run, instead of the job file's")
    parser.add_argument(
        "--until",
        type=float,
        default=math.inf,
        help="end a run once this share of its latest 100 episodes succeeded",
    )
    parser.add_argument("--evaluation", type=int, help="fresh episodes after each run, instead of the job file's")
    asked = parser.parse_args()
    changes = {name: getattr(asked, name) for name in ("steps", "evaluation") if getattr(asked, name) is not None}
    for seed in range(1, asked.seeds + 1):
        for world in asked.worlds:
            for arm in asked.arms:
                if seed not in read_steps(asked.folder / CURVES).get((world, arm), {}):
                    train_arm(asked.folder, world, arm, changes | {"seed": seed}, until=asked.until)
    draw(asked.folder)
    print(describe(read_steps(asked.folder / CURVES)))


if __name__ == "__main__":
    main()
