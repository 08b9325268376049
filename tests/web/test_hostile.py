"""Hostile pages and requests: refused, without a traceback, without a file, and without anybody else's noticing."""

import asyncio
import json
import random
import socket as plain
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.sync.client import ClientConnection, connect

from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.web.traffic_limits import MAX_WAITING
from tests.counts import PATIENCE_S, count
from tests.web.served import Served, served
from tests.web.typed_page import Counts, TypedPage

pytestmark = [pytest.mark.program, pytest.mark.nightly(sample=True)]
EXAMPLES, EACH = count(30, 1000), 10
REQUESTS = count(60, 500)


class Neighbour:
    """Somebody who takes part while others misbehave."""

    def __init__(self, server: Served, token: str) -> None:
        self.page = TypedPage(server.host, token, keys_per_s=6, rng=random.Random(1))
        self.counts: Counts | None = None
        self._thread = threading.Thread(target=self._take_part, daemon=True)
        self._thread.start()

    def _take_part(self) -> None:
        self.counts = asyncio.run(self.page.take_part())

    def leaves(self) -> Counts:
        """They have pressed enough, and leave when all they pressed is on the disk."""
        deadline_s = time.monotonic() + PATIENCE_S
        while self.page.counts.presses < 12 and time.monotonic() < deadline_s:
            time.sleep(0.1)
        self.page.enough = True
        self._thread.join(timeout=PATIENCE_S)
        assert self.counts is not None, f"the neighbour is stuck: {self.page.counts}"
        return self.counts


@pytest.fixture(scope="module")
def server(tmp_path_factory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("hostile")
    with served(folder, links=3, episodes=1000) as one:
        yield one


def files(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def address(server: Served) -> str:
    return f"ws://{server.host}/socket"


def opened(server: Served, **more) -> ClientConnection:
    quiet = {"compression": None, "ping_interval": None}  # a ping draws from `random`, over which Hypothesis watches
    return connect(address(server), origin=f"http://{server.host}", open_timeout=PATIENCE_S, **quiet, **more)


HUGE = {  # by name: Hypothesis writes its strategies out
    "number": 10**400,
    "word": "A" * 20_000,
    "brackets": "[" * 15_000,
    "inside one another": '{"t":"n","n":1,"at":1,"what":' * 400,
    "too much": "x" * 70_000,
}
NASTY = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([2**31, 2**53, 2**53 + 1, 2**63, 2**64, -1, 0])
    | st.sampled_from(["number", "word"]).map(HUGE.__getitem__)
    | st.floats()
    | st.text(max_size=40)
    | st.sampled_from(["../../../etc/passwd", "\x00", "<script>alert(1)</script>", "\ud800", "%n%s"])
    | st.lists(st.integers(), max_size=3)
    | st.recursive(st.none(), lambda inner: st.dictionaries(st.text(max_size=3), inner, max_size=2), max_leaves=5)
)
SAID = [
    {"t": "key", "key": "1", "down": True, "stamp": 5},
    {"t": "shown", "submit": 1, "flip": 2, "screen": 1},
    {"t": "shown", "submit": 1, "flip": 2, "episode": 0, "step": 0, "node": 0},
    {"t": "typed", "text": "x"},
    {"t": "pointer", "what": "pressed", "x": 0.5, "y": 0.5, "target": "go_on", "along": 0.5},
    {"t": "focus", "focused": False},
    {"t": "link", "sent": 1, "received": 2, "answered": 3, "back": 4, "latest": 3},
    {"t": "asked", "number": 1},
    {"t": "unheard", "text": "x"},
    {"t": "tick"},
]
OUTER = [
    {"t": "n", "n": 1, "at": 5, "what": SAID[0]},
    {"t": "heard", "n": 0},
    {"t": "ping", "sent": 1},
    {
        "t": "hello",
        "version": MESSAGE_VERSION,
        "token": "x",
        "platform": {"PROLIFIC_PID": "y"},
        "facts": {"browser": "z"},
    },
]


@st.composite
def spoilt(draw: st.DrawFn) -> str:
    """A message of a page's with a field that no page puts there."""
    message = dict(draw(st.sampled_from(OUTER)))
    if message["t"] == "n":
        message["what"] = dict(draw(st.sampled_from(SAID)))
        if draw(st.booleans()):
            message["what"][draw(st.sampled_from([*message["what"], "extra"]))] = draw(NASTY)
        message["n"] = draw(st.sampled_from([1, 2, 3, 50, 2**31, 0, -1]))
        message["at"] = draw(st.sampled_from([1, 5, 10**9, 2**53]))
    if draw(st.booleans()):
        message[draw(st.sampled_from([*message, "extra"]))] = draw(NASTY)
    return json.dumps(message)


SHORT = st.tuples(
    st.sampled_from(["k", "s", "t", "n"]), st.sampled_from([1, 2, 3, 0, -1]), st.sampled_from([1, 5, 10**6, 2**53])
)
MESSAGES = (
    spoilt()
    | st.builds(lambda head, rest: json.dumps([*head, *rest]), SHORT, st.lists(NASTY, max_size=7))
    | st.text(max_size=60)
    | st.binary(max_size=60)
    | NASTY.map(json.dumps)
    | st.sampled_from(["brackets", "inside one another", "too much"]).map(HUGE.__getitem__)
)


def attack(server: Served, token: str | None, messages: list[str | bytes]) -> None:
    """Say these things on one socket after the other, with or without having said a proper hello."""
    hello = {"t": "hello", "version": MESSAGE_VERSION, "token": token or "", "stream": "attack"}
    waiting = list(messages)
    while waiting:
        with suppress(WebSocketException, OSError, UnicodeError, TimeoutError), opened(server) as socket:
            if token is not None:
                socket.send(json.dumps(hello))
            while waiting:
                socket.send(waiting.pop(0))
                with suppress(TimeoutError):
                    socket.recv(timeout=0.01)


def test_ten_thousand_hostile_messages_change_nothing_for_anybody_else(server, tmp_path):
    mine, attacker, _ = server.links
    before = files(server.said.parent)
    neighbour = Neighbour(server, mine)

    @settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(st.sampled_from([None, attacker, "guess"]), st.lists(MESSAGES, min_size=EACH, max_size=EACH))
    def say(token, messages):
        attack(server, token, messages)

    say()
    counts = neighbour.leaves()
    assert counts.presses >= 12
    folder = server.said.parent / "data" / "walk"
    logged = [presses_in(part) for part in folder.glob("sub-*/ses-01/*.mcap.part")]
    assert counts.presses + counts.others in logged
    for part in folder.glob("sub-*/ses-01/*.mcap.part"):
        assert verify_episodes(read_log(part)).difference == ""
    assert "Traceback" not in server.complaints()
    assert server.process.poll() is None
    new = files(server.said.parent) - before
    assert all(path.is_relative_to(folder) for path in new), new
    assert files(tmp_path) == set()


def presses_in(part: Path) -> int:
    return sum(isinstance(event, KeyPressed) and event.down for event in read_events(part))


@pytest.mark.parametrize("origin", [None, "https://evil.example", "null", "http://127.0.0.1:1", "file://"])
def test_a_foreign_page_is_refused(server, origin):
    with (
        pytest.raises((InvalidStatus, ConnectionClosed)) as refused,
        connect(address(server), origin=origin, compression=None, open_timeout=PATIENCE_S) as socket,
    ):
        socket.recv(timeout=PATIENCE_S)
    if isinstance(refused.value, InvalidStatus):
        assert refused.value.response.status_code == 403


def test_a_huge_message_is_refused(server):
    with opened(server) as socket:
        socket.send("x" * 70_000)
        with pytest.raises(ConnectionClosed) as closed:
            socket.recv(timeout=PATIENCE_S)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code in (1009, 4003)


def test_sockets_that_say_nothing_keep_nobody_out_and_the_oldest_make_room(server):
    with ExitStack() as silent:
        oldest = silent.enter_context(opened(server))
        for _ in range(MAX_WAITING):
            silent.enter_context(opened(server))
        with pytest.raises(ConnectionClosed) as closed:
            oldest.recv(timeout=PATIENCE_S)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4100
        with opened(server) as socket:
            socket.send(json.dumps({"t": "hello", "version": MESSAGE_VERSION, "token": "guess", "stream": "a"}))
            assert json.loads(socket.recv())["reason"] == "unknown"


HEADS = [
    "GET /../../../../etc/passwd HTTP/1.1",
    "GET /static/../../../etc/passwd HTTP/1.1",
    "GET /static/..%2f..%2f..%2fetc%2fpasswd HTTP/1.1",
    "GET /static/%2e%2e/server.py HTTP/1.1",
    "GET /static//etc/passwd HTTP/1.1",
    "GET /%00 HTTP/1.1",
    "GET /?" + "a" * 3000 + " HTTP/1.1",
    "GET /" + "a" * 70_000 + " HTTP/1.1",
    "POST / HTTP/1.1",
    "DELETE / HTTP/1.1",
    "CONNECT evil.example:443 HTTP/1.1",
    "TRACE / HTTP/1.1",
    "OPTIONS * HTTP/1.1",
    "GET http://evil.example/ HTTP/1.1",
    "GET / HTTP/9.9",
    "\x16\x03\x01\x02\x00\x01\x00",
    "",
]
FIELDS = [
    "Host: 127.0.0.1",
    "Host: evil.example",
    "Content-Length: -1",
    "Content-Length: 99999999999999",
    "Transfer-Encoding: chunked",
    "Transfer-Encoding: chunked\r\nContent-Length: 4",
    "Range: bytes=0-,0-,0-,0-",
    "Range: bytes=9999999999999999999-",
    "If-Modified-Since: \xff\xff",
    "Upgrade: websocket\r\nConnection: Upgrade",
    "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: x\r\nSec-WebSocket-Version: 13",
    "X: " + "y" * 20_000,
    "Accept-Encoding: " + "gzip," * 2000,
    " folded",
    ":",
    "Cookie: \x00",
]


def request(server: Served, raw: bytes, *, patience_s: float = 0.5) -> bytes:
    """What a request gets: all until the server closes or says nothing for so long."""
    host, _, port = server.host.partition(":")
    with plain.create_connection((host, int(port)), timeout=PATIENCE_S) as line:
        line.settimeout(patience_s)
        answer = b""
        with suppress(TimeoutError, OSError):
            line.sendall(raw)
            while chunk := line.recv(65_536):
                answer += chunk
        return answer


def test_five_hundred_hostile_requests_get_nothing(server):
    rng = random.Random(0)
    before = files(server.said.parent)
    for number in range(REQUESTS):
        head = HEADS[number % len(HEADS)]
        fields = rng.sample(FIELDS, rng.randrange(4))
        raw = "\r\n".join([head, *fields, "", ""]).encode("latin-1")
        if rng.random() < 0.2:
            raw = bytes(rng.randrange(256) for _ in range(rng.randrange(300)))
        answer = request(server, raw)
        status = answer[9:12]
        assert b"root:" not in answer
        assert b"import " not in answer
        assert not status.startswith(b"5") or status == b"501", (raw, answer[:200])
    assert "Traceback" not in server.complaints()
    assert files(server.said.parent) == before
    assert page_at(server, "/").startswith(b"HTTP/1.1 200")


def page_at(server: Served, path: str) -> bytes:
    raw = f"GET {path} HTTP/1.1\r\nHost: {server.host}\r\nConnection: close\r\n\r\n".encode()
    return request(server, raw, patience_s=PATIENCE_S)


def test_every_answer_has_the_headers_that_keep_the_page_to_itself(server):
    for path in ("/", "/static/page.js", "/nothing", "/favicon.ico"):
        answer = page_at(server, path)
        head = answer.partition(b"\r\n\r\n")[0].lower()
        for name in (b"content-security-policy", b"cross-origin-opener-policy", b"x-content-type-options"):
            assert head.count(name + b":") == 1, (path, head)
        assert b"cache-control: no-store" in head


def answer(server: Served, stack: ExitStack, *, address: str, token: str = "", person: str = "") -> str:
    """Come from an address, as a proxy says it, and stay: "welcome", or why not."""
    socket = stack.enter_context(opened(server, additional_headers={"X-Forwarded-For": address}))
    platform = {"PROLIFIC_PID": person} if person else {}
    facts = {"browser": "simulated", "window_px": "1366 x 768", "mouse": True, "touch": False}
    hello = {"t": "hello", "version": MESSAGE_VERSION, "token": token, "stream": "crowd", "platform": platform}
    socket.send(json.dumps({**hello, "facts": facts}))
    said = json.loads(socket.recv(timeout=PATIENCE_S))
    return said["reason"] if said["t"] == "refused" else said["t"]


@pytest.mark.parametrize("garbage", ["", "x"])  # as a link's token, which is none
def test_two_hundred_invented_ids_from_one_address_cost_nobody_else_a_seat(tmp_path, garbage):
    crowd = count(40, 200)
    web = "max_concurrent_sessions = 30\nmax_unconsented_per_address = 10"
    with served(tmp_path, links=1, web=web) as server, ExitStack() as stack:
        invented = [
            answer(server, stack, address=f"2001:db8::{n:x}", token=garbage, person=f"invented-{n}")
            for n in range(crowd)
        ]
        assert Counter(invented) == {"welcome": 10, "busy": crowd - 10}
        for number in range(15):
            assert answer(server, stack, address=f"198.51.100.{number}", person=f"real-{number}") == "welcome"
        assert answer(server, stack, address="2001:db8::1", token=server.links[0]) == "welcome", "who was invited"
        metrics = urllib.request.urlopen(f"http://{server.host}/metrics", timeout=PATIENCE_S).read().decode()
        assert "\nminihuman_sessions 26\n" in metrics
        assert urllib.request.urlopen(f"http://{server.host}/healthz", timeout=PATIENCE_S).read() == b"ok\n"
    entries = (tmp_path / "data/walk/register.jsonl").read_text().splitlines()
    assert len(entries) < 40, "an invented id that was refused took a slot"
