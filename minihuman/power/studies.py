"""Studies drawn from a pool of people, with a known effect, and how often the report's own test finds it."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from minihuman.errors import ReportError
from minihuman.measures.effort import log_excess_steps, log_steps_ratio, spl
from minihuman.statistics.compare import Values, permutation_p
from minihuman.statistics.shares import wilson
from minihuman.statistics.two_parts import people_of, two_parts_p

ALPHA = 0.05
_POOLS = 20
_Z = 1.96
TWO_PARTS = "reward_two_parts"  # how often there is any, and how much where there is


@dataclass(frozen=True, slots=True)
class Effect:
    """What the first group's people do otherwise: their steps over the best way, times ``excess``."""

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
            raise ReportError(f"--effect is {text!r}; write excess=0.7 for 30 % fewer excess steps, or none")
        return cls(excess)

    def of(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Episodes as they would have gone with the effect.

        An episode that timed out stays so: nobody knows how far off its end was, so power is understated a little.
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
class PowerAt:
    """How often studies of so many participants a group find the effect on a measure."""

    measure: str
    participants: int  # a group
    power: float
    low: float  # 95 % interval: how surely so many studies of so many simulated people tell it
    high: float
    studies: int


def values_of(rows: pd.DataFrame, measure: str) -> Values:
    """One value a person: the mean over episodes; of the reward in two parts two, (n, 2).

    Raises:
        ReportError: if there is no such measure, or nobody tells it.
    """
    if measure == TWO_PARTS:
        return people_of(rows, "reward")
    if measure not in MEASURES:
        raise ReportError(f"--measure is {measure!r}; there are {', '.join((*MEASURES, TWO_PARTS))}, or all")
    told = rows.assign(value=MEASURES[measure](rows)).groupby("participant")["value"].mean().dropna()
    if len(told) < 2:
        raise ReportError(
            f"{measure} is told by {len(told)} simulated people; it needs a world whose best way is known"
        )
    return told.to_numpy(float)


def power_curve(
    measure: str, treated: Values, untreated: Values, sizes: Sequence[int], *, studies: int, seed: int
) -> tuple[PowerAt, ...]:
    """Draw people, with replacement, into two groups of each size, and test them as the report does.

    ``treated`` and ``untreated`` are the same people with and without the effect. They are drawn anew some twenty times
    on the way: by how much power then changes tells how far it hangs on who happens to be in the pool.
    """
    return tuple(_power_at(measure, treated, untreated, size, studies=studies, seed=seed) for size in sizes)


def _power_at(measure: str, treated: Values, untreated: Values, size: int, *, studies: int, seed: int) -> PowerAt:
    test = permutation_p if untreated.ndim == 1 else two_parts_p
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
    low, high = wilson(sum(hits), studies)
    further = _Z * math.sqrt(between)
    low, high = power - math.hypot(power - low, further), power + math.hypot(high - power, further)
    return PowerAt(measure, size, power, max(low, 0.0), min(high, 1.0), studies)
