"""The study's figure: one small panel a cell, each run thin, the mean thick, the baseline's mean in every panel."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from minihuman.learn.transfer.plan import BASELINE, SOURCE, Study

RUNS, MEAN, REFERENCE = "#88a8c8", "#1f4e79", "#c05010"


def curves_figure(study: Study, points: pd.DataFrame) -> Figure:
    """Reward curves of every cell that has any, as a grid of panels with shared axes."""
    labels = [cell.label for cell in study.cells if (points["cell"] == cell.label).any()]
    columns = 4
    rows = max(1, -(-len(labels) // columns))
    figure = Figure(figsize=(2.7 * columns, 2.2 * rows + 0.5), layout="constrained")
    quick = "; QUICK, numbers mean nothing" if study.quick else ""
    figure.suptitle(f"Transfer study, {study.protocol}{quick}", fontsize=11)
    axes = list(figure.subplots(rows, columns, squeeze=False, sharey=True).flat)
    baseline = points[points["cell"] == BASELINE]
    for ax, label in zip(axes, labels, strict=False):
        its = points[points["cell"] == label]
        draw_curves(ax, its)
        if label not in (BASELINE, SOURCE) and len(baseline):
            mean = baseline.groupby("steps")["reward"].mean()
            ax.plot(mean.index, mean, color=REFERENCE, linewidth=1, linestyle="--")
        runs = its["run"].nunique()
        ax.set_title(f"{label}, {runs} run{'s' if runs > 1 else ''}", fontsize=10)
    for ax in axes[len(labels) :]:
        ax.set_axis_off()
    figure.supxlabel("steps", fontsize=10)
    figure.supylabel("mean reward of the last 100 episodes (dashed: baseline's mean)", fontsize=9)
    return figure


def draw_curves(ax: Axes, points: pd.DataFrame) -> Axes:
    """One cell's runs and their mean."""
    for _, run in points.groupby("run"):
        ax.plot(run["steps"], run["reward"], color=RUNS, linewidth=0.8)
    mean = points.groupby("steps")["reward"].mean()
    ax.plot(mean.index, mean, color=MEAN, linewidth=2)
    ax.set_ylim(0, 1)
    ax.grid(color="0.9")
    ax.xaxis.set_major_formatter(lambda steps, _: f"{steps / 1000:g}k")
    ax.tick_params(labelsize=8)
    return ax
