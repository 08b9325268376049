"""What a server knows of a page by its socket alone: that it lives, that it goes, and that nothing comes any more."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.testclient import TestClient

from minihuman.admin.protocol_file import read_protocol
from minihuman.experiment.machine.life_signs import LifeSigns
from minihuman.web.arrivals import Arrivals
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.web.server.app import WebServer
from tests.activities.team.study import PEOPLE, team_study

HELLO = {"t": "hello", "version": MESSAGE_VERSION, "stream": "a", "facts": {}}
WAIT_S = 3


class OnePage:
    """A raw socket to a server in this process."""

    def __init__(self, server: WebServer, client: TestClient) -> None:
        self._server = server
        self._client = client

    def connect(self) -> Any:
        """Open a socket."""
        return self._client.websocket_connect("/socket", headers={"origin": "http://testserver"})

    def greet(self, socket: Any, **fields: object) -> dict[str, Any]:
        """Say hello; return the welcome."""
        socket.send_text(json.dumps(HELLO | fields))
        welcome: dict[str, Any] = json.loads(socket.receive_text())
        assert welcome["t"] == "welcome", welcome
        return welcome

    @property
    def signs(self) -> LifeSigns:
        """What the server knows of the page."""
        [connection] = self._server.connections.values()
        return connection.presence.signs


@pytest.fixture
def page(tmp_path: Path) -> Iterator[OnePage]:
    team = f"{PEOPLE}\npartner_wait_s = {WAIT_S}"
    path = team_study(tmp_path, team=team)
    path.write_text(path.read_text().replace("[web]", "[web]\nopen_access = true"))
    server = WebServer(Arrivals(read_protocol(path), tmp_path), tmp_path)
    with TestClient(server.app()) as client:
        yield OnePage(server, client)


def ping(socket: Any) -> None:
    """Send a ping, and wait for its answer."""
    socket.send_text('{"t":"ping","sent":1}')
    while True:
        message = socket.receive()
        if "pong" in str(message.get("text") or message.get("bytes")):
            return


def test_a_page_is_asked_for_three_signs_in_the_time_that_partners_wait(page: OnePage) -> None:
    with page.connect() as socket:
        assert page.greet(socket)["sign_ms"] == WAIT_S * 1000 / 3


def test_a_ping_is_a_sign_of_the_page_and_none_of_the_person(page: OnePage) -> None:
    with page.connect() as socket:
        page.greet(socket)
        before_s = page.signs.page_s
        ping(socket)
        assert page.signs.page_s is not None
        assert before_s is not None
        assert page.signs.page_s > before_s
        assert page.signs.person_s is None


def test_a_lost_focus_is_the_persons_last_sign_until_it_is_found(page: OnePage) -> None:
    with page.connect() as socket:
        now = page.greet(socket)["now"]
        focus = {"t": "n", "n": 1, "at": now + 1, "what": {"t": "focus", "focused": False}}
        socket.send_text(json.dumps(focus))
        ping(socket)
        assert not page.signs.has_focus
        assert page.signs.person_s is not None


@pytest.mark.parametrize(("code", "state"), [(1001, "closed"), (1000, "offline"), (1006, "offline")])
def test_a_socket_closed_by_a_page_that_goes_is_told_from_one_that_broke(page: OnePage, code: int, state: str) -> None:
    with page.connect() as socket:
        page.greet(socket)
        heard_s = page.signs.page_s
        socket.close(code)
    with page.connect() as other:  # the server has seen the end once it answers another socket
        other.send_text("{}")
        other.receive()
    assert page.signs.page == state
    assert (page.signs.page_s == heard_s) == (state == "offline")


@pytest.mark.parametrize(("is_kept", "state"), [(True, "left"), (False, "closed")])
def test_a_farewell_says_that_the_page_goes(page: OnePage, is_kept: bool, state: str) -> None:
    with page.connect() as socket:
        page.greet(socket)
        socket.send_text(json.dumps({"t": "bye", "left": is_kept}))
        ping(socket)
        assert page.signs.page == state
