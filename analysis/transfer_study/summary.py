"""The study's outputs: the table of improvements, the curves and their figure, what was run and where the time went.

Published improvements to compare with: Chevalier-Boisvert et al. (2023), "Minigrid & Miniworld", table of the
transfer study (Table 1): mean and standard deviation over ten runs of 200,000 steps, all twelve cells.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from minihuman.errors import LearnError
from minihuman.learn.policy.file import get_versions
from minihuman.statistics.comparison import holm_correction
from minihuman.storage.durable_files import write_atomically
from transfer_study.job import Result, improvement, interquartile_mean
from transfer_study.plan import BASELINE, COMMITS, DEFECTS, SOURCE, TransferJob, TransferStudy

PUBLISHED_SOURCE = "Chevalier-Boisvert et al. (2023), Minigrid & Miniworld, Table 1"
STEPS = 200_000  # the published runs'; an area over fewer steps is not the same measure


def read_shipped() -> pd.DataFrame:
    """One row per cell: improvement and sd, as fractions."""
    return pd.read_csv(Path(__file__).with_name("published.csv"), index_col="cell")


def get_published(study: TransferStudy, path: Path | None) -> pd.DataFrame | None:
    """What to set beside a study: the file's, or the paper's where the study has as many steps; else nothing.

    Raises:
        LearnError: as ``read_published``.
    """
    if path is not None:
        return read_published(path)
    return read_shipped() if study.steps == STEPS and not study.quick else None


def read_published(path: Path) -> pd.DataFrame:
    """Published improvements from a CSV with columns cell and improvement (fractions), and sd where it is known.

    Raises:
        LearnError: if the file is missing or lacks a column.
    """
    try:
        found = pd.read_csv(path).set_index("cell")
        found["improvement"].astype(float)
    except FileNotFoundError:
        raise LearnError(f"{path} is not there; --beside takes a CSV with columns cell and improvement") from None
    except (KeyError, ValueError) as error:
        raise LearnError(f"{path}: {error}; --beside takes a CSV with columns cell and improvement") from None
    return found.reindex(columns=["improvement", "sd"])


RUNS, MEAN, REFERENCE = "#88a8c8", "#1f4e79", "#c05010"


def curves_figure(study: TransferStudy, points: pd.DataFrame) -> Figure:
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


COLUMNS = (
    *("runs", "area", "iqm", "final_reward", "runs_solved", "steps_to_solve"),
    *("improvement", "sd", "low", "high", "p", "smallest_p", "p_holm", "better"),
)
PUBLISHED = ("published", "published_sd")
SIGNIFICANT = 0.05
SOLVED = 0.9  # a world counts as solved from this mean reward of the last 100 episodes

Results = dict[TransferJob, Result]


@dataclass(frozen=True, slots=True)
class RunInfo:
    """How the results were made: what a report says beside the numbers."""

    command: str
    engine: str  # "" where nothing was trained
    wall_s: float  # of this sitting


def improvement_table(study: TransferStudy, results: Results, *, beside: pd.DataFrame | None = None) -> pd.DataFrame:
    """One row a cell that has finished runs: its areas, how it ended, and the improvement over the baseline.

    ``beside`` holds published improvements and their SD by row label; they become the columns "published" and
    "published_sd", and "beside" says whether ours can be told from them. Improvements are fractions, not percent;
    "p_holm" is corrected for the number of cells that were compared, and "verdict" says what it comes to.
    """
    baseline = {job.run: result.area for job, result in results.items() if job.cell.name == BASELINE}
    rows = []
    for cell in study.cells:
        found = [result for job, result in results.items() if job.cell == cell]
        if not found:
            continue
        areas = np.array([result.area for result in found])
        solved = [_solved_at(result) for result in found]
        horizon = min(study.steps, *(result.points[-1].steps for result in found))
        row: dict[str, Any] = {
            "cell": cell.label,
            "runs": len(found),
            "area": areas.mean(),
            "iqm": interquartile_mean(areas),
            "final_reward": np.mean([result.points[-1].reward for result in found]),
            "runs_solved": sum(step is not None for step in solved),
            "steps_to_solve": np.mean([horizon if step is None else min(step, horizon) for step in solved]),
        }
        pairs = [
            (result.area, baseline[job.run])
            for job, result in results.items()
            if job.cell == cell and job.run in baseline
        ]
        if cell.parts and pairs:
            gain = improvement(*np.array(pairs).T)
            row |= {name: getattr(gain, name) for name in ("sd", "low", "high", "p", "smallest_p", "better")}
            row["improvement"] = gain.mean
        if beside is not None:
            row |= {"published": beside["improvement"].get(cell.label, np.nan)}
            row |= {"published_sd": beside["sd"].get(cell.label, np.nan)}
        rows.append(row)
    if not rows:
        return pd.DataFrame()
    cells = pd.DataFrame(rows).set_index("cell")
    cells = cells.reindex(columns=[*COLUMNS, *(PUBLISHED if beside is not None else ())])
    cells["p_holm"] = holm_correction(list(cells["p"]))
    cells["verdict"] = [_verdict(row) for _, row in cells.iterrows()]
    if beside is not None:
        cells["beside"] = [_beside(row) for _, row in cells.iterrows()]
    return cells


def _verdict(row: pd.Series) -> str:
    """A cell's improvement in words, after correction for the number of cells."""
    if np.isnan(row["improvement"]):
        return ""
    if np.isnan(row["p_holm"]) or row["smallest_p"] >= SIGNIFICANT:
        return f"{row['runs']:.0f} run{'s' if row['runs'] > 1 else ''}, too few to tell"
    if row["p_holm"] >= SIGNIFICANT:
        return "not told apart"
    return "better" if row["improvement"] > 0 else "worse"


def _beside(row: pd.Series) -> str:
    """Whether the published mean lies in the interval of ours; its own spread is not in that."""
    if np.isnan(row["published"]):
        return ""
    if np.isnan(row["low"]):
        return f"{row['runs']:.0f} run{'s' if row['runs'] > 1 else ''}, no interval"
    return "within our interval" if row["low"] <= row["published"] <= row["high"] else "outside our interval"


def correlate_with_published(cells: pd.DataFrame) -> tuple[int, float, float]:
    """Compare the order of the cells' improvements with the published one.

    Returns:
        How many cells have both, Spearman's correlation of their means, and its p; NaN for fewer than three cells.
    """
    if "published" not in cells:
        return 0, math.nan, math.nan
    both = cells[["improvement", "published"]].dropna()
    if len(both) < 3:
        return len(both), math.nan, math.nan
    found = scipy.stats.spearmanr(both["improvement"], both["published"])
    return len(both), float(found.statistic), float(found.pvalue)


def curve_table(results: Results) -> pd.DataFrame:
    """Every point of every curve: cell, run, seed, steps, reward, length."""
    return pd.DataFrame(
        [
            (job.cell.label, job.run, job.seed, point.steps, point.reward, point.length)
            for job, result in results.items()
            for point in result.points
        ],
        columns=["cell", "run", "seed", "steps", "reward", "length"],
    )


def speed_table(results: Results) -> pd.DataFrame:
    """Steps per second in each kind of world, and the share of time in world, acting and learning."""
    rows = []
    for name, chosen in (
        ("grid (source)", [result for job, result in results.items() if job.cell.name == SOURCE]),
        ("3D (baseline and transfers)", [result for job, result in results.items() if job.cell.name != SOURCE]),
    ):
        if not chosen:
            continue
        spent = {part: sum(result.seconds[part] for result in chosen) for part in ("world", "acting", "learning")}
        total = sum(spent.values())
        steps = sum(result.steps for result in chosen)
        rows.append({"where": name, "steps_per_s": steps / total} | {key: spent[key] / total for key in spent})
    return pd.DataFrame(rows).set_index("where") if rows else pd.DataFrame()


def write_report(
    study: TransferStudy, results: Results, out: Path, run: RunInfo, *, beside: pd.DataFrame | None = None
) -> str:
    """Write table.csv, curves.csv, speed.csv, run.json, report.md and curves.png; return the report's text."""

    rows, points, speeds = improvement_table(study, results, beside=beside), curve_table(results), speed_table(results)
    cells, rank, p = correlate_with_published(rows)
    for name, frame in (("table", rows), ("speed", speeds)):
        write_atomically(frame.to_csv(), out / f"{name}.csv")
    write_atomically(points.to_csv(index=False), out / "curves.csv")
    facts = {
        "command": run.command,
        "engine": run.engine,
        "wall_s": round(run.wall_s, 1),
        "quick": study.quick,
        "jobs_done": len(results),
        "jobs": len(study.jobs()),
        "seeds": {job.name: job.seed for job in results},
        "versions": get_versions(),
        "published_state": COMMITS.get(study.protocol),
        "defects_reproduced": list(DEFECTS[study.protocol]),
        "cells_beside": cells,
        "rank_correlation": None if math.isnan(rank) else round(rank, 3),
        "rank_correlation_p": None if math.isnan(p) else round(p, 4),
        "core_hours": round(count_core_hours(results), 2),
    }
    write_atomically(json.dumps(facts, indent=1), out / "run.json")
    text = report_text(study, rows, speeds, facts)
    write_atomically(text, out / "report.md")
    figure = curves_figure(study, points)
    figure.savefig(out / "curves.png", dpi=150)
    return text


def report_text(study: TransferStudy, rows: pd.DataFrame, speeds: pd.DataFrame, facts: dict[str, Any]) -> str:
    """The report in Markdown."""
    lines = [f"# Transfer study, {study.protocol}", ""]
    if study.quick:
        lines += ["**QUICK: far fewer steps than the study; the numbers only show that everything runs.**", ""]
    source_steps = study.jobs()[0].steps
    lines += [
        (
            f"{study.runs} run(s) a cell and {study.baselines} of the baseline, {study.steps:,} steps a run, "
            f"{source_steps:,} for the source, seed {study.seed}; {facts['jobs_done']} of {facts['jobs']} jobs done, "
            f"{facts['core_hours']:g} core-hours."
        ),
        "",
        (
            "Improvement is transfer area / baseline area - 1 over the runs of both, which share first weights and "
            "layouts; area: under the curve of the mean reward of the last 100 episodes. p is of the exact paired "
            "permutation test, smallest_p the least that so many runs can come to; p_holm is corrected for the number "
            "of cells. The 95 % interval (low, high) is Student's, of log ratios, from three runs on, and assumes "
            "normal ones. better is the share of runs above their baseline; iqm is the mean of the middle half of "
            f"the runs. Reward {SOLVED} counts as solved; steps_to_solve is a restricted mean, a run that did not "
            "solve its world counting with all of its steps."
        ),
        "",
        _markdown(rows),
        "",
        *(
            []
            if facts["rank_correlation"] is None
            else [
                (
                    f"Rank correlation of {facts['cells_beside']} cells' improvements with the published ones: "
                    f"{facts['rank_correlation']:.2f} (p {facts['rank_correlation_p']:.3f})."
                ),
                "",
            ]
        ),
        "Where the time goes (shares of the jobs' own time):",
        "",
        _markdown(speeds),
        "",
    ]
    if facts["defects_reproduced"]:
        lines += [
            f"Reproduced from the published code at {facts['published_state']}:",
            "",
            *[f"- {defect}" for defect in facts["defects_reproduced"]],
            "",
        ]
    lines += [
        f"Command: `{facts['command']}`"
        + (f" ({facts['engine']}, {facts['wall_s'] / 60:.1f} min in the last sitting)" if facts["engine"] else ""),
        "",
        "Versions: " + ", ".join(f"{name} {number}" for name, number in facts["versions"].items()),
    ]
    return "\n".join(lines) + "\n"


def _markdown(frame: pd.DataFrame) -> str:
    if frame.empty:
        return "(nothing yet)"
    columns = [str(frame.index.name), *map(str, frame.columns)]
    lines = ["| " + " | ".join(columns) + " |", "|" + " --- |" * len(columns)]
    for label, values in frame.iterrows():
        lines.append("| " + " | ".join([str(label), *[_cell(value) for value in values]]) + " |")
    return "\n".join(lines)


def _cell(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, (int, np.integer)) or (float(value).is_integer() and abs(value) >= 1):
        return f"{int(value):,}"
    if np.isnan(value):
        return "-"
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3f}"


def count_core_hours(results: Results) -> float:
    """What the results took in all, in hours of one core."""
    return sum(result.core_s for result in results.values()) / 3600


def _solved_at(result: Result) -> int | None:
    """The step at which the reward first reached SOLVED; None where it never did."""
    return next((point.steps for point in result.points if point.reward >= SOLVED), None)
