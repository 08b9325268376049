"""Power by simulation: draw studies from a pool with a known effect, count how often the report's own test finds it,
and write the result as text, CSV and figure.
"""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from minihuman.dataset.measures import log_excess_steps, log_steps_ratio, spl
from minihuman.errors import ReportError
from minihuman.figures.style import COLUMN_CM, MUTED, SERIES, figure_style, save_figure
from minihuman.planning.pool import ParticipantPool
from minihuman.statistics.comparison import Values, permutation_tests
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.two_part_model import summarise_people, two_parts_p

ALPHA = 0.05
_POOLS = 20
_Z = 1.96
TWO_PARTS = "reward_two_parts"  # how often there is any, and how much where there is


@dataclass(frozen=True, slots=True)
class Effect:
    """The effect in the first group: its steps in excess of the shortest path, times ``excess``."""

    excess: float = 1.0

    @classmethod
    def parse(cls, text: str) -> "Effect":
        """Read ``excess=0.7``, or ``none``.

        Raises:
            ReportError: if it says anything else.
        """
        if text == "none":
            return cls()
        name, _, value = text.partition("=")
        try:
            excess = float(value)
        except ValueError:
            excess = math.nan
        if name != "excess" or not 0 < excess < math.inf:
            raise ReportError(f"--effect {text!r} is not valid; use none, or excess=0.7 for 30 % fewer excess steps")
        return cls(excess)

    def of(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Episodes as they would have gone with the effect.

        An episode that timed out stays so, since its remaining steps are unknown; power is understated a little.
        Reward is taken to fall in a straight line from the best way's, as Minigrid's and Miniworld's does.
        """
        if self.excess == 1.0:
            return rows
        goal = (rows["outcome"] == "goal") & rows["feasible_steps"].notna()
        fewer = rows["feasible_steps"] + self.excess * (rows["steps"] - rows["feasible_steps"])
        slope = (1 - rows["reward"]) / rows["steps"].clip(lower=1)
        return rows.assign(
            steps=rows["steps"].where(~goal, fewer), reward=rows["reward"].where(~goal, 1 - slope * fewer)
        )


def _each(rows: pd.DataFrame, measure: Callable[..., float | None]) -> list[float]:
    return [
        math.nan if (found := measure(*one)) is None else found
        for one in rows[["steps", "feasible_steps", "max_steps", "outcome"]].itertuples(index=False)
    ]


def _best(value: float) -> int | None:
    return None if pd.isna(value) else int(value)


MEASURES: Mapping[str, Callable[[pd.DataFrame], Sequence[float]]] = {
    "log_excess_steps": lambda rows: _each(rows, lambda s, b, m, o: log_excess_steps(s, _best(b), int(m), o)),
    "log_steps_ratio": lambda rows: _each(rows, lambda s, b, m, o: log_steps_ratio(s, _best(b), int(m), o)),
    "spl": lambda rows: _each(rows, lambda s, b, m, o: spl(s, _best(b), o)),
    "steps_at_limit": lambda rows: rows["steps"].where(rows["outcome"] == "goal", rows["max_steps"]).tolist(),
    "reward": lambda rows: rows["reward"].tolist(),
    "success": lambda rows: (rows["outcome"] == "goal").astype(float).tolist(),
}


@dataclass(frozen=True, slots=True)
class PowerEstimate:
    """The share of studies that find the effect on a measure."""

    measure: str
    participants: int  # per group
    power: float
    low: float  # Monte Carlo 95 % interval
    high: float
    studies: int


def compute_values(rows: pd.DataFrame, measure: str) -> Values:
    """One value a person: the mean over episodes; of the reward in two parts two, (n, 2).

    Raises:
        ReportError: if the measure is unknown, or too few participants have a value.
    """
    if measure == TWO_PARTS:
        return summarise_people(rows, "reward")
    if measure not in MEASURES:
        raise ReportError(f"--measure {measure!r} is unknown; use all or one of {', '.join((*MEASURES, TWO_PARTS))}")
    told = rows.assign(value=MEASURES[measure](rows)).groupby("participant")["value"].mean().dropna()
    if len(told) < 2:
        raise ReportError(
            f"only {len(told)} simulated participants have a value for {measure}, but two are needed; "
            "use a world with a known shortest path"
        )
    return told.to_numpy(float)


def power_curve(
    measure: str, treated: Values, untreated: Values, sizes: Sequence[int], *, studies: int, seed: int
) -> tuple[PowerEstimate, ...]:
    """Draw people, with replacement, into two groups of each size, and test them as the report does.

    ``treated`` and ``untreated`` are the same people with and without the effect. They are drawn anew some twenty times
    on the way: by how much power then changes tells how far it hangs on who happens to be in the pool.
    """
    return tuple(_power_at(measure, treated, untreated, size, studies=studies, seed=seed) for size in sizes)


def _power_at(measure: str, treated: Values, untreated: Values, size: int, *, studies: int, seed: int) -> PowerEstimate:
    test = _group_p if untreated.ndim == 1 else two_parts_p
    rng = np.random.default_rng([seed, size])
    hits, counts = list[int](), [len(part) for part in np.array_split(range(studies), min(_POOLS, studies))]
    for count in counts:
        pool = rng.integers(len(untreated), size=len(untreated))
        found = 0
        for _ in range(count):
            found += test(treated[rng.choice(pool, size)], untreated[rng.choice(pool, size)]) < ALPHA
        hits.append(found)
    power = sum(hits) / studies
    shares = np.array(hits) / np.array(counts)
    by_chance = power * (1 - power) * float(np.mean(1 / np.array(counts)))  # between pools that do not differ
    between = max(float(shares.var(ddof=1)) - by_chance, 0.0) if len(shares) > 1 else 0.0
    low, high = wilson_interval(sum(hits), studies)
    further = _Z * math.sqrt(between)
    low, high = power - math.hypot(power - low, further), power + math.hypot(high - power, further)
    return PowerEstimate(measure, size, power, max(low, 0.0), min(high, 1.0), studies)


def _group_p(a: Values, b: Values) -> float:
    (test,) = permutation_tests([(a, b)])
    return math.nan if test is None else test.p()


_LIKELY = 0.8
_CM = 1 / 2.54


def describe_power(pool: ParticipantPool, effect: Effect, found: Sequence[PowerEstimate], *, player: str) -> str:
    """Describe the result, for the terminal and a preregistration."""
    sizes = sorted({one.participants for one in found})
    what = "no effect" if effect.excess == 1 else f"excess steps times {effect.excess:g} in one of two groups"
    lines = [
        f"Power for {what}, block {pool.block}: the share of {found[0].studies:,} studies with p < {ALPHA:g}",
        f"(permutation of |Welch's t| over participants' means), people drawn from {pool.people} simulated ones of",
        f"group {pool.group}, player {player}. In brackets (95 %): the Monte Carlo interval.",
        "Whether real participants are like the simulated ones is not tested.",
        "",
        f"{'participants per group':<22}" + "".join(f"{size:>22}" for size in sizes),
    ]
    for measure in dict.fromkeys(one.measure for one in found):
        at = {one.participants: one for one in found if one.measure == measure}
        cells = (f"{at[size].power:.2f} ({at[size].low:.2f} to {at[size].high:.2f})" for size in sizes)
        lines.append(f"{measure:<22}" + "".join(f"{cell:>22}" for cell in cells))
    return "\n".join(lines)


def write_power(found: Sequence[PowerEstimate], out: Path) -> tuple[Path, ...]:
    """Write ``power.csv`` and the figure ``power``."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / "power.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("measure", "participants_a_group", "power", "low", "high", "studies"))
        table.writerows((one.measure, one.participants, one.power, one.low, one.high, one.studies) for one in found)
    return (out / "power.csv", *save_figure(power_figure(found), out / "power"))


def power_figure(found: Sequence[PowerEstimate]) -> Figure:
    """Draw power over participants per group, one line per measure, with its Monte Carlo interval."""
    with figure_style():
        figure = Figure(figsize=(COLUMN_CM * _CM, 7.2 * _CM), layout="constrained")
        axes = figure.subplots()
        for place, measure in enumerate(dict.fromkeys(one.measure for one in found)):
            rows = sorted((one for one in found if one.measure == measure), key=lambda one: one.participants)
            sizes, colour = [one.participants for one in rows], SERIES[place % len(SERIES)]
            axes.fill_between(sizes, [one.low for one in rows], [one.high for one in rows], color=colour, alpha=0.2)
            axes.plot(sizes, [one.power for one in rows], "os^DvPX"[place % 7], color=colour, markersize=3)
            axes.plot(sizes, [one.power for one in rows], color=colour, label=measure.replace("_", " "))
        axes.axhline(_LIKELY, color=MUTED, linewidth=0.6, linestyle=":")
        axes.set(xlabel="participants per group", ylabel="power", ylim=(0, 1.02))
        figure.legend(loc="outside upper center", ncols=3)
    return figure
