"""A stranger's protocol or policy file runs no code, reads nothing outside its folder, and is refused in a sentence."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.counts import count
from tests.machine import needs


@needs("learn")
@pytest.mark.nightly(sample=True)
@pytest.mark.program
def test_a_strangers_protocol_runs_nothing_reads_only_its_folder_and_stays_under_512_mb(tmp_path: Path) -> None:
    number = count(20, 1_000)
    done = subprocess.run(
        [sys.executable, "-P", "-m", "tests.promises.hostile_protocols", tmp_path / "cases", "0", str(number)],
        env=os.environ
        | {"PYTHONPATH": str(Path(__file__).parents[2]), "MINIHUMAN_CONFIG": str(tmp_path / "configuration")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["wrong"] == {}
    assert sum(found["ends"].values()) == number
    assert found["ends"]["read"] > 0
    assert found["ends"]["refused"] > number / 2
    assert found["peak_mb"] < 512
    assert not list((tmp_path / "configuration").glob("*"))
