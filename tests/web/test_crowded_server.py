"""A server with little room, a disk of 20 MB or 1,024 files and sockets: who abuses it ends alone.

MINIHUMAN_NIGHTLY=1 takes ten minutes of a page at full rate beside 20 people, and 400 half requests beside 200.
"""

import asyncio
import json
import random
import re
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Origin

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed, SessionEnded
from minihuman.log.read.session_reader import read_events
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.disks import small_disk
from tests.web.served import Served, served
from tests.web.typed_page import FACTS, TypedPage, parts_of

pytestmark = [pytest.mark.program, pytest.mark.nightly]
WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
DISK_BYTES = 20_000_000
FLOOD_S = count(20, 600)
NEIGHBOURS = count(4, 20)
ABUSER_BYTES = 5_000_000
HALF_AGAIN_S = 5.0  # they are to take files, not the processor that the server shares with them
PRESSES = count(4, 8)  # of each, before there are half requests, beside them, and with a newcomer


class RecordingPage(TypedPage):
    """A participant who keeps what they pressed, and which presses were acknowledged."""

    def __init__(self, host: str, token: str, *, number: int, keys_per_s: float) -> None:
        super().__init__(host, token, keys_per_s=keys_per_s, rng=random.Random(number), computes=WORLD)
        self.unacknowledged: dict[int, tuple[str, int]] = {}  # by message: key and time
        self.acknowledged: Counter[tuple[str, int]] = Counter()

    def say(self, *, waits: bool = False, **what: object) -> int:
        """Say something, and remember a press."""
        number = super().say(waits=waits, **what)
        if what["t"] == "key" and what["down"]:
            self.unacknowledged[number] = str(what["key"]), int(what["stamp"])  # type: ignore[call-overload]
        return number

    def _take_one(self, message: dict[str, Any]) -> None:
        super()._take_one(message)
        if message.get("t") == "acked":
            for number in [number for number in self.unacknowledged if number <= message["through"]]:
                self.acknowledged[self.unacknowledged.pop(number)] += 1


class FloodingPage:
    """A page that agrees, and then types as much as the server lets it, whatever it is told.

    Args:
        host: of the server.
        token: of its link.
    """

    def __init__(self, host: str, token: str) -> None:
        self.sent_bytes = 0
        self.welcomes = 0
        self.told: dict[str, Any] = {}  # at the end
        self._host = host
        self._token = token
        self._next = 1
        self._now_ns = 0

    async def flood(self, seconds: float) -> None:
        """Come again and again."""
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            with suppress(OSError, WebSocketException, TimeoutError):
                await self._visit(until_s)
            await asyncio.sleep(0.2)

    async def _visit(self, until_s: float) -> None:
        origin = Origin(f"http://{self._host}")
        async with connect(f"ws://{self._host}/socket", origin=origin, compression=None, max_size=None) as socket:
            hello = {"t": "hello", "version": MESSAGE_VERSION, "token": self._token, "facts": FACTS}
            await socket.send(json.dumps({**hello, "platform": {}, "stream": f"s{self.welcomes}"}))
            reading = asyncio.create_task(self._read(socket))
            try:
                await asyncio.sleep(1.0)
                began_s, began_ns = time.monotonic(), self._now_ns
                await self._say(socket, began_ns + 1_000, {"t": "tick"})
                await self._say(socket, began_ns + 2_000, {"t": "key", "key": "enter", "down": True, "stamp": began_ns})
                while time.monotonic() < until_s:
                    at_ns = began_ns + round((time.monotonic() - began_s) * 1e9) + 10_000 * self._next
                    await self._say(socket, at_ns, {"t": "typed", "text": "x" * 2_000})
            finally:
                reading.cancel()
                await asyncio.gather(reading, return_exceptions=True)

    async def _say(self, socket: ClientConnection, at_ns: int, what: dict[str, Any]) -> None:
        text = json.dumps({"t": "n", "n": self._next, "at": at_ns, "what": what})
        self._next += 1
        self.sent_bytes += len(text)
        await socket.send(text)

    async def _read(self, socket: ClientConnection) -> None:
        with suppress(ConnectionClosed):
            async for batch in socket:
                texts: Iterable[str | bytes] = [batch]
                if isinstance(batch, bytes):
                    texts = [part for is_picture, part in parts_of(batch) if not is_picture]
                for text in texts:
                    self._take(json.loads(text))

    def _take(self, message: dict[str, Any]) -> None:
        message = message.get("m", message)
        if message["t"] == "welcome":
            self.welcomes += 1
            self._next = message["heard"] + 1
            self._now_ns = message["now"]
        elif message["t"] == "over":
            self.told = message


async def measure_largest(folder: Path) -> int:
    """Watch a participant's folder until the task is cancelled; return the most bytes that its files had."""
    largest = 0
    with suppress(asyncio.CancelledError):
        while True:
            sizes = []
            for path in folder.rglob("*"):
                with suppress(FileNotFoundError):
                    sizes.append(path.stat().st_size)
            largest = max(largest, sum(sizes))
            await asyncio.sleep(0.5)
    return largest


async def play_beside_flood(server: Served, data: Path) -> tuple[FloodingPage, list[RecordingPage], int]:
    """Let one page flood and the others play; return all of them, and the most bytes that the first had on the disk."""
    flooding = FloodingPage(server.host, server.links[0])
    flood = asyncio.create_task(flooding.flood(FLOOD_S))
    while not (folders := list((data / "walk").glob("sub-*"))):
        await asyncio.sleep(0.1)
    [first] = folders
    watching = asyncio.create_task(measure_largest(first))
    pages = [
        RecordingPage(server.host, token, number=number, keys_per_s=2.0)
        for number, token in enumerate(server.links[1:])
    ]
    playing = [asyncio.create_task(page.take_part()) for page in pages]
    await flood
    for page in pages:
        page.enough = True
    await asyncio.wait_for(asyncio.gather(*playing), PATIENCE_S)
    watching.cancel()
    return flooding, pages, await watching


def test_a_page_at_full_rate_on_a_small_disk_is_ended_and_its_neighbours_lose_nothing(tmp_path: Path) -> None:
    data = tmp_path / "data"
    data.mkdir()
    with (
        small_disk(data, DISK_BYTES),
        served(tmp_path, links=1 + NEIGHBOURS, episodes=100, web='codes = { complete = "C1" }') as server,
    ):
        flooding, pages, largest_bytes = asyncio.run(play_beside_flood(server, data))
        server.process.terminate()
        server.process.wait(timeout=PATIENCE_S)
        logs = {path.name.partition("_")[0]: path for path in data.rglob("*.mcap*")}
        flooded = [log for log in logs.values() if "the page sent more than" in read_end(log)]
        ends = Counter(page.counts.over or "left" for page in pages)
        print(
            f"{FLOOD_S} s: {flooding.sent_bytes / 1e6:.1f} MB sent in {flooding.welcomes} visits, "
            f"at most {largest_bytes / 1e6:.2f} MB on the disk; {NEIGHBOURS} neighbours: {dict(ends)}, "
            f"{sum(page.acknowledged.total() for page in pages)} presses acknowledged"
        )
        assert len(flooded) == 1
        assert largest_bytes < ABUSER_BYTES
        assert flooding.told["code"]
        assert "stop" in flooding.told["words"]
        found = {participant: count_presses(log) for participant, log in logs.items()}
        for page in pages:
            assert page.counts.refused == ""
            check_ending(page, max(found.values(), key=lambda presses: (presses & page.acknowledged).total()))
        for log in logs.values():
            assert list(find_log_differences(log, World)) == []


def read_end(log: Path) -> str:
    """The details of a session's end; "" while it goes on."""
    return "".join(event.detail for event in read_events(log) if isinstance(event, SessionEnded))


def count_presses(log: Path) -> Counter[tuple[str, int]]:
    """The presses in a log: key and time."""
    events = (event for event in read_events(log) if isinstance(event, KeyPressed) and event.down)
    return Counter((event.key, event.t_ns - event.waited_ns) for event in events)


def check_ending(page: RecordingPage, logged: Counter[tuple[str, int]]) -> None:
    """Compare what a page was told with what the log has."""
    assert page.acknowledged - logged == Counter(), "an acknowledged press is lost"
    if page.counts.over == "":
        assert not page.unacknowledged
        return
    assert page.told["code"], page.told
    assert page.counts.over in ("complete", "broken"), page.told
    missing = Counter(page.unacknowledged.values()) - logged
    before_end = [press for press in missing if press[1] <= max((stamp for _, stamp in logged), default=0)]
    unsaved = re.search(r"\d+", page.told["words"])
    assert len(before_end) <= (int(unsaved[0]) if unsaved else 0), page.told


class HalfRequests:
    """Connections that send half a request, and again some seconds after they were closed.

    Args:
        host: of the server.
        number: how many at once.
    """

    def __init__(self, host: str, number: int) -> None:
        self.opened = self.refused = 0
        self._address = host.split(":")
        self._tasks = [asyncio.create_task(self._stay()) for _ in range(number)]

    async def _stay(self) -> None:
        while True:
            try:
                reader, writer = await asyncio.open_connection(self._address[0], int(self._address[1]))
            except OSError:
                self.refused += 1
                await asyncio.sleep(0.5)
                continue
            self.opened += 1
            try:
                writer.write(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Half: ")
                with suppress(OSError):
                    await reader.read(65_536)
            finally:
                writer.transport.abort()
            await asyncio.sleep(HALF_AGAIN_S)

    async def stop(self) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        await asyncio.sleep(0.1)  # in which the sockets are closed


async def let_all_press(pages: list[RecordingPage], presses: int) -> None:
    """Wait until each page has pressed so many keys more, or has ended."""
    goals = [(page, page.counts.presses + presses) for page in pages]
    until_s = time.monotonic() + PATIENCE_S
    while any(page.counts.presses < goal and not (page.counts.over or page.counts.refused) for page, goal in goals):
        assert time.monotonic() < until_s, [page.counts for page in pages]
        await asyncio.sleep(0.1)


async def play_beside_half_requests(
    server: Served, number: int
) -> tuple[list[RecordingPage], HalfRequests, list[float], list[float]]:
    """Let everyone play, first alone and then beside half requests; return both times' acknowledgements, in s."""
    pages = [
        RecordingPage(server.host, token, number=place, keys_per_s=1.0) for place, token in enumerate(server.links[:-1])
    ]
    playing = []
    for page in pages:
        playing.append(asyncio.create_task(page.take_part()))
        await asyncio.sleep(0.05)
    await let_all_press(pages, PRESSES)
    alone_s = [s for page in pages for s in page.counts.acked_s]
    for page in pages:
        page.counts.acked_s.clear()
    half = HalfRequests(server.host, number)
    await let_all_press(pages, PRESSES)
    late = RecordingPage(server.host, server.links[-1], number=len(pages), keys_per_s=2.0)
    pages.append(late)
    playing.append(asyncio.create_task(late.take_part()))
    await let_all_press(pages, PRESSES)
    for page in pages:
        page.enough = True
    await asyncio.wait_for(asyncio.gather(*playing), PATIENCE_S)
    beside_s = [s for page in pages for s in page.counts.acked_s]
    await half.stop()
    return pages, half, alone_s, beside_s


@pytest.mark.parametrize(
    ("limit", "people"), [("1024:4096", count(8, 200)), ("1024:1024", count(8, 164))], ids=["raised", "hard"]
)
@pytest.mark.parametrize("number", [400, 1_500])
def test_half_requests_cost_no_participant_anything(tmp_path: Path, limit: str, people: int, number: int) -> None:
    web = f"max_concurrent_sessions = {people + 1}"
    before = ("prlimit", f"--nofile={limit}")
    with served(tmp_path, links=people + 1, episodes=1_000, web=web, before=before) as server:
        pages, half, alone_s, beside_s = asyncio.run(play_beside_half_requests(server, number))
        complaints = server.complaints()
    alone_ms, beside_ms = (np.percentile(times_s, (50, 95)) * 1e3 for times_s in (alone_s, beside_s))
    print(
        f"{people} people, {number} half requests at once, {half.opened} in all, limit {limit}: acknowledged after "
        f"{alone_ms[0]:.0f} ms (95 %: {alone_ms[1]:.0f}) alone, {beside_ms[0]:.0f} ms ({beside_ms[1]:.0f}) beside them"
    )
    assert [page.counts.refused for page in pages if page.counts.refused] == []
    assert [page.told for page in pages if page.counts.over] == []
    assert all(page.counts.presses >= PRESSES and not page.unacknowledged for page in pages)
    assert complaints == ""
