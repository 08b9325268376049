"""Plug-ins of a lab: found, listed, and named in one line where they are wrong."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from minihuman.display.windows.blocking_window import open_window
from minihuman.errors import ExportError, SimulationError, WindowError
from minihuman.exporters.exporter import find_exporter
from minihuman.plugins import list_plugins, remember_by_name
from minihuman.simulation.participant import make_participant

CODE = """
from minihuman.simulation.participant import KeyPress, SimulatedParticipant

class Sleeper(SimulatedParticipant):
    def __init__(self, argument, rng): self.key = argument or "1"
    def begin(self, plan, pool, world): pass
    def press(self, world): return KeyPress(self.key, 300.0)

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
    assert make_participant("sleeper:7", np.random.default_rng(0)).key == "7"
    assert ("players", "sleeper", "a_lab:Sleeper", "a-lab 1.0") in {
        (one.group, one.name, one.where, one.package) for one in list_plugins()
    }


def test_ours_are_listed_as_minihumans():
    ours = {(one.group, one.name) for one in list_plugins() if one.package.startswith("minihuman-lab ")}
    assert {("players", "optimal"), ("windows", "pygame"), ("exporters", "csv")} <= ours


def test_what_makes_something_else_is_named(lab):
    lab("a-lab", players=["wrong = a_lab:NoPlayer"], windows=["wrong = a_lab:NoPlayer"])
    rng = np.random.default_rng(0)
    made = r"a_lab:NoPlayer \(a-lab 1.0\) makes a NoPlayer; .*simulation.participant.SimulatedParticipant"
    with pytest.raises(SimulationError, match=made):
        make_participant("wrong", rng)
    with pytest.raises(WindowError, match=r"makes a NoPlayer; .*windows.window.Window"):
        open_window("wrong", lambda: 0)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("gone = a_lab:Gone", r"a_lab:Gone does not exist; repair a-lab 1.0"),
        ("gone = nowhere_at_all:Gone", r"cannot be imported: No module named 'nowhere_at_all'; repair a-lab 1.0"),
    ],
)
def test_what_cannot_be_loaded_is_named(lab, entry, said):
    lab("a-lab", players=[entry])
    with pytest.raises(SimulationError, match=said):
        make_participant("gone", np.random.default_rng(0))


def test_a_name_taken_twice_is_refused_and_says_by_whom(lab):
    lab("a-lab", exporters=["csv = a_lab:Sleeper"])
    with pytest.raises(ExportError, match=r"'csv' is registered twice, by a_lab:Sleeper \(a-lab 1.0\) and minihuman"):
        find_exporter("csv")


@pytest.mark.program
def test_the_command_lists_what_is_loaded_and_from_where():
    done = subprocess.run([sys.executable, "-m", "minihuman", "plugins"], capture_output=True, text=True, check=True)
    assert "players      optimal        minihuman" in done.stdout
    assert "minihuman.exporters.lerobot:export" in done.stdout


def test_a_name_is_looked_up_again_where_packages_are_looked_for_in_other_folders(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two laboratories' packages that register one name, one after the other in a process."""
    names = []

    @remember_by_name
    def find(name: str) -> int:
        names.append(name)
        return len(names)

    assert [find("tapping"), find("tapping")] == [1, 1]
    monkeypatch.syspath_prepend(tmp_path)
    assert [find("tapping"), find("tapping")] == [2, 2]
