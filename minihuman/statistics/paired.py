"""Comparisons within participants: paired differences, order effects of a crossover, and growth over episodes.

Paired differences are tested by sign flips. Growth is compared by fitting a line to each person and comparing people;
`minihuman.statistics.mixed_model` has the model of all episodes.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, product
from types import MappingProxyType

import numpy as np
import pandas as pd
import scipy

from minihuman.statistics.comparison import holm_correction
from minihuman.statistics.effect_size import (
    ExplainedVariance,
    estimate_explained_variance,
    find_critical_statistic,
)
from minihuman.statistics.permutation import ALPHA, invert_test, permutation_tests
from minihuman.statistics.regroupings import RESAMPLES, SEED
from minihuman.statistics.t_tests import Values

_EXHAUSTIVE = 13  # differences, up to which all 2^n sign flips are taken
_TIES = 1e-9
_AT_ONCE = 1_000_000  # values permuted at a time
_SINGULAR = 1e-10  # a singular value below this share of the largest one counts as 0


@dataclass(frozen=True, slots=True, eq=False)
class PairedTest:
    """The permutation test of a mean difference within participants, which flips the differences' signs.

    The test is exact for differences that are distributed symmetrically around their mean (Fisher, 1935). The interval
    contains the shifts that the same flips do not reject at 5 %, so it never contradicts p.
    """

    n: int
    difference: float
    error: float  # of the mean
    sums: Values  # (flips,) of the signed deviations from the mean
    signs: Values  # (flips,) sum of the signs
    extra: int  # 1 where flips are a random sample, of which the observed signs count as one; else 0

    @property
    def smallest_p(self) -> float:
        """Return the smallest p that this number of differences can reach."""
        if self.extra:
            return 1 / (RESAMPLES + 1)
        return 2.0 ** (1 - self.n)

    def p(self, shift: float = 0.0) -> float:
        """Return the two-sided p of the null hypothesis that the mean difference is ``shift``."""
        d = self.difference - shift
        observed = abs(self.n * d)
        slack = _TIES * (observed + self.error * self.n)
        n_as_far = int(np.count_nonzero(np.abs(self.sums + d * self.signs) >= observed - slack))
        return (n_as_far + self.extra) / (len(self.sums) + self.extra)

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the mean difference; NaN where no difference could reach p < 0.05."""
        if not self.error > 0 or self.smallest_p >= ALPHA:
            return math.nan, math.nan
        return invert_test(self.p, self.difference, self.error)


def paired_test(differences: Values) -> PairedTest | None:
    """Make the permutation test of differences, one per participant; return None if there are fewer than two."""
    n = len(differences)
    if n < 2:
        return None
    signs = _draw_signs(n, RESAMPLES)
    mean = float(differences.mean())
    error = float(differences.std(ddof=1)) / math.sqrt(n)
    extra = int(n > _EXHAUSTIVE)
    return PairedTest(n, mean, error, signs @ (differences - mean), signs.sum(axis=1), extra)


@lru_cache(maxsize=8)
def _draw_signs(n: int, resamples: int) -> Values:
    """Return rows of n signs (1 or -1): every combination if there are few, else ``resamples`` random ones."""
    if n <= _EXHAUSTIVE:
        return np.array(list(product((1.0, -1.0), repeat=n)))
    return np.random.default_rng(SEED).choice([1.0, -1.0], (resamples, n))


@dataclass(frozen=True, slots=True)
class PairedComparison:
    """The comparison of two conditions on one measure, over the participants with a value in both conditions.

    Differences are the first condition minus the second. Of a contrast, ``first`` is the name and ``second`` is empty;
    the means are the weighted means of its positive and of its negative side, the difference that of weighted sums.
    """

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
    """The permutation test of one effect's F in an additive model of a crossover design."""

    measure: str
    effect: str  # "position" or "carry-over"
    freedom: tuple[int, int]
    f: float
    p: float
    variance: ExplainedVariance  # of the variance within participants


def compare_conditions(
    values: Mapping[str, pd.DataFrame],
    *,
    log_measures: Collection[str] = (),
    contrasts: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> tuple[PairedComparison, ...]:
    """Compare conditions on every measure; p is corrected for all comparisons together (Holm, 1979).

    Without contrasts, each pair of conditions is compared. A comparison of fewer than two participants is omitted.

    Args:
        values: per measure, a table with a row per participant and a column per condition; NaN where a value is missing
        log_measures: the measures whose values are natural logarithms
        contrasts: by name, the weights of conditions, which sum to 0
    """
    comparisons = []
    for measure, table in values.items():
        weights_by_names: dict[tuple[str, str], Mapping[str, float]]
        if contrasts:
            weights_by_names = {(name, ""): weights for name, weights in contrasts.items()}
        else:
            weights_by_names = {
                (str(first), str(second)): {str(first): 1.0, str(second): -1.0}
                for first, second in combinations(table.columns, 2)
            }
        for names, weights in weights_by_names.items():
            comparison = _compare_sides(table, weights, measure, names, is_log=measure in log_measures)
            if comparison is not None:
                comparisons.append(comparison)
    corrected = holm_correction([comparison.p for comparison in comparisons])
    return tuple(replace(comparison, p_holm=p) for comparison, p in zip(comparisons, corrected, strict=True))


def _compare_sides(
    table: pd.DataFrame, weights: Mapping[str, float], measure: str, names: tuple[str, str], *, is_log: bool
) -> PairedComparison | None:
    """Compare the conditions of positive weight with those of negative weight; None for fewer than two participants.

    Args:
        table: a row per participant and a column per condition; participants who lack a value in one of those that have
            a weight are omitted
        weights: by condition, the weights, which sum to 0
        measure: the measure's name
        names: the ``first`` and ``second`` of the result
        is_log: whether the values are natural logarithms, so that the means are reported as geometric means
    """
    complete = table.reindex(columns=list(weights)).dropna().to_numpy(float)  # a condition may be in no trial
    weight = np.array(list(weights.values()))
    sides = (complete @ np.maximum(weight, 0.0), complete @ np.maximum(-weight, 0.0))
    test = paired_test(sides[0] - sides[1])
    if test is None:
        return None
    side_weight = float(np.maximum(weight, 0.0).sum())  # of either side, since weights sum to 0
    averages = [float(side.mean()) / side_weight for side in sides]
    means = [math.exp(average) if is_log else average for average in averages]
    return PairedComparison(
        measure=measure,
        first=names[0],
        second=names[1],
        n=test.n,
        means=(means[0], means[1]),
        difference=test.difference,
        interval=test.interval(),
        p=test.p(),
        p_holm=math.nan,
        smallest_p=test.smallest_p,
        is_log=is_log,
    )


def fit_crossover(measure: str, rows: pd.DataFrame) -> tuple[CrossoverTerm, ...]:
    """Test the effects of position and carry-over in a crossover design.

    Each effect is tested given the other and the conditions, with participants as fixed effects. Carry-over is of first
    order: the effect of the condition just before (Jones and Kenward, 2014). p permutes orders between participants, so
    it needs no equal variances or normal values: residuals without the effect are exchanged whole (Freedman and Lane,
    1983). Effects that the design confounds with others are omitted, and all are if data or orders are too few.

    Args:
        measure: the measure's name
        rows: one row per participant and condition, with the columns ``participant``, ``condition``, ``position`` (1,
            2, ...), ``before`` (the condition just before, "" for the first one) and ``value``; participants without a
            value in every condition are omitted
    """
    present = rows.dropna(subset=["value"])
    conditions = present["condition"].nunique()
    has_all_conditions = present.groupby("participant")["value"].transform("size") == conditions
    complete = present[has_all_conditions].sort_values(["participant", "condition"], kind="stable")
    people = complete["participant"].nunique()
    if conditions < 2 or not _has_enough_orders(complete):
        return ()
    dummies = {name: pd.get_dummies(complete[name]).to_numpy(float) for name in ("condition", "position")}
    before = pd.get_dummies(complete["before"]).drop(columns="", errors="ignore").to_numpy(float)
    dummies["carry-over"] = before[:, 1:] - before[:, :1]  # sums to 0: its mean is the effect of not being the first
    centred = {name: _centre_people(columns, people) for name, columns in dummies.items()}
    values = _centre_people(complete["value"].to_numpy(float)[:, None], people)[:, 0]
    full_basis = _find_basis(np.column_stack(list(centred.values())))
    residual_freedom = len(values) - people - full_basis.shape[1]
    if residual_freedom < 1 or _sum_residuals(values, full_basis) <= _TIES * float(values @ values):
        return ()
    terms = []
    for effect in ("position", "carry-over"):
        reduced_basis = _find_basis(np.column_stack([columns for name, columns in centred.items() if name != effect]))
        effect_freedom = full_basis.shape[1] - reduced_basis.shape[1]
        if effect_freedom > 0:
            ratios = _compute_ratios(values, full_basis, reduced_basis, people)
            terms.append(_describe_term(measure, effect, ratios, (effect_freedom, residual_freedom)))
    return tuple(terms)


def _describe_term(measure: str, effect: str, ratios: Values, freedom: tuple[int, int]) -> CrossoverTerm:
    """Return the test of an effect; ``ratios`` are those of ``_compute_ratios``, the first of which is observed.

    ``freedom`` holds the degrees of freedom of the effect and the residual ones.
    """
    observed = float(ratios[0])
    variance = estimate_explained_variance(observed, find_critical_statistic(ratios[1:]), freedom, sum(freedom) + 1)
    p = float(np.mean(ratios >= observed * (1 - _TIES)))
    return CrossoverTerm(measure, effect, freedom, observed * freedom[1] / freedom[0], p, variance)


def _has_enough_orders(rows: pd.DataFrame) -> bool:
    """Return whether orders can be exchanged between participants in enough ways for p < 0.05."""
    orders = rows.sort_values("position").groupby("participant")["condition"].agg(tuple)
    counts = orders.value_counts().to_numpy()
    log_ways = scipy.special.gammaln(len(orders) + 1) - scipy.special.gammaln(counts + 1).sum()
    return bool(log_ways > -math.log(ALPHA))


def _centre_people(columns: Values, people: int) -> Values:
    """Subtract each participant's mean from columns whose rows are sorted by participant.

    Each of the ``people`` participants has the same number of rows.
    """
    by_person = columns.reshape(people, -1, columns.shape[1])
    centred: Values = (by_person - by_person.mean(axis=1, keepdims=True)).reshape(columns.shape)
    return centred


def _find_basis(columns: Values) -> Values:
    """Return an orthonormal basis of the space that columns span."""
    left_vectors, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    basis: Values = left_vectors[:, sizes > _SINGULAR * max(sizes.max(initial=0.0), 1.0)]
    return basis


def _sum_residuals(values: Values, basis: Values) -> Values:
    """Return the residual sum of squares of each row of values after a fit by the columns of an orthonormal basis."""
    squares: Values = (values**2).sum(axis=-1) - ((values @ basis) ** 2).sum(axis=-1)
    return squares


def _compute_ratios(values: Values, full_basis: Values, reduced_basis: Values, people: int) -> Values:
    """Return the effect's sum of squares divided by the residual one, for the observed orders and then permutations.

    Args:
        values: the values, centred within participants, sorted by participant and condition
        full_basis: a basis of all effects
        reduced_basis: a basis of all effects but the tested one
        people: the number of participants
    """
    residuals = (values - reduced_basis @ (reduced_basis.T @ values)).reshape(people, -1)
    rng = np.random.default_rng(SEED)
    orders = np.concatenate([np.arange(people)[None], rng.random((RESAMPLES, people)).argsort(axis=1)])
    batches = []
    for batch in np.array_split(orders, 1 + orders.size * residuals.shape[1] // _AT_ONCE):
        permuted = residuals[batch].reshape(len(batch), -1)
        full_residuals = np.maximum(_sum_residuals(permuted, full_basis), np.finfo(float).tiny)
        batches.append(_sum_residuals(permuted, reduced_basis) / full_residuals - 1)
    return np.concatenate(batches)


MIN_EPISODES = 3  # the fewest episodes to which a participant's line is fitted


@dataclass(frozen=True, slots=True)
class GrowthTerm:
    """An estimate over people with its 95 % interval and p, which are NaN if the people are too few."""

    name: str
    estimate: float
    interval: tuple[float, float]
    p: float
    people: int


@dataclass(frozen=True, slots=True)
class GrowthComparison:
    """The comparison of groups in a measure's level in the middle of a block and its change per episode.

    The terms of the reference group are its level and change; those of every other group are the differences from the
    reference group.
    """

    measure: str
    reference: str  # every other group's terms are its difference from this one
    terms: tuple[GrowthTerm, ...]
    left_out: tuple[str, ...]  # groups with fewer than two people who have a line, and why


def compare_growth(rows: pd.DataFrame, measure: str, *, order: Sequence[str] = ()) -> GrowthComparison | None:
    """Compare groups by the lines that fit each participant's values over ``episode_in_block``.

    This is the summary-statistics analysis of a random-slopes model. Groups are compared on levels and slopes by the
    permuted Welch test with its lower limits, as on any measure, and the reference group's mean slope is tested by
    flipping signs. By Welch's t alone, slopes of 2 and 18 people with SDs of 3 and 1 differ falsely in 15 % of studies;
    by a mixed model with a random intercept alone, slopes of SD 0.01 are falsely different from 0 in a third of them.

    Args:
        rows: one row per episode, with the columns ``participant``, ``group``, ``episode_in_block`` and the measure
        measure: the measure's column
        order: the groups, in alphabetical order if not given; the last one that can be compared is the reference

    Returns:
        The comparison; None if no group has two people with a line.
    """
    lines = _fit_lines(rows.dropna(subset=[measure]), measure)
    all_groups = list(order) or sorted({str(group) for group in rows["group"]})
    groups = [group for group in all_groups if len(lines.get(group, ())) >= 2]
    if not groups:
        return None
    *other_groups, reference = groups
    people = {group: np.array(lines[group]) for group in groups}
    terms = []
    for column, name in enumerate((f"{measure} in the middle of the block", "change an episode")):
        reference_values = people[reference][:, column]
        term = estimate_mean(f"{reference}: {name}", reference_values)
        if column == 0:
            term = replace(term, p=math.nan)  # a test of a level against 0 means nothing
        terms.append(term)
        for group in other_groups:
            values = people[group][:, column]
            terms.append(_estimate_difference(f"{group} minus {reference}: {name}", values, reference_values))
    left_out = tuple(
        f"{group}: {len(lines.get(group, ()))} with {MIN_EPISODES} episodes or more"
        for group in all_groups
        if group not in groups
    )
    return GrowthComparison(measure, reference, tuple(terms), left_out)


def _fit_lines(rows: pd.DataFrame, measure: str) -> dict[str, list[tuple[float, float]]]:
    """Return by group the level in the middle of the block and the slope of each participant's line.

    Participants with fewer than ``MIN_EPISODES`` different episodes are omitted. No value in ``rows`` may be missing.
    """
    middle = rows["episode_in_block"].mean()
    centred = rows.assign(at=rows["episode_in_block"] - middle, value=rows[measure])
    by_person = centred.groupby(["group", "participant"])
    mean = by_person[["at", "value"]].transform("mean")
    deviation = rows["episode_in_block"] - middle - mean["at"]
    products = pd.DataFrame({"product": deviation * (rows[measure] - mean["value"]), "square": deviation**2})
    sums = products.groupby([rows["group"], rows["participant"]])[["product", "square"]].sum()
    has_enough = by_person["at"].nunique() >= MIN_EPISODES
    slopes = (sums["product"] / sums["square"])[has_enough]
    levels = by_person["value"].mean()[has_enough] - slopes * by_person["at"].mean()[has_enough]
    lines: dict[str, list[tuple[float, float]]] = {}
    for (group, _), level, slope in zip(slopes.index, levels, slopes, strict=True):
        lines.setdefault(str(group), []).append((float(level), float(slope)))
    return lines


def estimate_mean(name: str, values: Values) -> GrowthTerm:
    """Estimate a mean over people, with the interval and p of the sign-flip test that the mean is 0.

    The interval and p are NaN if there are fewer than two people, or if all have the same value.
    """
    test = paired_test(values)
    if test is None or not test.error > 0:
        return GrowthTerm(name, float(values.mean()), (math.nan, math.nan), math.nan, len(values))
    return GrowthTerm(name, test.difference, test.interval(), test.p(), test.n)


def _estimate_difference(name: str, values: Values, reference: Values) -> GrowthTerm:
    """Estimate the difference of a group's mean from the reference group's; ``name`` names the term.

    The interval and p are NaN if no value varies within a group.
    """
    people = len(values) + len(reference)
    (test,) = permutation_tests([(values, reference)])
    if test is None or not test.error > 0:
        return GrowthTerm(name, float(values.mean() - reference.mean()), (math.nan, math.nan), math.nan, people)
    return GrowthTerm(name, test.difference, test.interval(), test.p(), people)
