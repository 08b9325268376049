"""The public API: the notebook in the docs runs, names say little and much, and importing takes nothing heavy."""

import gc
import re
import subprocess
import sys
import weakref
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

import minihuman
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.errors import LogError, QueryError
from minihuman.log.read import session_reader
from minihuman.log.read.session_reader import read_log
from tests.builders import session, write_log
from tests.export.study import recorded

PAGE = Path(__file__).parents[2] / "docs" / "api.md"


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    return recorded(tmp_path_factory.mktemp("sessions"), participants=2)


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("by-hand")
    for index in range(2):
        log = write_log(session(participant=f"sub-0{index + 1}", index=index, seed=index, episodes=2), data)
    add_annotation(read_log(log), Annotation("exclude", "2026-01-06T10:00:00Z", episode=2))
    return data / "transfer"


@pytest.mark.program
def test_the_notebook_of_the_docs_runs(demo, tmp_path, monkeypatch, capsys):
    first, *others = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len([line for line in first.splitlines() if line]) == 10
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sessions").symlink_to(demo.parent)
    (tmp_path / "protocols").symlink_to(PAGE.parents[1] / "protocols")
    names: dict = {}
    exec("".join((first, *others)), names)
    assert names["path"].shape == (len(names["frames"]), 4)
    assert (tmp_path / "paths.png").stat().st_size > 10_000
    assert len(names["logs"]) == 2
    assert (tmp_path / "trial" / "csv" / "steps.csv").stat().st_size > 1_000
    assert (tmp_path / "trial" / "report" / "report.html").exists()
    assert "playing_s" in capsys.readouterr().out


@pytest.mark.program
def test_an_episode_played_back_is_the_one_that_was_played(demo):
    episode = minihuman.open_session(next(demo.rglob("*.mcap"))).episodes[0]
    moments = list(episode.play_back())
    assert tuple(moment.action for moment in moments) == episode.actions
    assert [moment.reward for moment in moments] == episode.rewards.tolist()
    assert [moment.step for moment in moments] == list(range(1, episode.steps + 1))
    assert len(episode.frames()) == episode.steps + 1


def test_a_figure_that_there_is_not_is_refused_with_the_names_there_are(by_hand):
    study = minihuman.open_study(by_hand)
    with pytest.raises(ValueError, match="figure 'learnng' does not exist; the figures are 'learning', 'occupancy'"):
        study.figure("learnng")
    with pytest.raises(ValueError, match="figure 'path' does not exist; the figures are 'paths', 'overview'"):
        study["sub-01"].figure("path")


def test_the_band_of_rewards_between_0_and_1_stays_between_them(by_hand):
    (axes,) = minihuman.open_study(by_hand).figure("learning").axes
    bands = [band for band in axes.collections if (band.get_gid() or "").startswith("band")]
    values = np.concatenate([path.vertices[:, 1] for band in bands for path in band.get_paths()])
    assert np.nanmin(values) >= 0
    assert np.nanmax(values) <= 1
    assert axes.get_ylim() == pytest.approx((-0.03, 1.03))


def test_what_does_not_count_is_left_out_unless_it_is_asked_for(by_hand):
    study = minihuman.open_study(by_hand)
    assert len(study.episodes) == 7
    assert len(study.table("episodes")) == 7
    assert len(study.table("episodes", with_excluded=True)) == 8
    steps = study.table("steps")
    assert len(steps) == sum(episode.steps for episode in study.episodes)
    assert not ((steps["participant"] == "sub-02") & (steps["episode"] == 2)).any()
    assert any("tagged exclude" in line for line in study.exclusions)
    assert len(minihuman.open_study(by_hand, minihuman.Selection(with_=("exclude",))).episodes) == 8
    (marked,) = [episode for episode in study["sub-02"].all_episodes if episode.exclusion]
    assert repr(marked) == "<episode 2 of sub-02: grid, timeout, 23 steps, excluded: tagged exclude>"


def test_a_table_of_what_counts_has_nothing_of_a_session_that_does_not(tmp_path):
    for index in range(2):
        log = write_log(session(participant=f"sub-0{index + 1}", index=index, episodes=1, blocks=("grid",)), tmp_path)
    add_annotation(read_log(log), Annotation("exclude", "2026-01-06T10:00:00Z"))
    study = minihuman.open_study(tmp_path / "transfer")
    for table in ("participants", "keys", "segments", "plan", "steps", "frames"):
        assert set(study.table(table)["participant"]) == {"sub-01"}, table
        assert set(study.table(table, with_excluded=True)["participant"]) == {"sub-01", "sub-02"}, table


def test_names_are_short_and_a_cell_shows_a_table(by_hand):
    study = minihuman.open_study(by_hand)
    assert repr(study) == "<study transfer: 2 sessions>"
    assert repr(study["sub-01"]) == "<session 1 of sub-01 (grid_first): 4 of 4 episodes included>"
    for one in (study, study["sub-02"]):
        assert one._repr_html_().count("<tr>") == 1 + len(one.sessions if one is study else one.all_episodes)


def test_a_session_is_opened_by_its_log_or_its_folder(by_hand):
    log = next((by_hand / "sub-01").rglob("*.mcap"))
    for path in (log, log.parent, str(log)):
        opened = minihuman.open_session(path)
        assert isinstance(opened, minihuman.Session)
        assert len(opened) == 4
        assert np.array_equal(opened.episodes[0].path, read_log(log).episodes[0].poses)
    assert len(opened.table("blocks")) == 2


def test_a_participants_second_session_has_its_number(tmp_path):
    for number in (1, 2):
        log = session(participant="sub-01", index=0, episodes=1, blocks=("grid",))
        write_log(replace(log, plan=msgspec.structs.replace(log.plan, session=number)), tmp_path)
    study = minihuman.open_study(tmp_path / "transfer")
    assert [study["sub-01"].number, study["sub-01", 1].number, study["sub-01", 2].number] == [1, 1, 2]
    with pytest.raises(KeyError, match="3"):
        study["sub-01", 3]


def test_verify_names_a_log_that_cannot_be_read_and_goes_on(by_hand, tmp_path):
    broken = tmp_path / "broken" / "sub-01_ses-01.mcap"
    broken.parent.mkdir()
    broken.write_bytes(b"no log")
    lines = list(minihuman.verify(broken, next(by_hand.rglob("*.mcap"))))
    assert lines[0].log == broken
    assert isinstance(lines[0].error, LogError)
    assert not lines[0].ok
    assert {line.log for line in lines[1:]} == {next(by_hand.rglob("*.mcap"))}


def test_what_is_not_there_is_said_in_one_line(by_hand):
    with pytest.raises(LogError, match="is not a folder; name a study's folder"):
        minihuman.open_study(by_hand / "nowhere")
    with pytest.raises(QueryError, match="table 'stairs' does not exist; the tables are steps"):
        minihuman.open_study(by_hand).table("stairs")
    with pytest.raises(KeyError, match="sub-99"):
        minihuman.open_study(by_hand)["sub-99"]
    with pytest.raises(LogError, match="no included episode of 'attic'"):
        minihuman.open_study(by_hand).figure("learning", of="attic")
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        minihuman.nothing  # noqa: B018


def test_no_public_function_is_hidden_by_a_package_of_its_name():
    packages = {path.name for path in Path(minihuman.__file__).parent.iterdir() if path.is_dir()}
    assert packages & {*minihuman.__all__} == set()


def test_every_public_name_is_there_and_explained():
    assert len(minihuman.__all__) <= 24
    for name in set(minihuman.__all__) - {"__version__"}:
        thing = getattr(minihuman, name)
        assert thing.__doc__
        for member, value in vars(thing).items() if isinstance(thing, type) else ():
            if not member.startswith("_") and callable(value):
                assert value.__doc__, f"{name}.{member}"


@pytest.mark.program
def test_importing_loads_nothing_heavy_and_help_says_how_to_begin():
    heavy = "('pandas', 'numba', 'matplotlib', 'duckdb', 'mcap')"
    code = f"import minihuman, sys; print([name for name in {heavy} if name in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
    told = subprocess.run([sys.executable, "-c", "import minihuman; help(minihuman)"], capture_output=True, text=True)
    assert 'minihuman.open_study("sessions/fourrooms-transfer")' in told.stdout
    assert "class Study" in told.stdout


def test_a_study_and_a_session_are_opened_by_functions_of_their_own(by_hand):
    study = minihuman.open_study(str(by_hand))
    assert isinstance(study, minihuman.Study)
    folder = by_hand / "sub-01" / "ses-01"
    assert minihuman.open_session(str(folder)).participant == "sub-01"
    assert isinstance(minihuman.open_study(folder), minihuman.Study)
    with pytest.raises(LogError, match="is not a folder"):
        minihuman.open_study(next(by_hand.rglob("*.mcap")))


def test_one_session_is_opened_and_no_other(by_hand, monkeypatch):
    study, opened = minihuman.open_study(by_hand), []
    real = session_reader.read_log
    monkeypatch.setattr(session_reader, "read_log", lambda path: opened.append(path) or real(path))
    assert study["sub-02"].participant == "sub-02"
    assert len(opened) == 1


def test_going_through_a_study_keeps_no_session(by_hand):
    sessions = iter(minihuman.open_study(by_hand))
    first = weakref.ref(next(sessions))
    assert next(sessions) is not None
    gc.collect()
    assert first() is None
