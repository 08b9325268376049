"""Comparisons within a participant: paired differences by sign flips, and the order effects of a crossover."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
import pandas as pd
from scipy import special

from minihuman.statistics.comparison import ALPHA, RESAMPLES, SEED, Values, holm_correction, invert_test

_EXHAUSTIVE = 13  # differences, up to which all 2^n sign flips are taken
_TIES = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class PairedTest:
    """The permutation test of a mean difference within participants: each difference's sign is as likely as the other.

    Exact for differences that are symmetric around their mean (Fisher, 1935). The interval holds the shifts that the
    same flips do not reject at 5 %, so that it never contradicts p.
    """

    n: int
    difference: float
    error: float  # of the mean
    sums: Values  # (flips,) of the signed deviations from the mean
    signs: Values  # (flips,) sum of the signs
    drawn: int

    @property
    def smallest_p(self) -> float:
        """The smallest p that so many differences can reach."""
        return 1 / (RESAMPLES + 1) if self.drawn else 2.0 ** (1 - self.n)

    def p(self, shift: float = 0.0) -> float:
        """The two-sided p of a mean difference of ``shift``."""
        d = self.difference - shift
        observed = abs(self.n * d)
        slack = _TIES * (observed + self.error * self.n)
        as_far = int(np.count_nonzero(np.abs(self.sums + d * self.signs) >= observed - slack))
        return (as_far + self.drawn) / (len(self.sums) + self.drawn)

    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the mean difference; NaN where no difference could have p < 0.05."""
        if not self.error > 0 or self.smallest_p >= ALPHA:
            return math.nan, math.nan
        return invert_test(self.p, self.difference, self.error)


def paired_test(differences: Values) -> PairedTest | None:
    """The test of differences, one per participant; None of fewer than two."""
    n = len(differences)
    if n < 2:
        return None
    signs = _flips(n)
    mean = float(differences.mean())
    error = float(differences.std(ddof=1)) / math.sqrt(n)
    drawn = int(n > _EXHAUSTIVE)
    return PairedTest(n, mean, error, signs @ (differences - mean), signs.sum(axis=1), drawn)


@lru_cache(maxsize=8)
def _flips(n: int) -> Values:
    if n <= _EXHAUSTIVE:
        return np.array(list(product((1.0, -1.0), repeat=n)))
    return np.random.default_rng(SEED).choice([1.0, -1.0], (RESAMPLES, n))


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """Two conditions on one measure, over the participants who have a value in both; first minus second."""

    measure: str
    first: str
    second: str
    n: int
    means: tuple[float, float]  # of those participants; geometric where ``is_log``
    difference: float
    interval: tuple[float, float]
    p: float
    p_holm: float
    smallest_p: float
    is_log: bool


@dataclass(frozen=True, slots=True)
class CrossoverTerm:
    """The F test of one effect in an additive model of a crossover."""

    measure: str
    effect: str  # "condition", "position", "carry-over"
    freedom: tuple[int, int]
    f: float
    p: float


def compare_conditions(
    values: Mapping[str, pd.DataFrame], *, log_measures: Collection[str] = ()
) -> tuple[PairedComparison, ...]:
    """Compare every two conditions on every measure; p is corrected over all (Holm).

    Args:
        values: by measure, a row per participant and a column per condition; NaN without a value.
        log_measures: measures whose values are natural logarithms.
    """
    found = []
    for measure, table in values.items():
        for first, second in combinations(table.columns, 2):
            both = table[[first, second]].dropna().to_numpy(float)
            test = paired_test(both[:, 0] - both[:, 1])
            if test is None:
                continue
            is_log = measure in log_measures
            means = [math.exp(mean) if is_log else float(mean) for mean in both.mean(axis=0)]
            found.append(
                PairedComparison(
                    measure, str(first), str(second), test.n, (means[0], means[1]), test.difference, test.interval(),
                    test.p(), math.nan, test.smallest_p, is_log,
                )
            )  # fmt: skip
    corrected = holm_correction([one.p for one in found])
    return tuple(replace(one, p_holm=p) for one, p in zip(found, corrected, strict=True))


def fit_crossover(measure: str, rows: pd.DataFrame) -> tuple[CrossoverTerm, ...]:
    """Test condition, position and carry-over of a crossover, each given the others, participants as fixed effects.

    Carry-over is of the condition just before, first order (Jones and Kenward, 2014). An effect that the design cannot
    tell from the others is left out.

    Args:
        measure: its name.
        rows: a row per participant and condition, with ``participant``, ``condition``, ``position`` (1, 2, ...),
            ``before`` (the condition just before, "" of the first) and ``value``.
    """
    told = rows.dropna(subset=["value"])
    several = told.groupby("participant")["value"].transform("size") > 1
    told = told[several]
    if told.empty:
        return ()
    dummies = {name: pd.get_dummies(told[name]).to_numpy(float) for name in ("condition", "position")}
    before = pd.get_dummies(told["before"]).drop(columns="", errors="ignore").to_numpy(float)
    dummies["carry-over"] = before[:, 1:] - before[:, :1]  # sums to 0: its mean is the effect of not being the first
    people = pd.get_dummies(told["participant"]).to_numpy(float)
    value = told["value"].to_numpy(float)
    whole_rank, whole_squares = _fit(np.column_stack([people, *dummies.values()]), value)
    rest = len(value) - whole_rank
    if rest < 1 or whole_squares <= 0:
        return ()
    found = []
    for effect in dummies:
        others = [dummy for name, dummy in dummies.items() if name != effect]
        rank, squares = _fit(np.column_stack([people, *others]), value)
        if own := whole_rank - rank:
            f = (squares - whole_squares) / own / (whole_squares / rest)
            found.append(CrossoverTerm(measure, effect, (own, rest), f, float(special.fdtrc(own, rest, f))))
    return tuple(found)


def _fit(design: Values, value: Values) -> tuple[int, float]:
    """The rank of a design and the residual sum of squares of its least-squares fit."""
    fitted, _, rank, _ = np.linalg.lstsq(design, value, rcond=1e-10)
    return int(rank), float(((value - design @ fitted) ** 2).sum())
