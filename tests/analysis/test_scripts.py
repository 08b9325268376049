"""Every script in analysis/ runs on a small study and makes what it says."""

import json
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from minihuman.planning.benchmark import FAMILIES
from tests.builders import WORLDS, session, write_log
from tests.machine import needs

pytestmark = pytest.mark.program

SCRIPTS = Path(__file__).parents[2] / "analysis"


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    for index in range(4):
        group = ("grid_first", "direct")[index % 2]
        write_log(session(participant=f"sub-0{index + 1}", index=index, group=group, seed=index, episodes=2), data)
    return data / "transfer"


def run(monkeypatch, name, *arguments):
    monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
    runpy.run_path(str(SCRIPTS / name), run_name="__main__")


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("paths.py", ["sub-01/ses-01"]),
        ("overview.py", ["sub-01/ses-01"]),
        ("occupancy.py", [".", WORLDS["grid"]]),
        ("learning.py", [".", "room"]),
    ],
)
def test_a_figures_script_writes_a_picture_and_a_page(study, tmp_path, monkeypatch, capsys, name, arguments):
    run(monkeypatch, name, study / arguments[0], *arguments[1:], tmp_path / "figure")
    assert capsys.readouterr().out.split("\n")[:2] == [str(tmp_path / "figure.png"), str(tmp_path / "figure.pdf")]
    assert (tmp_path / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "figure.pdf").read_bytes().startswith(b"%PDF")


def test_the_reward_table_has_a_row_a_subject(study, tmp_path, monkeypatch):
    run(monkeypatch, "reward_table.py", study, tmp_path / "table.csv")
    table = pd.read_csv(tmp_path / "table.csv")
    assert table["participant"].tolist() == ["sub-02", "sub-04", "sub-01", "sub-03"]
    assert table["reward_mean"].between(0, 1).all()


def test_every_script_is_in_the_list():
    listed = (SCRIPTS / "README.md").read_text()
    scripts = sorted(path.name for path in SCRIPTS.glob("*.py"))
    assert scripts
    assert [name for name in scripts if f"analysis/{name}" not in listed] == []


def test_every_script_is_tested():
    others = (
        "learn/test_analysis.py",
        "learn/test_clone.py",
        "cli/test_teach.py",
        "test_error_rates.py",
        "designs/test_bars.py",
        "analysis/test_public_environments.py",
        "analysis/test_upstream_programs.py",
    )
    tests = Path(__file__).read_text() + "".join((SCRIPTS.parent / "tests" / each).read_text() for each in others)
    scripts = [path for path in SCRIPTS.glob("*.py") if "__main__" in path.read_text()]
    assert len(scripts) > 5
    assert [path.name for path in scripts if path.name not in tests] == []


def test_curves_of_trainings_are_compared_with_intervals_over_seeds(tmp_path, monkeypatch, capsys):
    rows = [
        {"world": "DoorKey", "trainer": trainer, "seed": seed, "steps": step, "episodes": step // 10,
         "success": min(1.0, step * speed / 4_000), "cpu_s": step / 1_000}
        for trainer, speed in (("ours", 8), ("sb3", 1))
        for seed in (1, 2, 3)
        for step in range(500, 3_001, 500)
    ]  # fmt: skip
    pd.DataFrame(rows).to_csv(tmp_path / "curves.csv", index=False)
    run(monkeypatch, "ppo_curves.py", tmp_path)
    ours, theirs = capsys.readouterr().out.splitlines()[2:]
    assert (
        ours == "| DoorKey | minihuman | 3 | 0.90 (0.90 to 0.90) | 1,000 (1,000 to 1,000) | 1,000 (1,000 to 1,000) |"
    ), "at 500 steps there were 50 episodes, of which a share says little"
    assert "| 0 of 3 learned |" in theirs
    assert (tmp_path / "curves.svg").stat().st_size > 5_000


WARM_START = """
steps = 512
worlds = 4
rollout = 16
critic_updates = 1
evaluation = 2
{people}
[[world]]
id = "minihuman/MiniGrid-Empty-5x5-v0"
"""


@needs("learn")
def test_a_warm_start_is_compared_with_ppo_alone(tmp_path, monkeypatch, capsys):
    jobs = SCRIPTS / "ppo"
    people = (jobs / "door-key-people.toml").read_text().split("[[blocks]]")
    small = people[0].replace('["small", "large", "corridor"]', '["small"]') + "[[blocks]]" + people[1]
    small = small.replace("episodes = 8", "episodes = 1").replace("DoorKey-5x5", "Empty-5x5").replace("= 250", "= 100")
    (tmp_path / "few.toml").write_text(small.replace('"door-key-people"', '"few"'))
    (tmp_path / "empty-plain.toml").write_text(WARM_START.format(people=""))
    people_line = f"from_people = {str(tmp_path / 'data' / 'few')!r}"
    (tmp_path / "empty-people.toml").write_text(WARM_START.format(people=people_line))
    run(monkeypatch, "warm_start.py", tmp_path, "--worlds", "empty", "--arms", "plain", "people", "--seeds", 1)
    plain, warm = capsys.readouterr().out.splitlines()[-2:]
    assert plain.startswith("| empty | plain | ")
    assert warm.startswith("| empty | people | ")
    curves = pd.read_csv(tmp_path / "warm_start.csv")
    assert curves.groupby("arm")["steps"].max().to_dict() == {"people": 512, "plain": 512}
    assert pd.read_csv(tmp_path / "warm_start_fresh.csv")["episodes"].tolist() == [2, 2]
    assert (tmp_path / "warm_start.svg").stat().st_size > 5_000


def test_the_list_of_changed_numbers_is_what_the_tests_give_now(tmp_path, monkeypatch):
    run(monkeypatch, "changed_statistics.py", "--out", tmp_path / "changes.csv")
    assert (tmp_path / "changes.csv").read_text() == (SCRIPTS / "changed_statistics.csv").read_text()


@pytest.mark.nightly
def test_the_papers_design_is_put_to_simulated_people(tmp_path, monkeypatch, capsys):
    run(monkeypatch, "ten_people.py", tmp_path, "--people", 4, "--studies", 2, "--processes", 1)
    rows = pd.read_csv(tmp_path / "ten_people.csv")
    assert set(rows["measure"]) == {"log_excess_steps", "log_steps_ratio", "reward", "success", "reward_two_parts"}
    assert rows["power"].between(0, 1).all()
    assert len(rows[rows["participants_a_group"] == 5]) == 4 * 5
    assert (tmp_path / "ten_people.png").stat().st_size > 10_000
    assert "five a group" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_scorecard_is_one_command_and_a_second_run_plays_nothing_again(tmp_path, monkeypatch):
    arguments = tmp_path / "out", "--data", tmp_path / "bench", "--processes", 1, "--quick"
    run(monkeypatch, "scorecard.py", *arguments)
    rows = pd.read_csv(tmp_path / "out" / "scores.csv").set_index("player")
    assert rows["levels"].to_dict() == {"human-like": 13, "exploring": 11}, "the expert plays grids and kitchens"
    assert (tmp_path / "out" / "scores.png").stat().st_size > 10_000
    assert "exploring does not play baseline-first-person" in (tmp_path / "out" / "scores.md").read_text()
    played = sorted((tmp_path / "bench").rglob("*.mcap"))
    assert len(played) == 2 * 3 + 2
    run(monkeypatch, "scorecard.py", *arguments)
    assert sorted((tmp_path / "bench").rglob("*.mcap")) == played


@pytest.mark.nightly
def test_what_new_readers_judge_is_drawn_again_by_its_seed(tmp_path, monkeypatch):
    for folder in ("first", "again"):
        run(monkeypatch, "readers/draw.py", tmp_path / folder, "--seed", 3)
    for name, count in (("help.txt", 40), ("errors.txt", 40), ("questions.txt", 24)):
        text = (tmp_path / "first" / name).read_text()
        assert text == (tmp_path / "again" / name).read_text()
        assert len(text.splitlines()) == count


def test_the_tasks_of_a_first_study_are_drawn_again_by_their_seed(tmp_path, monkeypatch):
    run(monkeypatch, "readers/first_study.py", tmp_path)
    published = Path(__file__).parents[2] / "analysis/readers/2026-11-26-first-study"
    for number in (1, 2, 3):
        task = (tmp_path / f"task-{number}.txt").read_text()
        assert task == (published / f"task-{number}.txt").read_text()
        assert len(re.findall("minihuman/[^, ]+-v[0-9]", task)) == 3


@pytest.mark.nightly
@needs("chromium")
def test_each_step_of_the_builder_has_a_picture_a_question_and_a_control(tmp_path, monkeypatch):
    run(monkeypatch, "readers/builder_steps.py", tmp_path, "--seed", 3)
    key = json.loads((tmp_path / "key.json").read_text())
    questions = (tmp_path / "questions.txt").read_text().splitlines()
    assert len(key) == len(questions) == len(list(tmp_path.glob("step-*.png"))) >= 20
    for number, question in zip(key, questions, strict=True):
        assert f"step-{number}.png" in question
        assert key[number]["goal"] in question
        assert 0 <= key[number]["box_px"]["y"] < 1000, "the control is in the picture"


@pytest.mark.nightly
@needs("chromium")
def test_ten_screens_of_two_builds_are_joined_in_the_order_that_the_key_says(tmp_path, monkeypatch):
    program = tmp_path / "before" / ".venv" / "bin" / "python"
    program.parent.mkdir(parents=True)
    program.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n')
    program.chmod(0o755)
    run(monkeypatch, "readers/page_screens.py", tmp_path / "out", "--before", tmp_path / "before", "--seed", 3)
    key = json.loads((tmp_path / "out" / "key.json").read_text())
    assert len({pair["screen"] for pair in key.values()}) == 10
    for number, pair in key.items():
        with Image.open(tmp_path / "out" / "pairs" / f"{number}.png") as joined:
            for side, x in (("left", 0), ("right", (joined.width + 24) // 2)):
                with Image.open(tmp_path / "out" / pair[side] / f"{number}.png") as picture:
                    of_pair = joined.crop((x, 0, x + picture.width, picture.height))
                    assert np.array_equal(np.asarray(of_pair), np.asarray(picture.convert("RGB")))


@pytest.mark.nightly
@needs("learn")
def test_the_study_of_partners_trains_plays_and_proves_its_four_conditions(tmp_path, monkeypatch):
    arguments = tmp_path, "--teams", 2, "--pilot", 4, "--steps", 2_048, "--quick"
    run(monkeypatch, "team_partners.py", *arguments)
    table = (tmp_path / "team_partners.md").read_text()
    for partner in ("person", "scripted", "clone", "self-play"):
        assert f"| {partner} | 2 |" in table, "of people two make a team"
    assert len(list((tmp_path / "logs").rglob("*.mcap"))) == 10
    assert (tmp_path / "report" / "report.html").is_file()
    for name in ("pettingzoo", "overcooked"):
        assert list((tmp_path / name).rglob("*.json*"))
    before = (tmp_path / "clone.pt").stat()
    run(monkeypatch, "team_partners.py", *arguments)
    assert (tmp_path / "clone.pt").stat() == before, "what is there is not made again"


@pytest.mark.nightly
@pytest.mark.parametrize("design", ["teams of two", "change between two days", "exclusions by the protocol's rules"])
def test_power_is_held_against_reports_and_whole_reports_against_the_quick_way(tmp_path, monkeypatch, capsys, design):
    run(monkeypatch, "power_against_reports.py", "--only", design, "--studies", 1, "--reports", 1, "--out", tmp_path)
    found = json.loads((tmp_path / "power_against_reports.json").read_text())
    [row] = found["designs"]
    assert (row["studies"], row["whole_reports"], row["numbers_that_differ"]) == (1, 1, 0)
    assert row["numbers"] > 300
    [comparison] = row["comparisons"]
    assert comparison["difference"] == comparison["power"] - comparison["reports"]
    assert comparison["reports"] in (0, 1)
    arguments = "--only", design, "--studies", 2, "--reports", 1, "--out", tmp_path
    run(monkeypatch, "power_against_reports.py", *arguments)
    [further] = json.loads((tmp_path / "power_against_reports.json").read_text())["designs"]
    assert (further["studies"], further["numbers"]) == (2, row["numbers"]), "what was done is not done again"
    assert f"| {design} |" in capsys.readouterr().out


def test_the_committed_comparison_of_power_is_the_docs():
    found = json.loads((SCRIPTS / "power_against_reports.json").read_text())
    assert len(found["designs"]) == 11
    assert {row["numbers_that_differ"] for row in found["designs"]} == {0}
    docs = (SCRIPTS.parent / "docs" / "statistics.md").read_text()
    table = (SCRIPTS / "power_against_reports.md").read_text().splitlines()
    assert [line for line in table if line.startswith("|") and line not in docs] == []


def test_planted_effects_of_trials_are_counted_and_more_studies_added(tmp_path, monkeypatch, capsys):
    out = tmp_path / "trial_effects.csv"
    monkeypatch.syspath_prepend(SCRIPTS)
    for studies in (2, 3):
        run(monkeypatch, "trial_effects.py", "--only", "d'", "--studies", studies, "--resamples", 99, "--out", out)
        (row,) = pd.read_csv(out).to_dict("records")
        assert (row["studies"], row["intervals"]) == (studies, studies)
    assert 0.4 < row["truth"] < 0.6
    assert "d' of 2.0 v 1.5" in capsys.readouterr().out


@needs("r")
@pytest.mark.nightly
@pytest.mark.parametrize("data_set", ["2 x 2, small group spreads", "2 x 3, missing cells", "3 x 2 x 2"])
def test_the_r_script_agrees_with_the_report_and_with_r(tmp_path, monkeypatch, capsys, data_set):
    run(monkeypatch, "r_agreement.py", "--only", data_set, "--out", tmp_path)
    rows = pd.read_csv(tmp_path / "r_agreement.csv")
    assert rows["agree"].eq("yes").all(), rows[rows["agree"] != "yes"]
    assert {"interaction: Kenward-Roger df", "interaction: Greenhouse-Geisser p"} <= {*rows["what"]}
    assert rows["what"].str.contains("difference, emmeans|mixed model").sum() >= 5
    assert "lmerTest" in capsys.readouterr().out


def test_r_agreed_with_the_report_on_the_committed_data_sets():
    rows = pd.read_csv(SCRIPTS / "r_agreement.csv")
    assert rows["data set"].nunique() == 10
    assert rows["agree"].eq("yes").all()


@pytest.mark.nightly
def test_each_attacker_is_held_out_of_the_fit_of_the_evidence(tmp_path, monkeypatch, capsys):
    run(monkeypatch, "bots.py", tmp_path, "--people", 20, "--programs", 2)
    rows = pd.read_csv(tmp_path / "bots.csv")
    assert rows["who"].tolist()[5:] == ["constant", "ex-Gaussian", "screenshot", "replay", "knowing", "replay"]
    assert rows["sessions"].tolist() == [12, 4, 2, 2, 20, 2, 2, 2, 2, 2, 2]
    assert rows.loc[5, "auc"] >= 0.95


@pytest.mark.nightly
def test_the_baseline_sets_difficulty_is_what_simulated_people_make_it(tmp_path, monkeypatch):
    run(monkeypatch, "baseline_difficulty.py", tmp_path, "--quick")
    table = pd.read_csv(tmp_path / "baseline_difficulty.csv")
    assert table["episodes"].tolist() == [2] * 13
    assert (table["success_at_limit"] >= 0.8).all()
    committed = pd.read_csv(SCRIPTS / "baseline_difficulty.csv")
    limits = {family.name: family.max_steps for families in FAMILIES.values() for family in families}
    assert dict(zip(committed["family"], committed["max_steps"], strict=True)) == limits


@needs("learn")
def test_the_baseline_sets_policies_are_trained_for_every_family(tmp_path, monkeypatch):
    from minihuman.learn.policy.file import load_policy

    monkeypatch.syspath_prepend(SCRIPTS)
    for what in ("clone", "ppo"):
        run(monkeypatch, "baseline_policies.py", what, tmp_path, "--quick")
        worlds = [world for path in (tmp_path / what).glob("*.pt") for world in load_policy(path)[1].worlds]
        every = [f"minihuman/{family.world}" for families in FAMILIES.values() for family in families]
        wanted = [world for world in every if "/Team-" not in world]  # of kitchens "not trained" is said
        assert sorted(worlds) == sorted(wanted)


def test_the_docs_say_of_the_transfer_study_what_its_table_does():
    table = pd.read_csv(SCRIPTS / "transfer" / "table.csv", index_col="cell")
    docs = (SCRIPTS.parent / "docs" / "agents.md").read_text()
    facts = json.loads((SCRIPTS / "transfer" / "run.json").read_text())
    assert f"{facts['jobs_done']} of {facts['jobs']} jobs" in docs
    assert f"{facts['jobs_done']} of {facts['jobs']})" in (SCRIPTS / "README.md").read_text()
    assert f"rank correlation of the means {facts['rank_correlation']:.2f}" in docs
    shown = docs[docs.index("| cell (runs)") :].split("\n\n")[0].splitlines()[3:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in shown]
    cells = {row[0]: row[1:4] for row in rows} | {row[5].replace(" (", "-frozen ("): row[6:9] for row in rows}
    assert len(cells) == 12
    for name, (reward, gain, published) in cells.items():
        found = table.loc[name.partition(" (")[0]]
        assert name.endswith(f"({found['runs']:.0f})")
        assert reward == f"{found['final_reward']:.3f}"
        bounds = [found["low"], found["high"]]
        few = {1: "(one run)", 2: "(two runs)"}
        words = few.get(int(found["runs"])) or "[{:.2f}, {:.2f}]".format(*bounds)
        assert gain == f"{found['improvement']:+.2f} {words}"
        assert published == f"{found['published']:+.2f} (SD {found['published_sd']:.2f})"


@needs("learn")
def test_job_files_are_run_with_several_seeds_and_not_again(tmp_path, monkeypatch, capsys):
    world = '[[world]]\nid = "minihuman/MiniGrid-Empty-5x5-v0"\n'
    (tmp_path / "two.toml").write_text(WARM_START.format(people="") + world.replace("Empty-5x5", "Empty-6x6"))
    run(monkeypatch, "job_runs.py", tmp_path, "--jobs", "two", "--seeds", 2)
    runs = pd.read_csv(tmp_path / "job_runs.csv")
    assert runs[["seed", "episodes"]].to_numpy().tolist() == [[1, 2], [1, 2], [2, 2], [2, 2]]
    assert set(runs["world"]) == {"minihuman/MiniGrid-Empty-5x5-v0", "minihuman/MiniGrid-Empty-6x6-v0"}
    table = capsys.readouterr().out.splitlines()[-1]
    assert table.startswith("| two | minihuman/MiniGrid-Empty-6x6-v0 | ")
    assert table.split("|")[3].strip().endswith(" of 2")
    run(monkeypatch, "job_runs.py", tmp_path, "--jobs", "two", "--seeds", 2)
    assert len(pd.read_csv(tmp_path / "job_runs.csv")) == 4
    assert pd.read_csv(tmp_path / "job_runs_curves.csv").groupby("seed")["steps"].max().tolist() == [512, 512]
