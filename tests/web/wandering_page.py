"""A page without a browser that is loaded again and again, from one server or another, as its outbox is kept."""

import asyncio
import contextlib
import json
import random
import time
from collections.abc import Callable
from typing import Any

from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from minihuman.web.messages import MESSAGE_VERSION
from tests.counts import PATIENCE_S
from tests.web.typed_page import FACTS, HOLD_S, Counts, TypedPage


class WanderingPage(TypedPage):
    """One participant, whose page comes to whichever server is named, as often as it is loaded.

    Args:
        find_host: the server that a page is sent to now.
        token: of their link.
        rng: decides which keys, and when the page is loaded again.
        loads: how often it is loaded on purpose.
    """

    def __init__(
        self, find_host: Callable[[], str], token: str, *, rng: random.Random, loads: int, keys_per_s: float = 4.0
    ) -> None:
        super().__init__("", token, keys_per_s=keys_per_s, rng=rng)
        self.acknowledged: list[tuple[str, int]] = []  # presses: key and time
        self.visits: list[str] = []  # hosts that welcomed it
        self._find_host = find_host
        self._loads_left = loads
        self._stream = f"{rng.getrandbits(64):x}"
        self._segment = ""
        self._unacknowledged: dict[int, str] = {}
        self._welcomed = False

    async def take_part(self) -> Counts:
        """Come again until the session is over."""
        while not self.counts.over and not self.counts.refused:
            with contextlib.suppress(OSError, WebSocketException, TimeoutError):
                await self._visit(self._find_host())
            self._zero_s = self._zero_s if self._segment else None
            await asyncio.sleep(0.2 + 0.3 * self._rng.random())
        return self.counts

    async def _visit(self, host: str) -> None:
        """One load of the page, until it is loaded again or its socket ends."""
        self._rules, self._edges, self._now, self._trail, self.screen = {}, {}, None, [], {}
        self._due_ns, self._told_due_ns, self._heard, self._heard_told = None, 0, 0, 0
        self._line, self._done, self._welcomed = asyncio.Queue(), asyncio.Event(), False
        self._held.clear()
        address, origin = f"ws://{host}/socket", f"http://{host}"
        async with connect(
            address, origin=origin, max_size=None, open_timeout=PATIENCE_S, compression=None, ping_interval=None
        ) as socket:
            first = min(self._unacknowledged, default=self._said + 1)
            hello = {"t": "hello", "version": MESSAGE_VERSION, "token": self._token, "stream": self._stream}
            kept = {"first": first, "segment": self._segment, "last": self._last_ns}
            await socket.send(json.dumps({**hello, **kept, "facts": FACTS}))
            doing = [asyncio.create_task(work) for work in (self._hear(socket), self._send(socket), self._live(socket))]
            doing.append(asyncio.create_task(socket.wait_closed()))
            if self._loads_left:
                doing.append(asyncio.create_task(self._load_again()))
            waiting = asyncio.create_task(self._done.wait())
            try:
                await asyncio.wait([*doing, waiting], return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in (*doing, waiting):
                    task.cancel()
                found = await asyncio.gather(*doing, return_exceptions=True)
        broke = [one for one in found if isinstance(one, AssertionError | KeyError | AttributeError)]
        if broke and not self._done.is_set():
            raise broke[0]
        if self._welcomed:
            self.visits.append(host)

    async def _load_again(self) -> None:
        while not self._welcomed:
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5 + 2.5 * self._rng.random())
        self._loads_left -= 1
        self._done.set()

    def say(self, *, waits: bool = False, **what: object) -> int:
        """Say something, and keep it until it is acknowledged."""
        if self._zero_s is None:
            return 0
        number = super().say(waits=waits, **what)
        at = {"t": "n", "n": number, "at": self._last_ns, "what": what}
        self._unacknowledged[number] = json.dumps(at)
        return number

    def _take_one(self, message: dict[str, Any]) -> None:
        if message.get("t") == "welcome":
            self._welcome(message)
            return
        super()._take_one(message)
        if message.get("t") == "acked":
            for number in [number for number in self._unacknowledged if number <= message["through"]]:
                what = json.loads(self._unacknowledged.pop(number))["what"]
                if what["t"] == "key" and what["down"]:
                    self.acknowledged.append((what["key"], what["stamp"]))

    def _welcome(self, welcome: dict[str, Any]) -> None:
        """As the page's own outbox takes over a server's time and numbers."""
        if welcome["segment"] != self._segment:
            self._unacknowledged.clear()
            self._segment, self._last_ns, self._said = welcome["segment"], 0, welcome["heard"]
            self._zero_s = time.monotonic() - welcome["now"] / 1e9
        assert self._zero_s is not None
        if abs((time.monotonic() - self._zero_s) * 1e9 - welcome["now"]) > 2e9:
            self._zero_s = time.monotonic() - max(welcome["now"], self._last_ns + 1) / 1e9
        if welcome["heard"] > self._said:
            self._said, self._last_ns = welcome["heard"], max(self._last_ns, welcome["taken"])
        for number in sorted(self._unacknowledged):
            if number > welcome["heard"]:
                self._line.put_nowait((0.0, self._unacknowledged[number]))
        self._welcomed = True
        if self._last_ns == 0:
            self.say(t="tick")

    async def _live(self, socket: Any) -> None:
        while not self._welcomed:
            await asyncio.sleep(0.02)
        ticking = asyncio.create_task(self._tick(socket))
        try:
            while True:
                await asyncio.sleep(self._between_s * (0.6 + 0.8 * self._rng.random()))
                if self.screen:
                    await (self._step() if self._now is not None else self._go_on())
                    await asyncio.sleep(HOLD_S)
        finally:
            ticking.cancel()
