import json
import subprocess
import sys
from pathlib import Path

import pytest

from minihuman.runtime.doctor import Finding, examine_machine, format_verdict
from tests.counts import PATIENCE_S

DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"
pytestmark = pytest.mark.program


def look(data: Path, environment: dict[str, str], window: str = "auto") -> subprocess.CompletedProcess[str]:
    """In a process of its own: window toolkits keep the display they saw first."""
    command = [sys.executable, "-m", "minihuman", "doctor", "--data", str(data), "--window", window]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.mark.parametrize("window", ["pygame", "pyglet"])
def test_it_measures_display_keys_and_disk(window: str, display: str, tmp_path: Path) -> None:
    said = look(tmp_path / "sessions", {"DISPLAY": display}, window).stdout
    for name in ("versions", "refresh", "frame time", "key to flip", "free space", "fsync"):
        assert any(line[9:].startswith(name) for line in said.splitlines()), said
    assert "This machine is " in said.splitlines()[-1]


def test_a_studys_own_worlds_are_drawn_in_its_own_size(display: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "minihuman", "doctor", str(DEMO), "--data", str(tmp_path), "--json"]
    done = subprocess.run(command, env={"DISPLAY": display}, capture_output=True, text=True, timeout=PATIENCE_S)
    found = {one["name"]: one["value"] for one in json.loads(done.stdout)}
    assert "fullscreen true" in found["display"]
    for block in ("block grid", "block first-person"):
        assert found[block].startswith("step to flip: median")


def test_without_a_display_it_reports_the_rest_and_says_not_fit(tmp_path: Path) -> None:
    done = look(tmp_path, {})
    assert done.returncode == 1
    assert "fsync" in done.stdout
    assert "NOT FIT  display" in done.stdout
    assert "because no window can be opened" in done.stdout.splitlines()[-1]


def test_what_is_found_of_the_disk_leaves_no_file_behind(tmp_path: Path) -> None:
    list(examine_machine(window="no such window", data=tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_the_verdict_names_every_reason() -> None:
    good, bad, worse = Finding("a", "1"), Finding("b", "2", "b is slow"), Finding("c", "3", "c is full")
    assert format_verdict([good]) == "This machine is fit to run participants."
    assert format_verdict([good, bad, worse]).endswith("because b is slow; c is full.")
