"""What a comparison of two groups of given sizes could show."""

import math
from dataclasses import dataclass

from scipy import special

from minihuman.statistics.compare import LEVEL

_LARGE_G = 0.8
_LIKELY = 0.8
_ONE_SIDED = 5.0  # standard errors
_LARGEST_G = 30.0
_NEAR_ENOUGH = 1e-9  # standard deviations


@dataclass(frozen=True, slots=True)
class Power:
    """What a comparison of two groups of these sizes could show, by a two-sided t test at 5 %."""

    n: tuple[int, int]
    power_for_large: float  # chance to find a difference of 0.8 standard deviations
    detectable_g: float  # the difference found with a chance of 80 %, in standard deviations
    needed_for_large: int  # participants a group for a chance of 80 % at 0.8 standard deviations


def power(n: tuple[int, int]) -> Power:
    """What two groups of ``n`` participants could show. NaN for a group with fewer than two."""
    needed = next(size for size in range(2, 1000) if t_test_power(_LARGE_G, (size, size)) >= _LIKELY)
    if min(n) < 2:
        return Power(n, math.nan, math.nan, needed)
    return Power(n, t_test_power(_LARGE_G, n), _found_with(_LIKELY, n), needed)


def _found_with(chance: float, n: tuple[int, int]) -> float:
    """The difference in standard deviations that is found with such a chance, by halving what it lies between."""
    low, high = 0.0, _LARGEST_G
    while high - low > _NEAR_ENOUGH:
        middle = (low + high) / 2
        low, high = (middle, high) if t_test_power(middle, n) < chance else (low, middle)
    return (low + high) / 2


def t_test_power(d: float, n: tuple[int, int], *, level: float = LEVEL) -> float:
    """The chance that a two-sided t test finds a difference of ``d`` standard deviations (Cohen, 1988)."""
    freedom = sum(n) - 2
    shift = d * math.sqrt(n[0] * n[1] / sum(n))
    critical = float(special.stdtrit(freedom, (1 + level) / 2))
    above = 1.0 - float(special.nctdtr(freedom, shift, critical))
    # the other tail is nothing by then, and SciPy's is NaN
    below = float(special.nctdtr(freedom, shift, -critical)) if shift < _ONE_SIDED else 0.0
    return above + below
