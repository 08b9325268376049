"""What docs/extending.md prints runs, and its table leads to what there is."""

import re
import tomllib
from pathlib import Path

import gymnasium
import pytest

import minihuman.testing
from minihuman.plugins import plugins

DOCS = Path(__file__).parents[1] / "docs"
TEXT = (DOCS / "extending.md").read_text(encoding="utf-8")
PARTS = dict(zip(*[iter(re.split(r"^## (.*)$", TEXT, flags=re.M)[1:])] * 2, strict=True))


@pytest.mark.parametrize(
    "part",
    ["A player", "A wrapper", pytest.param("An exporter", marks=pytest.mark.program), "A window"],
)
def test_the_code_runs_as_printed(part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code = "\n".join(re.findall(r"```python\n(.*?)```", PARTS[part], re.S))
    try:
        exec(compile(code, f"extending.md, {part}", "exec"), {"__name__": "extending"})
    finally:
        for name in ("lab/CostlyDoorKey-v0", "lab/Foggy-v0"):
            gymnasium.registry.pop(name, None)


def test_the_entry_points_are_groups_that_there_are():
    (toml,) = re.findall(r"```toml\n(.*?)```", TEXT, re.S)
    groups = {group.removeprefix("minihuman.") for group in tomllib.loads(toml)["project"]["entry-points"]}
    assert groups <= {one.group for one in plugins()}


def test_every_check_named_exists_and_every_link_leads_somewhere():
    assert set(re.findall(r"`(check_\w+)`", TEXT)) <= set(minihuman.testing.__all__)
    for link in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (DOCS / link).exists(), link
