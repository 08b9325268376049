"""Numbers of the report that changed on 29 November 2026, on the committed episodes of ``ten_people_pool.csv``.

``python analysis/changed_statistics.py`` writes ``changed_statistics.csv``: study, cell, the number of the test before,
the number of the report's test, and why. A study is some of the pool's participants as two groups.
"""

import argparse
import csv
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

from minihuman.statistics.equivalence import check_equivalence
from minihuman.statistics.paired import compare_growth
from minihuman.statistics.reliability import estimate_reliability
from minihuman.statistics.t_tests import compare_means

FOLDER = Path(__file__).parent
SIZES = ((2, 18), (4, 20), (10, 10))
MARGIN = 0.5  # of the log of the excess steps
WHY = "Welch's t rejects true nulls too often in small unequal groups; permutation with its lower limits"
CHANGED_CELLS = (  # cell, old, new, why
    ("order, row condition", "F and p", "none", "the table of conditions has that difference"),
    ("order, p of position and carry-over", "of F", "permutation of orders", "spreads may differ"),
    ("order, participants", "all", "those with every condition", "whole orders are exchanged"),
    ("reward in two parts, groups of three", "estimates and p", "refused", "four are the least everywhere"),
    ("change of the reference group over episodes", "t", "sign flips", "the test of changes between sessions"),
    ("time until all keys, p of the whole curves", "of the normal distribution", "permutation", "small groups"),
    ("reliability, intervals of groups below four", "F and z", "none", "four are the least everywhere"),
    (
        "time until all keys, where they were shown, or known to all or a part of a group",
        "compared",
        "left out",
        "not all of a group had to discover them",
    ),
    (
        "mixed model of the change over episodes, where participants differ by little",
        "not reported",
        "reported",
        "the likelihood was maximised from one start, and sometimes ended at an SD of 0, where it is always level",
    ),
    ("time until all keys, where nobody discovered all", "compared", "left out", "a key may do nothing there"),
    (
        "success, steps, SPL and excess steps, in blocks without a goal",
        "compared",
        "left out unless named",
        "no episode can reach one",
    ),
    (
        "a group's change between sessions, verdict",
        "beside the difference of the changes",
        "the difference alone has one",
        "one shown and one not do not differ by that",
    ),
    ("p (Holm) of groups on differences between levels", "a measure by itself", "over measures", "as its caption says"),
    ("p (Holm) of the measures left in such blocks", "over all", "over those that are left", "fewer comparisons"),
)
COLUMNS = ("study", "cell", "old", "new", "why")


def read_study(sizes: tuple[int, int]) -> pd.DataFrame:
    """Return the episodes of the first participants of the pool's last group, as groups a and b of these sizes."""
    rows = pd.read_csv(FOLDER / "ten_people_pool.csv")
    rows = rows[rows["group"] == sorted(rows["group"].unique())[-1]]
    codes = rows["participant"].unique()[: sum(sizes)]
    rows = rows[rows["participant"].isin(codes)]
    steps = rows["steps"].where(rows["outcome"] == "goal", rows["max_steps"])
    excess = np.log1p((steps - rows["feasible_steps"]).clip(lower=0))
    return rows.assign(
        group=np.where(rows["participant"].isin(codes[: sizes[0]]), "a", "b"),
        excess=excess,
        episode_in_block=rows["episode"],
    )


def list_changes(sizes: tuple[int, int]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield a row for each number of a study that changed."""
    rows = read_study(sizes)
    study = f"ten_people_pool.csv, first {sizes[0]} v next {sizes[1]} of the last group"
    growth = compare_growth(rows, "excess", order=("a", "b"))
    assert growth is not None
    lines = {
        str(code): scipy.stats.linregress(
            person["episode_in_block"] - rows["episode_in_block"].mean(), person["excess"]
        )
        for code, person in rows.groupby("participant")
    }
    group_of = rows.drop_duplicates("participant").set_index("participant")["group"]
    for term in growth.terms:
        if not term.name.startswith("a minus b"):
            continue
        coefficient = "slope" if "change" in term.name else "intercept"
        a, b = (
            np.array([getattr(line, coefficient) for code, line in lines.items() if group_of[code] == group])
            for group in ("a", "b")
        )
        welch = compare_means(a, b)
        yield study, f"{term.name}, p", f"{welch.p:.4f}", f"{term.p:.4f}", WHY
        yield study, f"{term.name}, interval", _format(welch.interval()), _format(term.interval), WHY
    means = rows.groupby(["group", "participant"])["excess"].mean()
    a, b = means["a"].to_numpy(), means["b"].to_numpy()
    test = check_equivalence(a, b, (-MARGIN, MARGIN))
    old = compare_means(a, b)
    sides = (old.difference + MARGIN, MARGIN - old.difference)
    p = max(float(scipy.special.stdtr(old.freedom, -side / old.error)) for side in sides)
    yield (
        study,
        f"equivalence within {MARGIN}, p",
        f"{p:.4f}",
        f"{test.p:.4f}".replace("nan", "n/a"),
        test.reason or WHY,
    )
    yield (
        study,
        f"equivalence within {MARGIN}, 90 % interval",
        _format(old.interval(0.9)),
        _format(test.interval),
        WHY,
    )
    yield from list_reliability_changes(rows, study)


def list_reliability_changes(rows: pd.DataFrame, study: str) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield a row for each interval of a measure's reliability that changed."""
    reliability = estimate_reliability("excess", rows.rename(columns={"excess": "value"}))
    assert reliability is not None
    spare = reliability.participants - rows["group"].nunique()
    freedom = reliability.episodes - reliability.participants
    length = reliability.episodes / reliability.participants  # the pool's participants have equal numbers
    f = 1 + length * reliability.icc / (1 - reliability.icc)
    ends = (f / scipy.stats.f.ppf(0.975, spare, freedom), f * scipy.stats.f.ppf(0.975, freedom, spare))
    old = ((ends[0] - 1) / (ends[0] + length - 1), (ends[1] - 1) / (ends[1] + length - 1))
    correlation = reliability.halves / (2 - reliability.halves)
    reach = float(scipy.special.ndtri(0.975)) / math.sqrt(spare - 2)
    bounds = [math.tanh(math.atanh(correlation) + side * reach) for side in (-1, 1)]
    halves = (max(0.0, 2 * bounds[0] / (1 + bounds[0])), max(0.0, 2 * bounds[1] / (1 + bounds[1])))
    why = reliability.note or "too narrow where participants of one group vary more, or are skewed"
    yield study, "reliability of excess, ICC, interval", _format(old), _format(reliability.icc_interval), why
    new_halves = _format(reliability.halves_interval)
    yield study, "reliability of excess, split-half, interval", _format(halves), new_halves, why


def _format(bounds: tuple[float, float]) -> str:
    if np.isnan(bounds[0]):
        return "n/a"
    return f"{bounds[0]:.4f} to {bounds[1]:.4f}"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=FOLDER / "changed_statistics.csv")
    with parser.parse_args().out.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for sizes in SIZES:
            table.writerows(list_changes(sizes))
        table.writerows(("any study", *change) for change in CHANGED_CELLS)


if __name__ == "__main__":
    main()
