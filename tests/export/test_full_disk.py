"""A disk that is full: one sentence that names the output, whatever library was writing."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.disks import fill, small_disk

PLAIN = Path(__file__).parents[1] / "golden" / "v1" / "plain"
pytestmark = pytest.mark.program


def minihuman(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)


def said(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What a command complained of; that kernels are compiled is said on a fresh machine, and no complaint."""
    return [line for line in done.stderr.splitlines() if not line.startswith("compiling ")]


@pytest.mark.parametrize("free_bytes", [12_000, 40_000, 70_000])
def test_minari_on_a_full_disk_is_one_sentence(free_bytes: int, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    study = shutil.copytree(PLAIN, tmp_path / "plain")
    disk = tmp_path / "disk"
    disk.mkdir()
    with small_disk(disk, 2_000_000):
        fill(disk, but=free_bytes)
        done = minihuman("export", "minari", study, "--out", disk / "out")
    assert done.returncode == 2
    assert said(done) == [f"minihuman: {disk / 'out'}: No space left on device"]


@pytest.mark.parametrize("command", ["report", "plot"])
def test_a_report_and_figures_on_a_full_disk_are_one_sentence(command: str, tmp_path: Path) -> None:
    study = shutil.copytree(PLAIN, tmp_path / "plain")
    disk = tmp_path / "disk"
    disk.mkdir()
    with small_disk(disk, 2_000_000):
        fill(disk, but=40_000)
        done = minihuman(command, study, "--out", disk / "out")
    assert done.returncode == 2
    assert said(done) == [f"minihuman: {disk / 'out'}: No space left on device"]


def test_a_refusal_writes_a_line_break_of_a_name_as_an_escape(tmp_path: Path) -> None:
    done = minihuman("export", "csv", tmp_path / "a\nb", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "a\\nb" in done.stderr


def test_a_terminal_that_takes_nothing_is_one_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "minihuman", "worlds"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert said(done) == ["minihuman: No space left on device"]


def test_a_test_that_fails_with_a_file_open_leaves_no_disk_mounted(tmp_path: Path) -> None:
    with small_disk(tmp_path, 65_536):
        held = (tmp_path / "held").open("w")
    assert not tmp_path.is_mount()
    held.close()
