"""Linear mixed models of a measure over the episodes of a block, fitted by restricted maximum likelihood."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from minihuman.statistics.paired import GrowthTerm
from minihuman.statistics.t_tests import LEVEL, Values


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A linear mixed model of a measure over episodes, fitted by REML."""

    has_slopes: bool  # of each person, besides the intercept
    people: int
    terms: tuple[GrowthTerm, ...]  # those of ``GrowthComparison``; empty where no model converged


# The gain in log-likelihood above which a part of a mixed model is kept: programs do not stop at the same last digits.
MIN_GAIN = 1e-3
_Fit = tuple[float, Values, Values]  # the log-likelihood, the estimates, and their standard errors
_MAX_RATIO = 1e3  # the largest SD between people over the residual SD; above half of it, the likelihood has no maximum


def fit_mixed_model(rows: pd.DataFrame, measure: str, groups: Sequence[str]) -> MixedModel | None:
    """Fit group, episode and their interaction by REML, with random slopes or random intercepts of people.

    Random slopes and intercepts are kept if they raise the log-likelihood by more than ``MIN_GAIN`` above that of every
    singular covariance of the two; otherwise, intercepts alone are kept if they raise it by as much. If neither is
    kept, or no maximum exists, the model has no terms. Intervals and p are Wald's, with a t distribution whose degrees
    of freedom are people minus groups, since the groups' terms differ between people. The last group is the reference.

    Args:
        rows: one row per episode, with ``participant``, ``group``, ``episode_in_block`` and the measure
        measure: the measure's column
        groups: the groups to compare

    Returns:
        The model; None if there are fewer than two degrees of freedom.
    """
    valid = rows[rows["group"].isin(groups)].dropna(subset=[measure]).sort_values("participant", kind="stable")
    *other_groups, reference = groups
    begins = np.flatnonzero(~valid["participant"].duplicated())
    people = len(begins)
    freedom = people - len(groups)
    if freedom < 2:
        return None
    at = (valid["episode_in_block"] - valid["episode_in_block"].mean()).to_numpy(float)
    shares = np.column_stack([np.ones(len(at)), *((valid["group"] == group).to_numpy(float) for group in other_groups)])
    design = np.column_stack([shares, shares * at[:, None], valid[measure].to_numpy(float)])
    if np.linalg.matrix_rank(design) < design.shape[1]:  # the terms cannot be told apart, or explain everything
        return MixedModel(False, people, ())  # no slopes, no terms
    fits = [_fit_reml(design, at, begins, free) for free in range(4)]  # by the number of covariance parameters
    fit = _choose_fit(fits)
    if fit is None:
        return MixedModel(False, people, ())  # no slopes, no terms
    _, estimates, errors = fit
    half = scipy.special.stdtrit(freedom, (1 + LEVEL) / 2) * errors
    ps = 2 * scipy.special.stdtr(freedom, -np.abs(estimates / errors))
    ps[0] = math.nan  # a test of a level against 0 means nothing
    names = _name_mixed_terms(measure, reference, other_groups)
    terms = tuple(
        GrowthTerm(name, float(b), (float(b - h), float(b + h)), float(p), people)
        for name, b, h, p in zip(names, estimates, half, ps, strict=True)
    )
    return MixedModel(fit is fits[3], people, terms)


def _choose_fit(fits: Sequence[_Fit]) -> _Fit | None:
    """Return the fit with random slopes and intercepts, or that with intercepts; None if neither gains enough.

    ``fits`` are those of 0 to 3 covariance parameters: no random effects, intercepts, a singular covariance of
    intercepts and slopes, and any covariance of these.
    """
    without_effects, with_intercepts, with_singular_slopes, with_slopes = fits
    if with_slopes[0] > with_singular_slopes[0] + MIN_GAIN:
        return with_slopes
    if with_intercepts[0] > without_effects[0] + MIN_GAIN:
        return with_intercepts
    return None


def _name_mixed_terms(measure: str, reference: str, other_groups: Sequence[str]) -> list[str]:
    """Return the names of a mixed model's terms: the levels of all groups, then their changes per episode."""
    names = []
    for quantity in (f"{measure} in the middle of the block", "change an episode"):
        names.append(f"{reference}: {quantity}")
        names += [f"{group} minus {reference}: {quantity}" for group in other_groups]
    return names


def _fit_reml(design: Values, at: Values, begins: NDArray[np.int64], free: int) -> _Fit:
    """Maximise the restricted likelihood of a linear mixed model, profiled as in lme4 (Bates et al., 2015, 3.4).

    Args:
        design: the columns of the model's terms, with the measure as the last column
        at: the position of each row on its person's line
        begins: the first row of each person, whose rows follow each other
        free: the number of fitted covariance parameters, the others being 0: the SD of intercepts, the part of slopes
            shared with intercepts, and the variance of the rest of slopes, all relative to the residual variance

    Returns:
        The log-likelihood up to a constant (-infinity without a maximum), the estimates, and their standard errors.
    """
    own = np.column_stack([np.ones(len(at)), at / at.std()])
    among, between = (np.add.reduceat(own[:, :, None] * columns[:, None, :], begins) for columns in (own, design))
    among, kind, people = np.unique(among, axis=0, return_inverse=True, return_counts=True)
    products = np.zeros((len(among), 2, 2, *[design.shape[1]] * 2))  # summed over people with the same episodes
    np.add.at(products, kind.ravel(), between[:, :, None, :, None] * between[:, None, :, None, :])
    total = design.T @ design
    freedom = len(design) - design.shape[1] + 1

    def profile(entries: Values | Sequence[float]) -> tuple[float, Values, Values]:
        first, shared, slope_variance = (*entries, 0.0, 0.0, 0.0)[:3]  # parameters that are not fitted are 0
        factor = np.array([[first, 0.0], [shared, math.sqrt(slope_variance)]])  # an SD would have a saddle point at 0
        inner = np.eye(2) + factor.T @ among @ factor
        reduced = total - np.einsum("kij,kijab->ab", factor @ np.linalg.solve(inner, factor.T[None]), products)
        terms = reduced[:-1, :-1]
        estimates = np.linalg.solve(terms, reduced[:-1, -1])
        variance = max((reduced[-1, -1] - reduced[-1, :-1] @ estimates) / freedom, np.finfo(float).tiny)
        logs = freedom * math.log(variance) + people @ np.linalg.slogdet(inner)[1] + np.linalg.slogdet(terms)[1]
        return float(logs) / 2, estimates, np.sqrt(variance * np.diag(np.linalg.inv(terms)))

    def loss_of(entries: Values | Sequence[float], /) -> float:
        return profile(entries)[0]

    bounds = ((0, _MAX_RATIO), (-_MAX_RATIO, _MAX_RATIO), (0, _MAX_RATIO))[:free]
    optima: list[list[float]] = []
    if not free:
        optima.append([])
    for start in _list_starts(free):
        optima += [scipy.optimize.minimize(loss_of, start, bounds=bounds, tol=1e-10).x.tolist()]
    best = min(optima, key=loss_of)
    loss, estimates, errors = profile(best)
    if not np.all(np.abs(best) < _MAX_RATIO / 2):
        return -math.inf, estimates, errors
    return -loss, estimates, errors


def _list_starts(free: int) -> Iterator[tuple[float, ...]]:
    """Yield the parameters at which to start maximising the likelihood, each tuple of length ``free``.

    Several starts are needed because a step that is too long ends at an SD of 0, where the gradient is always 0.
    """
    for level in (0.5, 0.1, 2.0):
        for shared in (0.1, -0.1)[: min(free, 2)]:
            yield (level, shared, 0.1)[:free]
