"""People at a server: consent first, ends and codes, who does not come back, the experimenter's wishes, privacy."""

import asyncio
import os
import random
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.recruitment import IDS_FILE_NAME
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import find_leftovers
from minihuman.runtime.session_loop import CommandRequest, inbox_path, send_command
from tests.counts import PATIENCE_S
from tests.web import typed_page
from tests.web.served import Served, served
from tests.web.typed_page import TypedPage

pytestmark = pytest.mark.program
PERSON = "5f2b8a1c9d3e4f5061728394"
CODES = 'codes = { complete = "C1", declined = "D2", screened_out = "S3", timed_out = "T4" }'
REDIRECT = 'redirect = "https://app.prolific.com/submissions/complete?cc={code}"'


def page(server: Served, number: int = 0, **more) -> TypedPage:
    token = server.links[number] if number < len(server.links) else ""
    return TypedPage(server.host, token, keys_per_s=15, rng=random.Random(number), **more)


def takes_part(one: TypedPage, within_s: float = PATIENCE_S):
    return asyncio.run(asyncio.wait_for(one.take_part(), within_s))


def data(server: Served) -> Path:
    return server.said.parent / "data" / "walk"


def files(server: Served) -> list[str]:
    return sorted(path.name for path in data(server).rglob("*") if path.is_file())


@contextmanager
def at_a_stand(server: Served) -> Iterator[None]:
    """Nothing happens in the server meanwhile: a file that is missing for a moment is not made anew."""
    server.process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, server.process.pid, os.WSTOPPED)
    yield
    server.process.send_signal(signal.SIGCONT)


def the_log(server: Served):
    (path,) = data(server).rglob("*.mcap")
    return read_log(path)


def test_a_whole_session_ends_with_a_code_when_the_log_is_on_the_disk(tmp_path):
    with served(tmp_path, web=f"{CODES}\n{REDIRECT}") as server:
        one = page(server)
        counts = takes_part(one)
        assert counts.over == "complete"
        assert (one.told["code"], one.told["url"]) == ("C1", "https://app.prolific.com/submissions/complete?cc=C1")
        log = the_log(server)  # there already, though the server still runs
        assert log.end_reason == "complete"
        assert verify_episodes(log).difference == ""
        pressed = [event.key for event in read_events(log.path) if isinstance(event, KeyPressed) and event.down]
        assert len(pressed) - pressed.count("enter") == counts.presses
        again = page(server)
        assert takes_part(again).over == "complete"  # whoever loads the page again is told the same
        assert again.told["code"] == "C1"
        server.process.terminate()
        server.process.wait(timeout=PATIENCE_S)
    with served(tmp_path, web=f"{CODES}\n{REDIRECT}", links=0) as anew:
        again = TypedPage(anew.host, server.links[0])
        assert takes_part(again).refused == "complete"  # and so by a server that was started anew
        assert again.told["words"].endswith("Your code: C1")
        assert again.told["url"] == "https://app.prolific.com/submissions/complete?cc=C1"


TWO_DAYS = """
[[blocks]]
name = "again"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 1
max_steps = 5
actions = ["left", "right", "forward"]
[[sessions]]
name = "one"
parts = ["walk"]
completion_code = "DAY1"
[[sessions]]
name = "two"
parts = ["again"]
days_after_previous = [1, 2]
completion_code = "DAY2"
"""


def test_each_day_has_a_code_of_its_own_and_it_is_told_again_by_a_server_that_was_started_anew(tmp_path):
    with served(tmp_path, web=f"{CODES}\n{REDIRECT}", parts="", more=TWO_DAYS) as server:
        one = page(server)
        assert takes_part(one).over == "complete"
        assert (one.told["code"], one.told["url"][-4:]) == ("DAY1", "DAY1")
        token = server.links[0]
    with served(tmp_path, web=f"{CODES}\n{REDIRECT}", parts="", more=TWO_DAYS, links=0) as anew:
        again = TypedPage(anew.host, token)
        assert takes_part(again).refused == "not_today"
        assert "not open yet" in again.told["words"]
        assert again.told["words"].endswith("Your code: DAY1")
        assert again.told["url"].endswith("DAY1")


def test_who_has_only_a_touch_screen_is_told_so_where_a_keyboard_is_required(tmp_path, monkeypatch):
    monkeypatch.setattr(typed_page, "FACTS", {**typed_page.FACTS, "mouse": False, "touch": True})
    with served(tmp_path, web=CODES) as server:
        one = page(server)
        assert takes_part(one, within_s=60).refused == "keyboard"
        assert one.told["words"].endswith("Your code: S3")


def test_nothing_is_written_before_the_consent_and_who_declines_leaves_nothing(tmp_path):
    with served(tmp_path, web=CODES) as server:
        one = page(server, platform={"PROLIFIC_PID": PERSON})
        one._token = ""
        one.declines = True
        assert takes_part(one).over == "declined"
        assert one.told["code"] == "D2"
        assert not list(data(server).glob("sub-*"))
        assert not any(PERSON.encode() in path.read_bytes() for path in data(server).rglob("*") if path.is_file())
        assert read_enrolled(data(server)) == ()


def test_who_comes_after_somebody_declined_gets_the_slot_and_not_their_goodbye(tmp_path):
    with served(tmp_path, links=2, web=CODES) as server:
        first, second, again = page(server, 0), page(server, 1), page(server, 0)
        first.declines = True
        assert takes_part(first).over == "declined"
        assert (takes_part(second).over, second.told["code"]) == ("complete", "C1")
        assert (takes_part(again).over, again.told["code"]) == ("declined", "D2"), "their own page loaded again"
        assert the_log(server).plan.participant.id == "sub-01"


def test_who_reads_the_consent_is_in_no_file_yet(tmp_path):
    async def reads(one: TypedPage) -> list[str]:
        reading = asyncio.create_task(one.take_part())
        while not one.screen:
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
        found = files(server)
        reading.cancel()
        await asyncio.gather(reading, return_exceptions=True)
        return found

    with served(tmp_path) as server:
        one = page(server)
        one.idle = True
        assert asyncio.run(reads(one)) == ["arrivals.jsonl", "register.jsonl"]


def test_who_presses_nothing_for_long_is_timed_out_with_a_code_of_its_own(tmp_path):
    with served(tmp_path, web=f"idle_timeout_s = 3\n{CODES}", episodes=50) as server:
        one = page(server, most_presses=8)
        takes_part(one)
        quiet = page(server)
        quiet.idle = True
        assert takes_part(quiet).over == "timed_out"
        assert quiet.told["code"] == "T4"
        assert the_log(server).end_reason == "timed_out"


def test_who_does_not_come_back_ends_as_connection_lost_and_can_go_on_even_so(tmp_path):
    with served(tmp_path, web="reconnect_timeout_s = 1", episodes=50) as server:
        takes_part(page(server, most_presses=8))
        deadline_s = time.monotonic() + PATIENCE_S
        while not list(data(server).rglob("*.mcap")):
            assert time.monotonic() < deadline_s
            time.sleep(0.2)
        assert the_log(server).end_reason == "connection_lost"


def test_the_experimenters_note_and_abort_reach_the_page_and_the_log(tmp_path):
    async def aborted(one: TypedPage):
        playing = asyncio.create_task(one.take_part())
        while one.counts.presses < 5:
            await asyncio.sleep(0.05)
        log = data(server) / "sub-01" / "ses-01" / "sub-01_ses-01.mcap"
        send_command(log, CommandRequest("note", "the phone rang"))
        send_command(log, CommandRequest("abort", "it burns"))
        assert inbox_path(log).exists()
        return await asyncio.wait_for(playing, PATIENCE_S)

    with served(tmp_path, episodes=50) as server:
        assert asyncio.run(aborted(page(server))).over == "quit"
        log = the_log(server)
        assert log.end_reason == "aborted"
        assert [note.text for note in log.notes if note.kind == "experimenter"] == [
            "note: the phone rang",
            "abort: it burns",
        ]
        assert verify_episodes(log).difference == ""


def test_who_does_not_fit_is_told_why_and_gets_a_code_back(tmp_path):
    with served(tmp_path, web=f'allowed_browsers = ["firefox"]\n{CODES}\n{REDIRECT}') as server:
        one = page(server)
        assert takes_part(one).refused == "browser"
        assert "firefox" in one.told["words"]
        assert "S3" in one.told["words"]
        assert one.told["url"] == "https://app.prolific.com/submissions/complete?cc=S3"
        assert one.told["leave"]
        assert not list(data(server).glob("sub-*"))


def test_no_file_says_where_somebody_sat_or_who_they_are(tmp_path):
    with served(tmp_path) as server:
        one = page(server, platform={"PROLIFIC_PID": PERSON, "SESSION_ID": "abc123session"})
        one._token = ""
        assert takes_part(one).over == "complete"
        holding = {path.name for path in server.said.parent.rglob("*") if path.is_file() and _tells(path.read_bytes())}
        assert holding == {IDS_FILE_NAME}
        assert "127.0.0.1" not in server.complaints()


def _tells(content: bytes) -> bool:
    """An address of a machine, an id, a session of the platform's, or a user agent."""
    private = (PERSON.encode(), b"abc123session", b"127.0.0.1", b"Mozilla", b"Python/", b"websockets/")
    return any(one in content for one in private)


def test_the_end_waits_for_a_register_that_is_away_and_is_told_when_it_is_back(tmp_path):
    async def ends(one: TypedPage, register: Path, away: Path, server: Served) -> str:
        playing = asyncio.create_task(one.take_part())
        while one.counts.presses < 5:
            await asyncio.sleep(0.05)
        with at_a_stand(server):
            register.rename(away)
            register.mkdir()  # whoever reads or writes it fails
        while not list(register.parent.rglob("*.mcap")):
            await asyncio.sleep(0.05)
        await asyncio.sleep(2.5)  # it is tried again every second
        early = one.counts.over
        with at_a_stand(server):
            register.rmdir()
            away.rename(register)
        await asyncio.wait_for(playing, PATIENCE_S)
        return early

    with served(tmp_path, web=CODES, episodes=2) as server:
        one = page(server)
        register = data(server) / "register.jsonl"
        assert asyncio.run(asyncio.wait_for(ends(one, register, tmp_path / "away.jsonl", server), PATIENCE_S)) == ""
        assert (one.counts.over, one.told["code"]) == ("complete", "C1")
        assert '"sealed"' in register.read_text()
        assert "Traceback" not in server.complaints()


def test_a_full_disk_ends_the_session_and_says_so_and_what_was_written_is_kept(tmp_path):
    shell = ("bash", "-c", 'trap "" XFSZ; ulimit -f 200; exec "$@"', "limited")
    with served(tmp_path, episodes=500, before=shell) as server:
        one = page(server)
        assert takes_part(one).over == "broken"
        assert "Traceback" not in server.complaints()
    parts = find_leftovers(data(server))
    logs = [read_log(path) for path in (*parts, *data(server).rglob("*.mcap"))]
    assert logs
    assert sum(len(episode.actions) for log in logs for episode in log.episodes) > 0
    assert [line.participant for line in read_enrolled(data(server))] == ["sub-01"]
