"""Programs in a participant's place over HTTP: the client of the docs plays, hostile requests are refused."""

import base64
import io
import json
import re
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from minihuman import verify
from minihuman.admin.protocol_file import read_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.web.agent_server import MAX_BODY_BYTES, ProgramSeats, make_agent_server
from tests.models.studies import study

DOCS = Path(__file__).parents[2] / "docs" / "models.md"


@pytest.fixture
def url(tmp_path: Path) -> Iterator[str]:
    (tmp_path / "study.toml").write_text(study(model="timeout_s = 1.0"))
    seats = ProgramSeats(read_protocol(tmp_path / "study.toml"), tmp_path / "data")
    server = make_agent_server(seats, port=0)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()
    thread.join()
    for one in seats.threads:
        one.join(10)


def call(url: str, body: Any = None, *, raw: bytes | None = None) -> tuple[int, dict[str, Any]]:
    data = raw if raw is not None else None if body is None else json.dumps(body).encode()
    try:
        with urllib.request.urlopen(urllib.request.Request(url, data)) as response:
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


def test_a_program_that_stayed_away_resumes_at_the_same_screen(url: str, tmp_path: Path) -> None:
    _, first = call(f"{url}/sessions", {"name": "walker"})
    _, second = call(url + first["session"], {"number": 1, "answer": "go_on"})
    assert second["screen"] == "play"
    while (found := call(url + first["session"])[1])["over"] is None:
        pass
    assert found["over"] == "ModelUnavailableError"
    _, again = call(f"{url}/sessions", {"name": "walker"})
    assert (again["screen"], again["text"]) == ("play", second["text"])
    assert len(list((tmp_path / "data").rglob("*.mcap.part"))) == 1


@pytest.mark.parametrize(
    ("path", "raw", "status"),
    [
        ("/sessions", b"{", 400),
        ("/sessions", b"[" * 5000, 400),
        ("/sessions", b"[]", 400),
        ("/sessions", b'{"name": 3}', 400),
        ("/sessions", json.dumps({"name": "x" * 41}).encode(), 400),
        ("/sessions", json.dumps({"name": "a\nb"}).encode(), 400),
        ("/sessions", b" " * (MAX_BODY_BYTES + 1), 413),
        ("/sessions/guessed", b'{"number": 1, "answer": "1"}', 404),
        ("/../etc/passwd", b"{}", 404),
    ],
)
def test_hostile_requests_are_refused(url: str, tmp_path: Path, path: str, raw: bytes, status: int) -> None:
    assert call(url + path, raw=raw)[0] == status
    assert not (tmp_path / "data").exists()


def test_the_client_of_the_docs_plays(url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (code,) = re.findall(r"```python\n(# A program.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    assert len(code.splitlines()) <= 30
    monkeypatch.setattr("sys.argv", ["client.py", url])
    exec(compile(code, "client.py", "exec"), {"__name__": "__main__"})
    assert [read_log(log).end_reason for log in (tmp_path / "data").rglob("*.mcap")] == ["complete"]
