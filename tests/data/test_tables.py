"""The tidy tables: what is in a row, and what is left out."""

import dataclasses
import json
import math

import duckdb
import msgspec
import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from minihuman.dataset.annotations import Annotation
from minihuman.dataset.rows import arrow_columns, arrow_schema
from minihuman.dataset.selection import NOT_FINISHED, Selection, SelectionSummary, read_exclusion_rules
from minihuman.dataset.session_measures import SessionMeasures
from minihuman.dataset.session_tables import build_activity_rows, build_session_tables
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_columns import is_time
from minihuman.dataset.table_database import TableDatabase
from minihuman.dataset.table_files import write_tables
from minihuman.errors import ReportError
from minihuman.experiment.machine.events import Answered
from minihuman.worlds.contract import PathLengthBounds
from tests.builders import made, plan, session, session_of
from tests.counts import count

EVERY = Selection()


PROTOCOL = """
[study]
name = "x"
version = "1"
seed = 1
participants = 2
[[groups]]
name = "a"
blocks = ["b"]
[[blocks]]
name = "b"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 10
"""


def twenty(_plan) -> PathLengthBounds:
    return PathLengthBounds(20, 25)


def tabled(log, *, marks=(), selection=EVERY):
    measured = SessionMeasures.of(log, twenty)
    return build_session_tables(selection.judge(log, measured=measured, marks=marks), measured)


def rows_of(log, **how):
    return {name: _said(table.to_pandas(), name) for name, table in tabled(log, **how).items()}


def _said(frame, name):
    """Texts as they were said: "" where a table has NULL, keys by their own names; times in microseconds."""
    for column in TABLES[name]:
        if is_time(column):
            frame[column.name] = pd.to_datetime(frame[column.name], utc=True).astype("datetime64[us, UTC]")
        elif column.kind in ("text", "key"):
            frame[column.name] = frame[column.name].fillna("").str.removeprefix("key_")
    return frame


@pytest.fixture(scope="module")
def log():
    return session(episodes=3)


@pytest.fixture(scope="module")
def tables(log):
    return rows_of(log)


def test_every_step_is_a_row(log, tables):
    steps = tables["steps"]
    assert len(steps) == sum(len(episode.actions) for episode in log.episodes)
    second = log.episodes[1]
    mine = steps[steps["episode"] == 2]
    assert mine["step"].tolist() == list(range(1, len(second.actions) + 1))
    assert mine["x"].tolist() == second.poses[1:, 0].tolist()
    assert mine["reaction_ms"].tolist() == second.rt_ms.tolist()
    assert mine["action"].tolist() == [second.start.action_names[action] for action in second.actions]
    assert mine["t_s"].tolist() == (second.t_ns[1:] / 1e9).tolist()
    assert mine["key"].tolist() == list(second.step_keys)
    assert mine["reward"].tolist() == second.rewards.tolist()
    assert mine["visible_effect"].tolist() == (np.diff(second.observation_hashes) != 0).tolist()
    assert mine["z"].tolist() == second.poses[1:, 2].tolist()
    assert mine["yaw_rad"].tolist() == second.poses[1:, 3].tolist()
    assert mine["terminated"].tolist() == second.terminated.tolist()
    assert mine["truncated"].tolist() == second.truncated.tolist()
    whose = mine[["study", "participant", "group", "session", "block", "attempt"]].drop_duplicates()
    assert whose.to_numpy().tolist() == [["transfer", "sub-01", "grid_first", 1, "grid", 1]]
    assert set(steps.columns) == {column.name for column in TABLES["steps"]}


def test_every_key_press_is_a_row(log, tables):
    presses = tables["presses"]
    assert presses["key"].tolist() == [press.key for episode in log.episodes for press in episode.keys]
    assert set(presses["verdict"]) == {"accepted"}


def test_an_episode_says_how_it_went_and_how_short_it_could_have_been(log, tables):
    goal, timeout = tables["episodes"].iloc[0], tables["episodes"].iloc[1]
    assert (goal["outcome"], bool(goal["success"])) == ("goal", True)
    assert goal["reward"] == log.episodes[0].return_
    excess = len(log.episodes[0].actions) - 25  # of the way that is known, not of the bound
    assert goal["excess_steps"] == excess
    assert goal["log_excess_steps"] == pytest.approx(np.log1p(excess))
    assert goal["log_steps_ratio"] == pytest.approx(np.log(1 + excess / 25))
    assert goal["spl"] == pytest.approx(25 / len(log.episodes[0].actions))
    assert (timeout["outcome"], bool(timeout["success"])) == ("timeout", False)
    assert np.isnan(timeout["excess_steps"])
    assert timeout["log_excess_steps"] == pytest.approx(np.log1p(timeout["max_steps"] - 25))
    assert timeout["log_steps_ratio"] == pytest.approx(np.log(timeout["max_steps"] / 25))
    assert timeout["spl"] == 0


def test_blocks_and_participants_sum_their_episodes_up(log, tables):
    block = tables["blocks"].set_index("block").loc["room"]
    rewards = [episode.return_ for episode in log.episodes if episode.plan.block_name == "room"]
    assert block["reward_mean"] == pytest.approx(np.mean(rewards))
    assert block["reward_sd"] == pytest.approx(np.std(rewards, ddof=1))
    person = tables["participants"].iloc[0]
    assert (person["episodes"], person["success"]) == (6, pytest.approx(5 / 6))
    times = np.concatenate([episode.rt_ms for episode in log.episodes])
    assert person["reaction_median_ms"] == pytest.approx(np.median(times))


def test_an_episode_begun_again_is_told_apart_and_the_broken_one_does_not_count(log):
    broken = dataclasses.replace(log.episodes[0], outcome="abandoned")
    tables = rows_of(session_of([broken, dataclasses.replace(log.episodes[0], attempt=2)]))
    assert tables["episodes"]["attempt"].tolist() == [1, 2]
    assert tables["episodes"]["exclusion_reason"].tolist() == [NOT_FINISHED, ""]
    assert tables["participants"]["episodes"].tolist() == [1]


def test_nothing_is_said_of_turns_where_the_world_tells_no_pose():
    blind = made(plan(), [(math.nan,) * 4] * 3, [0, 1], None)
    row = rows_of(session_of([blind]))["episodes"].iloc[0]
    assert pd.isna([row["path_length"], row["path_efficiency"], row["turns_in_place"]]).all()
    assert row["steps"] == 2


def test_keys_that_were_found_in_a_broken_off_attempt_were_found_then(log):
    whole = rows_of(session_of(log.episodes[:1]))
    broken = dataclasses.replace(log.episodes[0], outcome=None)
    walked = log.episodes[2]
    again = dataclasses.replace(walked, attempt=2, start=dataclasses.replace(walked.start, plan=broken.plan))
    tables = rows_of(session_of([broken, again]))
    for name in ("blocks", "participants"):
        assert tables[name]["all_keys_discovered_s"].tolist() == whole[name]["all_keys_discovered_s"].tolist()
        assert tables[name]["all_keys_discovered_s"].tolist() == [whole["keys"]["discovered_s"].max()]
        assert tables[name]["episodes"].tolist() == [1]
    some = rows_of(session_of(log.episodes[:3]), selection=Selection(outcome=("timeout",)))
    assert len(some["episodes"]) == 1
    assert some["keys"]["first_episode"].unique().tolist() == [1]
    assert some["keys"]["discovered_s"].tolist() == pytest.approx(whole["keys"]["discovered_s"].tolist(), nan_ok=True)


@pytest.mark.parametrize(
    ("selection", "expected"),
    [
        (Selection(), ["", "tagged exclude", ""]),
        (Selection(with_=("exclude",)), ["", "", ""]),
        (Selection(only=("exclude",), with_=("exclude",)), [""]),
        (Selection(only=("exclude",)), ["tagged exclude"]),
    ],
)
def test_tags_choose_the_episodes_that_count(log, selection, expected):
    marks = [Annotation("exclude", "2026-01-06T10:00:00Z", episode=2)]
    tables = rows_of(session_of(log.episodes[:3]), marks=marks, selection=selection)
    assert tables["episodes"]["exclusion_reason"].tolist() == expected
    assert tables["participants"]["episodes"].tolist() == [expected.count("")]


def with_rules(log, rules):
    toml = PROTOCOL + "".join(
        f'[[exclusions]]\nreason = "{reason}"\nlevel = "{level}"\nmeasure = "{measure}"\n{bound}\n'
        for reason, level, measure, bound in rules
    )
    return dataclasses.replace(log, plan=msgspec.structs.replace(log.plan, protocol_toml=toml.encode()))


def test_the_protocols_rules_leave_out_episodes_and_participants(log):
    slow = ("too slow", "episode", "steps", f"above = {len(log.episodes[0].actions) - 1}")
    lost = ("never got there", "participant", "success", "below = 0.99")
    tables = rows_of(with_rules(session_of(log.episodes[:3]), [slow]))
    assert tables["episodes"]["exclusion_reason"].tolist()[0] == "too slow"
    tables = rows_of(with_rules(session_of(log.episodes[:3]), [slow, lost]))
    for name in ("episodes", "blocks", "participants"):
        assert set(tables[name]["exclusion_reason"]) == {"never got there"}


def test_whom_a_rule_leaves_out_before_their_first_episode_is_in_the_account(log):
    gone = with_rules(
        dataclasses.replace(log, episodes=()), [("went home", "participant", "completed_share", "below = 0.5")]
    )
    account = SelectionSummary()
    account.take(Selection().judge(gone))
    assert list(account.lines()) == ["0 episodes of 0 sessions included", "excluded: 1 participant: went home"]
    account = SelectionSummary()
    account.take(Selection(block=("room",)).judge(gone))
    assert list(account.lines()) == ["0 episodes of 0 sessions included"]


def test_a_rule_is_judged_by_the_whole_session_whatever_part_is_asked_for(log):
    lost = ("never got there", "participant", "success", "below = 0.9")
    asked = Selection(block=("room",))  # in which everybody got there
    counted = asked.judge(with_rules(log, [lost]))
    assert counted.session_reason == "never got there"
    assert not counted.episodes


def test_who_is_exactly_at_a_rules_limit_is_kept(log):
    steps = len(log.episodes[0].actions)
    first = session_of(log.episodes[:1])
    for limit in ("below", "above"):
        exact, beyond = (
            rows_of(with_rules(first, [("out of bounds", "episode", "steps", f"{limit} = {number}")]))
            for number in (steps, steps + 0.5 if limit == "below" else steps - 0.5)
        )
        assert exact["episodes"]["exclusion_reason"].tolist() == [""]
        assert beyond["episodes"]["exclusion_reason"].tolist() == ["out of bounds"]


def test_answer_times_count_from_when_the_question_was_shown(log):
    answer = Answered(1_900_000_000, 0, "all", "age", "number", 1, "30", "30", 1_000_000_000, 1_400_000_000, 2, None)
    untouched = dataclasses.replace(answer, item="mood", first_ns=0, changes=0)
    unseen = dataclasses.replace(answer, item="load", shown_ns=0)
    segment = dataclasses.replace(log.segments[0], part_events=(answer, untouched, unseen))
    rows = build_activity_rows(dataclasses.replace(log, segments=(segment,)), {})["answers"].columns
    assert list(rows["item"]) == ["age", "mood", "load"]
    assert list(rows["first_ms"]) == [400.0, None, None]
    assert list(rows["answer_ms"]) == [900.0, 900.0, None]


def test_a_rule_about_a_column_that_is_not_there_is_refused(log):
    with pytest.raises(ReportError, match=r"\[0\]\.measure: 'yawns' is not a measure of an episode; use .*steps"):
        read_exclusion_rules(with_rules(log, [("too tired", "episode", "yawns", "above = 3")]).plan)


def test_parquet_csv_pandas_and_duckdb_agree_and_every_column_is_explained(log, tables, tmp_path):
    made = tabled(log)
    with TableDatabase(tmp_path / "one.duckdb") as kept:
        kept.insert([(1, made), (2, made)])
        paths = write_tables(kept, tmp_path, empty=True)
    explained = json.loads((tmp_path / "dictionary.json").read_text())
    assert {path.name for path in paths} >= {"steps.parquet", "participants.csv", "dictionary.json"}
    for name in TABLES:
        frame = pd.read_parquet(tmp_path / f"{name}.parquet")
        assert list(frame.columns) == list(explained[name])
        assert all(entry["meaning"] for entry in explained[name].values())
        again = pd.concat([tables[name]] * 2, ignore_index=True)
        pd.testing.assert_frame_equal(_said(frame.copy(), name), again, check_dtype=len(frame) > 0)
        csv = pd.read_csv(tmp_path / f"{name}.csv", keep_default_na=False, na_values={"reaction_ms": [""]}, nrows=5)
        assert list(csv.columns) == list(frame.columns)
        queried = duckdb.sql(f"SELECT * FROM '{tmp_path / name}.parquet'").df()
        pd.testing.assert_frame_equal(_said(queried, name), _said(frame, name), check_dtype=False)
    steps = pd.read_csv(tmp_path / "steps.csv", dtype={"x": str})  # pandas 2 loses a float's last bit
    assert [float(x) for x in steps["x"]] == pd.read_parquet(tmp_path / "steps.parquet")["x"].tolist()


def test_several_sessions_rows_together_are_each_ones_in_turn(log):
    """What is missing, whole, yes or no and text alike; a session without an episode among them."""
    without = dataclasses.replace(log, episodes=())
    made = [tabled(one) for one in (log, without, log)]
    for name, columns in TABLES.items():
        table = put_together(name, made)
        table.validate(full=True)
        rows = [row for one in made for row in one[name].to_pylist()]
        assert table.to_pylist() == rows
        assert len(rows) == sum(one.count(name) for one in made)
        assert set(table.column_names) == {column.name for column in columns}
    assert put_together("episodes", made).column("excess_steps").null_count == 2
    assert put_together("steps", []).num_rows == 0


def put_together(name, sessions):
    schema = arrow_schema(name)
    columns = arrow_columns(name, [one.parts[name] for one in sessions])
    texts = [pa.types.is_dictionary(column.type) for column in columns]
    assert texts == [pa.types.is_string(kind) for kind in schema.types]
    return pa.Table.from_arrays(
        [column.cast(kind) for column, kind in zip(columns, schema.types, strict=True)], schema=schema
    )


def test_a_number_that_does_not_fit_is_no_other_number(log):
    plan = msgspec.structs.replace(log.episodes[0].plan, seed=2**63)
    start = dataclasses.replace(log.episodes[0].start, plan=plan)
    rows = tabled(session_of([dataclasses.replace(log.episodes[0], start=start)]))
    with pytest.raises(OverflowError):
        rows["episodes"]


def test_units_are_in_the_dictionary():
    units = {column.name: column.unit for columns in TABLES.values() for column in columns}
    assert (units["reaction_ms"], units["playing_s"], units["yaw_rad"]) == ("ms", "s", "rad")
    for columns in TABLES.values():
        for column in columns:
            for ending, unit in (("_ms", "ms"), ("_s", "s"), ("_rad", "rad")):
                assert not column.name.endswith(ending) or column.unit == unit


@pytest.mark.nightly
def test_many_sessions_take_no_more_memory_than_a_few(log, tmp_path):
    made = tabled(session())

    def highest(sessions: int) -> int:
        held = []
        with TableDatabase(tmp_path / f"of-{sessions}.duckdb") as kept:
            for number in range(sessions):
                kept.insert([(number, made)])
                held.append(pa.total_allocated_bytes())
            write_tables(kept, tmp_path / str(sessions))
        held.append(pa.total_allocated_bytes())
        return max(held)

    assert highest(count(160, 1_000)) < 1.2 * highest(80) + 1_000_000
