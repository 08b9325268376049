"""Plug-ins of a lab: found, listed, and named in one line where they are wrong."""

import subprocess
import sys

import numpy as np
import pytest

from minihuman.errors import ExportError, PlayerError, WindowError
from minihuman.export.port import find_exporter
from minihuman.players.choose import make_player
from minihuman.plugins import plugins
from minihuman.windows.choose import open_window

CODE = """
from minihuman.players.port import Player, Press

class Sleeper(Player):
    def __init__(self, argument, rng): self.key = argument or "1"
    def begin(self, plan, pool, world): pass
    def press(self, world): return Press(self.key, 300.0)

class NoPlayer:
    def __init__(self, *arguments, **options): pass
"""


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """Installs a lab's package with these entry points."""

    def install(name, **groups):
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        lines = [line for group, entries in groups.items() for line in (f"[minihuman.{group}]", *entries)]
        (info / "entry_points.txt").write_text("\n".join(lines))
        (tmp_path / "a_lab.py").write_text(CODE)

    monkeypatch.syspath_prepend(tmp_path)
    yield install
    sys.modules.pop("a_lab", None)


def test_a_labs_player_is_found_and_listed_with_its_package(lab):
    lab("a-lab", players=["sleeper = a_lab:Sleeper"])
    assert make_player("sleeper:7", np.random.default_rng(0)).key == "7"
    assert ("players", "sleeper", "a_lab:Sleeper", "a-lab 1.0") in {
        (one.group, one.name, one.where, one.package) for one in plugins()
    }


def test_ours_are_listed_as_minihumans():
    ours = {(one.group, one.name) for one in plugins() if one.package.startswith("minihuman ")}
    assert {("players", "optimal"), ("windows", "pygame"), ("exporters", "csv")} <= ours


def test_what_makes_something_else_is_named(lab):
    lab("a-lab", players=["wrong = a_lab:NoPlayer"], windows=["wrong = a_lab:NoPlayer"])
    rng = np.random.default_rng(0)
    with pytest.raises(PlayerError, match=r"a_lab:NoPlayer \(a-lab 1.0\) makes a NoPlayer; .*players.port.Player"):
        make_player("wrong", rng)
    with pytest.raises(WindowError, match=r"makes a NoPlayer; .*windows.port.Window"):
        open_window("wrong", lambda: 0)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("gone = a_lab:Gone", r"there is no a_lab:Gone; see to a-lab 1.0"),
        ("gone = nowhere_at_all:Gone", r"cannot be imported: No module named 'nowhere_at_all'; see to a-lab 1.0"),
    ],
)
def test_what_cannot_be_loaded_is_named(lab, entry, said):
    lab("a-lab", players=[entry])
    with pytest.raises(PlayerError, match=said):
        make_player("gone", np.random.default_rng(0))


def test_a_name_taken_twice_is_refused_and_says_by_whom(lab):
    lab("a-lab", exporters=["csv = a_lab:Sleeper"])
    with pytest.raises(ExportError, match=r"'csv' is registered twice, a_lab:Sleeper \(a-lab 1.0\) and minihuman"):
        find_exporter("csv")


@pytest.mark.program
def test_the_command_lists_what_is_loaded_and_from_where():
    done = subprocess.run([sys.executable, "-m", "minihuman", "plugins"], capture_output=True, text=True, check=True)
    assert "players      optimal        minihuman" in done.stdout
    assert "minihuman.export.lerobot:export" in done.stdout
