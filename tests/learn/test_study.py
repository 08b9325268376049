import json
import shutil
from dataclasses import replace

import pandas as pd
import pytest
from rich.console import Console

from minihuman.errors import LearnError
from minihuman.learn.ppo import PpoSettings
from tests.machine import needs
from transfer_study.engines import (
    LocalPool,
    RayCluster,
    open_engine,
    open_folder,
    read_results,
    run_study,
)
from transfer_study.job import Result
from transfer_study.plan import BASELINE, SOURCE, TransferCell, TransferJob, TransferStudy
from transfer_study.summary import (
    RunInfo,
    correlate_with_published,
    count_core_hours,
    curves_figure,
    get_published,
    improvement_table,
    read_published,
    read_shipped,
    speed_table,
    write_report,
)
from transfer_study.training import TrainingPoint

pytestmark = pytest.mark.program

TINY = TransferStudy(
    runs=1,
    baselines=1,
    steps=128,
    source_steps=128,
    transfers=("M",),
    ppo=PpoSettings(64, 32, n_epochs=1),
)
QUIET = Console(quiet=True)


def result_of(job, rewards):
    points = tuple(TrainingPoint(100 * (n + 1), reward, 10.0, reward) for n, reward in enumerate(rewards))
    seconds = {"world": 1.0, "acting": 2.0, "learning": 5.0, "last_sitting": 9.0}
    return Result(job.name, job.config, job.config_hash, points, seconds, "cpu", {})


@pytest.fixture
def results():
    """Two runs of a hand-made study: baseline areas 0.4 and 0.6, transfer areas 0.6 and 0.8."""
    study = replace(TINY, runs=2, baselines=2)
    level = {(BASELINE, 0): 0.4, (BASELINE, 1): 0.6, ("M", 0): 0.6, ("M", 1): 0.8}
    made = {}
    for job in study.jobs():
        if not job.cell.frozen:
            height = level.get((job.cell.label, job.run), 0.95)
            made[job] = result_of(job, [height] * 3)
    return study, made


def test_the_table_holds_improvements_over_the_baseline(results):
    study, made = results
    rows = improvement_table(study, made)
    assert list(rows.index) == [SOURCE, BASELINE, "M"]
    assert rows.loc["M", "improvement"] == pytest.approx((0.6 * 0.8 / 0.4 / 0.6) ** 0.5 - 1)
    assert rows.loc["M", "p"] == rows.loc["M", "smallest_p"] == 0.5
    assert rows.loc["M", "p_holm"] == rows.loc["M", "p"]  # the only cell that is compared
    assert rows.loc["M", "verdict"] == "2 runs, too few to tell"
    assert rows.loc[BASELINE, "verdict"] == ""
    assert rows.loc[SOURCE, "runs_solved"] == 2
    assert rows.loc[SOURCE, "steps_to_solve"] == 100


def test_published_numbers_stand_beside_ours(results, tmp_path):
    study, made = results
    path = tmp_path / "published.csv"
    path.write_text("cell,improvement\nM,0.07\n")
    rows = improvement_table(study, made, beside=read_published(path))
    assert rows.loc["M", "published"] == 0.07
    assert pd.isna(rows.loc[BASELINE, "published"])
    assert rows.loc["M", "beside"] == "2 runs, no interval"
    assert rows.loc[BASELINE, "beside"] == ""
    path.write_text("cell,improvement,sd\nM,70,0.1\n")
    rows = improvement_table(study, made, beside=read_published(path))
    assert rows.loc["M", "published_sd"] == 0.1


def test_a_run_that_never_solves_its_world_counts_with_all_of_its_steps():
    made = {}
    for job in replace(TINY, steps=300, runs=2, baselines=2).jobs():
        rewards = {("M", 0): [0.5, 0.95, 0.95], ("M", 1): [0.5] * 3}.get((job.cell.label, job.run), [0.95] * 3)
        made[job] = result_of(job, rewards)
    rows = improvement_table(replace(TINY, steps=300, runs=2, baselines=2), made)
    assert rows.loc["M", "steps_to_solve"] == (200 + 300) / 2
    assert rows.loc["M", "runs_solved"] == 1
    assert rows.loc[BASELINE, "steps_to_solve"] == 100


def test_three_runs_stand_beside_the_published_and_in_its_order():
    study = replace(TINY, runs=3, baselines=3, transfers=("M", "A", "C"))
    heights = {BASELINE: 0.5, "M": 0.6, "A": 0.4, "C": 0.5}
    made = {}
    for job in study.jobs():
        height = heights.get(job.cell.name, 0.9) * (1 + 0.01 * job.run * (job.cell.name != BASELINE))
        made[job] = result_of(job, [height] * 3)
    rows = improvement_table(study, made, beside=read_shipped())
    assert rows.loc["M", "beside"] == "outside our interval"
    cells, rank, _ = correlate_with_published(rows)
    assert cells == 6
    assert -1 <= rank <= 1
    assert correlate_with_published(rows.loc[["M", "A", "C"]])[1] == 0.5  # theirs: C, M, A


def test_the_papers_numbers_stand_beside_studies_of_as_many_steps(results):
    study, _ = results
    assert get_published(study, None) is None
    assert get_published(replace(study, steps=200_000), None).equals(read_shipped())
    assert get_published(replace(study, steps=200_000, quick=True), None) is None
    labels = {cell.label for cell in TransferStudy().cells}
    assert set(read_shipped().index) == labels - {SOURCE, BASELINE}
    assert read_shipped().loc["ACM-frozen", "improvement"] == -0.31


def test_core_hours_are_the_processors_not_the_walls(results):
    _, made = results
    assert count_core_hours(made) == pytest.approx(len(made) * 8 / 3600)  # results of before have the wall's alone
    job, result = next(iter(made.items()))
    assert count_core_hours({job: replace(result, seconds=result.seconds | {"cpu": 3.6})}) == pytest.approx(0.001)


@pytest.mark.parametrize("content", [None, "row,gain\nM,0.1\n", ""])
def test_a_table_that_cannot_be_set_beside_is_refused(tmp_path, content):
    path = tmp_path / "published.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(LearnError, match=r"published\.csv"):
        read_published(path)


def test_the_report_is_written_and_says_where_the_time_goes(results, tmp_path):
    study, made = results
    text = write_report(study, made, tmp_path, RunInfo("python analysis/transfer.py run OUT", "local", 60.0))
    assert {path.name for path in tmp_path.iterdir()} == {
        *("table.csv", "curves.csv", "speed.csv", "run.json", "report.md", "curves.png")
    }
    assert speed_table(made).loc["grid (source)", "learning"] == pytest.approx(5 / 8)
    assert len(pd.read_csv(tmp_path / "curves.csv")) == 3 * len(made)
    assert json.loads((tmp_path / "run.json").read_text())["jobs_done"] == len(made)
    assert "QUICK" not in text


def test_a_panel_says_how_many_runs_it_has_and_one_without_a_cell_is_not_drawn():
    runs = ((SOURCE, 0), (BASELINE, 0), (BASELINE, 1), ("M", 0))
    points = pd.DataFrame([(cell, run, n, 0.5) for cell, run in runs for n in (0, 100)])
    points.columns = ["cell", "run", "steps", "reward"]
    titles = [f"{SOURCE}, 1 run", f"{BASELINE}, 2 runs", "M, 1 run", ""]
    assert [(ax.get_title(), ax.axison) for ax in curves_figure(TINY, points).axes] == [
        (title, bool(title)) for title in titles
    ]


def test_a_quick_study_says_so_everywhere(results, tmp_path):
    study, made = results
    study = replace(study, quick=True)
    assert "QUICK" in write_report(study, made, tmp_path, RunInfo("minihuman", "local", 1.0))
    assert json.loads((tmp_path / "run.json").read_text())["quick"] is True


def test_as_published_names_its_defects(results, tmp_path):
    study, made = results
    study = replace(study, protocol="as-published")
    assert "misspells" in write_report(study, made, tmp_path, RunInfo("minihuman", "local", 1.0))


@pytest.fixture(scope="module")
def local(tmp_path_factory):
    """The tiny study, run by a pool of two processes."""
    out = tmp_path_factory.mktemp("local") / "study"
    return out, run_study(TINY, out, lambda: LocalPool(2), device="cpu", console=QUIET)


def test_a_study_runs_every_job_once(local):
    out, results = local
    assert set(results) == set(TINY.jobs())

    def no_engine():
        raise AssertionError("a finished study needs no engine")

    assert run_study(TINY, out, no_engine, console=QUIET) == results


@needs("ray")
def test_ray_gives_the_numbers_of_the_local_pool(local, tmp_path):
    _, expected = local
    results = run_study(TINY, tmp_path / "ray", lambda: RayCluster(workers=1), device="cpu", console=QUIET)
    assert {job: result.points for job, result in results.items()} == {
        job: result.points for job, result in expected.items()
    }


def test_a_folder_of_another_study_is_refused_and_left_alone(local):
    out, _ = local
    before = (out / "study.json").read_text()
    with pytest.raises(LearnError, match="holds another study \\(seed is 1 there and 2 here\\)"):
        open_folder(replace(TINY, seed=2), out)
    assert (out / "study.json").read_text() == before


def test_a_study_comes_back_with_more_runs_and_keeps_those_it_has(local, tmp_path):
    out, results = local
    folder = tmp_path / "study"
    shutil.copytree(out, folder)
    more = replace(TINY, runs=TINY.runs + 1)
    open_folder(more, folder)
    assert {job.name: result for job, result in read_results(more, folder).items()} == {
        job.name: result for job, result in results.items()
    }
    with pytest.raises(LearnError, match="runs is"):
        open_folder(TINY, folder)


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "thesis.tex").write_text("")
    with pytest.raises(LearnError, match="is not empty and holds no study"):
        open_folder(TINY, tmp_path)


@pytest.mark.parametrize(
    "changes", [{"runs": 0}, {"steps": 0}, {"source_steps": 0}, {"protocol": "as-wished"}, {"transfers": ("X",)}]
)
def test_a_study_that_cannot_be_run_is_refused(changes):
    with pytest.raises(LearnError):
        TransferStudy(**changes)


def test_an_engine_there_is_not_is_refused():
    with pytest.raises(LearnError, match="no engine is called 'slurm'"):
        open_engine("slurm")
    with pytest.raises(LearnError, match="at least one process"):
        open_engine("local", workers=0)


def test_a_transfer_waits_for_the_source_of_its_own_run():
    job = TransferJob(TransferStudy(runs=3), TransferCell("ACM", frozen=True), 2)
    assert job.source == TransferJob(TransferStudy(runs=3), TransferCell(SOURCE), 2)
    assert job.name == "ACM-frozen/run-02"
