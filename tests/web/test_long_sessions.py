"""People who play for an hour: a server's memory is after an hour what it was after five minutes.

The server is the real one, with its tasks, its disk and its threads; its clock is the pages', which goes on as fast as
all of them can act. MINIHUMAN_NIGHTLY=1 takes the whole hour, and prints the memory of each five minutes;
MINIHUMAN_PEOPLE=200 takes all of them, in ten minutes of CPU time.
"""

import asyncio
import gc
import json
import os
import random
from pathlib import Path
from typing import Any

import msgspec
import pytest

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.storage.system import System, SystemClock, use_system
from minihuman.web.arrivals import Arrivals
from minihuman.web.messages import MESSAGE_VERSION, EpisodeRules, TransportName, WorldPosition
from minihuman.web.server.app import WebServer
from minihuman.web.server.page_transport import PageTransport, SocketClosedError
from minihuman.worlds.source_digest import kernels_digest
from tests.counts import count
from tests.web.page_steps import PageSteps
from tests.web.protocols import GRID, study
from tests.web.typed_page import FACTS, encode, parts_of

pytestmark = [pytest.mark.program, pytest.mark.nightly]
S = 1_000_000_000
MS = 1_000_000
PEOPLE = int(os.environ.get("MINIHUMAN_PEOPLE", count(10, 20)))
MINUTES = count(15, 60)
SETTLED_MINUTES = 5
KEYS_PER_S = 2
GROWTH = 1.25
MAX_UNACKNOWLEDGED = 30  # messages of a page: those of five seconds


class SharedClock(SystemClock):
    """The time of the server and of all pages, which a test moves."""

    def __init__(self) -> None:
        self.now_ns = S
        self._began_ns = super().wall_ns()

    def wall_ns(self) -> int:
        return self._began_ns + self.now_ns

    def monotonic_ns(self) -> int:
        return self.now_ns


class MemoryPage(PageTransport):
    """One participant's page in the server's own process, which computes the steps of its episodes.

    Args:
        clock: the time.
        token: of their link.
        rng: decides which keys.
    """

    name: TransportName = "websocket"

    def __init__(self, clock: SharedClock, token: str, rng: random.Random) -> None:
        self.presses = 0
        self.acknowledged = 0  # through this message
        self.said = 0
        self.over = ""
        self._clock = clock
        self._rng = rng
        self._texts: asyncio.Queue[str] = asyncio.Queue()
        self._zero_ns: int | None = None
        self._last_ns = 0
        self._heard = 0
        self._steps: PageSteps | None = None
        self._trail: list[tuple[int, int]] = []  # message and action of what is not acknowledged
        self.kind = ""  # of its screen; "" before the first
        hello = {"t": "hello", "version": MESSAGE_VERSION, "token": token, "stream": token, "platform": {}}
        self._texts.put_nowait(json.dumps({**hello, "facts": FACTS, "kernels": kernels_digest()}))

    async def receive(self) -> str:
        if self.over:
            raise SocketClosedError
        return await self._texts.get()

    async def send(self, message: str | bytes) -> None:
        if isinstance(message, str):
            self._take(json.loads(message))
            return
        for is_picture, part in parts_of(message):
            if is_picture:
                self._heard = int.from_bytes(part[:4], "little")
            else:
                self._take(json.loads(part))

    async def close(self, code: int, reason: str = "") -> None:
        self.over = self.over or f"closed: {code} {reason}"

    def act(self) -> None:
        """Press a key and let it go: one that makes a step where the page plays, else Enter."""
        if self._zero_ns is None or not self.kind:
            return
        lines = [json.dumps({"t": "heard", "n": self._heard})]
        steps = self._steps
        pressed: dict[str, Any] = {"t": "key", "key": "enter", "down": True, "stamp": self._now_ns()}
        if self.kind == "play" and (steps is None or steps.ended):
            lines.append(self._say(t="tick"))
        elif self.kind == "play" and steps is not None:
            key = self._rng.choice(sorted(steps.rules.actions))
            action = steps.rules.actions[key]
            lines.append(self._say(**{**pressed, "key": key, "digest": steps.act(action)}))
            self._trail.append((self.said, action))
            now_ns = self._now_ns()
            lines.append(self._say(t="shown", submit=now_ns, flip=now_ns, episode=steps.rules.episode, step=steps.step))
            lines.append(self._say(**{**pressed, "key": key, "down": False, "stamp": self._now_ns()}))
            self.presses += 1
        else:
            lines.append(self._say(**pressed))
            lines.append(self._say(**{**pressed, "down": False, "stamp": self._now_ns()}))
            lines.append(self._say(t="tick"))
        self._texts.put_nowait("\n".join(lines))

    def _now_ns(self) -> int:
        assert self._zero_ns is not None
        return max(self._last_ns + 1000, (self._clock.now_ns - self._zero_ns) // 1000 * 1000)

    def _say(self, **what: Any) -> str:
        self.said += 1
        self._last_ns = self._now_ns()
        return encode(self.said, self._last_ns, what)

    def _take(self, message: dict[str, Any]) -> None:
        if "n" in message:
            self._heard = message["n"]
            message = message["m"]
        match message["t"]:
            case "welcome":
                self._zero_ns = self._clock.now_ns - message["now"]
                self._texts.put_nowait(self._say(t="tick"))
            case "acked":
                self.acknowledged = message["through"]
                self._trail = [act for act in self._trail if act[0] > self.acknowledged]
            case "rules":
                content = {name: field for name, field in message.items() if name != "t"}
                self._steps = PageSteps(GRID[0], msgspec.convert(content, EpisodeRules))
            case "state":
                self._follow(message)
            case "screen":
                self.kind = message["screen"]["kind"]
                if self.kind != "play":
                    now_ns = self._now_ns()
                    self._texts.put_nowait(self._say(t="shown", submit=now_ns, flip=now_ns, screen=message["id"]))
            case "over" | "refused":
                self.over = message["t"]

    def _follow(self, message: dict[str, Any]) -> None:
        """Go where the server is, and from there where the keys lead that it has not had."""
        assert self._steps is not None
        self._steps.place(msgspec.convert(message["state"], WorldPosition))
        for number, action in self._trail:
            if number > message["through"]:
                self._steps.act(action)


def measure_memory_mb() -> float:
    """Return the resident memory of this process, MB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def play(folder: Path, minutes: int) -> tuple[list[float], list[MemoryPage]]:
    """Let everyone play; return the memory after each five minutes, and the pages."""
    clock = SharedClock()
    with use_system(System(clock=clock)):
        web = "image_size_px = [96, 96]\nmax_concurrent_sessions = 1000"
        path = study(folder, episodes=500, max_steps=100, block='computed = "page"', web=web)
        server = WebServer(Arrivals(decode_protocol(path.read_bytes()), folder), folder)
        tokens = server._arrivals.recruits.issue(PEOPLE)
        pages = [MemoryPage(clock, token, random.Random(number)) for number, token in enumerate(tokens)]
        memory_mb = []
        async with server._lifespan(None):  # type: ignore[arg-type] # it does not look at its application
            talking = [asyncio.create_task(server._converse(page, "192.0.2.1")) for page in pages]
            while not all(page.kind or page.over for page in pages):
                await asyncio.sleep(0.01)
            for moment in range(minutes * 60 * KEYS_PER_S):
                clock.now_ns += S // KEYS_PER_S
                for page in pages:
                    page.act()
                    await asyncio.sleep(0)
                await wait_for_disk(pages)
                if (moment + 1) % (SETTLED_MINUTES * 60 * KEYS_PER_S) == 0:
                    memory_mb.append(measure_memory_mb())
                    print(f"{(moment + 1) // (60 * KEYS_PER_S)} min: {memory_mb[-1]:.0f} MB", flush=True)
            for task in talking:
                task.cancel()
            await asyncio.gather(*talking, return_exceptions=True)
    return memory_mb, pages


async def wait_for_disk(pages: list[MemoryPage]) -> None:
    """Wait until nearly all that the pages said is acknowledged: as quick as they are, no disk is."""
    while any(page.acknowledged < page.said - MAX_UNACKNOWLEDGED and not page.over for page in pages):
        await asyncio.sleep(0.01)


def test_the_memory_of_a_server_does_not_grow_with_the_length_of_its_sessions(tmp_path: Path) -> None:
    memory_mb, pages = asyncio.run(play(tmp_path, MINUTES))
    presses = sum(page.presses for page in pages)
    print(
        f"{PEOPLE} people, {MINUTES} min, {presses} steps: {memory_mb[0]:.0f} MB after {SETTLED_MINUTES} min, "
        f"{memory_mb[-1]:.0f} MB at the end, at most {max(memory_mb):.0f} MB"
    )
    assert [page.over for page in pages if page.over] == []
    assert presses > PEOPLE * MINUTES * 60 * KEYS_PER_S / 2
    assert max(memory_mb) <= GROWTH * memory_mb[0]
