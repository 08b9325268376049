"""The guards of every HTTP server: whose requests are taken, how long they may be, and how long they may take."""

import asyncio
import socket
import threading
from collections.abc import Mapping
from pathlib import Path

import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.responses import PlainTextResponse
from starlette.routing import Route
from starlette.testclient import TestClient
from starlette.types import ASGIApp, Receive, Scope, Send

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.http_guard import is_own_request, read_length
from minihuman.runtime.watch.dashboard import DashboardServer
from minihuman.web.arrivals import Arrivals
from minihuman.web.server import request_timeout
from minihuman.web.server.app import WebServer
from minihuman.web.server.desk import StartPage
from minihuman.web.server.metrics import METRICS_TOKEN_VARIABLE
from minihuman.web.server.request_timeout import QueueingServer, TimedHttpProtocol
from tests.counts import PATIENCE_S
from tests.study.sessions import corridor_plan

EVIL = {"origin": "https://evil.example"}


@pytest.mark.parametrize(
    ("headers", "is_own"),
    [
        ({"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000"}, True),
        ({"host": "127.0.0.1:8000", "origin": "null", "sec-fetch-site": "same-origin"}, True),
        ({"host": "127.0.0.1:8000"}, True),  # no browser: whoever knows the secret
        ({"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8001"}, False),
        ({"host": "127.0.0.1:8000", "origin": "null"}, False),
        ({"host": "127.0.0.1:8000", "sec-fetch-site": "cross-site"}, False),
        ({"host": "127.0.0.1:8000", "origin": "http://127.0.0.1:8000", "sec-fetch-site": "same-site"}, False),
    ],
)
def test_a_request_of_another_page_is_not_taken(headers: Mapping[str, str], is_own: bool) -> None:
    assert is_own_request(headers) is is_own


@pytest.mark.parametrize(
    ("length", "known"), [("5", 5), ("0", 0), ("11", None), ("-1", None), ("abc", None), ("", None)]
)
def test_a_length_is_a_number_of_bytes_that_is_allowed(length: str, known: int | None) -> None:
    assert read_length(length, 10) == known
    assert read_length("٣", 10) is None


def ask_raw(port: int, request: bytes) -> bytes:
    with socket.create_connection(("127.0.0.1", port), PATIENCE_S) as client:
        client.sendall(request)
        return client.recv(65_536)


def test_watch_takes_nothing_of_another_page_or_of_a_length_that_is_none(tmp_path: Path) -> None:
    (tmp_path / "study").mkdir()
    server = DashboardServer(tmp_path / "study")
    thread = threading.Thread(target=server.serve, daemon=True)
    thread.start()
    port = int(server.url.split(":")[2].partition("/")[0])
    path = "/" + server.url.partition("//")[2].partition("/")[2]
    body = b'{"open": false}'

    def recruit(*headers: str) -> bytes:
        head = [f"POST {path}recruit HTTP/1.1", "Content-Type: application/json", *headers]
        return ask_raw(port, "\r\n".join([*head, "", ""]).encode() + body)

    try:
        length = f"Content-Length: {len(body)}"
        own = f"Host: 127.0.0.1:{port}"
        assert b" 400 " in recruit(own, length, "Origin: https://evil.example")
        assert b" 400 " in recruit(own, "Content-Length: abc")
        assert b" 400 " in recruit(own, "Content-Length: -1")
        assert b" 404 " in recruit("Host: evil.example", length)
        assert b" 200 " in recruit(own, length, f"Origin: http://127.0.0.1:{port}")
    finally:
        server.stop()
        thread.join(PATIENCE_S)


def test_desk_takes_no_form_of_another_page_nor_one_that_is_too_long(tmp_path: Path) -> None:
    desk = StartPage(tmp_path, tmp_path / "sessions", tmp_path)
    client = TestClient(desk.app(), base_url="http://127.0.0.1", follow_redirects=False)
    form = {"study": "none", "action": "check"}
    assert client.post(f"{desk.path}start", data=form, headers=EVIL).status_code == 403
    assert client.post(f"{desk.path}start", data={"study": "x" * 20_000}).status_code == 413
    assert client.post(f"{desk.path}start", json=form).status_code == 415
    assert client.post(f"{desk.path}start", data=form).status_code == 404  # no such study


def test_the_address_of_a_report_starts_no_command(tmp_path: Path) -> None:
    report = tmp_path / "reports/study/report.html"
    report.parent.mkdir(parents=True)
    report.write_text("<p>found")
    desk = StartPage(tmp_path, tmp_path / "sessions", tmp_path)
    client = TestClient(desk.app(), base_url="http://127.0.0.1")
    assert desk.path.strip("/") not in desk._reports_path
    answer = client.get(f"{desk._reports_path}/study/report.html")
    assert answer.text == "<p>found"
    assert "sandbox" in answer.headers["content-security-policy"]
    assert client.get(f"{desk.path}reports/study/report.html").status_code == 404


def come_from(host: str, app: ASGIApp) -> ASGIApp:
    """Let requests come from an address; older releases of Starlette's client cannot say one."""

    async def called(scope: Scope, receive: Receive, send: Send) -> None:
        await app({**scope, "client": (host, 5000)} if scope["type"] == "http" else scope, receive, send)

    return called


def test_metrics_are_closed_to_all_who_come_through_a_proxy_or_lack_the_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    protocol = decode_protocol(corridor_plan(consent="May we?").protocol_toml)
    app = WebServer(Arrivals(protocol, tmp_path), tmp_path).app()
    here = TestClient(come_from("127.0.0.1", app))
    assert here.get("/metrics").status_code == 200
    assert here.get("/metrics", headers={"X-Forwarded-For": "192.0.2.1"}).status_code == 404
    assert TestClient(come_from("10.0.0.7", app)).get("/metrics").status_code == 404
    monkeypatch.setenv(METRICS_TOKEN_VARIABLE, "s" * 20)
    pod = TestClient(come_from("10.0.0.7", app))
    assert pod.get("/metrics", headers={"Authorization": f"Bearer {'s' * 20}"}).status_code == 200
    assert here.get("/metrics").status_code == 404
    assert pod.get("/metrics", headers={"Authorization": "Bearer x"}).status_code == 404


def test_of_more_half_requests_than_may_wait_the_oldest_are_closed_and_a_whole_one_is_answered(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(request_timeout, "MAX_WAITING", 5)
    app = Starlette(routes=[Route("/", lambda _: PlainTextResponse("whole"))])
    whole = b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"

    async def run() -> tuple[bytes, list[bool]]:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            server = QueueingServer(
                uvicorn.Config(app, http=TimedHttpProtocol, log_level="error", lifespan="off", backlog=1)
            )
            serving = asyncio.create_task(server.serve(sockets=[listener]))
            port = listener.getsockname()[1]
            half = [await asyncio.open_connection("127.0.0.1", port) for _ in range(8)]
            for _, writer in half:
                writer.write(b"GET / HT")
            closed = [asyncio.create_task(reader.read()) for reader, _ in half]
            while sum(task.done() for task in closed) < 3:
                await asyncio.sleep(0.01)
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(whole)
            answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
            are_closed = [task.done() for task in closed]
            for _, opened in (*half, (reader, writer)):
                opened.close()
            server.should_exit = True
            await serving
            await asyncio.gather(*closed)
        return answer, are_closed

    answer, are_closed = asyncio.run(run())
    assert answer.endswith(b"whole")
    assert are_closed == [True] * 4 + [False] * 4


def test_half_requests_are_closed_and_whole_ones_answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(request_timeout, "HELLO_TIMEOUT_S", 0.3)
    app = Starlette(routes=[Route("/", lambda _: PlainTextResponse("whole"))])

    async def ask(port: int, request: bytes) -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(request)
        answer = await asyncio.wait_for(reader.read(), PATIENCE_S)
        writer.close()
        return answer

    async def run() -> list[bytes]:
        with socket.create_server(("127.0.0.1", 0)) as listener:
            server = uvicorn.Server(uvicorn.Config(app, http=TimedHttpProtocol, log_level="error", lifespan="off"))
            serving = asyncio.create_task(server.serve(sockets=[listener]))
            port = listener.getsockname()[1]
            requests = (b"", b"GET / HT", b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\nhalf")
            whole = b"GET / HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
            answers = await asyncio.gather(*(ask(port, request) for request in (*requests, whole)))
            server.should_exit = True
            await serving
        return answers

    *half, whole = asyncio.run(run())
    assert all(b"whole" not in answer for answer in half)
    assert whole.endswith(b"whole")
