"""The tables as other programs read them, and those of what lies around the episodes' steps."""

import json
import shutil
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from minihuman.activities.correction import rows as correction_rows
from minihuman.activities.preferences import rows as preference_rows
from minihuman.dataset.rows import arrow_schema
from minihuman.dataset.selection import Selection
from minihuman.dataset.session_tables import find_tables_of_topics
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES, find_primary_key, is_episode_table
from minihuman.dataset.table_columns import table_key_name
from minihuman.experiment.machine.activity import list_built_in_kinds
from minihuman.exporters.exporter import export_study
from minihuman.log import topics
from minihuman.log.codec import list_activity_topics
from minihuman.log.read.session_reader import read_log
from tests.lab.test_bonus import study

GOLDEN = Path(__file__).parents[1] / "golden/v1"
STUDIES = ("resumed", "marked", "real-time", "no-episode", "no-step")


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tables")
    for name in STUDIES:
        shutil.copytree(GOLDEN / name, folder / name)
        for kind in ("csv", "parquet"):
            export_study(kind, folder / name, folder / f"{name}-{kind}", Selection())
    return folder


def table(studies, study, name):
    path = studies / f"{study}-parquet" / f"{name}.parquet"
    return (pq.read_table(path) if path.exists() else arrow_schema(name).empty_table()).to_pandas()


def log_of(studies, study):
    [path] = (studies / study).rglob("*.mcap")
    return read_log(path)


def test_every_topic_of_the_log_is_in_a_table_or_an_export():
    truths = {
        topic.name
        for topic in (*topics.TOPICS, *topics.RARE_TOPICS, *list_activity_topics(list_built_in_kinds()))
        if not topic.is_preview
    }
    seen, none = (
        {preference_rows.PREFERENCE_FRAME_TOPIC, correction_rows.CORRECTION_FRAME_TOPIC},
        {preference_rows.NO_PREFERENCE_TOPIC, correction_rows.NO_CORRECTION_TOPIC},
    )
    said = {"/team/typed", "/team/edited", "/team/message"}  # between people: in their logs alone
    planned = {"/trial"}  # a trial's times before it begins; `trial_stimuli` has those of all that was shown
    # arrays; when something was seen; that there was nothing to see; what people wrote to each other
    left_out = {topics.OBSERVATION} | seen | none | said | planned
    tables_of_topics = find_tables_of_topics()
    assert set(tables_of_topics) == truths - left_out
    assert {name for names in tables_of_topics.values() for name in names} <= set(TABLES)


def test_segments_say_when_and_where_each_began(studies):
    segments, log = table(studies, "resumed", "segments"), log_of(studies, "resumed")
    assert segments["segment"].tolist() == [1, 2]
    assert segments["end_reason"].tolist() == ["quit", "complete"]
    assert segments["start_ns"].tolist() == [0, 3_600_000_000_000]
    assert (segments["started_unix_ns"].diff()[1], segments["slot"][0]) == (3_600_000_000_000, 1)
    assert json.loads(segments["station"][0])["refresh_hz"] == "60.0"
    assert segments["consent_sha256"][0] == log.plan.consent_sha256


def test_steps_are_placed_on_one_clock_over_all_segments(studies):
    steps, segments = table(studies, "resumed", "steps"), table(studies, "resumed", "segments")
    assert steps["t_ns"].is_monotonic_increasing
    assert steps["t_ns"].dtype == np.int64
    joined = steps.merge(segments, on=["participant", "session", "segment"])
    assert ((joined["t_ns"] >= joined["start_ns"]) & (joined["t_ns"] <= joined["end_ns"])).all()


def test_the_plan_holds_what_was_not_played_too(studies):
    plan = table(studies, "no-step", "plan")
    assert plan["episode"].tolist() == [1, 2, 3]
    assert plan["attempts"].tolist() == [1, 0, 0]
    assert set(json.loads(plan["key_map"][0]).values()) == {"left", "right", "forward"}
    unplayed = table(studies, "no-episode", "plan")
    assert unplayed["attempts"].tolist() == [0, 0, 0]
    assert len(table(studies, "no-episode", "participants")) == 1
    real_time = table(studies, "real-time", "plan")
    assert real_time[["pace", "step_period_ms", "noop"]].iloc[0].tolist() == ["real_time", 400.0, "done"]


def test_a_path_has_its_beginning(studies):
    starts, log = table(studies, "resumed", "starts"), log_of(studies, "resumed")
    assert starts[["x", "z", "yaw_rad"]].to_numpy().tolist() == [
        episode.poses[0, [0, 2, 3]].tolist() for episode in log.episodes
    ]
    assert json.loads(starts["map"][0])["unit"] == starts["unit"][0] == "cell"


def test_frames_are_there_with_both_times(studies):
    frames, log = table(studies, "resumed", "frames"), log_of(studies, "resumed")
    assert frames["flip_ns"].tolist() == [frame.flip_ns for episode in log.episodes for frame in episode.frames]
    assert (frames["flip_ns"] >= frames["submit_ns"]).all()


def test_every_key_is_in_one_table_or_the_other(studies):
    log = log_of(studies, "resumed")
    inside, outside = (table(studies, "resumed", name) for name in ("presses", "other_presses"))
    assert len(inside) == sum(len(episode.keys) for episode in log.episodes)
    assert len(inside) + len(outside) == len(log.keys)
    both = sorted([*zip(inside["t_ns"], inside["key"]), *zip(outside["t_ns"], outside["key"])])  # noqa: B905
    assert both == sorted((key.t_ns, table_key_name(key.key)) for key in log.keys)
    assert "keyboard_check" in set(outside["phase"])


def test_notes_hold_consent_and_pauses(studies):
    notes = table(studies, "resumed", "notes")
    assert notes["kind"].tolist().count("consent") == 1
    [pause] = notes[notes["kind"] == "pause"].to_dict("records")
    assert (pause["note"], pause["segment"]) == ("quit_question", 1)


def test_marks_are_there_with_who_took_them_back(studies):
    marks = table(studies, "marked", "marks")
    assert marks["tag"].tolist() == ["exclude", "slow", "doubt", "doubt"]
    assert marks["episode"].fillna(0).tolist() == [2, 0, 1, 1]
    assert marks["taken_back"].tolist() == [False, False, False, True]
    assert marks["note"][0] == "the phone rang"


@pytest.mark.parametrize("study", STUDIES)
def test_keys_are_unique_and_nothing_is_orphaned(studies, study):
    keys = {name: key for name in TABLES if (key := find_primary_key(name))}
    for name, fields in keys.items():
        assert not table(studies, study, name).duplicated(list(fields)).any(), name
    for name in TABLES:
        parent = "episodes" if is_episode_table(name) else "participants"
        fields = list(keys[parent])
        rows, parents = table(studies, study, name), table(studies, study, parent)
        assert len(rows.merge(parents[fields], on=fields)) == len(rows), name


@pytest.mark.parametrize("study", ["resumed", "real-time"])
def test_four_readers_find_the_same_missing_values_and_types(studies, study):
    polars = pytest.importorskip("polars")
    for name in TABLES:
        path = studies / f"{study}-csv" / f"{name}.csv"
        if not path.exists():
            continue
        true = pq.read_table(studies / f"{study}-parquet" / f"{name}.parquet")
        assert true.num_rows  # tables without rows are not written
        missing = [column.null_count for column in true.columns]
        by_pandas = pd.read_csv(path)
        by_polars = polars.read_csv(path, infer_schema_length=None)
        by_duckdb = duckdb.read_csv(str(path), sample_size=-1)
        assert by_pandas.isna().sum().tolist() == missing, name
        assert [by_polars[column].null_count() for column in by_polars.columns] == missing, name
        nulls = ", ".join(f'count(*) - count("{column}")' for column in true.column_names)
        assert list(by_duckdb.aggregate(nulls).fetchall()[0]) == missing, name
        kinds = {column.name: column.kind for column in TABLES[name]}
        for place, column in enumerate(true.column_names):
            if missing[place] == true.num_rows:
                continue  # nothing to tell a type by
            if kinds[column] == "yes_no":
                assert by_polars[column].dtype == polars.Boolean, (name, column)
                assert str(by_duckdb.types[place]) == "BOOLEAN", (name, column)
                assert set(by_pandas[column].dropna()) <= {True, False}, (name, column)
            if kinds[column] == "key":
                assert by_polars[column].dtype == polars.String, (name, column)
                assert str(by_duckdb.types[place]) == "VARCHAR", (name, column)
                assert all(isinstance(key, str) for key in by_pandas[column].dropna()), (name, column)
    steps, presses = (
        polars.read_csv(studies / f"{study}-csv" / f"{name}.csv", infer_schema_length=None)
        for name in ("steps", "presses")
    )
    acted = steps.filter(polars.col("key").is_not_null())
    assert len(acted.join(presses, on=["episode", "attempt", "key"], how="semi")) == len(acted)


def test_a_missing_text_is_null_and_not_an_empty_one(studies):
    presses = f"{studies}/resumed-parquet/presses.parquet"
    asked = duckdb.sql(f"SELECT count(*), count(action), sum((action = '')::int) FROM '{presses}'").fetchall()[0]
    assert asked[0] > asked[1]
    assert asked[2] == 0
    raw = (studies / "resumed-csv/presses.csv").read_text()
    assert '""' not in raw
    assert '"TRUE"' in raw


def test_the_package_beside_the_tables_describes_every_column(studies):
    described = json.loads((studies / "resumed-csv/datapackage.json").read_text())
    with StudyStore(StudySessions(studies / "resumed"), with_shortest=True) as store:
        assert [one["name"] for one in described["resources"]] == [name for name in TABLES if store.tables.count(name)]
    for resource in described["resources"]:
        header = (studies / "resumed-csv" / resource["path"]).read_text().splitlines()[0]
        fields = resource["schema"]["fields"]
        assert [field["name"] for field in fields] == header.replace('"', "").split(",")
        assert all(field["description"] for field in fields)


def test_what_people_sat_at_is_a_column_to_compare_by(tmp_path):
    export_study("csv", study(tmp_path, bonus=""), tmp_path / "out", Selection())
    for name in ("participants", "segments"):
        assert set(pd.read_csv(tmp_path / "out" / f"{name}.csv")["window"]) == {"simulated"}
