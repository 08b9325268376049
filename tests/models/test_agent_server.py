"""Programs in a participant's place over HTTP: the client of the docs plays, hostile requests are refused."""

import base64
import contextlib
import io
import json
import queue
import re
import socket
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from PIL import Image

from minihuman import verify
from minihuman.admin.protocol_file import read_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record import mcap_recorder
from minihuman.runtime import model_sessions
from minihuman.web import agent_server
from minihuman.web.agent_server import MAX_BODY_BYTES, ProgramSessions, make_agent_server
from tests.counts import PATIENCE_S
from tests.models.studies import study

pytestmark = pytest.mark.program

DOCS = Path(__file__).parents[2] / "docs" / "models.md"


class Answers(queue.Queue[str]):
    """A program's answers. It is late once a test says that it stays away, however long a busy machine takes."""

    stays_away = threading.Event()

    def get(self, block: bool = True, timeout: float | None = None) -> str:
        while True:
            try:
                return super().get(timeout=0.01)
            except queue.Empty:
                if self.stays_away.is_set():
                    raise


@pytest.fixture
def stays_away(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """Set it, and no program answers any more in time."""
    event = threading.Event()
    monkeypatch.setattr(Answers, "stays_away", event)
    monkeypatch.setattr(agent_server, "queue", SimpleNamespace(Queue=Answers, Empty=queue.Empty))
    yield event
    event.set()


@pytest.fixture
def programs(tmp_path: Path, stays_away: threading.Event) -> ProgramSessions:
    (tmp_path / "study.toml").write_text(study())
    return ProgramSessions(read_protocol(tmp_path / "study.toml"), tmp_path / "data")


@contextlib.contextmanager
def serve_programs(programs: ProgramSessions) -> Iterator[str]:
    """A server of these sessions; yields its address."""
    server = make_agent_server(programs, port=0)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@pytest.fixture
def url(programs: ProgramSessions, stays_away: threading.Event) -> Iterator[str]:
    with serve_programs(programs) as address:
        yield address
    stays_away.set()
    for one in programs.threads:
        one.join(PATIENCE_S)


def call(
    url: str, body: Any = None, *, raw: bytes | None = None, headers: dict[str, str] | None = None
) -> tuple[int, dict[str, Any]]:
    data = raw if raw is not None else None if body is None else json.dumps(body).encode()
    try:
        sent = urllib.request.Request(url, data, {"Content-Type": "application/json"} | (headers or {}))
        with urllib.request.urlopen(sent) as response:
            return response.status, json.load(response)
    except urllib.error.HTTPError as error:
        return error.code, json.load(error)


def answer_of(screen: dict[str, Any]) -> str:
    if screen["screen"] == "question":
        return "30" if "How old" in screen["text"] else "text" if "one line" in screen["text"] else "1"
    return (screen["keys"] or screen["buttons"])[-1]


def test_a_program_plays_a_session_that_verifies(url: str, tmp_path: Path) -> None:
    status, screen = call(f"{url}/sessions", {"name": "walker"})
    session = screen["session"]
    assert (status, screen["screen"], screen["buttons"]) == (201, "page", ["decline", "go_on"])
    seen = []
    while screen["over"] is None:
        seen.append(screen)
        status, screen = call(url + session, {"number": screen["number"], "answer": answer_of(screen)})
        assert status == 200
    assert screen["over"] == "complete"
    assert seen[1]["observation"]["image"]
    picture = Image.open(io.BytesIO(base64.b64decode(seen[1]["picture_png"])))
    assert picture.size == (640, 480)
    (log,) = map(read_log, (tmp_path / "data").rglob("*.mcap"))
    assert (log.player, log.plan.participant.id) == ("http:walker", "model-01")
    assert all(line.ok for line in verify(tmp_path / "data"))


def test_a_screen_is_answered_once_and_can_be_read_again(url: str) -> None:
    _, first = call(f"{url}/sessions", {"name": "walker"})
    session = url + first["session"]
    assert call(session)[1]["number"] == 1
    _, second = call(session, {"number": 1, "answer": "go_on"})
    status, found = call(session, {"number": 1, "answer": "go_on"})
    assert (status, found["number"]) == (409, second["number"])


def test_a_program_that_stayed_away_resumes_at_the_same_screen(
    url: str, tmp_path: Path, stays_away: threading.Event
) -> None:
    _, first = call(f"{url}/sessions", {"name": "walker"})
    _, second = call(url + first["session"], {"number": 1, "answer": "go_on"})
    assert second["screen"] == "play"
    stays_away.set()
    while (found := call(url + first["session"])[1])["over"] is None:
        pass
    assert found["over"] == "ModelUnavailableError"
    stays_away.clear()
    _, again = call(f"{url}/sessions", {"name": "walker"})
    assert (again["screen"], again["text"]) == ("play", second["text"])
    assert len(list((tmp_path / "data").rglob("*.mcap.part"))) == 1


NAME_ERROR = "name is not a text of 1 to 40 printable characters; send such a name"
OBJECT_ERROR = "send a JSON object"
NO_SESSION_ERROR = "this session does not exist; begin a session with POST /sessions"
SIZE_ERROR = f"send a body of at most {MAX_BODY_BYTES} bytes with its length"
LOCAL_ERROR = "only programs on this machine may play; ask for http://127.0.0.1 and the port"
TYPE_ERROR = "send JSON, with the header Content-Type: application/json"


@pytest.mark.parametrize(
    ("path", "raw", "status", "error"),
    [
        ("/sessions", b"{", 400, OBJECT_ERROR),
        ("/sessions", b"[" * 5000, 400, OBJECT_ERROR),
        ("/sessions", b"[]", 400, OBJECT_ERROR),
        ("/sessions", b'{"name": 3}', 400, NAME_ERROR),
        ("/sessions", json.dumps({"name": "x" * 41}).encode(), 400, NAME_ERROR),
        ("/sessions", json.dumps({"name": "a\nb"}).encode(), 400, NAME_ERROR),
        ("/sessions", b" " * (MAX_BODY_BYTES + 1), 413, SIZE_ERROR),
        ("/sessions/guessed", b'{"number": 1, "answer": "1"}', 404, NO_SESSION_ERROR),
        ("/../etc/passwd", b"{}", 404, NO_SESSION_ERROR),
    ],
)
def test_hostile_requests_are_refused_with_a_reason(
    url: str, tmp_path: Path, path: str, raw: bytes, status: int, error: str
) -> None:
    assert call(url + path, raw=raw) == (status, {"error": error})
    assert not (tmp_path / "data").exists()


def test_an_answer_to_no_screen_or_of_no_form_is_refused_with_a_reason(url: str) -> None:
    _, first = call(f"{url}/sessions", {"name": "walker"})
    session = url + first["session"]
    for body in ({"answer": "go_on"}, {"number": "1", "answer": "go_on"}, {"number": 1, "answer": 2}):
        assert call(session, body) == (400, {"error": 'send {"number": the screen\'s, "answer": a text}'})
    status, found = call(session, {"number": 7, "answer": "go_on"})
    assert (status, found["error"], found["number"]) == (409, "screen 7 does not wait for an answer", 1)


def test_a_program_too_many_is_told_to_come_later(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent_server, "MAX_SESSIONS", 1)
    assert call(f"{url}/sessions", {"name": "walker"})[0] == 201
    busy = call(f"{url}/sessions", {"name": "another"})
    assert busy == (503, {"error": "1 sessions run already; try again later"})


@pytest.mark.parametrize(
    ("headers", "status", "error"),
    [
        ({"Host": "rebound.example:8010"}, 403, LOCAL_ERROR),
        ({"Host": ""}, 403, LOCAL_ERROR),
        ({"Origin": "https://page.example"}, 403, LOCAL_ERROR),
        ({"Content-Type": "text/plain"}, 415, TYPE_ERROR),
        ({"Content-Type": "application/x-www-form-urlencoded"}, 415, TYPE_ERROR),
        ({"Host": "localhost:1"}, 201, None),
        ({"Content-Type": "application/json; charset=utf-8"}, 201, None),
    ],
)
def test_web_pages_cannot_take_a_seat(url: str, headers: dict[str, str], status: int, error: str | None) -> None:
    answer = call(f"{url}/sessions", {"name": "walker"}, headers=headers)
    assert (answer[0], answer[1].get("error")) == (status, error)
    if "Content-Type" not in headers:
        _, begun = call(f"{url}/sessions", {"name": "walker"})
        assert (call(url + begun["session"], headers=headers)[0] == 403) is (status == 403)


def test_a_length_of_thousands_of_digits_is_refused(url: str, capfd: pytest.CaptureFixture[str]) -> None:
    head = b"POST /sessions HTTP/1.1\r\nHost: localhost\r\nContent-Length: " + b"9" * 5_000 + b"\r\n\r\n"
    assert exchange(url, head).startswith(b"HTTP/1.1 413")
    assert capfd.readouterr().err == ""


def exchange(url: str, sent: bytes) -> bytes:
    """The first bytes that come back."""
    with connect(url) as connection:
        connection.sendall(sent)
        return connection.recv(1_000)


def connect(url: str) -> socket.socket:
    return socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2])), timeout=PATIENCE_S)


def test_an_answer_of_half_a_character_is_only_invalid(url: str, tmp_path: Path) -> None:
    _, first = call(f"{url}/sessions", {"name": "walker"})
    raw = b'{"number": 1, "answer": "\\ud800"}'
    status, second = call(url + first["session"], raw=raw)
    assert (status, second["number"], second["over"]) == (200, 2, None)


def is_closed(connection: socket.socket) -> bool:
    """Whether the other side has closed a connection, or does so within a tenth of a second."""
    connection.settimeout(0.1)
    try:
        return connection.recv(1) == b""
    except TimeoutError:
        return False


def test_a_client_that_sends_a_byte_now_and_then_comes_to_an_end(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(agent_server.AgentRequestHandler, "request_s", 1.0)
    monkeypatch.setattr(agent_server.AgentRequestHandler, "timeout", 1.0)
    with connect(url) as connection:
        connection.sendall(b"POST /sessions HTTP/1.1\r\nHost: localhost\r\n")
        until_s = time.monotonic() + PATIENCE_S
        with contextlib.suppress(ConnectionError):
            while not is_closed(connection):
                assert time.monotonic() < until_s, "it is still listened to"
                connection.sendall(b"X")
    assert call(f"{url}/sessions", {"name": "walker"})[0] == 201


@contextlib.contextmanager
def many_threads(count: int) -> Iterator[None]:
    """Threads of this process that are nothing of the server's."""
    over = threading.Event()
    threads = [threading.Thread(target=over.wait) for _ in range(count)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        over.set()
        for thread in threads:
            thread.join()


def test_connections_are_bounded_and_free_ones_are_served_again(
    programs: ProgramSessions, stays_away: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agent_server, "MAX_CONNECTIONS", 10)
    with serve_programs(programs) as url:
        threads = threading.active_count()
        connections = [connect(url) for _ in range(40)]
        until_s = time.monotonic() + PATIENCE_S
        closed = set[socket.socket]()
        while len(closed) < 30:
            assert time.monotonic() < until_s, f"{len(closed)} of {len(connections)} were refused"
            closed |= {connection for connection in connections if is_closed(connection)}
        assert threading.active_count() <= threads + 20
        for connection in connections:
            connection.close()
        until_s = time.monotonic() + PATIENCE_S
        while True:
            try:
                assert call(f"{url}/sessions", {"name": "walker"})[0] == 201
                break
            except OSError:
                assert time.monotonic() < until_s
    stays_away.set()
    for session in programs.threads:
        session.join(PATIENCE_S)


def test_threads_that_are_not_the_servers_take_no_connection_from_it(url: str) -> None:
    with many_threads(600):
        assert call(f"{url}/sessions", {"name": "walker"})[0] == 201


def test_ended_sessions_are_remembered_up_to_a_number(
    programs: ProgramSessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(agent_server, "MAX_SESSIONS", 2)
    monkeypatch.setattr(ProgramSessions, "_play_session", lambda self, client: client.end("complete"))
    for _ in range(20):
        programs.begin("walker")
        for thread in programs.threads:
            thread.join()
    assert len(programs.clients) <= 3


@pytest.mark.parametrize("left", [False, True])
def test_two_programs_that_begin_at_once_have_a_slot_each(
    url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stays_away: threading.Event, left: bool
) -> None:
    """Of one name, so that the slot of one, or a session that was left, might be taken by the other."""
    if left:
        _, first = call(f"{url}/sessions", {"name": "walker"})
        call(url + first["session"], {"number": 1, "answer": "go_on"})
        stays_away.set()
        while call(url + first["session"])[1]["over"] is None:
            pass
        stays_away.clear()
    create, resume = mcap_recorder.create_live_file, model_sessions.resume_segment

    def slowly(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
        return lambda where: (time.sleep(0.5), function(where))[1]

    monkeypatch.setattr(mcap_recorder, "create_live_file", slowly(create))
    monkeypatch.setattr(model_sessions, "resume_segment", slowly(resume))
    with ThreadPoolExecutor(2) as pool:
        begun = list(pool.map(lambda _: call(f"{url}/sessions", {"name": "walker"})[1], range(2)))
    assert [one["over"] for one in begun] == [None, None]
    assert sorted(one["screen"] for one in begun) == ["page", "play" if left else "page"]
    assert len(list((tmp_path / "data").rglob("*.mcap.part"))) == 2


def test_the_client_of_the_docs_plays(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```python\n(# A program.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert len(code.splitlines()) <= 30
    monkeypatch.setattr("sys.argv", ["client.py", url])
    exec(compile(code, "client.py", "exec"), {"__name__": "__main__"})
    assert [read_log(log).end_reason for log in (tmp_path / "data").rglob("*.mcap")] == ["complete"]
