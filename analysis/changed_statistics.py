"""Numbers of the report that changed on 29 November 2026, on the committed episodes of ``ten_people_pool.csv``.

``python analysis/changed_statistics.py`` writes ``changed_statistics.csv``: study, cell, the number of the test before,
the number of the report's test, and why. A study is some of the pool's participants as two groups.
"""

import argparse
import csv
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import scipy

from minihuman.statistics.equivalence import check_equivalence
from minihuman.statistics.paired import compare_growth
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
