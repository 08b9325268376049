"""The scripts error_rates.py and fit_recovery.py run, and their committed results hold what the docs say of them."""

import csv
from collections.abc import Iterator
from pathlib import Path

import pytest
import scipy

import changed_statistics
import design_error_rates
from analysis import error_rates, fit_recovery

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
    assert list(rows)[: len(named) + len(others)] == [*named, *others]
    assert {row["contradictions"] for row in rows.values()} == {"0"}
    by_table = {name: rows.pop(name) for name in list(rows)[len(named) + len(others) :]}
    check_tables(by_table)
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


def check_tables(rows: dict[str, dict[str, str]]) -> None:
    """No table's rate is above 0.06, but by chance, of which there is more in more rows."""
    for name, row in rows.items():
        if row["type_1"]:
            by_chance = scipy.stats.binomtest(int(row["rejected"]), int(row["studies"]), 0.06, alternative="greater")
            assert by_chance.pvalue > 0.05 / len(rows), name
        if int(row["intervals"]):
            by_chance = scipy.stats.binomtest(int(row["held"]), int(row["intervals"]), 0.93, alternative="less")
            assert by_chance.pvalue > 0.05 / len(rows), name


@pytest.mark.parametrize("measurement", design_error_rates.MEASUREMENTS, ids=lambda function: function.__name__)
def test_every_table_of_a_design_has_a_row(measurement: design_error_rates.Measurement, few: None) -> None:
    counts: dict[str, design_error_rates.TableCounts] = {}
    design_error_rates.measure_design(measurement, design_error_rates.normal(8, 9, 2, 1), 2, counts)
    assert counts
    assert all(table.contradictions == 0 for table in counts.values())
    assert all(name.endswith(": 8 v 9, SD 2 v 1") for name in counts)


def test_studies_that_are_added_later_are_those_of_one_run(few: None) -> None:
    only = "measure_waits: 10 v 10"
    (*_, whole) = design_error_rates.add_studies({}, 30, only)
    (begun,) = design_error_rates.add_studies({}, 12, only)
    (*_, resumed) = design_error_rates.add_studies(begun, 30, only)
    assert resumed == whole
    assert {row["studies"] for row in whole.values()} == {30}
    assert not [*design_error_rates.add_studies(whole, 30, only)]


@pytest.fixture
def few() -> Iterator[None]:
    with design_error_rates.use_resamples(199):
        yield


def test_the_changed_numbers_are_what_the_report_has_now() -> None:
    with Path(changed_statistics.__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        committed = [tuple(row) for row in csv.reader(file)]
    now = [*changed_statistics.list_changes((4, 20))]
    assert set(now) <= set(committed)


def test_the_recovery_of_fits_is_measured_and_its_committed_result_meets_its_bars() -> None:
    rows = fit_recovery.measure("2 % pauses, lag 1 0.4", 150, 1)
    assert [row["parameter"] for row in rows] == list(fit_recovery.PARAMETER_NAMES)
    with Path(fit_recovery.__file__).with_suffix(".csv").open(encoding="utf-8", newline="") as file:
        committed = [row for row in csv.DictReader(file) if row["times"] == "2 % pauses, lag 1 0.4"]
    wanted = {150: ("mu_ms", "sigma_ms", "repeat_factor")}
    wanted[600] = (*wanted[150], "tau_ms", "practice")
    for row in committed:
        if row["parameter"] in wanted[int(row["presses"])]:
            assert float(row["reported"]) >= 0.9, row
            assert float(row["held"]) >= 0.9, row
        if int(row["presses"]) == 600:
            assert float(row["held_out_bits"]) >= 0, row
