"""The experimenter's page, as they meet it: a session in a real window, and `minihuman watch` beside it."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.machine.inputs import ExperimenterCommand, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.session_loop import CommandInbox, CommandRequest, inbox_path, send_command
from minihuman.runtime.watch.dashboard import DashboardServer
from tests.counts import PATIENCE_S
from tests.seats.session_typist import enter_at
from tests.seats.station import DEMO, demo_started
from tests.study.sessions import corridor_plan
from tests.xserver import Typist


class Page:
    """The page's own requests, from a program of its own."""

    def __init__(self, study: Path) -> None:
        command = [sys.executable, "-m", "minihuman", "watch", str(study)]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.url = self.process.stdout.readline().split()[1]

    def get(self, path: str) -> bytes:
        with urllib.request.urlopen(self.url + path, timeout=PATIENCE_S) as answer:
            return answer.read()

    def state(self) -> dict[str, Any]:
        return json.loads(self.get("state"))

    def session(self) -> tuple[str, dict[str, Any]]:
        ((name, facts),) = self.state()["sessions"].items()
        return name, facts

    def ask(self, what: str, text: str = "") -> None:
        name, _ = self.session()
        body = json.dumps({"what": what, "text": text}).encode()
        address = f"{self.url}ask?session={name}"
        request = urllib.request.Request(address, body, {"Content-Type": "application/json"})
        urllib.request.urlopen(request, timeout=PATIENCE_S).close()

    def until(self, is_so: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        deadline_s = time.monotonic() + PATIENCE_S
        while True:
            state = self.state()["sessions"]
            one = next(iter(state.values()), {})
            if "phase" in one and is_so(one):  # else its log has no plan yet
                return one
            assert time.monotonic() < deadline_s, f"the page still says {state}"
            time.sleep(0.2)

    def kill(self) -> None:
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


@pytest.fixture
def pages() -> Iterator[list[Page]]:
    opened: list[Page] = []
    yield opened
    for page in opened:
        page.kill()


@pytest.mark.nightly
@pytest.mark.program
def test_the_page_shows_a_session_takes_notes_pauses_dies_comes_back_and_aborts(
    typist_and_display: tuple[Typist, str],
    tmp_path: Path,
    pages: list[Page],
) -> None:
    typist, display = typist_and_display
    demo = read_protocol(DEMO)
    plan = expand_protocol(demo, enrol_participant(demo, 0))
    station = demo_started("pygame", display, tmp_path)
    typist.focus(TITLE)
    typist.tap(*plan.key_pool)
    enter_at(typist, tmp_path, "instructions")
    study = tmp_path / demo.study.name
    pages.append(Page(study))
    page = pages[-1]
    page.until(lambda one: one["phase"] == "ready")
    deadline_s = time.monotonic() + PATIENCE_S
    while page.session()[1]["phase"] == "ready":  # an Enter before the screen is there is none
        assert time.monotonic() < deadline_s, "no Enter leads on from ready"
        typist.tap("enter")
        time.sleep(1.0)
    told = page.until(lambda one: one["phase"] == "playing")
    assert (told["participant"], told["episode"], told["steps"]) == ("sub-01", 1, 0)
    name, _ = page.session()
    first = np.asarray(Image.open(BytesIO(page.get(f"picture?session={name}"))))
    assert first.std() > 10

    keys = {action: key for key, action in plan.episodes[0].key_map.keys.items()}
    for _ in range(3):
        typist.tap(keys["left"])
        time.sleep(0.1)
    told = page.until(lambda one: one["steps"] == 3)
    assert [press["key"] for press in told["keys"]][-3:] == [keys["left"]] * 3
    assert len(told["times_ms"]) == 3
    assert not np.array_equal(np.asarray(Image.open(BytesIO(page.get(f"picture?session={name}")))), first)

    page.ask("note", "the phone rang")
    page.ask("pause")
    told = page.until(lambda one: one["paused"] == "experimenter")
    assert [note["text"] for note in told["notes"] if note["kind"] == "experimenter"] == [
        "note: the phone rang",
        "pause: ",
    ]
    page.kill()
    time.sleep(0.5)
    assert station.poll() is None
    pages.append(Page(study))
    page = pages[-1]
    assert page.until(lambda one: one["paused"])["steps"] == 3
    page.ask("go_on")
    page.until(lambda one: not one["paused"] and one["phase"] == "playing")
    typist.tap(keys["left"])
    page.until(lambda one: one["steps"] == 4)
    page.ask("abort", "fire alarm")
    _, complained = station.communicate(timeout=PATIENCE_S)
    assert station.returncode == 0, complained
    log = read_log(next(study.rglob("*.mcap")))
    assert log.end_reason == "aborted"
    notes = [note.text for note in log.notes if isinstance(note, Noted) and note.kind == "experimenter"]
    assert notes == ["note: the phone rang", "pause: ", "go_on: ", "abort: fire alarm"]
    assert verify_episodes(log).difference == ""
    assert page.state()["sessions"] == {}


@pytest.mark.program
def test_the_page_is_for_this_machine_and_whoever_knows_its_address(tmp_path: Path, pages: list[Page]) -> None:
    pages.append(Page(tmp_path))
    page = pages[-1]
    assert page.url.startswith("http://127.0.0.1:")
    assert b"minihuman: watch" in page.get("")
    root = page.url.split("/", 3)
    for wrong in (f"{root[0]}//{root[2]}/", f"{root[0]}//{root[2]}/state", page.url + "elsewhere"):
        with pytest.raises(urllib.error.HTTPError):
            urllib.request.urlopen(wrong, timeout=PATIENCE_S)


def test_what_was_asked_before_the_session_began_is_not_done_again(tmp_path: Path) -> None:
    log = tmp_path / "sub-01_ses-01.mcap"
    send_command(log, CommandRequest("abort", "yesterday"))
    desk = CommandInbox(inbox_path(log))
    assert desk.read_new() == []
    send_command(log, CommandRequest("note", "today"))
    with inbox_path(log).open("ab") as file:
        file.write(b'{"what": "no such wish"}\n{"what": "no')
    assert [one.text for one in desk.read_new()] == ["today"]
    with inbox_path(log).open("ab") as file:
        file.write(b'te", "text": "and whole"}\n')
    assert [one.text for one in desk.read_new()] == ["and whole"]


def test_a_pause_where_nothing_is_played_is_only_noted() -> None:
    from minihuman.worlds.adapters.world import World

    session = SessionMachine(corridor_plan(episodes=1, max_steps=9), World, {})
    session.receive(Tick(0))
    phase = session.phase
    events = session.receive(ExperimenterCommand(5, "pause"))
    assert [event.text for event in events if isinstance(event, Noted)] == ["pause: "]
    assert session.phase is phase
    session.close()


def test_a_session_that_nobody_asks_anything_has_no_such_file(tmp_path: Path) -> None:
    assert CommandInbox(inbox_path(tmp_path / "none.mcap")).read_new() == []
    assert os.listdir(tmp_path) == []


def test_a_browser_that_goes_before_it_is_answered_leaves_no_word_on_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server = DashboardServer(tmp_path)
    for error, said in ((BrokenPipeError(), ""), (ConnectionResetError(), ""), (ValueError("a bug"), "a bug")):
        try:
            raise error
        except Exception:
            server._server.handle_error(None, ("127.0.0.1", 1))
        assert said in capsys.readouterr().err if said else capsys.readouterr().err == ""
    server._server.server_close()
