import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd
import pytest

from minihuman.errors import LearnError
from tests.learn.test_study import TINY, result_of
from transfer_study.engines import open_folder, read_merged
from transfer_study.job import RESULT

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
        subprocess.run([sys.executable, "analysis/transfer.py", "table", folder, "--into", out], cwd=ROOT, check=True)
    rows = pd.read_csv(out / "table.csv", index_col="cell")
    assert list(rows.index) == ["source", "baseline", "M", "M-frozen"]
    assert list(rows["runs"]) == [2, 2, 2, 2]
    assert len(list(out.glob("*/run-*/result.json"))) == 8
    assert len(pd.read_csv(out / "curves.csv")) == 16


def test_the_transfer_study_runs_from_its_script_and_resumes(tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-W", "ignore", "analysis/transfer.py", "run", out, "--only", "m", "--device", "cpu"]
    command += ["--runs", "1", "--baselines", "1", "--steps", "1", "--source-steps", "1", "--workers", "1"]
    first = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    assert "# Transfer study, as-intended" in first.stdout
    assert "Command: `python analysis/transfer.py run " in first.stdout
    jobs = {path: path.stat().st_mtime_ns for path in out.glob("*/run-*/result.json")}
    assert len(jobs) == 4  # source, baseline, M and M frozen
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    assert {path: path.stat().st_mtime_ns for path in out.glob("*/run-*/result.json")} == jobs
    refused = subprocess.run([*command, "--seed", "2"], cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 1
    assert "holds another study (seed is 1 there and 2 here)" in refused.stderr
    assert "Traceback" not in refused.stderr


def test_the_shipped_results_are_still_read(tmp_path):
    shipped = ROOT / "analysis" / "transfer"
    command = [sys.executable, "analysis/transfer.py", "table", shipped, "--into", tmp_path / "copy"]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    again = pd.read_csv(tmp_path / "copy" / "table.csv", index_col="cell")
    pd.testing.assert_frame_equal(again, pd.read_csv(shipped / "table.csv", index_col="cell"))


def test_runs_of_different_studies_do_not_go_together(tmp_path):
    for name, study in (("one", TINY), ("other", replace(TINY, seed=9))):
        open_folder(study, tmp_path / name)
    with pytest.raises(LearnError, match="holds another study"):
        read_merged([tmp_path / "one", tmp_path / "other"])


def test_the_curve_of_cloning_is_made_and_goes_on_where_it_was(tmp_path):
    command = [sys.executable, "-W", "ignore", "analysis/imitation_curve.py", tmp_path, "--quick", "--episodes", "8"]
    subprocess.run([*command, "--seeds", "1"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    table = pd.read_csv(tmp_path / "curve.csv")
    assert set(table["source"]) == {"exploring expert", "human-like", "Minigrid's bot"}
    assert list(table["demonstrations"]) == [16, 32] * 3
    assert table["success"].between(0, 1).all()
    assert (tmp_path / "curve.png").stat().st_size > 10_000
    points = json.loads((tmp_path / "points.json").read_text())
    (tmp_path / "points.json").write_text(json.dumps(points[1:]))
    subprocess.run([*command, "--seeds", "1"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    again = json.loads((tmp_path / "points.json").read_text())
    assert sorted(again, key=str) == sorted(points, key=str)


def test_clones_of_people_who_search_are_tabled_and_go_on_where_they_were(tmp_path):
    command = [sys.executable, "-W", "ignore", "analysis/clone_searching.py", tmp_path, "--quick", "--episodes", "4"]
    subprocess.run([*command, "--seeds", "1"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    kept = tmp_path / "clone_searching.json"
    points = json.loads(kept.read_text())
    assert len(points) == 3 * 2 * 2  # who demonstrated, what is seen, how often
    table = (tmp_path / "clone_searching.md").read_text()
    assert table.count("| human-like, ") == table.count("| exploring, ") == table.count("| optimal, ") == 2
    kept.write_text(json.dumps(points[1:]))
    subprocess.run([*command, "--seeds", "1"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    assert sorted(json.loads(kept.read_text()), key=str) == sorted(points, key=str)


def test_policies_of_either_worlds_pictures_play_both(tmp_path):
    out = tmp_path / "found.json"
    command = [sys.executable, "-W", "ignore", "analysis/pictures_transfer.py", out, "--episodes", "2", "--tests", "1"]
    subprocess.run([*command, "--epochs", "1"], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    found = json.loads(out.read_text())["found"]
    sides = ("miniworld", "minihuman")
    assert [(each["learnt_from"], each["played_by"]) for each in found] == [(a, b) for a in sides for b in sides]
