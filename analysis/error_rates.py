"""Error rates of the report's statistics: type I error, coverage and contradictions, design by design.

``python analysis/error_rates.py [--studies 10000] [--only NAME] [--out analysis/error_rates.csv]`` simulates studies
whose truth is known and gives each to the functions that the report calls; of an existing table, only the designs
measured are replaced. Studies of the page's tables, whose designs are named ``measure_``, are added to those of an
existing table until there are as many as asked for. ``before`` columns are of what the report printed until
November 2026: Welch's interval, Hedges' g of the pooled SD with its equal-variance interval; ``before_contradictions``
is the share in which that interval and today's p disagree on 0.
"""

import argparse
import csv
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

import design_error_rates
from minihuman.statistics.comparison import standardise
from minihuman.statistics.paired import paired_test
from minihuman.statistics.permutation import adjust_groups, permutation_tests
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.survival import SurvivalTimes, compare_survival
from minihuman.statistics.t_tests import compare_means
from minihuman.statistics.units import find_units, name_units

ALPHA = 0.05
WITH_INTERVALS = (
    1000  # studies of a design whose intervals are searched; of more, coverage is 1 - P(p of the truth < 5 %)
)


@dataclass(frozen=True)
class Design:
    """How one study is drawn: two groups' values, their true difference, and the true difference over the SD."""

    name: str
    draw: Callable[[np.random.Generator], tuple[np.ndarray, np.ndarray]]
    difference: float = 0.0
    average_sd: float = math.nan  # root of the mean of both variances; NaN: g is not looked at


def normal(n: int, m: int, spread: float = 1.0, other: float = 1.0, shift: float = 0.0) -> Design:
    """Normal values."""
    name = f"{n} v {m}, SD {spread:g} v {other:g}" + (f", difference {shift:g}" if shift else "")
    return Design(
        name,
        lambda rng: (rng.normal(shift, spread, n), rng.normal(0, other, m)),
        shift,
        math.sqrt((spread**2 + other**2) / 2),
    )


def lognormal(n: int, m: int, spread: float, other: float) -> Design:
    """Seconds with equal geometric means, on the scale that the report compares them: logarithms."""
    return Design(
        f"{n} v {m} log-normal {spread:g} v {other:g}, as logarithms",
        lambda rng: (rng.normal(3, spread, n), rng.normal(3, other, m)),
        0.0,
        math.sqrt((spread**2 + other**2) / 2),
    )


def raw_lognormal(n: int, m: int, spread: float) -> Design:
    """Skewed values of both groups alike."""
    return Design(
        f"{n} v {m} log-normal {spread:g}, raw",
        lambda rng: (rng.lognormal(0, spread, n), rng.lognormal(0, spread, m)),
    )


def shares(n: int, m: int, alpha: float, beta: float, episodes: int) -> Design:
    """Success of some episodes, people's own chances from a beta distribution."""
    return Design(
        f"{n} v {m} success of {episodes}, people Beta({alpha:g}, {beta:g})",
        lambda rng: (
            rng.binomial(episodes, rng.beta(alpha, beta, n)) / episodes,
            rng.binomial(episodes, rng.beta(alpha, beta, m)) / episodes,
        ),
    )


def ratings(n: int, m: int) -> Design:
    """Five-point answers."""
    chances = (0.1, 0.2, 0.4, 0.2, 0.1)
    return Design(
        f"{n} v {m} five-point answers", lambda rng: (rng.choice(5, n, p=chances), rng.choice(5, m, p=chances))
    )


MEANS = (
    normal(6, 18, 2.5, 1), normal(6, 18, 1, 2.5), normal(4, 20, 2.5, 1), normal(2, 18, 2.5, 1), normal(4, 9),
    normal(2, 2), normal(5, 25, 3, 1), normal(10, 10, 3, 1), normal(6, 18, 2.5, 1, 2), normal(6, 18, 1, 2.5, 2),
    normal(10, 10, shift=1), normal(6, 18, shift=1), normal(3, 3, shift=2), lognormal(10, 10, 1.2, 0.4),
    lognormal(6, 18, 1.2, 1.2), raw_lognormal(10, 10, 1.2),
    raw_lognormal(6, 18, 1.2), shares(10, 10, 18, 1, 10), shares(6, 18, 18, 1, 10), shares(6, 18, 99, 1, 10),
    shares(10, 10, 3, 1, 4), ratings(10, 10),
)  # fmt: skip


def pooled_g_holds(a: np.ndarray, b: np.ndarray, truth: float) -> bool:
    """Whether the equal-variance interval of Hedges' g holds the truth."""
    n, m = len(a), len(b)
    pooled = math.sqrt(((n - 1) * a.var(ddof=1) + (m - 1) * b.var(ddof=1)) / (n + m - 2))
    g = (a.mean() - b.mean()) / pooled * (1 - 3 / (4 * (n + m) - 9))
    return abs(g - truth) <= float(scipy.special.ndtri(0.975)) * math.sqrt(
        (n + m) / (n * m) + 0.5 * g**2 / (n + m - 3.94)
    )


def measure_means(design: Design, studies: int, seed: int) -> dict[str, object]:
    """Simulate a design's studies."""
    rng = np.random.default_rng([20261123, seed])
    rejected, held, welch, g_held, old_g, contradictions, old_contradictions, refused = [], [], [], [], [], [], [], 0
    for _ in range(studies):
        a, b = (values.astype(float) for values in design.draw(rng))
        (test,) = permutation_tests([(a, b)])
        assert test is not None
        p = test.p()
        rejected.append(p < ALPHA)  # of the true null where the difference is 0
        if not test.has_interval:
            refused += 1
            continue
        held.append(test.p(design.difference) >= ALPHA)
        if len(held) > WITH_INTERVALS:
            continue
        interval = test.interval()
        contradictions.append((p < ALPHA) == (interval[0] <= 0 <= interval[1]))
        low, high = compare_means(a, b).interval()
        welch.append(low <= design.difference <= high)
        old_contradictions.append((p < ALPHA) == (low <= 0 <= high))
        if min(test.n) >= 5 and min(np.ptp(a), np.ptp(b)) > 0 and not math.isnan(design.average_sd):
            _, (low, high) = standardise(a, b, interval)
            contradictions.append((p < ALPHA) == (low <= 0 <= high))
            g_held.append(low <= design.difference / design.average_sd <= high)
            pooled = design.difference / design.average_sd
            old_g.append(pooled_g_holds(a, b, pooled))
    kind = "type_1" if design.difference == 0 else "power"
    return {
        "design": design.name, "studies": studies, kind: np.mean(rejected), "coverage": held, "g_coverage": g_held,
        "contradictions": sum(contradictions), "refused": refused / studies, "before_coverage": welch,
        "before_g_coverage": old_g, "before_contradictions": np.mean(old_contradictions) if old_contradictions else "",
    }  # fmt: skip


@dataclass(frozen=True)
class Waits:
    """Waiting times of two groups: log-normal where ``sigma`` is given, else exponential.

    ``censored`` are shares of the first and of the second group, at the end of a time or at random times.
    """

    n: tuple[int, int]
    censored: tuple[float, float]
    at_random: bool = False
    means: tuple[float, float] = (40.0, 40.0)
    sigma: float = 0.0

    def draw(self, rng: np.random.Generator) -> list[SurvivalTimes]:
        """Both groups."""
        found = []
        for size, share, mean in zip(self.n, self.censored, self.means, strict=True):
            times = rng.lognormal(math.log(mean), self.sigma, size) if self.sigma else rng.exponential(mean, size)
            stop = np.full(size, -mean * math.log(share))
            if self.at_random:
                stop = rng.exponential(mean * (1 - share) / share, size)
            found.append(SurvivalTimes(np.minimum(times, stop), times <= stop))
        return found

    def difference(self, until: float) -> float:
        """The true difference of restricted means."""
        if self.means[0] == self.means[1]:
            return 0.0
        first, second = (mean * -math.expm1(-until / mean) for mean in self.means)
        return first - second


SURVIVAL = {
    "15 v 15 waits, 60 % censored at the end": Waits((15, 15), (0.6, 0.6)),
    "6 v 18 waits, 60 % censored at the end": Waits((6, 18), (0.6, 0.6)),
    "6 v 18 waits, 60 % censored at random": Waits((6, 18), (0.6, 0.6), at_random=True),
    "10 v 20 waits, 30 % censored at random": Waits((10, 20), (0.3, 0.3), at_random=True),
    "6 v 18 waits, 10 % censored at the end": Waits((6, 18), (0.1, 0.1)),
    "15 v 15 log-normal 1.2 waits, 20 v 40 % censored at random": Waits((15, 15), (0.2, 0.4), True, sigma=1.2),
    "9 v 18 waits, 40 v 20 % censored at random": Waits((9, 18), (0.4, 0.2), at_random=True),
    "18 v 6 waits, 40 v 10 % censored at random": Waits((18, 6), (0.4, 0.1), at_random=True),
    "20 v 20 waits, mean 40 v 80, 55 v 74 % censored at the end": Waits((20, 20), (0.549, 0.741), means=(40, 80)),
}


def measure_survival(name: str, studies: int, seed: int) -> dict[str, object]:
    """Restricted means of two groups' waiting."""
    rng = np.random.default_rng([20261124, seed])
    rejected, held, contradictions, refused = [], [], 0, 0
    for _ in range(studies):
        found = compare_survival(*SURVIVAL[name].draw(rng))
        assert found is not None
        if math.isnan(found.p):
            refused += 1
            continue
        low, high = found.interval
        rejected.append(found.p < ALPHA)
        held.append(low <= SURVIVAL[name].difference(found.until) <= high)
        contradictions += (found.p < ALPHA) == (low <= 0 <= high)
    kind = "type_1" if SURVIVAL[name].difference(1.0) == 0 else "power"
    return {
        "design": name, "studies": studies, kind: np.mean(rejected) if rejected else "", "coverage": held,
        "contradictions": contradictions, "refused": refused / studies,
    }  # fmt: skip


PAIRED = {
    "12 within, normal": (lambda rng: rng.normal(0.5, 1, 12), 0.5),
    "8 within, normal": (lambda rng: rng.normal(0.0, 1, 8), 0.0),
    "20 within, success of 10 twice": (lambda rng: _two_shares(rng, 20), 0.0),
    "15 within, logarithms of times": (lambda rng: rng.gamma(4, 0.25, 15) - rng.gamma(4, 0.25, 15), 0.0),
}


@dataclass(frozen=True)
class Adjusted:
    """Groups of equal adjusted means; each of some covariates predicts values with a slope of ``slope``."""

    n: tuple[int, int]
    covariates: int
    spreads: tuple[float, float] = (1.0, 1.0)
    slope: float = 0.5

    def draw(self, rng: np.random.Generator) -> list[tuple[np.ndarray, np.ndarray]]:
        """Values and covariates of both groups; covariates differ between groups by 0.3 on average."""
        found = []
        for size, spread, shift in zip(self.n, self.spreads, (0.3, 0.0), strict=True):
            covariates = rng.normal(shift, 1, (size, self.covariates))
            found.append((rng.normal(0, spread, size) + self.slope * covariates.sum(axis=1), covariates))
        return found


ADJUSTED = {
    "4 v 4 adjusted for 2 covariates": Adjusted((4, 4), 2),
    "5 v 5 adjusted for 2 covariates": Adjusted((5, 5), 2),
    "6 v 6 adjusted for 3 covariates": Adjusted((6, 6), 3),
    "6 v 18 adjusted for 1 covariate, SD 2.5 v 1": Adjusted((6, 18), 1, (2.5, 1.0)),
    "20 v 20 adjusted for 2 covariates": Adjusted((20, 20), 2),
}


def measure_adjusted(name: str, studies: int, seed: int) -> dict[str, object]:
    """Two groups at equal covariates."""
    rng = np.random.default_rng([20261126, seed])
    rejected, held, contradictions, refused = [], [], 0, 0
    for _ in range(studies):
        found = adjust_groups(*ADJUSTED[name].draw(rng))
        if found is None:
            refused += 1
            continue
        test = found[2]
        p = test.p()
        rejected.append(p < ALPHA)
        held.append(p >= ALPHA)  # the truth is 0
        if len(held) <= WITH_INTERVALS:
            low, high = test.interval()
            contradictions += (p < ALPHA) == (low <= 0 <= high)
    return {
        "design": name, "studies": studies, "type_1": np.mean(rejected) if rejected else "", "coverage": held,
        "contradictions": contradictions, "refused": refused / studies,
    }  # fmt: skip


def _two_shares(rng: np.random.Generator, n: int) -> np.ndarray:
    own = rng.beta(18, 1, n)
    return (rng.binomial(10, own) - rng.binomial(10, own)) / 10


def measure_paired(name: str, studies: int, seed: int) -> dict[str, object]:
    """Differences within a person."""
    rng = np.random.default_rng([20261125, seed])
    draw, truth = PAIRED[name]
    rejected, held, contradictions = [], [], 0
    for _ in range(studies):
        test = paired_test(draw(rng))
        assert test is not None
        p, (low, high) = test.p(), test.interval()
        rejected.append(p < ALPHA)
        held.append(low <= truth <= high)
        contradictions += (p < ALPHA) == (low <= 0 <= high)
    kind = "power" if truth else "type_1"
    return {
        "design": name, "studies": studies, kind: np.mean(rejected), "coverage": held,
        "contradictions": contradictions, "refused": 0.0,
    }  # fmt: skip


@dataclass(frozen=True)
class Teams:
    """Two conditions of so many teams of two; a person's value is their team's and their own.

    ``own`` is the share of the variance within teams.
    """

    teams: int = 20
    own: float = 0.5

    def rows(self) -> tuple[pd.DataFrame, np.ndarray]:
        """Who was in which team, as the table "teams" says it, and each person's condition."""
        names = [f"sub-{number:03d}" for number in range(4 * self.teams)]
        team = [f"{side}-{team}" for side in (0, 1) for team in range(self.teams) for _ in range(2)]
        return pd.DataFrame({"participant": names, "team": team}), np.repeat((0, 1), 2 * self.teams)

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Everyone's values."""
        common = np.repeat(rng.normal(0, math.sqrt(1 - self.own), 2 * self.teams), 2)
        return common + rng.normal(0, math.sqrt(self.own), len(common))


TEAMS = {
    "20 v 20 teams of two, half the variance within": Teams(),
    "20 v 20 teams of two, a tenth of the variance within": Teams(own=0.1),
}


def measure_teams(name: str, studies: int, seed: int) -> dict[str, object]:
    """Conditions that teams play in, by the report's way: the mean of each unit, regrouped whole."""
    rng, design = np.random.default_rng([20261126, seed]), TEAMS[name]
    rows, side = design.rows()
    number, unit = np.unique(name_units(rows, find_units(rows))["participant"], return_inverse=True)
    sizes, sides = np.bincount(unit), np.zeros(len(number), int)
    sides[unit] = side
    rejected, held, contradictions = [], [], 0
    means = [np.bincount(unit, design.draw(rng)) / sizes for _ in range(studies)]
    pairs = [(values[sides == 0], values[sides == 1]) for values in means]
    for test in (test for begin in range(0, studies, 100) for test in permutation_tests(pairs[begin : begin + 100])):
        assert test is not None
        rejected.append(test.p() < ALPHA)
        held.append(not rejected[-1])
        if len(held) <= WITH_INTERVALS:
            low, high = test.interval()
            contradictions += rejected[-1] == (low <= 0 <= high)
    return {
        "design": name, "studies": studies, "type_1": np.mean(rejected), "coverage": held,
        "contradictions": contradictions, "refused": 0.0,
    }  # fmt: skip


COLUMNS = (
    *("design", "studies", "type_1", "power", "coverage", "coverage_low", "coverage_high", "g_coverage"),
    *("contradictions", "refused", "before_coverage", "before_g_coverage", "before_contradictions", "ms_per_study"),
    *("rejected", "intervals", "held"),  # counts of the report's tables, to which studies can be added
)


def summarise(row: dict[str, object], seconds: float) -> dict[str, object]:
    """One line of the table, shares with the Monte Carlo interval of the coverage."""
    held = row.get("coverage")
    found = dict(row)
    if isinstance(held, list) and held:
        found["coverage_low"], found["coverage_high"] = wilson_interval(int(sum(held)), len(held))
    for name in ("coverage", "g_coverage", "before_coverage", "before_g_coverage"):
        values = found.get(name)
        found[name] = float(np.mean(values)) if isinstance(values, list) and values else ""
    found["ms_per_study"] = 1000 * seconds / int(str(row["studies"]))
    return {name: f"{value:.4g}" if isinstance(value := found.get(name, ""), float) else value for name in COLUMNS}


Job = Callable[[int], list[dict[str, object]]]


def list_jobs(studies: int) -> Iterator[tuple[str, Job]]:
    """Yield the name of each measurement, and the function that makes its rows from a seed."""
    for design in MEANS:
        yield design.name, lambda at, d=design: [measure_means(d, studies, at)]
    for names, measure in (
        (SURVIVAL, measure_survival), (PAIRED, measure_paired), (TEAMS, measure_teams), (ADJUSTED, measure_adjusted),
    ):  # fmt: skip
        for name in names:
            yield name, lambda at, n=name, f=measure: [f(n, studies, at)]


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--studies", type=int, default=1000)
    options.add_argument("--only", default="", help="designs whose names hold this")
    options.add_argument("--out", type=Path)
    options.add_argument("--resamples", type=int, default=9999, help="permutations of a test")
    given = options.parse_args()
    with design_error_rates.use_resamples(given.resamples):
        measure_all(given)


def measure_all(given: argparse.Namespace) -> None:
    """Measure the designs that are wanted; write the table after each, and print them."""
    jobs: list[tuple[str, Job]] = list(list_jobs(given.studies))
    names = [name for name, _ in jobs]
    rows: dict[str, dict[str, object]] = {}
    if given.out and given.out.exists():
        with given.out.open(newline="", encoding="utf-8") as file:
            rows = {row["design"]: dict(row) for row in csv.DictReader(file)}
    for at, (name, job) in enumerate(jobs):
        if given.only in name:
            begun = time.process_time()
            measured = job(at)
            seconds = (time.process_time() - begun) / len(measured)
            for row in measured:
                summary = summarise(row, seconds)
                rows[str(row["design"])] = summary
                print(" ".join(f"{key}={value}" for key, value in summary.items() if value != ""), flush=True)
            write_table(given.out, rows, names)
    for more in design_error_rates.add_studies(rows, given.studies, given.only):
        rows |= more
        write_table(given.out, rows, names)


def write_table(out: Path | None, rows: dict[str, dict[str, object]], names: list[str]) -> None:
    """Write the rows of all designs measured so far: first those that are a job of their own, in the jobs' order."""
    if out is None:
        return
    in_order = [*(name for name in names if name in rows), *(name for name in rows if name not in names)]
    with out.open("w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows[name] for name in in_order)


if __name__ == "__main__":
    main()
