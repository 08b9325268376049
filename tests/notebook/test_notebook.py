"""The public API: the notebook in the docs runs, names say little and much, and importing takes nothing heavy."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import minihuman
from minihuman.data.marks import Mark, add_mark
from minihuman.errors import LogError, StoreError
from minihuman.log.read.open_log import open_log
from tests.builders import session, write_log
from tests.export.study import recorded

PAGE = Path(__file__).parents[2] / "docs" / "notebook.md"


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> Path:
    return recorded(tmp_path_factory.mktemp("sessions"), participants=2)


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory) -> Path:
    data = tmp_path_factory.mktemp("by-hand")
    for index in range(2):
        log = write_log(session(participant=f"sub-0{index + 1}", index=index, seed=index, episodes=2), data)
    add_mark(open_log(log), Mark("exclude", "2026-01-06T10:00:00Z", episode=2))
    return data / "transfer"


@pytest.mark.program
def test_the_notebook_of_the_docs_runs(demo, tmp_path, monkeypatch, capsys):
    first, second = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert len([line for line in first.splitlines() if line]) == 10
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sessions").symlink_to(demo.parent)
    names: dict = {}
    exec(first + second, names)
    assert names["path"].shape == (len(names["frames"]), 4)
    assert (tmp_path / "paths.png").stat().st_size > 10_000
    assert "playing_s" in capsys.readouterr().out


@pytest.mark.program
def test_an_episode_played_back_is_the_one_that_was_played(demo):
    episode = minihuman.open(next(demo.rglob("*.mcap"))).episodes[0]
    moments = list(episode.play_back())
    assert tuple(moment.action for moment in moments) == episode.actions
    assert [moment.reward for moment in moments] == episode.rewards.tolist()
    assert [moment.step for moment in moments] == list(range(1, episode.steps + 1))
    assert len(episode.frames()) == episode.steps + 1


def test_what_does_not_count_is_left_out_unless_it_is_asked_for(by_hand):
    study = minihuman.open(by_hand)
    assert len(study.episodes) == 7
    assert len(study.table("episodes")) == 7
    assert len(study.table("episodes", everything=True)) == 8
    steps = study.table("steps")
    assert len(steps) == sum(episode.steps for episode in study.episodes)
    assert not ((steps["participant"] == "sub-02") & (steps["episode"] == 2)).any()
    assert any("tagged exclude" in line for line in study.left_out)
    assert len(minihuman.open(by_hand, minihuman.Selection(with_=("exclude",))).episodes) == 8
    (marked,) = [episode for episode in study["sub-02"].everything if episode.left_out]
    assert repr(marked) == "<episode 2 of sub-02: grid, timeout, 23 steps, left out: tagged exclude>"


def test_a_table_of_what_counts_has_nothing_of_a_session_that_does_not(tmp_path):
    for index in range(2):
        log = write_log(session(participant=f"sub-0{index + 1}", index=index, episodes=1, blocks=("grid",)), tmp_path)
    add_mark(open_log(log), Mark("exclude", "2026-01-06T10:00:00Z"))
    study = minihuman.open(tmp_path / "transfer")
    for table in ("participants", "keys", "segments", "plan", "steps", "frames"):
        assert set(study.table(table)["participant"]) == {"sub-01"}, table
        assert set(study.table(table, everything=True)["participant"]) == {"sub-01", "sub-02"}, table


def test_names_are_short_and_a_cell_shows_a_table(by_hand):
    study = minihuman.open(by_hand)
    assert repr(study) == "<study transfer: 2 sessions>"
    assert repr(study["sub-01"]) == "<session 1 of sub-01 (grid_first): 4 of 4 episodes count>"
    for one in (study, study["sub-02"]):
        assert one._repr_html_().count("<tr>") == 1 + len(one.sessions if one is study else one.everything)


def test_a_session_is_opened_by_its_log_or_its_folder(by_hand):
    log = next((by_hand / "sub-01").rglob("*.mcap"))
    for path in (log, log.parent, str(log)):
        opened = minihuman.open(path)
        assert isinstance(opened, minihuman.Session)
        assert len(opened) == 4
        assert np.array_equal(opened.episodes[0].path, open_log(log).episodes[0].poses)
    assert len(opened.table("blocks")) == 2


def test_what_is_not_there_is_said_in_one_line(by_hand):
    with pytest.raises(LogError, match="does not exist; name a session log"):
        minihuman.open(by_hand / "nowhere")
    with pytest.raises(StoreError, match="there is no table 'stairs'; there are steps"):
        minihuman.open(by_hand).table("stairs")
    with pytest.raises(KeyError, match="sub-99"):
        minihuman.open(by_hand)["sub-99"]
    with pytest.raises(LogError, match="no episode of 'attic'"):
        minihuman.open(by_hand).figure("learning", of="attic")
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        minihuman.nothing  # noqa: B018


def test_every_public_name_is_there_and_explained():
    assert len(minihuman.__all__) < 13
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
    assert 'minihuman.open("sessions/fourrooms-transfer")' in told.stdout
    assert "class Study" in told.stdout
