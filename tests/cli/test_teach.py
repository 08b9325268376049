"""Teaching from the command line: a policy of what a log holds, and simulated trials that resume."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.machine import need_module

need_module("learn")

pytestmark = pytest.mark.program
ROOT = Path(__file__).parents[2]
TAUGHT = ROOT / "tests" / "golden" / "v1" / "taught"


def learn(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", "learn", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def teaching(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "analysis/teaching.py", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, cwd=ROOT)


def test_a_policy_is_made_of_what_a_person_showed_and_is_never_written_over(tmp_path: Path) -> None:
    out = tmp_path / "taught.pt"
    asked = ("teach", TAUGHT, "--world", "minihuman/MiniGrid-Empty-5x5-v0", "--learner", "hg-dagger:updates=2")
    said = learn(*asked, "--out", out)
    assert said.returncode == 0, said.stderr
    assert f"{out}: hg-dagger:updates=2 of " in said.stdout.replace("\n", "")
    made = out.read_bytes()
    again = learn(*asked, "--out", out)
    assert again.returncode == 2
    assert "already exists" in again.stderr
    assert out.read_bytes() == made


def test_a_world_in_which_nobody_taught_is_named(tmp_path: Path) -> None:
    said = learn("teach", TAUGHT, "--world", "minihuman/MiniGrid-Empty-8x8-v0", "--out", tmp_path / "taught.pt")
    assert said.returncode == 2
    assert "MiniGrid-Empty-8x8-v0" in said.stderr
    assert not (tmp_path / "taught.pt").exists()


@pytest.mark.nightly
def test_trials_that_are_there_are_tabled_and_not_run_again(tmp_path: Path) -> None:
    (tmp_path / "rows").mkdir()
    known = [row for row in json.loads((ROOT / "analysis" / "takeovers.json").read_text())["rows"] if row["seed"] == 1]
    mine = [row for row in known if row["trial"] == "DoorKey-8x8"]
    for arm in {row["arm"] for row in mine}:
        rows = [row for row in mine if row["arm"] == arm]
        (tmp_path / "rows" / f"DoorKey-8x8-{arm}-seed-1.json").write_text(json.dumps(rows))
    said = teaching("takeovers", tmp_path, "--worlds", "DoorKey-8x8", "--seeds", 1)
    assert said.returncode == 0, said.stderr
    for row in mine:
        assert f"| {row['labelled_steps']} | {row['arm']} | {row['success']:.2f} (one seed) |" in said.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "rows",
        "takeovers.json",
        "takeovers.md",
        "takeovers.png",
    ]
    for command in ("takeovers", "ratings", "comparisons"):
        assert teaching(command, "--help").returncode == 0
    wrong = teaching("takeovers", tmp_path, "--worlds", "DoorKey")
    assert wrong.returncode == 1
    assert "--worlds has 'DoorKey'; it is some of DoorKey-8x8" in wrong.stderr
