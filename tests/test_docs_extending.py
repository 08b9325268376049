"""What docs/extending.md prints runs, and its table leads to what there is."""

import re
import tomllib
from pathlib import Path

import gymnasium
import pytest

import minihuman.testing
from minihuman.plugins import list_plugins
from tests.lab_package import install_lab as install_lab
from tests.machine import needs

DOCS = Path(__file__).parents[1] / "docs"
TEXT = (DOCS / "extending.md").read_text(encoding="utf-8")
PARTS = dict(zip(*[iter(re.split(r"^## (.*)$", TEXT, flags=re.M)[1:])] * 2, strict=True))


@pytest.mark.parametrize(
    "part",
    [
        "A simulated participant",
        "An agent",
        pytest.param("A learner", marks=[pytest.mark.program, needs("learn")]),
        "A wrapper",
        pytest.param("An exporter", marks=pytest.mark.program),
        "A window",
    ],
)
def test_the_code_runs_as_printed(part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "\n".join(re.findall(r"```python\n(.*?)```", PARTS[part], re.S))
    try:
        exec(compile(code, f"extending.md, {part}", "exec"), {"__name__": "extending"})
    finally:
        for name in ("lab/CostlyDoorKey-v0", "lab/Foggy-v0"):
            gymnasium.registry.pop(name, None)


@pytest.mark.parametrize(
    ("part", "name", "group"),
    [("A kind of question", "affect_grid", "questions"), ("An activity", "tapping", "activities")],
)
def test_a_part_of_a_session_is_one_file_and_one_registration(part, name, group, install_lab):
    code, check = (
        re.findall(rf'```python title="{file}.py"\n(.*?)```', PARTS[part], re.S) for file in (name, f"test_{name}")
    )
    toml = tomllib.loads(re.findall(r"```toml\n(.*?)```", PARTS[part], re.S)[0])
    [(word, place)] = toml["project"]["entry-points"][f"minihuman.{group}"].items()
    install_lab("a-lab", code[0], **{group: [f"{word} = a_lab:{place.partition(':')[2]}"]})
    exec(compile(check[0], f"extending.md, {part}", "exec"), {"__name__": "extending"})


def test_the_entry_points_are_groups_that_there_are():
    tables = [tomllib.loads(toml) for toml in re.findall(r"```toml\n(.*?)```", TEXT, re.S)]
    named = {group for toml in tables for group in toml.get("project", {}).get("entry-points", {})}
    groups = {group.removeprefix("minihuman.") for group in named}
    assert groups <= {one.group for one in list_plugins()}


def test_every_check_named_exists_and_every_link_leads_somewhere():
    assert set(re.findall(r"`(check_\w+)`", TEXT)) <= set(minihuman.testing.__all__)
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (DOCS / link).exists(), link
