"""The script of error rates runs, and its committed result is that of its designs and holds what the docs say."""

import csv
from pathlib import Path

import pytest

from analysis import error_rates

COMMITTED = Path(error_rates.__file__).with_suffix(".csv")


def test_the_script_measures_every_kind_of_design(capsys: pytest.CaptureFixture[str]) -> None:
    at_hand = error_rates.summarise(error_rates.measure_means(error_rates.normal(6, 9), 20, 1), 1.0)
    assert at_hand["contradictions"] == 0
    for found in (
        error_rates.measure_survival("10 v 20 waits, 30 % censored at random", 5, 1),
        error_rates.measure_paired("12 within, normal", 20, 1),
        error_rates.measure_teams("20 v 20 teams of two, half the variance within", 20, 1),
        error_rates.measure_adjusted("5 v 5 adjusted for 2 covariates", 20, 1),
    ):
        assert error_rates.summarise(found, 1.0)["contradictions"] == 0


def test_the_committed_result_is_of_these_designs_and_holds_what_it_should() -> None:
    with COMMITTED.open(encoding="utf-8", newline="") as file:
        rows = {row["design"]: row for row in csv.DictReader(file)}
    named = [one.name for one in error_rates.MEANS]
    others = (*error_rates.SURVIVAL, *error_rates.PAIRED, *error_rates.TEAMS, *error_rates.ADJUSTED)
    assert list(rows) == [*named, *others]
    assert {row["contradictions"] for row in rows.values()} == {"0"}
    for name in error_rates.TEAMS:
        assert rows[name]["studies"] == "10000"
        assert abs(float(rows[name]["type_1"]) - 0.05) <= 0.015, name
    for name, row in rows.items():
        few_people = name.startswith(("2 v", "3 v", "4 v 4 adjusted"))
        assert few_people == (float(row["refused"]) == 1), name  # of waiting times the events decide, study by study
        if few_people:
            continue
        low, high = float(row["coverage_low"]), float(row["coverage_high"])
        assert high >= 0.93, name
        if not any(word in name for word in ("success", "five-point")):  # discrete measures may hold more
            assert low <= 0.97, name
        if row["type_1"] and int(row["studies"]) == 10_000:
            assert float(row["type_1"]) <= 0.065, name
