"""The script adaptive_designs.py runs, and its committed result holds what the docs say."""

import csv
from pathlib import Path

from analysis import adaptive_designs

COMMITTED = Path(adaptive_designs.__file__).with_suffix(".csv")


def test_the_script_measures_every_kind_of_row():
    rows = list(adaptive_designs.measure_all(people=2, studies=20, sessions=1))
    assert [row["what"].partition(",")[0] for row in rows] == [
        *(("questplus", "fixed", "fixed") * 2),
        *("sequential", "naive", "sequential", "replayed"),
    ]
    assert rows[-1]["share"] == "1"


def test_the_committed_result_holds_the_bars_and_is_what_the_docs_print():
    with COMMITTED.open(encoding="utf-8", newline="") as file:
        rows = {row["what"]: row for row in csv.DictReader(file)}
    for guess in ("0.5", "0"):
        quest, fixed = (rows[f"{what} trials, guess {guess}"] for what in ("questplus, 40", "fixed, 80"))
        assert quest["n"] == "500"
        assert float(quest["median_error"]) <= 0.10
        assert float(quest["error_90"]) <= 0.25
        assert float(quest["median_error"]) <= float(fixed["median_error"])  # half the trials
    sequential = rows["sequential, looks at 16, 32, 48, difference 0"]
    assert sequential["n"] == "10000"
    assert abs(float(sequential["share"]) - 0.05) <= 0.01
    replayed = rows["replayed, 40 trials of QUEST+"]
    assert (replayed["n"], replayed["share"]) == ("500", "1")
    docs = (Path(__file__).parents[2] / "docs" / "trials.md").read_text(encoding="utf-8")
    percent = [
        f"{100 * float(rows[f'questplus, 40 trials, guess {guess}']['median_error']):.2g} %" for guess in (0.5, 0)
    ]
    for number in (*percent, sequential["share"]):
        assert number in docs, number
