"""The record of public environments: its page says what its table has, and no refusal is a traceback."""

import csv
import json
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from minihuman.worlds.outcomes import normalize_outcome_rule, parse_outcome_rule
from tests.worlds.odd.contract import PYTHON_WORDS

FOLDER = Path(__file__).parents[2] / "analysis"
SCRIPT = FOLDER / "public_environments.py"


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


def read_rows(folder: Path = FOLDER) -> list[dict[str, str]]:
    with (folder / "public_environments.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def test_the_page_says_what_the_table_has(script: dict[str, Any], tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    script["write_page"](FOLDER, page)
    assert page.read_text() == (FOLDER / "public_environments.md").read_text()


def test_a_package_that_is_not_installed_now_keeps_the_version_with_which_it_was_tried(
    script: dict[str, Any], tmp_path: Path
) -> None:
    for name in ("public_environments.csv", "public_environments.json"):
        shutil.copy(FOLDER / name, tmp_path)
    before = json.loads((tmp_path / "public_environments.json").read_text())["versions"]
    script["write_trial"](script["Trial"]("gymnasium", "9.9", "CartPole-v1"), tmp_path)
    after = json.loads((tmp_path / "public_environments.json").read_text())["versions"]
    assert {name: number for name, number in after.items() if number != before.get(name)}.keys() <= {
        "gymnasium",
        "minihuman-lab",
        "numpy",
    }
    assert before.keys() == after.keys()


def test_every_public_environment_was_played_and_proven_or_refused_in_a_sentence() -> None:
    rows = read_rows()
    assert len({row["package"] for row in rows}) >= 18
    for row in rows:
        assert row["failures"] == "", row
        if row["verdict"] == "refused":
            assert row["refused_because"], row
            assert not any(words in row["refused_because"] for words in PYTHON_WORDS), row
        else:
            assert row["verdict"] == "played", row
            assert int(row["exports"]) > 0, row
            assert row["outcomes"], row


def test_an_end_of_a_public_environment_means_what_its_documentation_says(script: dict[str, Any]) -> None:
    stated = {family.package: set() for family in script["read_families"]()}
    for family in script["read_families"]():
        assert family.reason
        if family.success:
            stated[family.package].add(
                normalize_outcome_rule(family.success, at_any_step=False) or "terminated and reward > 0"
            )
    for row in read_rows():
        parse_outcome_rule(row["rule"])
        assert row["stated_by"] in ("block", "table", "world")
        if row["stated_by"] == "block":
            assert row["rule"] in stated[row["package"]], row
        if row["rule"] == "none":
            assert set(row["outcomes"].split()) <= {"ended"}, row


@pytest.mark.nightly
@pytest.mark.program
def test_a_run_tries_an_environment_and_writes_its_row(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    options = ["--only", "gymnasium", "--ids", "FrozenLake-v1", "--out", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", [SCRIPT.name, *options])
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("MINIHUMAN_TRUST", "")  # the script sets it
    runpy.run_path(str(SCRIPT), run_name="__main__")
    [row] = read_rows(tmp_path)
    assert (row["id"], row["verdict"], row["stated_by"], row["failures"]) == ("FrozenLake-v1", "played", "table", "")
    assert "`FrozenLake-v1`" in (tmp_path / "public_environments.md").read_text()
