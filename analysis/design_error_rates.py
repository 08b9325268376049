"""Error rates of the report's tables in studies of several designs, for ``error_rates.py``.

A study is drawn as rows of tables and passed to the functions that the report calls. Each design gives one or more
rows, named for the design and the table of the page.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign, Factor
from minihuman.reporting.block_results import compare_measures, list_changes
from minihuman.reporting.interactions import compute_interaction
from minihuman.reporting.within_results import compare_within, unite_teams
from minihuman.statistics import interaction, paired, permutation, regroupings, two_part_model
from minihuman.statistics.equivalence import check_equivalence
from minihuman.statistics.paired import compare_growth
from minihuman.statistics.reliability import estimate_reliability
from minihuman.statistics.two_part_model import compare_two_parts

ALPHA = 0.05
MEASURE = "reward_mean"
LATIN_SQUARE = ("abc", "bca", "cab", "acb", "bac", "cba")  # each condition follows each other one as often
Draw = Callable[[np.random.Generator, int], np.ndarray]


@dataclass(frozen=True)
class Outcome:
    """What one table of one study says: p of a true null hypothesis, and whether an interval holds the truth.

    p is NaN where the table has none, and ``holds`` None where there is no interval.
    """

    p: float
    holds: bool | None = None


@dataclass(frozen=True)
class Population:
    """Two groups of participants whose own values have a mean of 0."""

    name: str
    sizes: tuple[int, int]
    draws: tuple[Draw, Draw]
    spreads: tuple[float, float]  # standard deviations


def normal(n: int, m: int, first: float, second: float) -> Population:
    """Return groups of normal values."""
    return Population(
        f"{n} v {m}, SD {first:g} v {second:g}",
        (n, m),
        (lambda rng, size: rng.normal(0, first, size), lambda rng, size: rng.normal(0, second, size)),
        (first, second),
    )


def skewed(n: int, m: int) -> Population:
    """Return a group of exponential values and a group of normal ones, with equal standard deviations."""
    return Population(
        f"{n} v {m}, exponential v normal",
        (n, m),
        (lambda rng, size: rng.exponential(1, size) - 1, lambda rng, size: rng.normal(0, 1, size)),
        (1.0, 1.0),
    )


POPULATIONS = (
    normal(2, 18, 3, 1), normal(4, 20, 3, 1), normal(8, 24, 3, 1), normal(10, 10, 3, 1), skewed(12, 12), skewed(12, 40),
)  # fmt: skip


def _people(population: Population, rng: np.random.Generator, values: int) -> Iterator[tuple[str, str, np.ndarray]]:
    """Yield each participant's group, code and own values, which are independent."""
    for group, size, draw in zip("ab", population.sizes, population.draws, strict=True):
        own = np.column_stack([draw(rng, size) for _ in range(values)])
        for number, row in enumerate(own):
            yield group, f"{group}{number:03}", row


def measure_lines(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the differences of level and slope of lines over five episodes."""
    rows = [
        (group, code, at, level + slope * (at - 3) + rng.normal(0, 0.3))
        for group, code, (level, slope) in _people(population, rng, 2)
        for at in range(1, 6)
    ]
    frame = pd.DataFrame(rows, columns=["group", "participant", "episode_in_block", "reward"])
    growth = compare_growth(frame, "reward", order=("a", "b"))
    assert growth is not None
    for term in growth.terms:
        if term.name.startswith("a minus b"):
            name = "slope" if "change" in term.name else "level"
            low, high = term.interval
            yield f"lines, {name}", Outcome(term.p, None if math.isnan(low) else low <= 0 <= high)


def measure_equivalence(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the test of equivalence of groups whose difference is the margin, three standard errors."""
    a, b = (draw(rng, size) for draw, size in zip(population.draws, population.sizes, strict=True))
    margin = 3 * math.hypot(*(s / math.sqrt(n) for s, n in zip(population.spreads, population.sizes, strict=True)))
    test = check_equivalence(a + margin, b, (-margin, margin))
    yield "equivalence at the margin", Outcome(test.p)


def measure_parts(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of rewards in two parts; three tenths of the episodes are at 0."""
    rows = []
    for group, code, (level, odds) in _people(population, rng, 2):
        chance = 1 / (1 + math.exp(-(math.log(3 / 7) + odds / 2)))
        rows += [(group, code, 0.0 if rng.random() < chance else 20 + level + rng.normal()) for _ in range(10)]
    frame = pd.DataFrame(rows, columns=["group", "participant", "reward"])
    parts = compare_two_parts(frame, "reward", ("a", "b"))
    yield "reward where earned", Outcome(parts.amount.p)
    yield "both parts of the reward", Outcome(parts.p)


def measure_reliability(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield whether the interval of the ICC holds the pooled share of variance between participants."""
    rows = [
        (group, code, level + rng.normal()) for group, code, (level,) in _people(population, rng, 1) for _ in range(8)
    ]
    reliability = estimate_reliability("m", pd.DataFrame(rows, columns=["group", "participant", "value"]))
    if reliability is None:
        yield "reliability, ICC", Outcome(math.nan)
        return
    weights = np.array(population.sizes) - 1
    variance = float(weights @ np.square(population.spreads)) / weights.sum()
    low, high = reliability.icc_interval
    yield "reliability, ICC", Outcome(math.nan, None if math.isnan(low) else low <= variance / (variance + 1) <= high)


def measure_order(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of conditions in a Latin square, and the tests of position and carry-over."""
    rows = []
    for number, (_, code, own) in enumerate(_people(population, rng, 3)):
        level = rng.normal()
        for block in LATIN_SQUARE[number % 6]:
            rows.append((code, 1, block, level + own["abc".index(block)] * (3 if block == "a" else 1)))
    frame = pd.DataFrame(rows, columns=["participant", "session", "block", MEASURE])
    within = compare_within(frame, AnalysisSpec(primary_measure=MEASURE, conditions=("a", "b", "c")))
    assert within is not None
    pair = within.comparisons[0]
    yield "Latin square, conditions", Outcome(pair.p, pair.interval[0] <= 0 <= pair.interval[1])
    yield "Latin square, any two conditions", Outcome(min(comparison.p_holm for comparison in within.comparisons))
    for term in within.effects:
        yield f"Latin square, {term.effect}", Outcome(term.p)


def _design(conditions: str) -> ExperimentDesign:
    return ExperimentDesign(
        factors=(Factor("group", ("a", "b"), is_within=False), Factor("condition", tuple(conditions), is_within=True)),
        primary_effect="interaction",
        condition_of_block=tuple((name, name) for name in conditions),
    )


def _mixed_rows(population: Population, rng: np.random.Generator, conditions: str) -> pd.DataFrame:
    rows = [
        (group, code, block, 1, value)
        for group, code, own in _people(population, rng, len(conditions))
        for block, value in zip(conditions, own, strict=True)
    ]
    return pd.DataFrame(rows, columns=["group", "participant", "block", "session", MEASURE])


def measure_mixed(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the interaction of two groups and three conditions: all of it, and its contrasts."""
    rows = _mixed_rows(population, rng, "xyz")
    results = compute_interaction(rows, _design("xyz"), AnalysisSpec(primary_measure=MEASURE), ("a", "b"))
    assert results is not None
    yield "2 x 3 mixed, interaction", Outcome(results.omnibus[0].test.p)
    low, high = results.contrasts[0].groups.interval
    yield "2 x 3 mixed, contrast", Outcome(results.contrasts[0].groups.p, None if math.isnan(low) else low <= 0 <= high)
    yield "2 x 3 mixed, any contrast", Outcome(min(compared.groups.p_holm for compared in results.contrasts))


def measure_teams(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the interaction of two groups and two conditions that teams of two played; a team has its own value."""
    rows = _mixed_rows(population, rng, "xy")
    members = pd.concat([rows.assign(member=number, team=rows["participant"]) for number in (0, 1)])
    members["participant"] += "-" + members["member"].astype(str)
    members[MEASURE] += rng.normal(0, 0.5, len(members))
    members = members.reset_index(drop=True)
    united = unite_teams(members, members[["participant", "team", "block"]])
    results = compute_interaction(united, _design("xy"), AnalysisSpec(primary_measure=MEASURE), ("a", "b"))
    assert results is not None
    (contrast,) = results.contrasts
    assert contrast.groups.n == population.sizes
    low, high = contrast.groups.interval
    yield "teams of two, interaction", Outcome(contrast.groups.p, None if math.isnan(low) else low <= 0 <= high)


def measure_days(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of two groups on their change from one day to the next; a tenth miss the second day."""
    rows = [
        (group, code, session, 1.0 * session + value)
        for group, code, own in _people(population, rng, 2)
        for session, value in zip((1, 2), own, strict=True)
        if session == 1 or rng.random() > 0.1
    ]
    frame = pd.DataFrame(rows, columns=["group", "participant", "session", MEASURE])
    ((_, change),) = list_changes(frame, [MEASURE]).items()
    (comparison,) = compare_measures(change, {MEASURE: "primary"}, ("a", "b"))
    low, high = comparison.interval
    yield "two days, change", Outcome(comparison.p, None if math.isnan(low) else low <= 0 <= high)


def use_resamples(count: int) -> None:
    """Let every test draw ``count`` permutations instead of 9,999, which leaves the level as it is."""
    for module in (interaction, paired, permutation, regroupings, two_part_model):
        module.RESAMPLES = count


Measurement = Callable[[Population, np.random.Generator], Iterator[tuple[str, Outcome]]]
MEASUREMENTS: tuple[Measurement, ...] = (
    measure_lines, measure_equivalence, measure_parts, measure_reliability, measure_order, measure_mixed,
    measure_teams, measure_days,
)  # fmt: skip


def measure_design(
    measurement: Measurement, population: Population, studies: int, seed: int
) -> Iterator[dict[str, object]]:
    """Yield a row for each table of a design's studies, with the share of true null hypotheses at p < 0.05.

    A study without p, or without an interval where there is no p, counts as refused and as not rejected.
    """
    rng = np.random.default_rng([20261129, seed])
    outcomes: dict[str, list[Outcome]] = defaultdict(list)
    for _ in range(studies):
        for name, outcome in measurement(population, rng):
            outcomes[name].append(outcome)
    for name, of_table in outcomes.items():
        has_p = [not math.isnan(outcome.p) for outcome in of_table]
        held = [outcome.holds for outcome in of_table if outcome.holds is not None]
        both = [outcome for outcome in of_table if outcome.holds is not None and not math.isnan(outcome.p)]
        refused = sum(math.isnan(outcome.p) and outcome.holds is None for outcome in of_table)
        yield {
            "design": f"{name}: {population.name}", "studies": len(of_table),
            "type_1": sum(outcome.p < ALPHA for outcome in of_table) / len(of_table) if any(has_p) else "",
            "coverage": held, "contradictions": sum((outcome.p < ALPHA) == outcome.holds for outcome in both),
            "refused": refused / len(of_table),
        }  # fmt: skip
