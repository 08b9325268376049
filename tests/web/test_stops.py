"""What a page says when a session stops: what happened, what of it is on the disk, and a code."""

import asyncio
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Event
from minihuman.experiment.machine.screen_texts import find_stop_code
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import WebSpec
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import CommandInbox
from minihuman.web import messages
from minihuman.web.computed import PageWorld
from minihuman.web.connection import Connection
from minihuman.web.eligibility import build_completion, get_page_texts
from minihuman.web.hosted_session import HostedSession
from minihuman.web.outbox import PageSettings
from minihuman.web.server.app import build_session_over, classify_connection_ending
from minihuman.web.session_host import SessionHost
from tests.web.protocols import study

MS = 1_000_000
WORDS = get_page_texts("en")


class Disk(MemoryRecorder):
    """Has no more than so many writes; the next one fails, or closing does."""

    def __init__(self, room: int, *, fails_late: bool) -> None:
        super().__init__()
        self._room = room
        self._fails_late = fails_late

    def begin(self, events: Sequence[Event]) -> None:
        if self._writes >= self._room and events and not self._fails_late:
            raise LogError("no space left on device")
        super().begin(events)

    @property
    def durable_writes(self) -> int:
        return min(self._writes, self._room)

    def close(self) -> None:
        if self._writes > self._room:
            raise LogError("no space left on device")


def play_until(folder: Path, recorder: Disk, stop: Callable[[Connection], object]) -> messages.SessionOver:
    """Press some keys in an episode, stop, and return the last message to the page."""
    protocol = decode_protocol(study(folder).read_bytes())
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))

    async def play() -> messages.SessionOver:
        session = SessionMachine(plan, PageWorld, {}, picture_px=(84, 84), renders_steps=False)
        host = SessionHost(session, recorder, PageWorld, PageSettings(picture_px=(84, 84)))
        files: list[Any] = ["agreed"]
        admission: Any = SimpleNamespace(key="", lease=None, token="")
        connection = Connection(
            admission, HostedSession(host, recorder, 0, "", files), CommandInbox(folder / "requests")
        )
        acts: list[messages.PageMessage] = [messages.TickMessage(), messages.KeyMessage("enter", True, 2 * MS)]
        acts += [messages.KeyMessage(key, True, at * MS) for at, key in enumerate("1213", 3)]
        for number, act in enumerate(acts, 1):
            connection.take(messages.NumberedMessage(number, number * MS, act))
        stop(connection)
        assert host.over
        connection.finish()
        completion = build_completion(WebSpec(), classify_connection_ending(connection))
        over = build_session_over(connection, completion)
        host.close()
        return over

    return asyncio.run(play())


def stop_with(reason: str, detail: str = "") -> Callable[[Connection], object]:
    return lambda connection: connection.stop(reason, detail)


@pytest.mark.parametrize(
    ("reason", "end"),
    [("timed_out", "timed_out"), ("connection_lost", "timed_out"), ("window_closed", "quit"), ("aborted", "quit")],
)
def test_a_session_that_ended_on_a_sound_disk_says_that_its_data_are_saved(
    tmp_path: Path, reason: str, end: str
) -> None:
    over = play_until(tmp_path, Disk(100, fails_late=True), stop_with(reason))
    assert (over.end, over.words, over.code) == (end, WORDS[end], "")
    assert "Your data are saved" in over.words


@pytest.mark.parametrize("reason", ["timed_out", "window_closed", "world_error", "internal_error"])
def test_a_session_whose_log_was_not_finished_says_how_many_inputs_may_be_lost(tmp_path: Path, reason: str) -> None:
    over = play_until(tmp_path, Disk(4, fails_late=True), stop_with(reason, "it broke"))
    assert (over.end, over.words) == ("broken", WORDS["broken_in_part"].replace("{unsaved}", "2"))
    assert over.code == find_stop_code(reason, "it broke")


@pytest.mark.parametrize("reason", ["world_error", "internal_error", "player_failed"])
def test_a_failure_after_which_all_is_on_the_disk_says_so_with_a_code_in_place_of_the_error(
    tmp_path: Path, reason: str
) -> None:
    over = play_until(tmp_path, Disk(100, fails_late=True), stop_with(reason, "ZeroDivisionError: division by zero"))
    assert (over.end, over.words) == ("broken", WORDS["broken"])
    assert re.fullmatch(r"[WIP]-[0-9A-F]{4}", over.code)
    assert "ZeroDivision" not in str(over)


def test_a_disk_that_fills_up_in_mid_session_stops_it_and_the_inputs_that_it_lacks_are_counted(tmp_path: Path) -> None:
    over = play_until(tmp_path, Disk(4, fails_late=False), lambda connection: None)
    assert over.end == "broken"
    [lost] = re.findall(r"Your last (\d+) inputs may not be saved", over.words)
    assert int(lost) >= 1
    assert over.code == find_stop_code("disk_full", "no space left on device")
