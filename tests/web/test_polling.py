"""A page whose network lets no web socket through takes part over HTTP: nothing is lost, doubled, or another's."""

import asyncio
import json
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed, Noted
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.web.arrivals import Arrivals
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.web.server import polling
from minihuman.web.server.app import ANOTHER, REFUSED, WebServer
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.web.polling_page import Network, PollingLine, PollingTypedPage, open_client
from tests.web.protocols import study
from tests.web.typed_page import parts_of

WEB = "image_size_px = [96, 96]\nopen_access = true\nmax_unconsented_per_address = 1000"
SESSIONS = count(2, 100)
FAULT_PROBABILITY = 0.03  # of each of four kinds, at each request


@pytest.fixture(autouse=True)
def _short_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(polling, "HOLD_S", 0.5)


def make_server(folder: Path, **options: Any) -> WebServer:
    path = study(folder, **{"web": WEB, **options})
    return WebServer(Arrivals(read_protocol(path), folder), folder)


@asynccontextmanager
async def page_at(server: WebServer) -> AsyncIterator[httpx.AsyncClient]:
    async with open_client(server) as client:
        yield client


def hello(**fields: object) -> str:
    return json.dumps({"t": "hello", "version": MESSAGE_VERSION, "token": "x" * 32, "stream": "a"} | fields)


def numbered(number: int, at_ns: int, **what: object) -> str:
    return json.dumps({"t": "n", "n": number, "at": at_ns, "what": what})


def name_line(number: int) -> str:
    return f"{number:032x}"


async def hear(line: PollingLine, kind: str) -> dict[str, Any]:
    """Fetch until a message of a kind came, and return it."""
    while line.end is None:
        for is_picture, part in parts_of(await line.fetch()):
            message = {} if is_picture else json.loads(part)
            message = message.get("m", message)
            if message.get("t") == kind:
                return message
    raise AssertionError(f"no {kind} came: {line.end}")


async def open_page(client: httpx.AsyncClient, number: int = 1, **fields: object) -> tuple[PollingLine, dict[str, Any]]:
    line = PollingLine(client, name_line(number))
    await line.send(hello(**fields))
    return line, await hear(line, "welcome")


def list_presses(log: Path) -> list[tuple[str, int]]:
    """Return the keys that went down, and when."""
    presses = [event for event in read_events(log) if isinstance(event, KeyPressed) and event.down]
    return [(press.key, press.t_ns - press.waited_ns) for press in presses]


def list_keys(folder: Path) -> list[str]:
    """Return the keys that went down in the one log of a folder."""
    [log] = folder.rglob("*.mcap*")
    return [key for key, _ in list_presses(log)]


@pytest.mark.parametrize("probability", [0.0, FAULT_PROBABILITY], ids=["whole", "faulty"])
@pytest.mark.nightly(sample=True)
def test_sessions_on_key_complete_over_http_with_nothing_lost_or_doubled(tmp_path: Path, probability: float) -> None:
    server = make_server(tmp_path, episodes=1, max_steps=6)
    network = Network(server, random.Random(SESSIONS), probability)
    n_sessions = SESSIONS if probability else 1
    pages: list[PollingTypedPage] = []

    async def play(client: httpx.AsyncClient, turn: asyncio.Semaphore, page: PollingTypedPage) -> None:
        async with turn:
            await page.take_part()

    async def run() -> None:
        async with open_client(server, network) as client:
            turn = asyncio.Semaphore(10)
            for number in range(n_sessions):
                pages.append(PollingTypedPage(client, number, f"{number:0>32}", keys_per_s=20))
            await asyncio.gather(*(play(client, turn, page) for page in pages))

    asyncio.run(run())
    assert [page.counts.over for page in pages] == ["complete"] * n_sessions
    logs = sorted(tmp_path.rglob("*.mcap"))
    assert len(logs) == n_sessions
    unmatched = [page.sent_presses for page in pages]
    for log in logs:
        assert list(find_log_differences(log, World)) == []
        assert read_log(log).facts["transport"] == "http"
        logged = list_presses(log)
        sent = next(presses for presses in unmatched if presses[: len(logged)] == logged)  # the rest came after the end
        unmatched.remove(sent)
    assert bool(network.faults) == bool(probability)


@pytest.mark.parametrize(
    ("headers", "body", "status"),
    [
        ({"origin": "https://evil.example"}, b"{}", 403),
        ({"origin": ""}, b"{}", 403),
        ({"content-type": "text/plain"}, b"{}", 415),
        ({}, b"x" * (polling.MAX_BODY_BYTES + 1), 413),
        ({}, b"[" * 50_000, 400),
        ({}, b'{"line": "../../x", "n": 1, "texts": ["a"]}', 400),
        ({}, json.dumps({"line": name_line(1), "n": 0, "texts": ["a"]}).encode(), 400),
        ({}, json.dumps({"line": name_line(1), "n": 1, "texts": []}).encode(), 400),
        ({}, json.dumps({"line": name_line(1), "n": 1, "texts": ["x" * 20_000]}).encode(), 400),
        ({}, json.dumps({"line": name_line(1), "n": 1}).encode(), 410),  # fetches from a line that was never opened
        ({}, json.dumps({"line": name_line(1), "n": 2, "texts": ["a"]}).encode(), 410),
    ],
)
def test_what_no_page_of_ours_sends_is_refused(
    tmp_path: Path, headers: dict[str, str], body: bytes, status: int
) -> None:
    async def ask() -> int:
        async with page_at(make_server(tmp_path)) as client:
            sent = {"content-type": "application/json"} | headers
            return (await client.post("/socket", content=body, headers=sent)).status_code

    assert asyncio.run(ask()) == status


def test_a_line_that_says_no_hello_is_ended_with_the_reason(tmp_path: Path) -> None:
    async def ask() -> dict[str, Any] | None:
        async with page_at(make_server(tmp_path)) as client:
            line = PollingLine(client, name_line(1))
            await line.send('{"t":"ping","sent":1}')
            await line.fetch()
            return line.end

    end = asyncio.run(ask())
    assert end is not None
    assert end["code"] == REFUSED
    assert "must be a hello" in end["reason"]


def test_requests_that_come_twice_change_nothing_and_get_the_same_answer(tmp_path: Path) -> None:
    server = make_server(tmp_path)

    async def play() -> None:
        async with page_at(server) as client:
            line, welcome = await open_page(client)
            text = numbered(1, welcome["now"] + 1_000, t="key", key="enter", down=True, stamp=welcome["now"] + 1_000)
            body = {"line": name_line(1), "n": 2, "texts": [text]}
            await asyncio.gather(line.post(body), line.post(body), line.post(body))
            fetch = {"line": name_line(1), "n": line._n_fetched + 1}
            first, second = await asyncio.gather(line.post(fetch), line.post(fetch))
            assert first == second == await line.post(fetch)
            assert line.end is None

    asyncio.run(play())
    assert list_keys(tmp_path) == ["enter"]


@pytest.mark.parametrize("kind", ["brings", "fetches"])
def test_a_request_out_of_turn_ends_the_line(tmp_path: Path, kind: str) -> None:
    async def play() -> dict[str, Any] | None:
        async with page_at(make_server(tmp_path)) as client:
            line, _ = await open_page(client)
            texts = {"texts": ["[]"]} if kind == "brings" else {}
            await line.post({"line": name_line(1), "n": 999, **texts})
            return line.end

    end = asyncio.run(play())
    assert end is not None
    assert end["code"] == 1006


def test_a_new_line_goes_on_where_the_old_one_was_lost(tmp_path: Path) -> None:
    """What was sent and not acknowledged is sent again, and taken once; the older line is told of the newer one."""
    server = make_server(tmp_path)

    async def play() -> None:
        async with page_at(server) as client:
            line, welcome = await open_page(client)
            now_ns = welcome["now"]
            press = {"t": "key", "key": "enter", "down": True, "stamp": now_ns + 1_000}
            await line.send(numbered(1, now_ns + 1_000, **press))
            again, renewed = await open_page(client, 2, segment=welcome["segment"], last=now_ns + 1_000)
            assert renewed["heard"] == 1
            assert (await line.fetch(), line.end) != (b"", None)
            while line.end is None:
                await line.fetch()
            assert line.end["code"] == ANOTHER
            release = {"t": "key", "key": "enter", "down": False, "stamp": now_ns + 2_000}
            await again.send(numbered(1, now_ns + 1_000, **press), numbered(2, now_ns + 2_000, **release))
            while (await hear(again, "acked"))["through"] < 2:
                pass

    asyncio.run(play())
    assert list_keys(tmp_path) == ["enter"]


def test_a_server_that_starts_anew_goes_on_with_a_page_over_http(tmp_path: Path) -> None:
    """The line's name says nothing to the new server, which sends the page to another line."""

    async def play() -> None:
        async with page_at(make_server(tmp_path)) as client:
            line, welcome = await open_page(client)
            now_ns = welcome["now"]
            press = numbered(1, now_ns + 1_000, t="key", key="enter", down=True, stamp=now_ns + 1_000)
            await line.send(press)
            assert (await hear(line, "acked"))["through"] == 1
        async with page_at(make_server(tmp_path)) as client:
            lost = PollingLine(client, name_line(1))
            lost._n_brought = lost._n_fetched = 2
            await lost.send(press)
            assert lost.end is not None
            again, renewed = await open_page(
                client, 2, token=welcome["token"], segment=welcome["segment"], last=now_ns + 1_000, first=2
            )
            assert renewed["taken"] >= now_ns + 1_000
            await again.send('{"t":"ping","sent":1}')
            await hear(again, "pong")

    asyncio.run(play())
    assert list_keys(tmp_path) == ["enter"]


def test_the_log_says_when_a_page_goes_on_by_another_transport(tmp_path: Path) -> None:
    server = make_server(tmp_path)

    async def play() -> None:
        async with page_at(server) as client:
            _, welcome = await open_page(client)
            [connection] = server.connections.values()
            connection.transport = "websocket"  # as if it had come by a socket
            again, renewed = await open_page(client, 2, segment=welcome["segment"], last=welcome["now"])
            at_ns = renewed["now"] + 1_000
            await again.send(numbered(1, at_ns, t="key", key="enter", down=True, stamp=at_ns))
            await hear(again, "acked")

    asyncio.run(play())
    [log] = tmp_path.rglob("*.mcap*")
    notes = [event.text for event in read_events(log) if isinstance(event, Noted)]
    assert "the page speaks by http from here on" in notes


REAL_TIME = 'pace = "real_time"\nstep_period_ms = 200.0\nnoop_action = "done"\ncomputed = "server"\n'


async def read_metrics(client: httpx.AsyncClient) -> dict[str, int]:
    text = (await client.get("/metrics")).text
    return {line.split()[0]: int(line.split()[1]) for line in text.splitlines() if not line.startswith("#")}


def test_a_line_too_slow_for_real_time_says_what_is_wrong_whom_to_tell_and_how_to_return(tmp_path: Path) -> None:
    server = make_server(tmp_path, episodes=1, max_steps=5, block=REAL_TIME, web=f"{WEB}\nreconnect_timeout_s = 120")

    async def play() -> tuple[PollingTypedPage, PollingTypedPage, dict[str, int]]:
        async with open_client(server) as client:
            slow = PollingTypedPage(client, 1, "x" * 32, keys_per_s=5, reported_rtt_s=0.201)
            await slow.take_part()
            quick = PollingTypedPage(client, 2, "x" * 32, keys_per_s=5, reported_rtt_s=0.199)
            await quick.take_part()
            return slow, quick, await read_metrics(client)

    slow, quick, metrics = asyncio.run(play())
    assert slow.counts.refused == "too_slow"
    for words in ("real time", "tell the researchers", "open the same link within 2 minutes from another network"):
        assert words in slow.told["words"]
    assert quick.counts.over == "complete", "the participant returns by another network"
    assert metrics["minihuman_too_slow_pages_total"] == 1
    assert metrics["minihuman_http_pages_total"] == 2
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []


def test_turns_and_what_the_page_computes_go_on_however_slow_the_line_is(tmp_path: Path) -> None:
    server = make_server(tmp_path, episodes=1, max_steps=3)

    async def play() -> PollingTypedPage:
        async with open_client(server) as client:
            page = PollingTypedPage(client, 1, "x" * 32, keys_per_s=5, reported_rtt_s=8.0)
            await page.take_part()
            return page

    assert asyncio.run(play()).counts.over == "complete"
