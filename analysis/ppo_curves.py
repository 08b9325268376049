"""Compare the learning curves that `python -m benchmarks.ppo --out FOLDER` wrote: python analysis/ppo_curves.py FOLDER.

For each world and trainer the mean success over a training (the area under its curve, 0 before the hundredth episode),
the steps until 90 % of the latest episodes succeeded, and steps per CPU-second: the interquartile mean over seeds with
a 95 % interval by bootstrap, as Agarwal et al. propose ("Deep Reinforcement Learning at the Edge of the Statistical
Precipice", 2021).
Writes `curves.svg` beside the table: each seed's curve, and the median over seeds.
"""

import argparse
import csv
from collections import defaultdict
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import trim_mean

LEARNED = 0.9
JUDGED = 100  # episodes, as many as success is of: a point of fewer says little and is left out
RESAMPLES = 10_000
NAMES = {
    "ours": "minihuman",
    "ours, one-hot": "minihuman, one-hot codes",
    "ours with memory": "minihuman, memory",
    "sb3": "Stable-Baselines3 PPO",
    "sb3, lookup": "Stable-Baselines3 PPO, our encoder",
    "sb3 recurrent": "RecurrentPPO",
}
Curve = dict[str, list[float]]


def read_curves(folder: Path) -> dict[tuple[str, str], dict[int, Curve]]:
    """By world and trainer, the curve of each seed."""
    curves: dict[tuple[str, str], dict[int, Curve]] = defaultdict(dict)
    with (folder / "curves.csv").open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            curve = curves[row["world"], row["trainer"]].setdefault(int(row["seed"]), defaultdict(list))
            for name in ("steps", "cpu_s"):
                curve[name].append(float(row[name]))
            curve["success"].append(float(row["success"]) if int(row["episodes"]) >= JUDGED else float("nan"))
    return dict(curves)


def measure(curve: Curve) -> dict[str, float]:
    """What a training is compared by; infinite steps where it never learned."""
    steps, success = np.array(curve["steps"]), np.nan_to_num(np.array(curve["success"]))
    learned = steps[success >= LEARNED]
    return {
        "mean success": float(np.trapezoid(success, steps) / (steps[-1] - steps[0])),
        "steps to 90 %": float(learned[0]) if len(learned) else float("inf"),
        "steps per CPU-s": float(steps[-1] / curve["cpu_s"][-1]),
    }


def summarise(values: list[float], rng: np.random.Generator) -> tuple[float, float, float]:
    """The interquartile mean and its interval."""
    drawn = rng.choice(values, (RESAMPLES, len(values)))
    low, high = np.quantile(trim_mean(drawn, 0.25, axis=1), (0.025, 0.975))
    return float(trim_mean(values, 0.25)), float(low), float(high)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    curves, rng = read_curves(folder), np.random.default_rng(1)
    worlds = sorted({world for world, _ in curves})
    figure, axes = plt.subplots(1, len(worlds), figsize=(4.5 * len(worlds), 3.2), squeeze=False, sharey=True)
    print("| world | trainer | seeds | mean success | steps to 90 % | steps per CPU-s |\n|---|---|---|---|---|---|")
    for axis, world in zip(axes[0], worlds, strict=True):
        for number, (trainer, name) in enumerate(NAMES.items()):
            seeds = curves.get((world, trainer), {})
            if not seeds:
                continue
            told = [measure(curve) for curve in seeds.values()]
            cells = []
            for what, form in (("mean success", ".2f"), ("steps to 90 %", ",.0f"), ("steps per CPU-s", ",.0f")):
                values = [each[what] for each in told]
                if not np.isfinite(values).all():
                    cells.append(f"{int(np.isfinite(values).sum())} of {len(values)} learned")
                    continue
                mean, low, high = summarise(values, rng)
                cells.append(f"{mean:{form}} ({low:{form}} to {high:{form}})")
            print(f"| {world} | {name} | {len(seeds)} | {' | '.join(cells)} |")
            for curve in seeds.values():
                axis.plot(curve["steps"], curve["success"], color=f"C{number}", alpha=0.3, linewidth=0.8)
            shared = min((curve["steps"] for curve in seeds.values()), key=len)
            middle = np.median([curve["success"][: len(shared)] for curve in seeds.values()], axis=0)
            axis.plot(shared, middle, color=f"C{number}", label=name)
        axis.set(title=world, xlabel="steps", ylim=(0, 1.02))
    axes[0][0].set_ylabel("success of the latest 100 episodes")
    shown = {label: line for axis in axes[0] for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    figure.tight_layout(rect=(0, 0, 1, 0.92))
    figure.legend(shown.values(), shown.keys(), fontsize=8, loc="upper center", ncols=len(shown))
    figure.savefig(folder / "curves.svg")


if __name__ == "__main__":
    main()
