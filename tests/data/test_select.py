"""One selection to tables: the store is opened once, in the order of the logs, and left to others when it is read."""

from pathlib import Path

import pytest

from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.table_database import TableDatabase
from minihuman.dataset.tables import select
from tests.builders import session, write_log


@pytest.fixture
def study(tmp_path: Path) -> Path:
    """A study whose cache took the second participant first."""
    write_log(session(participant="sub-02", index=2, episodes=1, blocks=("grid",)), tmp_path)
    with select(tmp_path / "transfer", processes=1) as tables:
        assert tables.count("participants") == 1
    write_log(session(participant="sub-01", index=1, episodes=2, blocks=("grid",)), tmp_path)
    return tmp_path / "transfer"


def test_tables_are_in_the_order_of_the_logs_before_and_after_a_query(study):
    with select(study, processes=1) as tables:
        before = tables.frame("episodes")
        numbers = tables.query("SELECT count(*) AS n FROM episodes").to_pylist()
        after = tables.frame("episodes")
    assert before["participant"].tolist() == ["sub-01", "sub-01", "sub-02"]
    assert after.equals(before)
    assert numbers == [{"n": 3}]


def test_the_account_names_what_is_selected(study):
    with select(study, Selection(participant=("sub-01",)), processes=1) as tables:
        assert [session.outline.participant for session in tables.sessions if session.outline] == ["sub-01"]
    assert list(tables.account.lines()) == ["2 episodes of 1 session included (--participant sub-01)"]


def test_shortest_paths_that_were_not_required_at_first_are_refused(study):
    with select(study, processes=1) as tables:
        tables.require(("episodes",))
        with pytest.raises(AssertionError, match="opened without shortest paths"):
            tables.require(("episodes",), shortest_paths=True)


def test_a_table_that_was_not_required_is_refused(study):
    with select(study, processes=1) as tables:
        tables.require(("episodes",))
        with pytest.raises(AssertionError, match="not opened for steps"):
            tables.frame("steps")


def test_sessions_are_not_counted_a_second_time_beside_the_store(study):
    with select(study, processes=1) as tables:
        tables.require(("episodes",))
        with pytest.raises(AssertionError, match="has filled the account"):
            tables.read_sessions()


def test_a_released_store_may_be_written_by_others_and_names_its_sessions_still(study):
    with select(study, processes=1) as tables:
        tables.require(("episodes",))
        tables.release()
        TableDatabase(study / TABLE_CACHE).close()
        assert [tables.read_session(known).session.plan.participant.id for known in tables.sessions] == [
            "sub-01",
            "sub-02",
        ]


def test_tables_in_a_temporary_file_are_read_after_their_release(study):
    with select(study, Selection(block=("grid",)), processes=1) as tables:
        rows = tables.frame("episodes")
        tables.release()
        assert tables.frame("episodes").equals(rows)


def test_an_exporter_that_asks_for_the_store_gets_it_with_a_warning(study):
    with pytest.warns(DeprecationWarning, match=r"is now IncludedEpisodes\.tables"):
        store = IncludedEpisodes(StudySessions(study, processes=1)).store()
    with store:
        assert store.tables.count("episodes") == 3


def test_an_exporter_that_uses_the_old_names_of_the_selection_gets_it_with_a_warning(study):
    logs = []
    sessions = StudySessions(study, processes=1)
    with pytest.warns(DeprecationWarning, match=r"is now IncludedEpisodes\(on_included=...\)"):
        included = IncludedEpisodes(sessions, taken=lambda log, facts: logs.append(log))
    session = next(included.counted())
    assert logs
    with pytest.warns(DeprecationWarning, match=r"is now SelectedSession\.selected"):
        assert session.asked == session.selected
    with pytest.warns(DeprecationWarning, match=r"is now SelectedSession\.is_selected"):
        assert session.wanted is session.is_selected
