"""The takeover trials' numbers, table and figure: success of each way to teach, with intervals over seeds."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from minihuman.learn.teach.takeovers import ARMS, TRIALS, Row, as_rows, run_arm
from minihuman.learn.teach.trials import ending, interval, run_trials, said, write_results

COLOURS = {"cloning": "#666666", "hg-dagger": "#1f4e79", "corrections": "#c05010", "intervention-weighted": "#3a7d44"}

FEWEST_SEEDS = 3  # of which an interval is drawn: that of two reaches from 0 to 1


def run_takeovers(
    out: Path, trials: Sequence[str], seeds: int, *, workers: int, command: str, episodes: int | None = None
) -> str:
    """Run every trial with every seed, those that are not in the folder yet; write what came of it; returns the table.

    ``OUT/rows`` has a small file a trial, way to teach and seed, ``takeovers.json`` all of it, ``takeovers.md`` the
    table, ``takeovers.png`` the figure.
    """
    jobs = {
        out / "rows" / f"{name}-{arm}-seed-{seed}.json": (_run, (name, arm, seed, episodes))
        for name in trials
        for seed in range(1, seeds + 1)
        for arm in TRIALS[name].ways
    }
    numbers = run_trials(jobs, workers=workers)
    rows = as_rows(numbers)
    text = table(rows, command)
    write_results(out, "takeovers", numbers, text, command)
    draw(rows, out / "takeovers.png")
    return text


def _run(name: str, arm: str, seed: int, episodes: int | None) -> list[Row]:
    return run_arm(TRIALS[name], arm, seed, episodes=episodes)


def table(rows: Sequence[Row], command: str) -> str:
    """Success, the person's minutes and how often they took over, in Markdown."""
    lines = ["# What a takeover is worth", ""]
    for trial in dict.fromkeys(row.trial for row in rows):
        mine = [row for row in rows if row.trial == trial]
        seeds = sorted({row.seed for row in mine})
        lines += [
            f"## {trial}",
            "",
            f"Seeds: {', '.join(map(str, seeds))}. Mean and 95 % interval of Student's t over seeds.",
            "",
            (
                "| the person's steps | way to teach | success | the person's minutes | interventions | agent's steps "
                "| seeds |"
            ),
            "| --- | --- | --- | --- | --- | --- | --- |",
        ]
        for budget in sorted({row.budget for row in mine}):
            for arm in ARMS:
                chosen = [row for row in mine if row.budget == budget and row.arm == arm]
                if chosen:
                    minutes, taken, labelled, steps = (
                        float(np.mean([getattr(row, name) for row in chosen]))
                        for name in ("minutes", "interventions", "labelled_steps", "steps")
                    )
                    lines.append(
                        f"| {labelled:.0f} | {arm} | {said([row.success for row in chosen])} | {minutes:.1f} "
                        f"| {taken:.0f} | {steps - labelled:.0f} | {len(chosen)} |"
                    )
        lines.append("")
    return "\n".join([*lines, *ending(command)]) + "\n"


def draw(rows: Sequence[Row], path: Path) -> None:
    """Success over the person's steps and over the person's minutes, a row of panels a world."""
    from matplotlib.figure import Figure

    trials = list(dict.fromkeys(row.trial for row in rows))
    figure = Figure(figsize=(8, 3 * len(trials)), layout="constrained")
    axes = figure.subplots(len(trials), 2, squeeze=False, sharey=True)
    for panels, trial in zip(axes, trials, strict=True):
        for ax, over, words in zip(panels, ("labelled_steps", "minutes"), ("steps", "minutes"), strict=True):
            for arm in ARMS:
                mine = [row for row in rows if row.trial == trial and row.arm == arm]
                budgets = sorted({row.budget for row in mine})
                at = [[row for row in mine if row.budget == budget] for budget in budgets]
                if not at:
                    continue
                x = [float(np.mean([getattr(row, over) for row in some])) for some in at]
                means, lows, highs = zip(*[interval([row.success for row in some]) for some in at], strict=True)
                ax.plot(x, means, marker="o", color=COLOURS[arm], label=arm)
                if min(len(some) for some in at) >= FEWEST_SEEDS:
                    ax.fill_between(x, lows, highs, color=COLOURS[arm], alpha=0.15, linewidth=0)
            ax.set_xlabel(f"the person's {words}")
            ax.set_ylim(0, 1)
            ax.set_title(trial, fontsize=10)
            ax.grid(color="0.9")
        panels[0].set_ylabel("success, held-out episodes")
    axes[0][0].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)
