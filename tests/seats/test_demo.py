import os
import subprocess
import sys
from pathlib import Path

import pytest

from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S

pytestmark = pytest.mark.program


def test_without_a_display_a_simulated_participant_plays_and_everything_made_is_named(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "minihuman", "demo", "--data", str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stderr
    said = done.stdout.splitlines()
    assert "simulated participant plays" in said[0]
    made = {line.rpartition(" ")[0].strip(): Path(line.rpartition(" ")[2]) for line in said if str(tmp_path) in line}
    assert {"log", "figure overview", "figure paths", "replay"} <= set(made)
    assert all(path.stat().st_size > 0 for path in made.values())
    log = read_log(made["log"])
    assert log.end_reason == "complete"
    assert len(log.episodes) == 4
    assert any(line.startswith("verified: 4 episodes") for line in said)


def test_a_window_asked_for_by_name_is_not_replaced(tmp_path: Path) -> None:
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = [sys.executable, "-m", "minihuman", "demo", "--data", str(tmp_path), "--window", "pygame"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 2
    assert list(tmp_path.iterdir()) == []


def test_the_shipped_protocols_are_found_and_valid() -> None:
    assert read_protocol(find_shipped_protocol("demo")).study.name == "demo"
    assert read_protocol(find_shipped_protocol("fourrooms-transfer")).study.name == "fourrooms-transfer"
