"""Comparisons within a participant: paired differences by sign flips, the order effects of a crossover, and growth, how
a measure changes over a block's episodes: a line for each person, then a comparison of the people, or a mixed model.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from minihuman.statistics.comparison import holm_correction
from minihuman.statistics.permutation import ALPHA, invert_test
from minihuman.statistics.regroupings import RESAMPLES, SEED
from minihuman.statistics.t_tests import LEVEL, Values, compare_means

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
    extra: int  # 1 where flips are a random sample: the differences as they were count as one more

    @property
    def smallest_p(self) -> float:
        """Return the smallest p that so many differences can reach."""
        if self.extra:
            return 1 / (RESAMPLES + 1)
        return 2.0 ** (1 - self.n)

    def p(self, shift: float = 0.0) -> float:
        """Return the two-sided p of a mean difference of ``shift``."""
        d = self.difference - shift
        observed = abs(self.n * d)
        slack = _TIES * (observed + self.error * self.n)
        as_far = int(np.count_nonzero(np.abs(self.sums + d * self.signs) >= observed - slack))
        return (as_far + self.extra) / (len(self.sums) + self.extra)

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the mean difference; NaN where no difference could have p < 0.05."""
        if not self.error > 0 or self.smallest_p >= ALPHA:
            return math.nan, math.nan
        return invert_test(self.p, self.difference, self.error)


def paired_test(differences: Values) -> PairedTest | None:
    """Test differences, one per participant; None of fewer than two."""
    n = len(differences)
    if n < 2:
        return None
    signs = _flips(n)
    mean = float(differences.mean())
    error = float(differences.std(ddof=1)) / math.sqrt(n)
    extra = int(n > _EXHAUSTIVE)
    return PairedTest(n, mean, error, signs @ (differences - mean), signs.sum(axis=1), extra)


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
    comparisons = []
    for measure, table in values.items():
        for first, second in combinations(table.columns, 2):
            pairs = table[[first, second]].dropna().to_numpy(float)
            test = paired_test(pairs[:, 0] - pairs[:, 1])
            if test is None:
                continue
            is_log = measure in log_measures
            means = [math.exp(mean) if is_log else float(mean) for mean in pairs.mean(axis=0)]
            comparisons.append(
                PairedComparison(
                    measure, str(first), str(second), test.n, (means[0], means[1]), test.difference, test.interval(),
                    test.p(), math.nan, test.smallest_p, is_log,
                )
            )  # fmt: skip
    corrected = holm_correction([comparison.p for comparison in comparisons])
    return tuple(replace(comparison, p_holm=p) for comparison, p in zip(comparisons, corrected, strict=True))


def fit_crossover(measure: str, rows: pd.DataFrame) -> tuple[CrossoverTerm, ...]:
    """Test condition, position and carry-over of a crossover, each given the others, participants as fixed effects.

    Carry-over is of the condition just before, first order (Jones and Kenward, 2014). An effect that the design cannot
    tell from the others is left out.

    Args:
        measure: its name.
        rows: a row per participant and condition, with ``participant``, ``condition``, ``position`` (1, 2, ...),
            ``before`` (the condition just before, "" of the first) and ``value``.
    """
    known = rows.dropna(subset=["value"])
    is_repeated = known.groupby("participant")["value"].transform("size") > 1
    known = known[is_repeated]
    if known.empty:
        return ()
    dummies = {name: pd.get_dummies(known[name]).to_numpy(float) for name in ("condition", "position")}
    before = pd.get_dummies(known["before"]).drop(columns="", errors="ignore").to_numpy(float)
    dummies["carry-over"] = before[:, 1:] - before[:, :1]  # sums to 0: its mean is the effect of not being the first
    people = pd.get_dummies(known["participant"]).to_numpy(float)
    value = known["value"].to_numpy(float)
    whole_rank, whole_squares = _fit(np.column_stack([people, *dummies.values()]), value)
    residual_freedom = len(value) - whole_rank
    if residual_freedom < 1 or whole_squares <= 0:
        return ()
    terms = []
    for effect in dummies:
        other_dummies = [dummy for name, dummy in dummies.items() if name != effect]
        rank, squares = _fit(np.column_stack([people, *other_dummies]), value)
        own = whole_rank - rank
        if own:
            f = (squares - whole_squares) / own / (whole_squares / residual_freedom)
            terms.append(
                CrossoverTerm(
                    measure, effect, (own, residual_freedom), f, float(scipy.special.fdtrc(own, residual_freedom, f))
                )
            )
    return tuple(terms)


def _fit(design: Values, value: Values) -> tuple[int, float]:
    """Return a design's rank and the residual sum of squares of its least-squares fit."""
    fitted, _, rank, _ = np.linalg.lstsq(design, value, rcond=1e-10)
    return int(rank), float(((value - design @ fitted) ** 2).sum())


MIN_EPISODES = 3  # for a line of one's own


@dataclass(frozen=True, slots=True)
class GrowthTerm:
    """One estimate over people, with its t interval and p; NaN where too few people tell it."""

    name: str
    estimate: float
    interval: tuple[float, float]
    p: float
    people: int


@dataclass(frozen=True, slots=True)
class GrowthComparison:
    """A measure at the middle of a block and its change an episode, in the reference group and against it."""

    measure: str
    reference: str  # every other group's terms are its difference from this one
    terms: tuple[GrowthTerm, ...]
    left_out: tuple[str, ...]  # groups with fewer than two people who have a line, and why


def compare_growth(rows: pd.DataFrame, measure: str, *, order: Sequence[str] = ()) -> GrowthComparison | None:
    """Compare lines of a measure over ``episode_in_block`` between groups; None where no group has two people.

    ``rows`` has one row an episode: ``participant``, ``group``, ``episode_in_block`` and the measure. The last group
    of ``order`` (of the alphabet without one) that can be compared is the reference.

    The summary-statistics analysis of a random-slopes model: exact where everybody has the same episodes, and at its
    nominal error where people's slopes differ, which a random intercept alone is not (with slopes of SD 0.01 around 0,
    20 people and a term for the episode, it rejects a true null in a third of studies).
    """
    lines = _fit_lines(rows.dropna(subset=[measure]), measure)
    everyone = list(order) or sorted({str(group) for group in rows["group"]})
    groups = [group for group in everyone if len(lines.get(group, ())) >= 2]
    if not groups:
        return None
    *other_groups, reference = groups
    people = {group: np.array(lines[group]) for group in groups}
    terms = []
    for column, name in enumerate((f"{measure} in the middle of the block", "change an episode")):
        base = people[reference][:, column]
        term = estimate_mean(f"{reference}: {name}", base)
        if column == 0:
            term = replace(term, p=math.nan)  # a test of a level against 0 means nothing
        terms.append(term)
        for group in other_groups:
            values = people[group][:, column]
            terms.append(_estimate_difference(f"{group} minus {reference}: {name}", values, base))
    left_out = tuple(
        f"{group}: {len(lines.get(group, ()))} with {MIN_EPISODES} episodes or more"
        for group in everyone
        if group not in groups
    )
    return GrowthComparison(measure, reference, tuple(terms), left_out)


def _fit_lines(known: pd.DataFrame, measure: str) -> dict[str, list[tuple[float, float]]]:
    """Fit a line to each participant with enough episodes: level in the middle of the block and slope, by group."""
    middle = known["episode_in_block"].mean()
    centred = known.assign(at=known["episode_in_block"] - middle, value=known[measure])
    by_person = centred.groupby(["group", "participant"])
    mean = by_person[["at", "value"]].transform("mean")
    at = known["episode_in_block"] - middle - mean["at"]
    products = pd.DataFrame({"product": at * (known[measure] - mean["value"]), "square": at**2})
    sums = products.groupby([known["group"], known["participant"]])[["product", "square"]].sum()
    enough = by_person["at"].nunique() >= MIN_EPISODES
    slopes = (sums["product"] / sums["square"])[enough]
    levels = by_person["value"].mean()[enough] - slopes * by_person["at"].mean()[enough]
    lines: dict[str, list[tuple[float, float]]] = {}
    for (group, _), level, slope in zip(slopes.index, levels, slopes, strict=True):
        lines.setdefault(str(group), []).append((float(level), float(slope)))
    return lines


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A linear mixed model of a measure's episodes, by REML."""

    has_slopes: bool  # of each person, besides the intercept
    people: int
    terms: tuple[GrowthTerm, ...]  # those of ``GrowthComparison``; empty where no model converged


MIN_GAIN = 1e-3  # of a log-likelihood, from which on a part of a mixed model counts
_MAX_RATIO = 1e3  # of an SD of people to the residual one; at half of it the likelihood is said to have no maximum


def fit_mixed_model(rows: pd.DataFrame, measure: str, groups: Sequence[str]) -> MixedModel | None:
    """Fit group, episode and their product by REML, with a random intercept and slope of each person, or an intercept.

    Two programs need not stop at the same last digits, so each choice has a margin: slopes are kept where the
    log-likelihood is higher by more than ``MIN_GAIN`` than with any singular covariance of intercept and slope, which
    is that of no slopes, too; the intercept where it is higher by as much than without one. Where neither is, or the
    likelihood has no maximum, no model is reported.

    Intervals and p are Wald's with a t of as many degrees of freedom as there are people above groups, since the
    groups' terms differ between people. The last group is the reference. None with fewer than two such degrees.

    Args:
        rows: a row per episode, with ``participant``, ``group``, ``episode_in_block`` and the measure.
        measure: its column.
        groups: those that are compared.
    """
    known = rows[rows["group"].isin(groups)].dropna(subset=[measure]).sort_values("participant", kind="stable")
    *other_groups, reference = groups
    begins = np.flatnonzero(~known["participant"].duplicated())
    people = len(begins)
    freedom = people - len(groups)
    if freedom < 2:
        return None
    at = (known["episode_in_block"] - known["episode_in_block"].mean()).to_numpy(float)
    shares = np.column_stack([np.ones(len(at)), *((known["group"] == group).to_numpy(float) for group in other_groups)])
    design = np.column_stack([shares, shares * at[:, None], known[measure].to_numpy(float)])
    if np.linalg.matrix_rank(design) < design.shape[1]:  # the terms cannot be told apart, or explain everything
        return MixedModel(False, people, ())
    nothing, level, singular, slopes = (_fit_reml(design, at, begins, free) for free in range(4))
    chosen = next((fit for fit, less in ((slopes, singular), (level, nothing)) if fit[0] > less[0] + MIN_GAIN), None)
    if chosen is None:
        return MixedModel(False, people, ())
    _, estimates, errors = chosen
    half = scipy.special.stdtrit(freedom, (1 + LEVEL) / 2) * errors
    ps = 2 * scipy.special.stdtr(freedom, -np.abs(estimates / errors))
    ps[0] = math.nan  # a test of a level against 0 means nothing
    names = _name_mixed_terms(measure, reference, other_groups)
    terms = tuple(
        GrowthTerm(name, float(b), (float(b - h), float(b + h)), float(p), people)
        for name, b, h, p in zip(names, estimates, half, ps, strict=True)
    )
    return MixedModel(chosen is slopes, people, terms)


def _name_mixed_terms(measure: str, reference: str, other_groups: Sequence[str]) -> list[str]:
    """Name the terms of a mixed model: the levels of the groups, then their changes."""
    names = []
    for quantity in (f"{measure} in the middle of the block", "change an episode"):
        names.append(f"{reference}: {quantity}")
        names += [f"{group} minus {reference}: {quantity}" for group in other_groups]
    return names


def _fit_reml(design: Values, at: Values, begins: NDArray[np.int64], free: int) -> tuple[float, Values, Values]:
    """Maximise the restricted likelihood of random lines of people, as lme4 profiles it (Bates et al., 2015, 3.4).

    Args:
        design: the terms, and last the measure.
        at: where on a line each row is.
        begins: the first row of each person, whose rows follow each other.
        free: so many of the covariance's parameters are free, and the others 0: the SD of intercepts, what slopes share
            with them, and the variance of the rest of slopes, over the residual variance.

    Returns:
        Its logarithm but for a constant, minus infinity without a maximum; the estimates, and their standard errors.
    """
    own = np.column_stack([np.ones(len(at)), at / at.std()])
    among, between = (np.add.reduceat(own[:, :, None] * columns[:, None, :], begins) for columns in (own, design))
    among, kind, people = np.unique(among, axis=0, return_inverse=True, return_counts=True)
    products = np.zeros((len(among), 2, 2, *[design.shape[1]] * 2))  # summed over people with the same episodes
    np.add.at(products, kind.ravel(), between[:, :, None, :, None] * between[:, None, :, None, :])
    total = design.T @ design
    freedom = len(design) - design.shape[1] + 1

    def profile(entries: Values | Sequence[float]) -> tuple[float, Values, Values]:
        first, shared, slope_variance = (*entries, 0.0, 0.0, 0.0)[:3]
        factor = np.array([[first, 0.0], [shared, math.sqrt(slope_variance)]])  # a square root: rest = 0 is no saddle
        inner = np.eye(2) + factor.T @ among @ factor
        left = total - np.einsum("kij,kijab->ab", factor @ np.linalg.solve(inner, factor.T[None]), products)
        terms = left[:-1, :-1]
        estimates = np.linalg.solve(terms, left[:-1, -1])
        variance = max((left[-1, -1] - left[-1, :-1] @ estimates) / freedom, np.finfo(float).tiny)
        logs = freedom * math.log(variance) + people @ np.linalg.slogdet(inner)[1] + np.linalg.slogdet(terms)[1]
        return float(logs) / 2, estimates, np.sqrt(variance * np.diag(np.linalg.inv(terms)))

    def loss_of(entries: Values | Sequence[float], /) -> float:
        return profile(entries)[0]

    bounds = ((0, _MAX_RATIO), (-_MAX_RATIO, _MAX_RATIO), (0, _MAX_RATIO))[:free]
    optima: list[list[float]] = []
    if not free:
        optima.append([])
    for start in ((0.5, 0.1, 0.1), (0.5, -0.1, 0.1))[: min(free, 2)]:
        optima += [scipy.optimize.minimize(loss_of, start[:free], bounds=bounds, tol=1e-10).x.tolist()]
    best = min(optima, key=loss_of)
    loss, estimates, errors = profile(best)
    if not np.all(np.abs(best) < _MAX_RATIO / 2):
        return -math.inf, estimates, errors
    return -loss, estimates, errors


def estimate_mean(name: str, values: Values) -> GrowthTerm:
    """Estimate a mean over people, with its t interval and the p of its being 0; NaN where all have one value."""
    mean = float(values.mean())
    n = len(values)
    if not np.ptp(values):
        return GrowthTerm(name, mean, (math.nan, math.nan), math.nan, n)
    error = float(values.std(ddof=1)) / math.sqrt(n)
    half = float(scipy.special.stdtrit(n - 1, (1 + LEVEL) / 2)) * error
    return GrowthTerm(
        name, mean, (mean - half, mean + half), float(2 * scipy.special.stdtr(n - 1, -abs(mean) / error)), n
    )


def _estimate_difference(name: str, values: Values, base: Values) -> GrowthTerm:
    """Estimate the difference of two groups' means; without interval and p where no value differs."""
    people = len(values) + len(base)
    if not max(np.ptp(values), np.ptp(base)):
        return GrowthTerm(name, float(values.mean() - base.mean()), (math.nan, math.nan), math.nan, people)
    comparison = compare_means(values, base)
    return GrowthTerm(name, comparison.difference, comparison.interval(), comparison.p, people)
