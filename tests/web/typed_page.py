"""A page without a browser: says what the real one says, presses keys at a rate, and counts.

It goes ahead of the server as the page does: a press whose scene is known is shown at once. What comes with every key
has the page's short form, and it asks for the time as often as the page does.
"""

import asyncio
import json
import random
import struct
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from typing import Any

import msgspec
from websockets.asyncio.client import ClientConnection, connect

from minihuman.web.messages import MESSAGE_VERSION, EpisodeRules, WorldPosition
from minihuman.worlds.source_digest import kernels_digest
from tests.counts import PATIENCE_S
from tests.web.page_steps import PageSteps

FACTS = {"browser": "Chromium", "browser_version": "156", "window_px": "1366 x 768", "mouse": True, "touch": False}
HOLD_S = 0.08
HEARD_S = 1.0  # so often a page says what it has heard, if there is more,
MOST_UNTOLD = 100  # or when there is so much more
FLIP_S = 0.008  # from a picture's being known to its being seen
WAIT_S, COMPUTED_WAIT_S = 0.1, 2.0  # how long what can wait does, at most
MOST_UNSENT = 64  # or so many messages
PING_S, PATIENT_S, REPORT_S = 2.5, 4.5, 10.0  # a ping goes with other messages, or by itself after so long


@dataclass
class Counts:
    """What one page did and saw."""

    presses: int = 0  # in episodes
    others: int = 0  # outside of them
    steps: int = 0
    ahead: int = 0  # presses whose picture was there
    bytes: int = 0  # that came over the line
    sent_bytes: int = 0
    acked_s: list[float] = field(default_factory=list)  # from a press to its being on the disk
    over: str = ""  # how it ended
    refused: str = ""


class TypedPage:
    """One participant.

    Args:
        host: "127.0.0.1:8000".
        token: of their link.
        keys_per_s: how often they press.
        rtt_s: how long the line takes, there and back.
        rng: decides which keys.
        platform: the parameters of a recruiting platform's link.
        most_presses: after so many they leave, if the session is not over.
        computes: the world whose episodes the page computes; "" for none.
    """

    def __init__(
        self,
        host: str,
        token: str,
        *,
        keys_per_s: float = 2.0,
        rtt_s: float = 0.0,
        rng: random.Random | None = None,
        platform: dict[str, str] | None = None,
        most_presses: int = 10**9,
        computes: str = "",
    ) -> None:
        self.counts = Counts()
        self.told: dict[str, Any] = {}  # at the end
        self.idle = False  # they press nothing at all
        self.declines = False  # they do not agree
        self.enough = False  # they press no more, and leave when all is acknowledged
        self.screen: dict[str, Any] = {}
        self._host, self._token = host, token
        self._between_s, self._line_s = 1 / keys_per_s, rtt_s / 2
        self._rng = rng or random.Random(0)
        self._platform = platform or {}
        self._most_presses = most_presses
        self._computes = computes
        self.steps: PageSteps | None = None  # of the episode that it computes
        self._zero_s: float | None = None
        self._last_ns = self._said = self._heard = 0
        self._heard_told = self._acked = 0
        self._sent_s: dict[int, float] = {}  # presses that are not acknowledged
        self._rules: dict[int, dict[str, Any]] = {}
        self._edges: dict[
            tuple[int, int, int], tuple[int, bool]
        ] = {}  # episode, scene, action -> scene, whether it ends
        self._now: dict[str, Any] | None = None
        self._seen: tuple[int, int, int] | None = None  # episode, step and scene of a team's picture
        self._trail: list[tuple[int, int]] = []  # message and action of what is not confirmed
        self._due_ns: int | None = None
        self._told_due_ns = 0
        self._pinged_s = self._reported_s = 0.0
        self._line: asyncio.Queue[tuple[float, str]] = asyncio.Queue()
        self._held: list[str] = []
        self._flushing: asyncio.TimerHandle | None = None
        self._done = asyncio.Event()

    async def take_part(self) -> Counts:
        """Take part, to the end of the session or of the presses."""
        async with self.open_socket() as socket:
            hello = {"t": "hello", "version": MESSAGE_VERSION, "token": self._token, "platform": self._platform}
            hello |= {"kernels": kernels_digest() if self._computes else ""}
            await socket.send(json.dumps({**hello, "stream": f"{id(self):x}", "facts": FACTS}))
            doing = [asyncio.create_task(work) for work in (self._hear(socket), self._send(socket), self._live(socket))]
            waiting = asyncio.create_task(self._done.wait())
            try:
                await asyncio.wait([*doing, waiting], return_when=asyncio.FIRST_COMPLETED)
            finally:
                for task in (*doing, waiting):
                    task.cancel()
                found = await asyncio.gather(*doing, return_exceptions=True)
            broke = [one for one in found if isinstance(one, Exception)]
            if broke and not self._done.is_set():
                raise broke[0]
        return self.counts

    def open_socket(self) -> AbstractAsyncContextManager[Any]:
        """Open what the page speaks by."""
        address, origin = f"ws://{self._host}/socket", f"http://{self._host}"
        quiet = {
            "compression": None,
            "ping_interval": None,
        }  # a ping draws from `random`, which Hypothesis watches over
        return connect(address, origin=origin, max_size=None, open_timeout=PATIENCE_S, **quiet)

    # What is said

    def _now_ns(self) -> int:
        assert self._zero_s is not None
        return max(self._last_ns + 1000, 1000 * round((time.monotonic() - self._zero_s) * 1e6))

    def say(self, *, waits: bool = False, **what: object) -> int:
        """Say something, numbered; what ``waits`` goes with what is said next, if that is soon."""
        self._said += 1
        self._last_ns = self._now_ns()
        self._held.append(encode(self._said, self._last_ns, what))
        if not waits or len(self._held) >= MOST_UNSENT:
            self._flush()
        elif self._flushing is None:
            wait_s = COMPUTED_WAIT_S if self.steps else WAIT_S
            self._flushing = asyncio.get_running_loop().call_later(wait_s, self._flush)
        return self._said

    def _flush(self) -> None:
        if self._flushing is not None:
            self._flushing.cancel()
            self._flushing = None
        self._put("\n".join([*self._ping(PING_S), *self._held]))
        self._held.clear()

    def _put(self, text: str) -> None:
        self._line.put_nowait((time.monotonic() + self._line_s, text))

    def _ping(self, after_s: float) -> list[str]:
        """A ping, if the last one was so long ago."""
        if time.monotonic() < self._pinged_s + after_s:
            return []
        self._pinged_s = time.monotonic()
        return [json.dumps({"t": "ping", "sent": self._now_ns()}, separators=(",", ":"))]

    async def _send(self, socket: ClientConnection) -> None:
        while True:
            due_s, text = await self._line.get()
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            self.counts.sent_bytes += len(text)
            await socket.send(text)

    async def _press(self, key: str) -> None:
        self.say(t="key", key=key, down=True, stamp=self._now_ns())
        self.counts.others += 1
        await asyncio.sleep(HOLD_S)
        self.say(t="key", key=key, down=False, stamp=self._now_ns())

    # What is heard

    async def _hear(self, socket: ClientConnection) -> None:
        arriving: asyncio.Queue[tuple[float, str | bytes]] = asyncio.Queue()

        async def read() -> None:
            async for data in socket:
                arriving.put_nowait((time.monotonic() + self._line_s, data))
            arriving.put_nowait((0.0, ""))

        reading = asyncio.create_task(read())
        try:
            while True:
                due_s, data = await arriving.get()
                if data == "":
                    self._done.set()
                    return
                await asyncio.sleep(max(0.0, due_s - time.monotonic()))
                self._take(data)
        finally:
            reading.cancel()

    def _take(self, data: str | bytes) -> None:
        self.counts.bytes += len(data)
        if isinstance(data, str):
            self._take_one(json.loads(data))
            return
        for is_picture, part in parts_of(data):
            if is_picture:
                self._heard = int.from_bytes(part[:4], "little")
            else:
                self._take_one(json.loads(part))

    def _take_one(self, message: dict[str, Any]) -> None:
        if "n" in message:
            self._heard, message = message["n"], message["m"]
        match message["t"]:
            case "welcome":
                self._zero_s = time.monotonic() - message["now"] / 1e9
                self.say(t="tick")
            case "pong":
                back_ns = self._now_ns()
                if time.monotonic() >= self._reported_s + REPORT_S:
                    self._reported_s = time.monotonic()
                    times = {name: message[name] for name in ("sent", "received", "answered")}
                    self.say(t="link", **times, back=back_ns, latest=max(0, back_ns - times["sent"]))
            case "refused":
                self.counts.refused, self.told = message["reason"], message
                self._done.set()
            case "acked":
                self._acked = message["through"]
                if self.steps is not None:
                    self._trail = [(number, action) for number, action in self._trail if number > self._acked]
                for number in [n for n in self._sent_s if n <= message["through"]]:
                    self.counts.acked_s.append(time.monotonic() - self._sent_s.pop(number))
            case "screen":
                self._shown(message)
            case "rules":
                self._rules[message["episode"]] = message
                if message["computed"] is not None:
                    rules = msgspec.convert(
                        {name: value for name, value in message.items() if name != "t"}, EpisodeRules
                    )
                    self.steps = PageSteps(self._computes, rules)
            case "state":
                assert self.steps is not None
                self.steps.place(msgspec.convert(message["state"], WorldPosition))
                for number, action in self._trail:
                    if number > message["through"]:
                        self.steps.act(action)
            case "ahead":
                for scene, action, to, ends in message["edges"]:
                    self._edges[message["episode"], scene, action] = to, ends
            case "now":
                self._due_ns = message["tick"]
                self._confirmed(message)
            case "ask":
                self.say(t="asked", number=message["number"])
            case "over":
                self.counts.over, self.told = message["end"], message
                self._done.set()

    def _shown(self, message: dict[str, Any]) -> None:
        self.screen, self._due_ns = message["screen"], message["tick"]
        at_ns = self._now_ns()
        if self.screen["kind"] != "play" or "picture" in self.screen:
            self._now = None
        if self.screen["kind"] != "play":
            self.say(t="shown", submit=at_ns, flip=at_ns, screen=message["id"])

    def _confirmed(self, now: dict[str, Any]) -> None:
        if now["step"] < 0:
            self._now = None
            return
        self.counts.steps += now["step"] > 0 and (self._now is None or now["step"] != self._now["step"])
        self._now = now
        self._trail = [(number, action) for number, action in self._trail if number > now["through"]]
        seen = (now["episode"], now["step"], now["node"])
        if self._rules[now["episode"]]["team"] and now["action"] < 0 and seen != self._seen:
            at_ns, self._seen = self._now_ns(), seen
            self.say(
                t="shown", submit=at_ns, flip=at_ns, waits=now["step"] > 0, episode=seen[0], step=seen[1], node=seen[2]
            )

    # What is done

    async def _live(self, socket: ClientConnection) -> None:
        ticking = asyncio.create_task(self._tick(socket))
        try:
            await asyncio.sleep(self._rng.random() * self._between_s)
            while self.counts.presses < self._most_presses and not self.enough:
                await asyncio.sleep(self._between_s * (0.6 + 0.8 * self._rng.random()))
                if self._zero_s is None or not self.screen or self.idle:
                    continue
                if self.declines:
                    self.say(t="pointer", what="pressed", x=0.5, y=0.5, target="decline")
                    await self._done.wait()
                await (self._step() if self._now is not None else self._go_on())
            while self._acked < self._said:
                await asyncio.sleep(0.05)
            self._done.set()
        finally:
            ticking.cancel()

    async def _step(self) -> None:
        """Press a key that does something, and see where it leads if that is known."""
        assert self._now is not None
        if self.steps is not None and self.steps.rules.episode == self._now["episode"]:
            await self._compute(self.steps)
            return
        episode, step, scene = self._now["episode"], self._now["step"], self._now["node"]
        known = True
        rules = self._rules[episode]
        if rules["team"] == "turns" and (self._trail or self._now["action"] >= 0):
            return  # others are waited for
        for _, action in self._trail:
            scene, ended = self._edges.get((episode, scene, action), (-1, False))
            step, known = step + 1, known and scene >= 0
            if ended:
                return  # the page waits, too
        key = self._rng.choice(sorted(rules["actions"]))
        action = rules["actions"][key]
        number = self.say(t="key", key=key, down=True, stamp=self._now_ns())
        self._sent_s[number] = time.monotonic()
        self._trail.append((number, action))
        self.counts.presses += 1
        led = self._edges.get((episode, scene, action)) if known else None
        if led is not None:
            self.counts.ahead += 1
            self._seen = (episode, step + 1, led[0])
            submit_ns, waits = self._now_ns(), not led[1] and step + 1 < rules["most_steps"]
            await asyncio.sleep(FLIP_S)
            shown = {"episode": episode, "step": step + 1, "node": led[0]}
            self.say(t="shown", submit=submit_ns, flip=self._now_ns(), waits=waits, **shown)
        await asyncio.sleep(HOLD_S)
        self.say(t="key", key=key, down=False, stamp=self._now_ns())

    async def _compute(self, steps: PageSteps) -> None:
        """Press a key that does something, and show at once where it leads."""
        if steps.ended:
            return  # the page waits, too
        key = self._rng.choice(sorted(steps.rules.actions))
        digest = steps.act(steps.rules.actions[key])
        pressed = {"t": "key", "key": key, "down": True, "stamp": self._now_ns(), "digest": self.lies(digest)}
        number = self.say(waits=not steps.ended, **pressed)
        self._sent_s[number] = time.monotonic()
        self._trail.append((number, steps.rules.actions[key]))
        self.counts.presses += 1
        self.counts.ahead += 1
        submit_ns = self._now_ns()
        await asyncio.sleep(FLIP_S)
        shown = {"episode": steps.rules.episode, "step": steps.step}
        self.say(t="shown", submit=submit_ns, flip=self._now_ns(), waits=not steps.ended, **shown)
        await asyncio.sleep(HOLD_S)
        self.say(t="key", key=key, down=False, stamp=self._now_ns(), waits=not steps.ended)

    def lies(self, digest: str) -> str:
        """What it says of a step: the truth, unless somebody makes it say something else."""
        return digest

    async def _go_on(self) -> None:
        """Do what the present screen asks for."""
        match self.screen["kind"]:
            case "text" if waiting := _names(self.screen.get("keys", ())):
                await self._press(waiting[0])
            case "text" | "page":
                await self._press("enter")

    async def _tick(self, socket: ClientConnection) -> None:
        heard_s = 0.0
        while True:
            await asyncio.sleep(0.02)
            due_ns = self._due_ns
            if due_ns is not None and self._zero_s is not None and self._told_due_ns != due_ns <= self._now_ns():
                self._told_due_ns = due_ns
                self.say(t="tick")
            if self._zero_s is not None:
                for ping in self._ping(PATIENT_S):
                    self._put(ping)
            untold = self._heard - self._heard_told
            if untold >= MOST_UNTOLD or (untold and time.monotonic() >= heard_s + HEARD_S):
                self._heard_told, heard_s = self._heard, time.monotonic()
                await socket.send(json.dumps({"t": "heard", "n": self._heard}))


def encode(number: int, at_ns: int, what: dict[str, Any]) -> str:
    """A message as `stream.js` sends it: what comes with every key as an array, times in us before its own."""
    values: list[Any] = []
    match what["t"]:
        case _ if at_ns % 1000:
            pass
        case "tick":
            values = ["t", what.get("digest", "")]
        case "shown" if "step" in what and "screen" not in what:
            flip, submit = ((at_ns - what[name]) // 1000 for name in ("flip", "submit"))
            values = ["s", flip, submit, what["episode"], what["step"], what.get("node", "")]
        case "key":
            stamp, down = (at_ns - what["stamp"]) // 1000, int(what["down"])
            values = ["k", stamp, what["key"], down, what.get("digest", ""), what.get("symbol", "")]
    while values and values[-1] == "":
        values.pop()
    full = {"t": "n", "n": number, "at": at_ns, "what": what}
    return json.dumps([values[0], number, at_ns // 1000, *values[1:]] if values else full, separators=(",", ":"))


def parts_of(data: bytes) -> Iterator[tuple[bool, bytes]]:
    """The messages in one of the server's: whether it is a picture, and its bytes."""
    at = 0
    while at < len(data):
        is_picture, size = struct.unpack_from("<BI", data, at)
        yield bool(is_picture), data[at + 5 : at + 5 + size]
        at += 5 + size


def _names(keys: Iterable[dict[str, Any]]) -> list[str]:
    """The keys of a keyboard check that have not been pressed yet."""
    return [key["cap"].lower() for key in keys if not key["pressed"]]
