"""How often the report's intervals hold effects that were planted in simulated trials, for ``trial_effects.csv``.

``python analysis/trial_effects.py [--studies 2000] [--only NAME] [--resamples 999] [--out FILE]``

Participants have a congruency effect, a sensitivity or a stop-signal reaction time of their own. Each study's trials go
through the report's functions: trimmed means, log-linear d', integration with replacement, then the comparison within
participants or between groups. The truth is the same estimate from very many trials of very many participants, since an
estimate of 50 trials is not the planted number itself. Studies are added to those that the file has.
"""

import argparse
import csv
import math
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from design_error_rates import Outcome, TableCounts, describe_counts, use_resamples
from minihuman.activities.trials.stop_signal import estimate_stop_signal
from minihuman.activities.trials.trial_measures import mark_trimmed
from minihuman.statistics.comparison import compare_groups
from minihuman.statistics.paired import compare_conditions
from minihuman.statistics.signal_detection import measure_detection

FOLDER = Path(__file__).parent
COLUMNS = (
    *("design", "truth", "studies", "power", "coverage", "coverage_low", "coverage_high"),
    *("refused", "rejected", "intervals", "held"),
)
BATCH = 50  # studies between two writings
MANY_PEOPLE = 200  # of whom the truth is estimated
MANY_TRIALS = 500  # of each kind, of each of them: 10^5 trials of a kind in all
Estimates = tuple[NDArray[np.float64], NDArray[np.float64]]  # of two conditions or groups, one per participant


def draw_congruency(rng: np.random.Generator, people: int, trials: int) -> Estimates:
    """Return each participant's trimmed mean response time, incongruent and congruent: 60 ms apart, SD 25."""
    shape = (people, 2, trials)
    level = rng.normal(520, 60, (people, 1, 1))
    effect = rng.normal(60, 25, (people, 1, 1)) * np.array([1.0, 0.0])[:, None]
    times = level + effect + rng.normal(0, 40, shape) + rng.exponential(90, shape)
    is_correct = rng.random(shape) < np.array([0.92, 0.97])[:, None]
    person, condition, _ = np.indices(shape)
    frame = pd.DataFrame(
        {"participant": person.ravel(), "session": 1, "group": "all", "block": "stroop", "condition": condition.ravel(),
         "response_ms": times.ravel(), "is_correct": is_correct.ravel()}
    )  # fmt: skip
    means = frame[mark_trimmed(frame)].groupby(["participant", "condition"])["response_ms"].mean().unstack()
    return means[0].to_numpy(float), means[1].to_numpy(float)


def draw_sensitivity(rng: np.random.Generator, people: int, trials: int) -> Estimates:
    """Return d' of two groups whose own are 2.0 and 1.5, with SDs of 0.6 and 0.3; the first group is half as large."""
    estimates = []
    for count, mean, spread in ((people // 2, 2.0, 0.6), (people, 1.5, 0.3)):
        own = rng.normal(mean, spread, count)
        criterion = rng.normal(0, 0.2, count)
        hits = (rng.normal(own[:, None], 1, (count, trials)) > (own / 2 + criterion)[:, None]).sum(axis=1)
        false_alarms = (rng.normal(0, 1, (count, trials)) > (own / 2 + criterion)[:, None]).sum(axis=1)
        counts = zip(hits.tolist(), false_alarms.tolist(), strict=True)
        estimates.append(np.array([measure_detection(h, trials - h, f, trials - f).d_prime for h, f in counts]))
    return estimates[0], estimates[1]


def draw_stopping(rng: np.random.Generator, people: int, trials: int) -> Estimates:
    """Return stop-signal reaction times of two groups whose own are 260 and 220 ms, with SDs of 40 and 20."""
    estimates = []
    for mean, spread in ((260, 40), (220, 20)):
        own = rng.normal(mean, spread, people)
        level = rng.normal(420, 40, people)
        delay = np.full(people, 200.0)
        delays = np.empty((people, trials))
        stop_ms = np.empty((people, trials))
        for trial in range(trials):
            racing_ms = level + rng.normal(0, 40, people) + rng.exponential(80, people)
            is_stopped = racing_ms > delay + own + rng.normal(0, 15, people)
            delays[:, trial] = delay
            stop_ms[:, trial] = np.where(is_stopped, math.nan, racing_ms)
            delay = np.clip(delay + np.where(is_stopped, 50, -50), 50, 900)
        go_ms = level[:, None] + rng.normal(0, 40, (people, 3 * trials)) + rng.exponential(80, (people, 3 * trials))
        go_ms[rng.random(go_ms.shape) < 0.01] = math.nan
        is_correct = np.ones(3 * trials, bool)
        ssrt = [estimate_stop_signal(go_ms[at], is_correct, stop_ms[at], delays[at]).ssrt_ms for at in range(people)]
        estimates.append(np.array(ssrt))
    return estimates[0], estimates[1]


def compare_within(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[float, tuple[float, float]]:
    """Return p and interval of a difference between conditions."""
    (comparison,) = compare_conditions({"effect": pd.DataFrame({"a": first, "b": second})})
    return comparison.p, comparison.interval


def compare_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> tuple[float, tuple[float, float]]:
    """Return p and interval of a difference between groups; participants without an estimate are left out."""
    values = np.concatenate([first, second])
    frame = pd.DataFrame({"group": ["a"] * len(first) + ["b"] * len(second), "effect": values}).dropna()
    (comparison,) = compare_groups(frame, ["effect"])
    return comparison.p, comparison.interval


Draw = Callable[[np.random.Generator, int, int], Estimates]
Compare = Callable[[NDArray[np.float64], NDArray[np.float64]], tuple[float, tuple[float, float]]]
DESIGNS: dict[str, tuple[Draw, Compare, int, int]] = {  # participants, and trials of each kind
    "congruency of 60 ms, 24 within, 48 trials each": (draw_congruency, compare_within, 24, 48),
    "d' of 2.0 v 1.5, 12 v 24, 50 trials each": (draw_sensitivity, compare_between, 24, 50),
    "SSRT of 260 v 220 ms, 20 v 20, 50 stop trials": (draw_stopping, compare_between, 20, 50),
}


def find_truth(name: str) -> float:
    """Return the difference that very many participants with very many trials have."""
    draw, _, _, _ = DESIGNS[name]
    differences = []
    for part in range(10):
        rng = np.random.default_rng([zlib.crc32(name.encode()), 1, part])
        first, second = draw(rng, MANY_PEOPLE, MANY_TRIALS)
        differences.append(float(np.nanmean(first) - np.nanmean(second)))
    return float(np.mean(differences))


def measure_study(name: str, number: int, truth: float) -> Outcome:
    """Return whether one study's interval holds the truth, and its p of no difference."""
    draw, compare, people, trials = DESIGNS[name]
    p, (low, high) = compare(*draw(np.random.default_rng([zlib.crc32(name.encode()), 0, number]), people, trials))
    return Outcome(p, None if math.isnan(low) else bool(low <= truth <= high))


def read_table(row: Mapping[str, object] | None) -> TableCounts:
    """Return the counts of a row of the file; none yet without a row."""
    if row is None:
        return TableCounts()
    studies, rejected, intervals, held = (int(str(row[name])) for name in ("studies", "rejected", "intervals", "held"))
    refused = round(float(str(row["refused"])) * studies)
    return TableCounts(
        studies, with_p=studies - refused, rejected=rejected, intervals=intervals, held=held, refused=refused
    )


def main() -> None:
    """Measure, write and print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--studies", type=int, default=2000)
    options.add_argument("--only", default="", help="designs whose names hold this")
    options.add_argument("--resamples", type=int, default=999, help="permutations of a test")
    options.add_argument("--out", type=Path, default=FOLDER / "trial_effects.csv")
    given = options.parse_args()
    with use_resamples(given.resamples):
        count_studies(given)


def count_studies(given: argparse.Namespace) -> None:
    """Count studies until there are as many as wanted; write the table after each round, and print it."""
    rows: dict[str, dict[str, object]] = {}
    if given.out.exists():
        with given.out.open(newline="", encoding="utf-8") as file:
            rows = {row["design"]: dict(row) for row in csv.DictReader(file)}
    counts = {name: read_table(rows.get(name)) for name in DESIGNS if given.only in name}
    truths = {name: find_truth(name) for name in counts}
    while any(table.studies < given.studies for table in counts.values()):
        for name, table in counts.items():
            for number in range(table.studies, min(table.studies + BATCH, given.studies)):
                table.add(measure_study(name, number, truths[name]))
            rows[name] = describe_counts(name, table) | {
                "truth": f"{truths[name]:.4g}", "power": f"{table.rejected / table.studies:.4g}",
            }  # fmt: skip
        with given.out.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n", extrasaction="ignore")
            writer.writeheader()
            writer.writerows(rows.values())
    for row in rows.values():
        print(" ".join(f"{name}={row[name]}" for name in COLUMNS if row.get(name, "") != ""))


if __name__ == "__main__":
    main()
