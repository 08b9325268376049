"""The pages about guarantees and speed have no figure that is not in a record, and a command writes records."""

import json
import re
import sys
from pathlib import Path

import pytest

from benchmarks.record import main

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "benchmarks" / "results"
NUMBER = re.compile(r"\d(?:[\d,.]*\d)?")


@pytest.mark.parametrize("page", ["promises.md", "speed.md"])
def test_every_figure_of_a_table_is_in_a_record(page: str) -> None:
    recorded = {number for path in RESULTS.iterdir() for number in NUMBER.findall(path.read_text(encoding="utf-8"))}
    rows = re.findall(r"^\| .*\|$", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) > 25
    missing = {
        number: row
        for row in rows
        for number in NUMBER.findall(row)
        if not recorded & {number, number.replace(",", "")}  # a program may print no commas
    }
    assert missing == {}


def test_a_record_has_what_a_command_printed_and_what_it_depends_on(tmp_path: Path) -> None:
    main(["kills", "--folder", str(tmp_path), "--", sys.executable, "-c", "print('300 kills'); print('0 lost')"])
    record = json.loads((tmp_path / "kills.json").read_text(encoding="utf-8"))
    assert record["output"] == ["300 kills", "0 lost"]
    assert record["command"][0] == Path(sys.executable).name
    assert {"date", "commit", "python", "versions", "machine", "cores", "load_before", "load_after"} <= record.keys()


def test_a_command_that_fails_leaves_no_record(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="3"):
        main(["kills", "--folder", str(tmp_path), "--", sys.executable, "-c", "raise SystemExit(3)"])
    assert list(tmp_path.iterdir()) == []


def test_a_record_names_no_folder_of_the_machine(tmp_path: Path) -> None:
    earlier = tmp_path / "earlier"
    program = "import sys; print(f'of {sys.argv[1]}: 3')"
    main(["builds", "--folder", str(tmp_path), "--", sys.executable, "-c", program, str(earlier)])
    record = json.loads((tmp_path / "builds.json").read_text(encoding="utf-8"))
    assert record["command"] == [Path(sys.executable).name, "-c", program, "earlier"]
    assert record["output"] == ["of earlier: 3"]
    for path in RESULTS.glob("*.json"):
        words = json.loads(path.read_text(encoding="utf-8")).get("command", [])
        assert [word for word in words if Path(word).is_absolute()] == [], path.name


def test_a_record_is_written_nowhere_else(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="is no name of a record"):
        main(["../kills", "--folder", str(tmp_path), "--", sys.executable, "-c", "pass"])
