import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd
import pytest

from minihuman.errors import LearnError
from minihuman.learn.transfer.folder import open_folder, read_merged
from minihuman.learn.transfer.job import RESULT
from tests.learn.test_study import TINY, result_of

pytestmark = pytest.mark.program

ROOT = Path(__file__).parents[2]


def test_runs_of_two_machines_become_one_table_with_a_small_file_a_job(tmp_path):
    out = tmp_path / "shipped"
    for number, machine in enumerate(("here", "there")):
        study, folder = replace(TINY, runs=number + 1, baselines=number + 1), tmp_path / machine
        open_folder(study, folder)
        for job in study.jobs(first_run=number):
            (folder / job.name).mkdir(parents=True)
            (folder / job.name / RESULT).write_text(json.dumps(asdict(result_of(job, [0.5, 0.8 + number / 10]))))
        subprocess.run([sys.executable, "analysis/transfer.py", folder, "--into", out], cwd=ROOT, check=True)
    rows = pd.read_csv(out / "table.csv", index_col="cell")
    assert list(rows.index) == ["source", "baseline", "M", "M-frozen"]
    assert list(rows["runs"]) == [2, 2, 2, 2]
    assert len(list(out.glob("*/run-*/result.json"))) == 8
    assert len(pd.read_csv(out / "curves.csv")) == 16


def test_runs_of_different_studies_do_not_go_together(tmp_path):
    for name, study in (("one", TINY), ("other", replace(TINY, seed=9))):
        open_folder(study, tmp_path / name)
    with pytest.raises(LearnError, match="holds another study"):
        read_merged([tmp_path / "one", tmp_path / "other"])
