"""Statistics over participants, from scipy and statsmodels: which groups differ, by how much, how surely."""

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from numpy.typing import NDArray
from scipy import stats
from statsmodels.stats.meta_analysis import effectsize_smd
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestIndPower

LEVEL = 0.95
RESAMPLES = 9_999
_SEED = 20_230_613  # of the permutations, so that the same data give the same p
_LARGE_G = 0.8
_OPTIMISERS = ["bfgs", "lbfgs", "cg", "powell"]  # each tried where the ones before failed; the last needs no slope


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two groups on one measure; differences are first minus second. NaN where the data do not tell."""

    measure: str
    first: str
    second: str
    n: tuple[int, int]  # participants
    means: tuple[float, float]
    difference: float
    interval: tuple[float, float]  # Welch's t interval of the difference
    p: float  # permutation test of the means, two-sided
    p_holm: float  # corrected for all the comparisons made together
    g: float  # Hedges' g
    g_interval: tuple[float, float]


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A linear model of one measure over episodes, with a random intercept a participant.

    Intervals and p use Student's t with between-within degrees of freedom: what differs between participants is judged
    by their number, what differs within them by that of episodes. The normal distribution, which statsmodels uses,
    makes intervals too short for the few participants that a study has.
    """

    measure: str
    terms: tuple[str, ...]
    estimates: tuple[float, ...]
    intervals: tuple[tuple[float, float], ...]
    p: tuple[float, ...]
    participants: int
    episodes: int
    note: str  # "" if it converged without complaint


@dataclass(frozen=True, slots=True)
class Power:
    """What a comparison of two groups of these sizes could show, by a two-sided t test at 5 %."""

    n: tuple[int, int]
    power_for_large: float  # chance to find a difference of 0.8 standard deviations
    detectable_g: float  # the difference found with a chance of 80 %, in standard deviations
    needed_for_large: int  # participants a group for a chance of 80 % at 0.8 standard deviations


def compare_groups(rows: pd.DataFrame, measures: Sequence[str], *, order: Sequence[str] = ()) -> tuple[Comparison, ...]:
    """Compare every two groups on every measure; ``rows`` has one row a participant, with ``group`` and the measures.

    Of a pair, the group that is earlier in ``order`` comes first; without an order, the earlier in the alphabet.

    Groups with fewer than two participants that tell a measure are not compared on it.
    """
    found = []
    for measure in measures:
        told = {str(group): part[measure].dropna().to_numpy(float) for group, part in rows.groupby("group", sort=True)}
        told = {group: told[group] for group in (order or told) if len(told.get(group, ())) > 1}
        found += [_compare(measure, a, b, told[a], told[b]) for a, b in combinations(told, 2)]
    return _corrected(found)


def mixed_model(rows: pd.DataFrame, measure: str) -> MixedModel | None:
    """Model a measure over episodes by group and episode in the block, participants drawn at random.

    ``rows`` has one row an episode: ``participant``, ``group``, ``episode_in_block`` and the measure. None where there
    are not two groups, or not two participants in each, or the measure differs too little for a model.
    """
    told = rows.dropna(subset=[measure])
    sizes = told.groupby("group")["participant"].nunique()
    if len(sizes) < 2 or sizes.min() < 2 or told["episode_in_block"].nunique() < 2:
        return None
    if told[measure].nunique() < 2:
        return None
    centred = told.assign(
        value=told[measure].astype(float), episode=told["episode_in_block"] - told["episode_in_block"].mean()
    )
    with warnings.catch_warnings(record=True) as complaints:
        warnings.simplefilter("always")
        try:
            model = smf.mixedlm("value ~ C(group) + episode", centred, groups=centred["participant"])
            fit = model.fit(reml=True, method=_OPTIMISERS)
        except np.linalg.LinAlgError:  # next to no variance: its matrices have no inverse
            return None
    names = [name for name in fit.params.index if name != "Group Var"]
    participants = int(told["participant"].nunique())
    within = max(1, len(told) - participants - 1)
    told_by = [stats.t(within if name == "episode" else participants - len(sizes)) for name in names]
    estimates, errors = fit.fe_params[names].to_numpy(float), fit.bse_fe[names].to_numpy(float)
    reach = [float(t.ppf((1 + LEVEL) / 2) * error) for t, error in zip(told_by, errors, strict=True)]
    return MixedModel(
        measure=measure,
        terms=tuple(_term(name) for name in names),
        estimates=tuple(map(float, estimates)),
        intervals=tuple((float(at - by), float(at + by)) for at, by in zip(estimates, reach, strict=True)),
        p=tuple(float(2 * t.sf(abs(at / error))) for t, at, error in zip(told_by, estimates, errors, strict=True)),
        participants=participants,
        episodes=len(told),
        note=_note([str(complaint.message) for complaint in complaints], converged=bool(fit.converged)),
    )


def _note(complaints: Sequence[str], *, converged: bool) -> str:
    """What statsmodels complains of, in one sentence that a reader can use; "" if of nothing."""
    if not converged:
        return "The fit did not converge; do not rely on these numbers."
    if any("boundary" in complaint or "singular" in complaint for complaint in complaints):
        return "Participants differ no more than their episodes do; the random intercept is next to nothing."
    return "The fit was hard to find; take these numbers with care." if complaints else ""


def power(n: tuple[int, int]) -> Power:
    """What two groups of ``n`` participants could show. NaN for a group with fewer than two."""
    if min(n) < 2:
        return Power(n, math.nan, math.nan, _needed())
    test, ratio = TTestIndPower(), n[1] / n[0]
    return Power(
        n=n,
        power_for_large=float(test.power(_LARGE_G, n[0], 1 - LEVEL, ratio=ratio)),
        detectable_g=float(test.solve_power(None, n[0], 1 - LEVEL, 0.8, ratio=ratio)),
        needed_for_large=_needed(),
    )


def _needed() -> int:
    return math.ceil(float(TTestIndPower().solve_power(_LARGE_G, None, 1 - LEVEL, 0.8)))


def _compare(measure: str, first: str, second: str, a: NDArray[np.float64], b: NDArray[np.float64]) -> Comparison:
    difference = float(a.mean() - b.mean())
    interval, g, g_interval = (math.nan, math.nan), math.nan, (math.nan, math.nan)
    if a.std() + b.std() > 0:
        welch = stats.ttest_ind(a, b, equal_var=False).confidence_interval(LEVEL)
        interval = (float(welch.low), float(welch.high))
        g, variance = (
            float(v) for v in effectsize_smd(a.mean(), a.std(ddof=1), len(a), b.mean(), b.std(ddof=1), len(b))
        )
        half = float(stats.norm.ppf(0.5 + LEVEL / 2)) * math.sqrt(variance)
        g_interval = (g - half, g + half)
    test = stats.permutation_test(
        (a, b), _mean_difference, n_resamples=RESAMPLES, vectorized=True, rng=np.random.default_rng(_SEED)
    )
    return Comparison(
        measure, first, second, (len(a), len(b)), (float(a.mean()), float(b.mean())), difference, interval,
        float(test.pvalue), math.nan, g, g_interval,
    )  # fmt: skip


def _mean_difference(a: NDArray[np.float64], b: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    return np.asarray(a.mean(axis=axis) - b.mean(axis=axis))


def _corrected(found: Sequence[Comparison]) -> tuple[Comparison, ...]:
    if not found:
        return ()
    corrected = multipletests([one.p for one in found], method="holm")[1]
    return tuple(replace(one, p_holm=float(p)) for one, p in zip(found, corrected, strict=True))


def _term(name: str) -> str:
    """A term as a reader knows it: "Intercept", "group: direct", "episode"."""
    return "group: " + name.partition("[T.")[2].rstrip("]") if name.startswith("C(group)") else name
