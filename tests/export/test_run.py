"""Exports of whole studies: filters, cards, bad input and what is left behind."""

import json
from pathlib import Path

import pandas as pd
import pytest

from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD
from minihuman.dataset.selection import Selection
from minihuman.dataset.table_catalogue import TABLES
from minihuman.errors import ExportError, LogError
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_log
from tests.copied import as_another
from tests.export.study import DEMO, recorded

pytestmark = pytest.mark.program

EVERYTHING = Selection()


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp("study"), participants=2)


@pytest.fixture
def log(study):
    return next(study.glob("sub-01/*/*.mcap"))


def written(study, out, selection=EVERYTHING, format_name="parquet"):
    return export_study(format_name, study, out, selection)[0]


@pytest.mark.parametrize("format_name", ["csv", "parquet", "minari", "lerobot", "imitation"])
def test_every_format_writes_a_study_and_its_card(study, tmp_path, monkeypatch, format_name):
    monkeypatch.chdir(tmp_path)
    done, _ = export_study(format_name, study, type(study)("out"), Selection())
    assert done.episodes == 8
    assert all(path.exists() for path in done.paths)
    card = (tmp_path / "out/README.md").read_text()
    assert "8 episodes" in card
    assert "| sub-02 | 4 |" in card


def test_filters_take_what_they_say(study, log, tmp_path):
    assert written(study, tmp_path / "a", Selection(participant=("sub-02",))).episodes == 4
    assert written(study, tmp_path / "b", Selection(block=("grid",))).episodes == 4
    ended_so = sum(episode.outcome == "goal" for path in study.rglob("*.mcap") for episode in read_log(path).episodes)
    assert written(study, tmp_path / "c", Selection(outcome=("goal",))).episodes == ended_so
    assert written(log, tmp_path / "d").episodes == 4


def test_tables_are_made_from_the_log_alone(study, tmp_path):
    """What takes the world itself, the fewest possible steps, is in the report's tables and not in these."""
    written(study, tmp_path / "out")
    described = json.loads((tmp_path / "out/dictionary.json").read_text())
    assert {"steps", "episodes", "participants"} <= set(described)
    assert {path.stem for path in (tmp_path / "out").glob("*.parquet")} == set(described)
    for name in described:
        table, columns = pd.read_parquet(tmp_path / f"out/{name}.parquet"), TABLES[name]
        assert len(table), f"{name} has no row, and a file"
        assert (
            list(table.columns)
            == list(described[name])
            == [c.name for c in columns if c.name not in COLUMNS_NEEDING_WORLD]
        )


def test_a_rule_by_what_takes_the_world_leaves_the_same_out_as_in_the_report(tmp_path):
    rule = '[[exclusions]]\nreason = "wandered"\nlevel = "episode"\nmeasure = "excess_steps"\nabove = -1\n'
    study = recorded(tmp_path / "data", participants=1, toml=DEMO.read_bytes() + rule.encode())
    written(study, tmp_path / "out")
    exclusion_reason = pd.read_parquet(tmp_path / "out/episodes.parquet")["exclusion_reason"]
    assert exclusion_reason.tolist() == ["wandered"] * 4


def test_sessions_read_side_by_side_are_written_in_order_and_alike(study, tmp_path):
    """Enough sessions for a second process: the same tables as one process writes, session by session."""
    many = tmp_path / "many"
    logs = sorted(study.rglob("*.mcap"))
    for number in range(40):
        as_another(logs[number % 2], f"sub-{number:02}", many)
    damaged = [many / "sub-03" / "foreign.mcap", many / "sub-37" / "foreign.mcap"]
    for path in damaged:
        path.write_bytes(b"not a log")
    done, card = export_study("parquet", many, tmp_path / "all", EVERYTHING)
    assert [many / one.path for one in card.account.skipped] == damaged
    apart = [written(log, tmp_path / f"one-{number}") for number, log in enumerate(logs)]
    assert done.episodes == 20 * sum(one.episodes for one in apart)
    for name in json.loads((tmp_path / "all/dictionary.json").read_text()):
        pair = [pd.read_parquet(tmp_path / f"one-{number}/{name}.parquet") for number in range(2)]
        together = pd.read_parquet(tmp_path / f"all/{name}.parquet")
        who = [f"sub-{number:02}" for number in range(40)] if len(together) else []  # no device, no mark
        assert together["participant"].drop_duplicates().tolist() == who
        whose = [name for name in together.columns if name == "participant"]
        alike = pd.concat(pair * 20, ignore_index=True).drop(columns=whose)
        pd.testing.assert_frame_equal(together.drop(columns=whose), alike, check_dtype=len(together) > 0)


def test_marked_episodes_can_be_left_out_or_taken_alone(tmp_path):
    study = recorded(tmp_path / "data", participants=1)
    path = add_annotation(
        read_log(next(study.rglob("*.mcap"))), Annotation(tag="exclude", at="2026-01-01T00:00:00Z", episode=2)
    )
    assert path.exists()
    assert written(study, tmp_path / "a", Selection()).episodes == 3
    assert written(study, tmp_path / "b", Selection(only=("exclude",), with_=("exclude",))).episodes == 1


def test_a_damaged_log_is_named_in_the_card_and_the_rest_is_written(tmp_path):
    study = recorded(tmp_path / "data", participants=2)
    damaged = next(study.glob("sub-01/*/*.mcap"))
    damaged.write_bytes(b"not a log")
    done, card = export_study("parquet", study, tmp_path / "out", Selection())
    assert done.episodes == 4
    assert any(study / one.path == damaged for one in card.account.skipped)
    assert damaged.name in (tmp_path / "out/README.md").read_text()
    assert damaged.read_bytes() == b"not a log"


def test_nothing_is_overwritten(study, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine.txt").write_text("keep")
    with pytest.raises(ExportError, match="already exists; choose another folder"):
        written(study, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["mine.txt"]


def test_the_folder_one_is_in_is_refused_before_any_work(study, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    read: list[Path] = []
    with pytest.raises(ExportError, match=r"\. is the current folder; choose a new folder"):
        export_study("parquet", study, Path(), EVERYTHING, progress=read.append)
    assert not read
    assert not list(tmp_path.iterdir())


def test_a_selection_of_which_nothing_counts_leaves_nothing(study, tmp_path):
    with pytest.raises(
        ExportError, match=r"nothing to export: 0 episodes of 0 sessions included \(--outcome failure\)"
    ):
        written(study, tmp_path / "out", Selection(outcome=("failure",)))
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_format_lists_the_known(study, tmp_path):
    with pytest.raises(
        ExportError,
        match="'xlsx' is unknown; it is one of bids, croissant, csv, frictionless, hugging-face, im",
    ):
        written(study, tmp_path / "out", format_name="xlsx")


def test_a_source_that_is_not_there_says_so(tmp_path):
    with pytest.raises((LogError, OSError), match="nowhere"):
        written(tmp_path / "nowhere", tmp_path / "out")
    assert not (tmp_path / "out").exists()
