"""What the power of a study comes to: a table in words, a CSV, and a figure."""

import csv
from collections.abc import Sequence
from pathlib import Path

from matplotlib.figure import Figure

from minihuman.figures.files import save
from minihuman.figures.style import COLUMN_CM, QUIET, SERIES, our_style
from minihuman.power.pool import Pool
from minihuman.power.studies import ALPHA, Effect, PowerAt

_LIKELY = 0.8
_CM = 1 / 2.54


def told(pool: Pool, effect: Effect, found: Sequence[PowerAt], *, player: str) -> str:
    """Lines that can be read, and put into a preregistration."""
    sizes = sorted({one.participants for one in found})
    what = "no effect" if effect.excess == 1 else f"excess steps times {effect.excess:g} in one of two groups"
    lines = [
        f"Power for {what}, block {pool.block}: the share of {found[0].studies:,} studies with p < {ALPHA:g}",
        f"(permutation of |Welch's t| over participants' means), people drawn from {pool.people} simulated ones of",
        f"group {pool.group}, player {player}. In brackets (95 %): how surely so many studies tell it",
        "of so few people; whether people are like these it cannot tell.",
        "",
        f"{'participants a group':<22}" + "".join(f"{size:>22}" for size in sizes),
    ]
    for measure in dict.fromkeys(one.measure for one in found):
        at = {one.participants: one for one in found if one.measure == measure}
        cells = (f"{at[size].power:.2f} ({at[size].low:.2f} to {at[size].high:.2f})" for size in sizes)
        lines.append(f"{measure:<22}" + "".join(f"{cell:>22}" for cell in cells))
    return "\n".join(lines)


def write(found: Sequence[PowerAt], out: Path) -> tuple[Path, ...]:
    """Write ``power.csv`` and the figure ``power``."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / "power.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("measure", "participants_a_group", "power", "low", "high", "studies"))
        table.writerows((one.measure, one.participants, one.power, one.low, one.high, one.studies) for one in found)
    return (out / "power.csv", *save(power_figure(found), out / "power"))


def power_figure(found: Sequence[PowerAt]) -> Figure:
    """Power over participants a group, a line a measure, with its Monte Carlo interval."""
    with our_style():
        figure = Figure(figsize=(COLUMN_CM * _CM, 7.2 * _CM), layout="constrained")
        axes = figure.subplots()
        for place, measure in enumerate(dict.fromkeys(one.measure for one in found)):
            rows = sorted((one for one in found if one.measure == measure), key=lambda one: one.participants)
            sizes, colour = [one.participants for one in rows], SERIES[place % len(SERIES)]
            axes.fill_between(sizes, [one.low for one in rows], [one.high for one in rows], color=colour, alpha=0.2)
            axes.plot(sizes, [one.power for one in rows], "os^DvPX"[place % 7], color=colour, markersize=3)
            axes.plot(sizes, [one.power for one in rows], color=colour, label=measure.replace("_", " "))
        axes.axhline(_LIKELY, color=QUIET, linewidth=0.6, linestyle=":")
        axes.set(xlabel="participants a group", ylabel="power", ylim=(0, 1.02))
        figure.legend(loc="outside upper center", ncols=3)
    return figure
