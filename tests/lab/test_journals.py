"""Journals: what one process adds all others read, once and in order, in files and in a database alike."""

import multiprocessing
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from minihuman.admin.enrolment_entries import ParticipantWithdrawn, read_enrolled
from minihuman.admin.enrolment_log import record_departure, take_slot
from minihuman.admin.recruitment import PlatformId, Recruitment, hash_link_token
from minihuman.dataset.log_files import list_readable_logs
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate
from minihuman.storage.file_journal import FileJournal
from minihuman.storage.journal import Journal
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME, URL_FILE_NAME, find_database_url, open_journal
from minihuman.web.arrivals import Admission, Arrival, Arrivals
from tests.counts import count
from tests.lab.database import database, fresh
from tests.machine import needs
from tests.web.protocols import study

PROCESSES, EACH = count(4, 8), count(10, 200)


class Word(msgspec.Struct, frozen=True):
    word: str


def words(line: bytes, number: int) -> Word | None:
    try:
        return msgspec.json.decode(line, type=Word)
    except msgspec.DecodeError:
        return None


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    with database() as address:
        yield address


@pytest.fixture(params=["file", pytest.param("database", marks=[pytest.mark.program, needs("postgresql")])])
def data(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A data folder whose journals are files, or in a database of its own."""
    if request.param == "database":
        (tmp_path / URL_FILE_NAME).write_text(fresh(request.getfixturevalue("url")) + "\n")
    return tmp_path


@pytest.fixture
def two(data: Path) -> Iterator[tuple[Journal[Word], Journal[Word]]]:
    """One journal as two processes have it."""
    mine = open_journal(data / "talk", "said.jsonl", words)
    if isinstance(mine, FileJournal):
        yield mine, FileJournal(data / "talk" / "said.jsonl", words)
        return
    from minihuman.storage.postgres_journal import PostgresJournal

    assert isinstance(mine, PostgresJournal)
    with closing(mine), closing(PostgresJournal(find_database_url(data / "talk"), "talk/said.jsonl", words)) as yours:
        yield mine, yours


def say(one: Journal[Word], *said: str) -> None:
    with one.hold() as held:
        held.append(*map(Word, said))


def heard(one: Journal[Word]) -> list[str]:
    return [line.word for line in one.read()]


def test_what_one_adds_the_other_reads_on_from_where_it_was(two: tuple[Journal[Word], Journal[Word]]) -> None:
    mine, yours = two
    assert not mine.begun
    assert heard(mine) == []
    say(mine, "a", "b")
    assert heard(yours) == ["a", "b"]
    say(yours, "c")
    with mine.hold() as held:
        assert [line.word for line in held.lines] == ["a", "b", "c"]
        held.append(Word("d"))
        assert [line.word for line in held.lines] == ["a", "b", "c", "d"]
    assert heard(mine) == heard(yours) == ["a", "b", "c", "d"]
    assert yours.begun


def test_what_is_taken_out_is_gone_for_everybody(two: tuple[Journal[Word], Journal[Word]]) -> None:
    mine, yours = two
    say(mine, "a", "b", "c")
    assert heard(yours) == ["a", "b", "c"]
    mine.keep(lambda line: b'"b"' not in line)
    assert heard(yours) == heard(mine) == ["a", "c"]
    say(yours, "d")
    assert heard(mine) == ["a", "c", "d"]


def test_an_error_while_it_is_held_lets_it_go(two: tuple[Journal[Word], Journal[Word]]) -> None:
    mine, yours = two
    say(mine, "a")
    with pytest.raises(ValueError, match="nothing"), mine.hold():
        raise ValueError("nothing")
    say(yours, "b")
    assert heard(mine) == ["a", "b"]


def test_a_file_that_was_shortened_or_changed_is_read_anew(tmp_path: Path) -> None:
    path = tmp_path / "said.jsonl"
    mine = FileJournal(path, words)
    say(mine, "aa", "bb", "cc")
    assert heard(mine) == ["aa", "bb", "cc"]
    path.write_bytes(path.read_bytes().splitlines(keepends=True)[0])
    assert heard(mine) == ["aa"]
    say(mine, "dd")
    path.write_bytes(path.read_bytes().replace(b"dd", b"xx"))
    assert heard(mine) == ["aa", "xx"]
    path.unlink()
    assert heard(mine) == []


def test_half_a_line_of_a_crash_is_passed_over_and_what_follows_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "said.jsonl"
    mine = FileJournal(path, words)
    say(mine, "a")
    with path.open("ab") as file:
        file.write(b'{"word":"ha')
    assert heard(mine) == ["a"]
    say(mine, "b")
    assert heard(mine) == heard(FileJournal(path, words)) == ["a", "b"]


def test_what_is_read_once_is_not_decoded_again(tmp_path: Path) -> None:
    decoded = []

    def counting(line: bytes, number: int) -> Word | None:
        decoded.append(number)
        return words(line, number)

    mine = FileJournal(tmp_path / "said.jsonl", counting)
    for _ in range(5):
        say(mine, "a")
    mine.read()
    assert decoded == [1, 2, 3, 4, 5]


def test_a_database_that_is_away_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / URL_FILE_NAME).write_text(f"postgresql:///none?host={tmp_path}")
    with pytest.raises(OSError, match=r"the database of s/register\.jsonl cannot be queried") as refused:
        open_journal(tmp_path / "s", ENROLMENT_FILE_NAME, words).read()
    assert "\n" not in str(refused.value)


def test_who_withdrew_by_the_register_is_in_nothing_that_is_read(data: Path) -> None:
    protocol = the_protocol(data)
    list(simulate(protocol, data, participants=2, seed=1, player="random"))
    folder = data / protocol.study.name
    record_departure(
        folder, ParticipantWithdrawn("sub-01", "2026-09-21T12:00:00Z", "erased")
    )  # on another machine: the log is still here
    assert [path.parent.parent.name for path in list_readable_logs(folder)[0]] == ["sub-02"]


def test_a_study_that_has_begun_in_files_goes_on_in_files(tmp_path: Path) -> None:
    protocol = the_protocol(tmp_path)
    begun = tmp_path / protocol.study.name
    (token,) = Recruitment(tmp_path / "offered").issue(1)
    take_slot(protocol, begun)
    record_departure(begun, ParticipantWithdrawn("sub-01", "2026-09-21T12:00:00Z", "erased"))
    (tmp_path / URL_FILE_NAME).write_text(f"postgresql:///none?host={tmp_path}")  # for another study
    assert take_slot(protocol, begun)[0].id == "sub-100001"
    assert [line.participant for line in read_enrolled(begun)] == ["sub-100001"]
    assert hash_link_token(token) in Recruitment(tmp_path / "offered").standing().issued
    assert find_database_url(tmp_path / "another")


def the_protocol(folder: Path):
    return decode_protocol(
        study(folder, web='image_size_px = [96, 96]\nrecruitment_platforms = ["prolific"]').read_bytes()
    )


@pytest.mark.nightly(by_day=["file"])
@pytest.mark.program
def test_no_slot_is_given_twice_by_many_processes(data: Path) -> None:
    many = max(500, PROCESSES * EACH)
    spawn = multiprocessing.get_context("spawn")
    for number in range(PROCESSES):
        (data / f"process-{number}").mkdir()
    workers = [spawn.Process(target=allocate_in, args=(str(data), number, EACH, many)) for number in range(PROCESSES)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert [worker.exitcode for worker in workers] == [0] * PROCESSES
    indices = [line.index for line in read_enrolled(data / "tried")]
    assert sorted(indices) == list(range(PROCESSES * EACH))
    assert len({line.participant for line in read_enrolled(data / "tried")}) == PROCESSES * EACH


def allocate_in(folder: str, number: int, each: int, many: int) -> None:
    data = Path(folder)
    path = study(data / f"process-{number}")
    protocol = decode_protocol(path.read_bytes().replace(b"participants = 500", f"participants = {many}".encode()))
    for _ in range(each):
        take_slot(protocol, data / protocol.study.name)


def test_people_come_go_and_are_forgotten_wherever_the_register_is(data: Path) -> None:
    protocol = the_protocol(data)
    here, there = Arrivals(protocol, data), Arrivals(protocol, data)
    first, second = here.recruits.issue(2)
    by_link, again = here.arrive(Arrival(first)), there.arrive(Arrival(first))
    assert isinstance(by_link, Admission)
    assert isinstance(again, Admission)
    assert by_link.participant == again.participant == "sub-01"
    person = Arrival("", {"PROLIFIC_PID": "5f2a"})
    from_platform = there.arrive(person)
    assert isinstance(from_platform, Admission)
    assert here.recruits.ids() == {from_platform.participant: PlatformId(from_platform.participant, "prolific", "5f2a")}
    assert Recruitment(data / "tried").hash_platform_id("prolific", "x") == here.recruits.hash_platform_id(
        "prolific", "x"
    )
    there.decline(from_platform, "declined")
    assert here.recruits.ids() == {}
    reused = here.arrive(Arrival(second))
    assert isinstance(reused, Admission)
    assert reused.participant == "sub-02"
    record_departure(data / "tried", ParticipantWithdrawn("sub-01", "now", "erased"))
    assert [line.participant for line in read_enrolled(data / "tried")] == ["sub-02"]


@pytest.mark.program
def test_reading_on_after_the_last_answer_for_longer_than_a_call_may_take_costs_no_later_call_its_answer(
    url: str,
) -> None:
    """As a server does that decodes 200,000 lines on a busy machine: the connection was cut off meanwhile."""
    from minihuman.storage.database import Database

    slow = Database(fresh(url), "select 1", "a test", timeout_s=3.0)
    with slow.open_cursor() as cursor:
        assert cursor.execute("select 7").fetchone() == (7,)
        time.sleep(4.0)
    with slow.open_cursor() as cursor:
        assert cursor.execute("select 8").fetchone() == (8,)
    slow.close()
