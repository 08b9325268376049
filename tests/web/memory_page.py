"""Participants' pages in the process of the server, on a clock that a test moves as fast as all of them can act."""

import asyncio
import json
import random
from collections.abc import Sequence
from typing import Any

import msgspec

from minihuman.storage.system import SystemClock
from minihuman.web.messages import MESSAGE_VERSION, EpisodeRules, TransportName, WorldPosition
from minihuman.web.server.page_transport import PageTransport, SocketClosedError
from minihuman.worlds.source_digest import kernels_digest
from tests.web.page_steps import PageSteps
from tests.web.protocols import GRID
from tests.web.typed_page import FACTS, encode, parts_of

S = 1_000_000_000
WAIT_S = 0.01  # between two looks at what is acknowledged
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
        self.ending: dict[str, Any] = {}  # the last message of a session that is over
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

    @property
    def acknowledged_presses(self) -> int:
        """How many presses the server has said to be on its disk."""
        return self.presses - len(self._trail)

    def act(self) -> None:
        """Press a key and let it go: one that makes a step where the page plays, else Enter."""
        if self._zero_ns is None or not self.kind or self.over:
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
                self.ending = message

    def _follow(self, message: dict[str, Any]) -> None:
        """Go where the server is, and from there where the keys lead that it has not had."""
        assert self._steps is not None
        self._steps.place(msgspec.convert(message["state"], WorldPosition))
        for number, action in self._trail:
            if number > message["through"]:
                self._steps.act(action)


async def wait_for_disk(pages: Sequence[MemoryPage], clock: SharedClock) -> None:
    """Wait until nearly all that the pages said is acknowledged: as quick as they are, no disk is.

    Time goes on meanwhile, so that a server that gives a session up after a while does so.
    """
    while any(page.acknowledged < page.said - MAX_UNACKNOWLEDGED and not page.over for page in pages):
        await asyncio.sleep(WAIT_S)
        clock.now_ns += int(WAIT_S * S)
