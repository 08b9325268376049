import re
import subprocess
import sys
import tomllib
from importlib.metadata import version
from pathlib import Path

import gymnasium
import pytest

import minihuman
from minihuman.plugins import DISTRIBUTION
from minihuman.worlds.catalogue import WORLDS

ROOT = Path(__file__).parents[1]


def test_importing_registers_every_world():
    assert all(entry.id in gymnasium.registry for entry in WORLDS)


def test_the_version_is_said_once_and_repeated_truly():
    assert version(DISTRIBUTION) == minihuman.__version__
    assert tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["name"] == DISTRIBUTION
    assert f"\nversion: {minihuman.__version__}\n" in (ROOT / "CITATION.cff").read_text()
    assert "version =" not in (ROOT / "pyproject.toml").read_text().partition("[project.optional")[0]


def test_the_changelog_goes_by_version():
    headings = re.findall(r"^## (.*)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert headings[0] == "Unreleased" or headings[0].startswith(minihuman.__version__)


@pytest.mark.parametrize("page", ["CONTRIBUTING.md", "docs/extending.md", "docs/grid-worlds.md"])
def test_links_lead_somewhere(page):
    for link in re.findall(r"\]\(([^)#:]+)\)", (ROOT / page).read_text()):
        assert (ROOT / page).parent.joinpath(link).exists(), link


def test_every_room_stands_in_the_guide():
    rooms = {path.name for path in Path(minihuman.__file__).parent.iterdir() if (path / "__init__.py").exists()}
    guide = set(re.findall(r"`(\w+)`", (ROOT / "CONTRIBUTING.md").read_text()))
    assert rooms <= guide, f"{rooms - guide} are not in CONTRIBUTING.md"


@pytest.mark.program
@pytest.mark.parametrize(
    "first", ["import minihuman, gymnasium", "import gymnasium, minihuman", "import minihuman, gymnasium.spaces"]
)
def test_worlds_are_registered_whichever_is_imported_first_and_neither_imports_the_other(first):
    code = (
        f"{first}; assert 'minihuman/MiniGrid-Empty-5x5-v0' in gymnasium.registry; "
        "print(type(gymnasium.__spec__.loader).__name__)"
    )
    run = [sys.executable, "-c"]
    assert subprocess.run([*run, code], capture_output=True, text=True, check=True).stdout.strip() == "SourceFileLoader"
    alone = "import sys, minihuman; assert not {'gymnasium', 'numpy', 'numba'} & sys.modules.keys()"
    subprocess.run([*run, alone], check=True)
