"""The success rate of clones by number of demonstrations: points per source, number and seed, a table, a figure."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from minihuman.learn.behaviour_cloning import (
    CloningSettings,
    clone_policy,
    evaluate_policy,
    make_sampling_policy,
    split_by_participant,
)
from minihuman.learn.demonstrations import Demonstrations
from minihuman.learn.policy.network import EncoderName
from minihuman.statistics.scores import wilson_interval
from minihuman.storage.durable_files import write_atomically

COLOURS = ("#1f4e79", "#c05010", "#4a7a3a", "#7a4a8a")


@dataclass(frozen=True, slots=True)
class CloningPoint:
    """A clone and how it played its held-out episodes."""

    source: str
    demonstrations: int
    seed: int
    steps: int  # of the world, that the demonstrations hold
    epochs: int
    agreement: float
    episodes: int
    successes: int


def run_cloning_curve(
    sources: Mapping[str, Demonstrations],
    *,
    sizes: Sequence[int],
    seeds: Sequence[int],
    eyes: EncoderName,
    episodes: int,
    settings: CloningSettings,
    kept: Path,
) -> list[CloningPoint]:
    """Clone from the first so many demonstrations of each source and judge each clone.

    Every finished point is written to ``kept`` (JSON) at once, so that a run that is broken off goes on.

    Args:
        sources: Demonstrations by who made them.
        sizes: Numbers of demonstrations to train on, beside those that training is stopped by; all there are, where
            they are fewer.
        seeds: Of the first weights, the order of steps, and who is held out for validation.
        eyes: What the policies see with.
        episodes: How many held-out episodes each clone plays; the same for all.
        settings: How clones are trained.
        kept: The file of points.
    """
    points = [CloningPoint(**each) for each in json.loads(kept.read_text())] if kept.exists() else []
    for source, demonstrations in sources.items():
        for seed in seeds:
            training, validation = split_by_participant(demonstrations, share=settings.validation_share, seed=seed)
            for size in sorted({min(size, len(training.episodes)) for size in sizes}):
                if any((p.source, p.demonstrations, p.seed) == (source, size, seed) for p in points):
                    continue
                chosen = training.first(size)
                policy, cloned = clone_policy(chosen, validation, eyes=eyes, settings=replace(settings, seed=seed))
                played = evaluate_policy(
                    make_sampling_policy(policy, seed),
                    demonstrations.world,
                    demonstrations.options,
                    demonstrations.eyesight,
                    episodes=episodes,
                    seed=0,
                    most_steps=demonstrations.most_steps,
                )
                points.append(
                    CloningPoint(
                        source,
                        size,
                        seed,
                        sum(len(each.actions) for each in chosen.episodes),
                        cloned.epochs,
                        cloned.agreement,
                        played.episodes,
                        played.successes,
                    )
                )
                write_atomically(json.dumps([asdict(point) for point in points], indent=1) + "\n", kept)
    return points


def build_curve_table(points: Sequence[CloningPoint]) -> pd.DataFrame:
    """A row a source and number: the success rate of all its clones' episodes with its 95 % interval, and its range.

    The interval is Wilson's over episodes; clones of different seeds differ by more than it says, which the lowest and
    highest clone show.
    """
    rows = []
    for (source, size), group in pd.DataFrame([asdict(point) for point in points]).groupby(
        ["source", "demonstrations"], sort=False
    ):
        rates = group["successes"] / group["episodes"]
        low, high = wilson_interval(int(group["successes"].sum()), int(group["episodes"].sum()))
        rows.append(
            {
                "source": source,
                "demonstrations": size,
                "steps": round(group["steps"].mean()),
                "clones": len(group),
                "success": group["successes"].sum() / group["episodes"].sum(),
                "low": low,
                "high": high,
                "lowest_clone": rates.min(),
                "highest_clone": rates.max(),
            }
        )
    return pd.DataFrame(rows).sort_values(["source", "demonstrations"], ignore_index=True)


def curve_figure(table: pd.DataFrame, *, title: str) -> Figure:
    """Success by number of demonstrations, a line a source; bars are intervals, dots the lowest and highest clone."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    ax = figure.subplots()
    for k, (source, rows) in enumerate(table.groupby("source", sort=True)):
        x = rows["demonstrations"] * 1.03 ** (k - 1)
        errors = [rows["success"] - rows["low"], rows["high"] - rows["success"]]
        ax.errorbar(
            x, rows["success"], yerr=errors, color=COLOURS[k], capsize=3, marker="o", markersize=4, label=source
        )
        for column in ("lowest_clone", "highest_clone"):
            ax.plot(x, rows[column], ".", color=COLOURS[k], markersize=3, alpha=0.6)
    ax.set_xscale("log", base=2)
    ax.set_xticks(sorted(table["demonstrations"].unique()))
    ax.xaxis.set_major_formatter(lambda value, _: f"{value:,.0f}")
    ax.minorticks_off()
    ax.set_ylim(math.floor(20 * table["low"].min()) / 20, 1)
    ax.set_xlabel("demonstrations")
    ax.set_ylabel("success in held-out episodes (95 % interval)")
    ax.grid(color="0.9")
    ax.legend(frameon=False, loc="lower right")
    ax.set_title(title, fontsize=10)
    return figure
