import json
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import pandas as pd
import pytest

from minihuman.learn.transfer.folder import open_folder
from minihuman.learn.transfer.job import RESULT
from tests.learn.test_study import TINY, result_of

pytestmark = pytest.mark.program

ROOT = Path(__file__).parents[2]


def test_the_shipped_data_come_from_a_studys_folder(tmp_path):
    folder, out = tmp_path / "study", tmp_path / "out"
    open_folder(TINY, folder)
    out.mkdir()
    for job in TINY.jobs()[:2]:
        (folder / job.name).mkdir(parents=True)
        (folder / job.name / RESULT).write_text(json.dumps(asdict(result_of(job, [0.5, 0.95]))))
    subprocess.run([sys.executable, "analysis/transfer.py", str(folder), str(out)], cwd=ROOT, check=True)
    assert list(pd.read_csv(out / "transfer_table.csv")["cell"]) == ["source", "baseline"]
    assert len(pd.read_csv(out / "transfer_curves.csv")) == 4
    assert json.loads((out / "transfer_run.json").read_text())["jobs"] == 4
