"""A rule that a participant breaks in one session excludes them whole: every session, every output, once in a count."""

from pathlib import Path

import pandas as pd
import pytest

from minihuman.api import open_session
from minihuman.dataset.annotations import Annotation, add_annotation
from minihuman.dataset.selection import RULES, Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_catalogue import TABLES
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.exclusions import PRACTICE_ALONE, exclude_practice_alone, list_exclusions
from minihuman.reporting.participant_flow import flow_section
from minihuman.reporting.sections import exclusions_section
from minihuman.runtime.simulated_session import simulate
from tests.study.studies import two_days

TOO_FEW = """
[[exclusions]]
reason = "too few"
level = "participant"
measure = "episodes"
below = 2
"""
TWO_DAYS = decode_protocol(
    (two_days("tests.worlds.corridor:tests/Corridor-v0", ["back", "forward", "dive"]) + TOO_FEW).encode()
)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    list(simulate(TWO_DAYS, tmp_path, participants=2, seed=1, player="random"))
    folder = tmp_path / "days"
    with StudyStore(StudySessions(folder), with_shortest=False):
        pass  # the cache has every row before the annotation of session 2
    (second,) = (folder / "sub-01" / "ses-02").glob("*.mcap")
    add_annotation(read_log(second), Annotation("exclude", "2026-11-22T09:00:00Z", episode=1))
    return folder


def test_both_sessions_of_the_participant_are_excluded_whether_the_cache_is_used_or_not(study: Path) -> None:
    counted = {(one.log.plan.participant.id, one.log.plan.session): len(one.places) for one in StudySessions(study)}
    assert counted == {("sub-01", 1): 0, ("sub-01", 2): 0, ("sub-02", 1): 2, ("sub-02", 2): 2}
    (alone,) = (study / "sub-01" / "ses-01").glob("*.mcap")
    assert len(open_session(alone)) == 0
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        people = store.tables.table("participants", ["participant", "exclusion_reason"]).to_pydict()
    assert people["exclusion_reason"] == ["too few", "too few", None, None]


def test_the_participant_is_counted_once_with_and_without_the_cache(study: Path) -> None:
    lines = ["4 episodes of 2 sessions included", "excluded: 1 participant: too few"]
    sessions = StudySessions(study)
    list(sessions)
    assert list(sessions.account.lines()) == lines
    for _ in ("read", "kept"):
        with StudyStore(kept := StudySessions(study), with_shortest=False):
            assert list(kept.account.lines()) == lines


def test_without_the_rules_the_other_session_counts(study: Path) -> None:
    counted = [len(one.places) for one in StudySessions(study, Selection(with_=(RULES,)))]
    assert counted == [2, 1, 2, 2]


def test_the_rows_of_the_flow_and_of_what_was_left_out_add_up(study: Path) -> None:
    with StudyStore(StudySessions(study), with_shortest=False) as store:
        tables = {name: store.tables.table(name).to_pandas() for name in ("participants", "episodes")}
    flow = flow_section(study, tables["participants"])
    assert flow is not None
    assert flow.table is not None
    for stage, count in (("allocated to a group", 2), ("excluded: too few", 1), ("included in this report", 1)):
        assert (stage, str(count), str(count)) in flow.table.rows
    rows: pd.DataFrame = list_exclusions(tables["episodes"], tables["participants"])
    excluded = exclusions_section(rows)
    assert excluded is not None
    assert ("too few", "participant", "1") in excluded.totals.rows


def test_a_session_without_an_episode_that_counts_takes_no_participant_out() -> None:
    nothing = "no episode counts"
    people = pd.DataFrame(
        {
            "participant": ["sub-01", "sub-01", "sub-02", "sub-03", "sub-03"],
            "session": [1, 2, 1, 1, 2],
            "exclusion_reason": [None, nothing, None, nothing, nothing],
        }
    )
    columns = ["exclusion_reason", "participant", "session", "episode", "attempt"]
    excluded = exclusions_section(list_exclusions(pd.DataFrame([], columns=columns), people))
    assert excluded is not None
    assert list(excluded.totals.rows) == [(nothing, "participant", "1"), (nothing, "session", "1")]


def test_who_played_practice_alone_is_not_included() -> None:
    people = pd.DataFrame(
        {
            "participant": ["practised", "came twice", "came twice", "had nothing to play", "broke a rule"],
            "episodes": [0, 0, 3, 0, 0],
            "completed_share": [0.1, 1.0, 1.0, None, 0.5],
            "exclusion_reason": [None, None, None, None, "idle"],
        }
    )
    reasons = exclude_practice_alone(people)["exclusion_reason"]
    assert reasons.fillna("").tolist() == [PRACTICE_ALONE, "", "", "", "idle"]


def test_path_measures_that_are_filled_in_later_are_those_of_the_logs_where_a_participant_is_excluded(
    study: Path,
) -> None:
    with StudyStore(StudySessions(study), with_shortest=False):
        pass
    found = []
    for from_logs in (False, True):
        with StudyStore(StudySessions(study, from_logs=from_logs), with_shortest=True) as store:
            found.append({name: store.tables.table(name).to_pylist() for name in TABLES})
    assert found[0] == found[1]
    assert {row["participant"] for row in found[0]["blocks"] if row["exclusion_reason"]} == {"sub-01"}
