"""The record of programs written for Minigrid: its page says what it has, and nothing differs on our worlds."""

import json
import runpy
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[2] / "analysis"


@pytest.fixture(scope="module")
def script() -> dict[str, Any]:
    return runpy.run_path(str(FOLDER / "upstream_programs.py"))


def test_the_page_says_what_the_record_has(script: dict[str, Any], tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    script["write_page"](FOLDER, page)
    assert page.read_text(encoding="utf-8") == (FOLDER / "upstream_programs.md").read_text(encoding="utf-8")


def test_programs_do_the_same_on_our_worlds() -> None:
    record = json.loads((FOLDER / "upstream_programs.json").read_text(encoding="utf-8"))
    assert len(record["comparisons"]) >= 6
    for comparison in record["comparisons"]:
        assert (comparison["verdict"], comparison["difference"]) == ("equal", ""), comparison
        assert comparison["lines"] > 0, comparison


def test_a_program_that_prints_otherwise_is_found(script: dict[str, Any], tmp_path: Path) -> None:
    def run(_: Path, world: str) -> str:
        return f"{world}\nreward=0.9\n" if world.startswith("minihuman/") else f"{world}\nreward=0.8\n"

    program = script["Program"]("a program", script["MINIGRID"], ("Maze-v0",), run, "what it prints", "nothing")
    comparison = script["compare"](program, "Maze-v0", tmp_path)
    assert (comparison.verdict, comparison.difference) == ("different", "'reward=0.8' there, 'reward=0.9' here")
