"""Error rates of the report's tables in studies of several designs, for ``error_rates.py``.

A study is drawn as rows of tables and passed to the functions that the report calls. Each design gives one or more
rows, named for the design and the table of the page.
"""

import json
import math
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign, Factor
from minihuman.reporting.block_results import compare_adjusted, compare_measures, list_changes
from minihuman.reporting.interactions import compute_interaction
from minihuman.reporting.within_results import compare_labels, compare_within, measure_levels, unite_teams
from minihuman.statistics import interaction, paired, permutation, regroupings, survival, two_part_model
from minihuman.statistics.equivalence import check_equivalence
from minihuman.statistics.paired import compare_growth, paired_test
from minihuman.statistics.reliability import estimate_reliability
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.survival import SurvivalTimes, compare_survival
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


def _holds(interval: tuple[float, float], truth: float = 0.0) -> bool | None:
    """Return whether an interval holds the truth; None if there is no interval."""
    if math.isnan(interval[0]):
        return None
    return bool(interval[0] <= truth <= interval[1])


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


def measure_groups(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of groups, also at equal covariates: age predicts values and differs between groups."""
    rows = []
    for group, code, (own,) in _people(population, rng, 1):
        age = rng.normal(0.3 if group == "a" else 0.0)
        rows.append((group, code, own, own + 0.5 * age, age))
    frame = pd.DataFrame(rows, columns=["group", "participant", MEASURE, "aged", "age"])
    (comparison,) = compare_measures(frame, {MEASURE: "primary"}, ("a", "b"))
    yield "groups", Outcome(comparison.p, _holds(comparison.interval))
    analysis = AnalysisSpec(primary_measure="aged", covariates=("age",))
    (adjusted,) = compare_adjusted(frame, analysis, ("a", "b"))
    yield "groups, adjusted", Outcome(adjusted.p, _holds(adjusted.interval))


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
            yield f"lines, {name}", Outcome(term.p, _holds(term.interval))


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
        chance = min(max(0.3 + 0.03 * odds, 0.0), 1.0)  # linear, so that groups have equal shares
        rows += [(group, code, 0.0 if rng.random() < chance else 20 + level + rng.normal()) for _ in range(10)]
    frame = pd.DataFrame(rows, columns=["group", "participant", "reward"])
    parts = compare_two_parts(frame, "reward", ("a", "b"))
    yield "odds of a reward", Outcome(parts.any.p, _holds(parts.any.interval, 1.0))
    yield "reward where earned", Outcome(parts.amount.p, _holds(parts.amount.interval))
    yield "both parts of the reward", Outcome(parts.p)


def measure_reliability(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield whether the interval of the ICC holds the pooled share of variance between participants."""
    rows = [
        (group, code, level + rng.normal()) for group, code, (level,) in _people(population, rng, 1) for _ in range(8)
    ]
    reliability = estimate_reliability("m", pd.DataFrame(rows, columns=["group", "participant", "value"]))
    assert reliability is not None
    weights = np.array(population.sizes) - 1
    variance = float(weights @ np.square(population.spreads)) / weights.sum()
    for name, interval, episodes in (
        ("ICC", reliability.icc_interval, 1),
        ("split-half", reliability.halves_interval, 8),
    ):
        truth = variance / (variance + 1 / episodes)
        yield f"reliability, {name}", Outcome(math.nan, _holds(interval, truth))


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
    yield "Latin square, conditions", Outcome(pair.p, _holds(pair.interval))
    yield "Latin square, any two conditions", Outcome(min(comparison.p_holm for comparison in within.comparisons))
    for term in within.effects:
        yield f"Latin square, {term.effect}", Outcome(term.p)


def _design(conditions: str, groups: tuple[str, ...] = ("a", "b")) -> ExperimentDesign:
    return ExperimentDesign(
        factors=(Factor("group", groups, is_within=False), Factor("condition", tuple(conditions), is_within=True)),
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
    contrast = results.contrasts[0].groups
    yield "2 x 3 mixed, contrast", Outcome(contrast.p, _holds(contrast.interval))
    yield "2 x 3 mixed, any contrast", Outcome(min(compared.groups.p_holm for compared in results.contrasts))


def measure_factorial(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the interaction of three groups and two by two conditions; the third group is another second one."""
    rows = _mixed_rows(population, rng, "wxyz")
    others = _mixed_rows(population, rng, "wxyz")
    others = others[others["group"] == "b"].replace({"group": {"b": "c"}})
    others["participant"] = "c" + others["participant"].str[1:]
    design = _design("wxyz", groups=("a", "b", "c"))
    analysis = AnalysisSpec(primary_measure=MEASURE)
    frame = pd.concat([rows, others], ignore_index=True)
    results = compute_interaction(frame, design, analysis, ("a", "b", "c"))
    assert results is not None
    test = results.omnibus[0].test
    yield "3 x 2 x 2, interaction", Outcome(test.p)
    factors = (
        Contrast("first factor", (("w", 0.5), ("x", 0.5), ("y", -0.5), ("z", -0.5))),
        Contrast("both", (("w", 1.0), ("x", -1.0), ("y", -1.0), ("z", 1.0))),
    )
    stated = compute_interaction(frame, replace(design, contrasts=factors), analysis, ("a", "b", "c"))
    assert stated is not None
    first = stated.contrasts[0].groups
    yield "3 x 2 x 2, stated contrast", Outcome(first.p, _holds(first.interval))
    yield "3 x 2 x 2, any stated contrast", Outcome(min(compared.groups.p_holm for compared in stated.contrasts))


def measure_labels(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of three labels of trials, and their interaction with the group."""
    rows = [
        (group, code, 1, json.dumps({"cue": level}), True, value + noise, 500.0)
        for group, code, own in _people(population, rng, 3)
        for level, value in zip("xyz", own, strict=True)
        for noise in rng.normal(0, 1, 4)
    ]
    columns = ["group", "participant", "session", "labels", "success", "reward", "response_median_ms"]
    trials = pd.DataFrame(rows, columns=columns)
    analysis = AnalysisSpec(primary_measure=MEASURE, conditions=("label:cue",))
    within = compare_labels(trials, analysis)
    assert within is not None
    pair = within.comparisons[0]
    yield "trials, labels", Outcome(pair.p, _holds(pair.interval))
    yield "trials, any two labels", Outcome(min(comparison.p_holm for comparison in within.comparisons))
    results = compute_interaction(measure_levels(trials, "cue"), _design("xyz"), analysis, ("a", "b"))
    assert results is not None
    contrast = results.contrasts[0].groups
    yield "trials, interaction", Outcome(results.omnibus[0].test.p)
    yield "trials, contrast of labels", Outcome(contrast.p, _holds(contrast.interval))


def measure_waits(population: Population, rng: np.random.Generator) -> Iterator[tuple[str, Outcome]]:
    """Yield the comparison of waiting times whose groups differ in size and in how many are censored."""
    groups = []
    for size, censored in zip(population.sizes, (0.1, 0.5), strict=True):
        times = rng.exponential(40, size)
        stops = rng.exponential(40 * (1 - censored) / censored, size)
        groups.append(SurvivalTimes(np.minimum(times, stops), times <= stops))
    comparison = compare_survival(groups[0], groups[1])
    assert comparison is not None
    yield "waits, restricted means", Outcome(comparison.p, _holds(comparison.interval))
    yield "waits, whole curves", Outcome(comparison.logrank_p)


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
    yield "teams of two, interaction", Outcome(contrast.groups.p, _holds(contrast.groups.interval))


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
    yield "two days, change", Outcome(comparison.p, _holds(comparison.interval))
    own_change = paired_test(change.loc[change["group"] == "a", MEASURE].dropna().to_numpy(float))
    if own_change is not None:
        yield "two days, own change", Outcome(own_change.p(1.0), _holds(own_change.interval(), 1.0))


@contextmanager
def use_resamples(count: int) -> Iterator[None]:
    """Let every test draw ``count`` permutations meanwhile instead of 9,999, which leaves the level as it is."""
    usual = regroupings.RESAMPLES
    modules = (interaction, paired, permutation, regroupings, survival, two_part_model)
    for module in modules:
        module.RESAMPLES = count
    try:
        yield
    finally:
        for module in modules:
            module.RESAMPLES = usual


Measurement = Callable[[Population, np.random.Generator], Iterator[tuple[str, Outcome]]]
MEASUREMENTS: tuple[Measurement, ...] = (
    measure_groups, measure_lines, measure_equivalence, measure_parts, measure_reliability, measure_order,
    measure_mixed, measure_factorial, measure_labels, measure_teams, measure_days, measure_waits,
)  # fmt: skip


@dataclass
class TableCounts:
    """How often one table of a design's studies rejected a true null hypothesis, or held the truth."""

    studies: int = 0
    with_p: int = 0
    rejected: int = 0
    intervals: int = 0
    held: int = 0
    contradictions: int = 0
    refused: int = 0

    def add(self, outcome: Outcome) -> None:
        """Count the table of one more study.

        A study without p, or without an interval where there is no p, counts as refused and as not rejected.
        """
        has_p = not math.isnan(outcome.p)
        is_rejected = outcome.p < ALPHA
        self.studies += 1
        self.with_p += has_p
        self.rejected += is_rejected
        self.intervals += outcome.holds is not None
        self.held += outcome.holds is True
        self.contradictions += has_p and outcome.holds is not None and is_rejected == outcome.holds
        self.refused += not has_p and outcome.holds is None


def measure_design(
    measurement: Measurement, population: Population, studies: int, counts: dict[str, TableCounts]
) -> None:
    """Simulate more studies of a design, and add their tables to the design's counts by the name of the row.

    A study's seed follows from the design and the study's number, so that studies can be added later.
    """
    label = f"{measurement.__name__}: {population.name}"
    done = next((table.studies for table in counts.values()), 0)
    for number in range(done, done + studies):
        rng = np.random.default_rng([zlib.crc32(label.encode()), number])
        for name, outcome in measurement(population, rng):
            counts.setdefault(f"{name}: {population.name}", TableCounts()).add(outcome)


BATCH = 25  # studies of a design that are simulated before the next design's


def read_counts(rows: Mapping[str, Mapping[str, object]]) -> dict[str, TableCounts]:
    """Return the counts of the rows that have them."""
    counts = {}
    for name, row in rows.items():
        if row.get("rejected", "") in ("", None):
            continue
        studies, rejected, intervals, held, contradictions = (
            int(str(row[column])) for column in ("studies", "rejected", "intervals", "held", "contradictions")
        )
        refused = round(float(str(row["refused"])) * studies)
        counts[name] = TableCounts(studies, bool(row["type_1"]), rejected, intervals, held, contradictions, refused)
    return counts


def describe_counts(name: str, counts: TableCounts) -> dict[str, object]:
    """Return the row of a table."""
    row: dict[str, object] = {
        "design": name, "studies": counts.studies, "contradictions": counts.contradictions,
        "refused": f"{counts.refused / counts.studies:.6g}", "rejected": counts.rejected,
        "intervals": counts.intervals, "held": counts.held,
    }  # fmt: skip
    if counts.with_p:
        row["type_1"] = f"{counts.rejected / counts.studies:.6g}"
    if counts.intervals:
        low, high = wilson_interval(counts.held, counts.intervals)
        row |= {"coverage": f"{counts.held / counts.intervals:.6g}"}
        row |= {"coverage_low": f"{low:.4g}", "coverage_high": f"{high:.4g}"}
    return row


def add_studies(
    rows: Mapping[str, Mapping[str, object]], studies: int, only: str = ""
) -> Iterator[dict[str, dict[str, object]]]:
    """Add studies to the tables' rows, in turns of the designs, and yield the rows of a design after each turn.

    Args:
        rows: the rows measured so far, by name
        studies: the studies that each design is to have
        only: a part of the names of the designs to measure
    """
    counts = read_counts(rows)
    designs = [
        (measurement, population)
        for measurement in MEASUREMENTS
        for population in POPULATIONS
        if only in f"{measurement.__name__}: {population.name}"
    ]
    of_design: dict[tuple[Measurement, Population], dict[str, TableCounts]] = {}
    for measurement, population in designs:
        names = _list_tables(measurement, population)
        of_design[measurement, population] = {name: counts[name] for name in names if name in counts}
    for wanted in range(BATCH, studies + BATCH, BATCH):
        for (measurement, population), tables in of_design.items():
            done = next((table.studies for table in tables.values()), 0)
            more = min(wanted, studies) - done
            if more > 0:
                measure_design(measurement, population, more, tables)
                yield {name: describe_counts(name, table) for name, table in tables.items()}


def _list_tables(measurement: Measurement, population: Population) -> list[str]:
    """Return the names of the rows of a design, from one study of it."""
    return [f"{name}: {population.name}" for name, _ in measurement(population, np.random.default_rng(0))]
