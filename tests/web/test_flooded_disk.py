"""One page at full rate for ten minutes, on a small disk beside twenty who play: it is ended, and they lose nothing.

The minutes are those of a shared clock; the disk is real, and so is the server with its limits.
"""

import asyncio
import random
from pathlib import Path

import pytest

from minihuman.experiment.machine.events import Event, KeyPressed, SessionEnded
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.disk import RESERVE_BYTES
from minihuman.storage.system import System, use_system
from minihuman.web.arrivals import Arrivals
from minihuman.web.server.app import WebServer
from minihuman.web.traffic_limits import MESSAGES_PER_S
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.disks import small_disk
from tests.web.memory_page import MemoryPage, S, SharedClock, wait_for_disk
from tests.web.protocols import study

pytestmark = [pytest.mark.program, pytest.mark.nightly(sample=True)]
PEOPLE = count(3, 20)
MINUTES = count(2, 10)
TURNS_PER_S = 2
ROOM_BYTES = 20_000_000
MOST_WRITTEN_BYTES = 5_000_000
TEXT_BYTES = 400


class FloodingPage(MemoryPage):
    """A page whose extension types for ever, as fast as the server takes it."""

    def __init__(self, clock: SharedClock, token: str, rng: random.Random) -> None:
        super().__init__(clock, token, rng)
        self.sent_bytes = 0

    def act(self) -> None:
        super().act()
        if self.over or not self.kind:
            return
        texts = [self._rng.randbytes(TEXT_BYTES // 2).hex() for _ in range(int(MESSAGES_PER_S / TURNS_PER_S) - 10)]
        lines = [self._say(t="typed", text=text) for text in texts]
        for line in lines:
            self._texts.put_nowait(line)
            self.sent_bytes += len(line)


async def flood(folder: Path) -> tuple[FloodingPage, list[MemoryPage]]:
    """Let everyone play beside the page that floods; return it and the others."""
    clock = SharedClock()
    with use_system(System(clock=clock)):
        web = "image_size_px = [96, 96]\nmax_concurrent_sessions = 40"
        path = study(folder, episodes=100, max_steps=100, block='computed = "page"', web=web)
        server = WebServer(Arrivals(decode_protocol(path.read_bytes()), folder), folder)
        tokens = server._arrivals.recruits.issue(PEOPLE + 1)
        flooding = FloodingPage(clock, tokens[0], random.Random(0))
        others = [MemoryPage(clock, token, random.Random(number)) for number, token in enumerate(tokens[1:], 1)]
        pages = [flooding, *others]
        async with server._lifespan(None):  # type: ignore[arg-type] # it does not look at its application
            talking = [asyncio.create_task(server._converse(page, f"192.0.2.{n}")) for n, page in enumerate(pages, 1)]
            while not all(page.kind or page.over for page in pages):
                await asyncio.sleep(0.01)
            for _ in range(MINUTES * 60 * TURNS_PER_S):
                clock.now_ns += S // TURNS_PER_S
                for page in pages:
                    page.act()
                    await asyncio.sleep(0)
                await wait_for_disk(others, clock)
                while flooding.acknowledged < flooding.said - MESSAGES_PER_S and not flooding.over:
                    await asyncio.sleep(0.01)  # the server takes its messages at the rate that it allows
            while any(page.acknowledged_presses < page.presses and not page.over for page in others):
                clock.now_ns += S // TURNS_PER_S  # some of what a session does is due later
                await asyncio.sleep(0.01)
            for task in talking:
                task.cancel()
            await asyncio.gather(*talking, return_exceptions=True)
    return flooding, others


def read_logs(folder: Path) -> dict[Path, list[Event]]:
    """Return the events of each log, finished or not; fail if one does not replay."""
    logs = {log: list(read_events(log)) for log in sorted(folder.rglob("*.mcap*"))}
    assert [problem for events in logs.values() for problem in compare_replay(events, World)] == []
    return logs


def count_presses(events: list[Event]) -> int:
    return sum(isinstance(event, KeyPressed) for event in events)


def is_flooded(events: list[Event]) -> bool:
    return any(isinstance(event, SessionEnded) and "sent more than" in event.detail for event in events)


def test_a_page_that_floods_a_disk_is_ended_and_its_neighbours_lose_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    with small_disk(folder, RESERVE_BYTES + ROOM_BYTES):
        flooding, others = asyncio.run(flood(folder))
        logs = read_logs(folder)
        [flooded] = [log for log, events in logs.items() if is_flooded(events)]
        written_bytes = flooded.stat().st_size
    presses = sum(count_presses(events) for log, events in logs.items() if log != flooded)
    print(
        f"{PEOPLE} people, {MINUTES} min, {ROOM_BYTES} bytes of room: the page sent {flooding.sent_bytes} bytes, "
        f"its log has {written_bytes}, the others' {presses} presses; it was told: {flooding.ending}"
    )
    assert written_bytes < MOST_WRITTEN_BYTES
    assert flooding.ending["end"] == "broken"
    assert flooding.ending["code"]
    assert len(logs) == PEOPLE + 1
    assert [page.over for page in others if page.over] == []
    assert sum(page.acknowledged_presses for page in others) == sum(page.presses for page in others) <= presses
    assert presses > PEOPLE * MINUTES * 60


@pytest.mark.nightly
def test_on_a_disk_that_is_too_small_for_all_everybody_is_told_and_what_was_acknowledged_is_there(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "disk"
    folder.mkdir()
    with small_disk(folder, ROOM_BYTES):  # the reserve leaves some three megabytes of it
        flooding, others = asyncio.run(flood(folder))
        logs = read_logs(folder)
    ended = [page for page in (flooding, *others) if page.over]
    presses = sum(map(count_presses, logs.values()))
    print(f"{PEOPLE} people, a disk of {ROOM_BYTES} bytes: {len(ended)} sessions ended, {presses} presses in the logs")
    assert ended
    assert all(page.ending["end"] == "broken" and page.ending["code"] for page in ended)
    acknowledged = sum(page.acknowledged_presses for page in (flooding, *others))
    assert 0 < acknowledged <= presses
