"""A participant and their tabs: the page's two streams as ``page/stream.js`` and ``page/connection.js`` have them."""

import json
import struct
from dataclasses import dataclass, field
from typing import Any

from minihuman.web.messages import MESSAGE_VERSION
from tests.fault_simulation.network import Socket
from tests.fault_simulation.schedule import Schedule

_PART = struct.Struct("<BI")
_RESTART_NS = 2_000_000_000
_ENDS = frozenset(
    {"finished", "full", "closed", "declined", "complete", "timed_out", "quit"}
)  # of refusals: what a participant takes for an answer


@dataclass
class Press:
    """A key that went down in the page."""

    key: str
    stamp_ns: int
    safe: bool = False  # the server said that it is on the disk
    dropped: bool = False  # its segment had ended: the page said so itself


@dataclass
class Participant:
    """Somebody who takes part.

    Args:
        token: of their link.
        schedule: the time.
        connect: opens a socket for a page; None where no server runs.
        make_tab: loads a page.
    """

    token: str
    schedule: Schedule
    connect: Any
    make_tab: "type[Tab]"
    pause_s: float = 0.5  # between keys, at most
    wall_skew_ns: int = 0
    presses: list[Press] = field(default_factory=list)
    end: str = ""  # what the last page said at the end, or why they were refused
    tab: "Tab | None" = None
    tabs: list["Tab"] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def arrive(self) -> None:
        """Open the link in a new tab."""
        if not self.end:
            self.tab = self.make_tab(self, {})
            self.tabs.append(self.tab)
            self.tab.open()

    def reload(self) -> None:
        """Load the page again."""
        if self.tab is not None and not self.end:
            self.tab.leave()
            self.tab = self.make_tab(self, self.tab.storage)
            self.tabs.append(self.tab)
            self.tab.open()

    def look_elsewhere(self, tab: "Tab") -> None:
        """A tab says that the study continues in another one."""
        if tab is self.tab:
            others = [other for other in self.tabs if not other.finished]
            if others:
                self.tab = others[-1]
                self.tab.act_later()
            else:
                self.schedule.after(3, self.reload)

    def copy_tab(self) -> None:
        """Duplicate the tab: both have what was kept."""
        if self.tab is not None and not self.end:
            kept = {name: value for name, value in self.tab.storage.items() if name != "messages"}
            self.tab = self.make_tab(self, kept | {"messages": dict(self.tab.storage.get("messages", {}))})
            self.tabs.append(self.tab)
            self.tab.open()


class Tab:
    """A page that was loaded."""

    def __init__(self, person: Participant, storage: dict[str, Any]) -> None:
        self.person, self.storage, self.schedule = person, storage, person.schedule
        if "next" not in storage:
            storage |= {"next": 1, "segment": "", "last": 0, "zero": 0, "messages": {}}
        storage["stream"] = f"{person.token[:4]}-{len(person.tabs)}"
        self._loaded_ns = self.schedule.now_ns
        self._origin_ns = self._loaded_ns + person.wall_skew_ns
        self._zero_ns: int | None = storage["zero"] - self._origin_ns if storage["segment"] else None
        self._life = ""
        self._heard = 0
        self._socket: Socket | None = None
        self.welcomed = False
        self.finished = False
        self._refusal = ""
        self.home: Any = None  # the machine that it came to last
        self._retry_s = 0.2
        self._screen: dict[str, Any] = {}
        self._playing: dict[str, Any] | None = None
        self._keys: list[str] = []
        self._tick_ns: int | None = None
        self._saying_heard = False
        self.act_later()

    # The connection

    def open(self) -> None:
        """Connect."""
        if self.finished:
            return
        self._socket = self.person.connect(self)
        if self._socket is None:
            self.schedule.after(self._retry_s, self.open)
            self._retry_s = min(3.0, self._retry_s * 1.6)

    def leave(self) -> None:
        """The page is closed."""
        self.finished, self.welcomed = True, False
        if self._socket is not None:
            self._socket.close()

    def opened(self) -> None:
        """Say hello."""
        kept = self.storage
        first = min([kept["next"], *kept["messages"]])
        facts = {"browser": "Chromium", "window_px": "1600 x 900"}
        self._say(
            {
                "t": "hello",
                "version": MESSAGE_VERSION,
                "token": self.person.token,
                "platform": {},
                "stream": kept["stream"],
            }
            | {"first": first, "life": self._life, "heard": self._heard, "segment": kept["segment"]}
            | {"last": kept["last"], "facts": facts}
        )

    def received(self, data: str | bytes) -> None:
        """Take what came."""
        if isinstance(data, str):
            self._take(json.loads(data))
            return
        at = 0
        while at < len(data):
            picture, size = _PART.unpack_from(data, at)
            part = data[at + 5 : at + 5 + size]
            at += 5 + size
            if picture:
                self._is_next(struct.unpack_from("<I", part)[0])
            else:
                self._take(json.loads(part))

    def closed(self, code: int, reason: str) -> None:
        """Come again, unless that is no use."""
        self.welcomed = False
        if self.finished:
            return
        if code == 4001:
            self.finished = True
            self.person.look_elsewhere(self)
        elif code == 4002 or 4003 <= code < 4100:
            if self._refusal:
                self._leave(self._refusal)
            elif self.schedule.now_ns - self._loaded_ns < 5_000_000_000:
                self._leave(reason)
            else:
                self.person.errors.append(reason)
                if self is self.person.tab:
                    self.person.reload()
                else:  # nobody looks at it
                    self.finished = True
        else:
            self.schedule.after(self._retry_s, self.open)
            self._retry_s = min(3.0, self._retry_s * 1.6)

    def _leave(self, why: str) -> None:
        """Show why; the participant tries again after a while, if it is no answer."""
        self.finished = True
        if why in _ENDS:
            self.person.end = f"refused: {why}"
        else:
            self.person.errors.append(why)
            if self is self.person.tab:
                self.schedule.after(2 + 3 * self.schedule.rng.random(), self.person.reload)

    def _say(self, message: dict[str, Any]) -> None:
        if self._socket is not None:
            self._socket.send(json.dumps(message))

    def _is_next(self, number: int) -> bool:
        if number != self._heard + 1:
            return False
        self._heard = number
        if not self._saying_heard:
            self._saying_heard = True
            self.schedule.after(1.0, self._say_heard)
        return True

    def _say_heard(self) -> None:
        self._saying_heard = False
        if self.welcomed:
            self._say({"t": "heard", "n": self._heard})

    def _take(self, message: dict[str, Any]) -> None:
        if "n" in message and "m" in message:
            if self._is_next(message["n"]):
                self._learn(message["m"])
            return
        match message["t"]:
            case "welcome":
                self._welcome(message)
            case "refused":
                self._refusal = message["reason"]
            case "acked":
                self.acknowledge(message["through"])

    def _welcome(self, message: dict[str, Any]) -> None:
        fresh = self._life == ""
        kept = self.storage
        self._set_time(message["segment"], message["now"], fresh, message["heard"])
        kept["last"] = max(kept["last"], message["taken"])
        if not message["again"]:
            self._heard = 0
            self._life = message["life"]
        self.resend(message["heard"])
        self.welcomed = True
        self._retry_s = 0.2
        if kept["last"] == 0:
            self.send({"t": "tick"})
        if fresh and message["taken"] > 0:
            self.send({"t": "focus", "focused": True})

    # The stream of what was done here

    def resend(self, received: int) -> None:
        """Send what a server lacks that has all up to a number."""
        for number, (message, _) in sorted(self.storage["messages"].items()):
            if number > received:
                self._say(message)

    def _performance_ns(self) -> int:
        return self.schedule.now_ns - self._loaded_ns

    def now_ns(self) -> int:
        """The session's time."""
        return max(0, self._performance_ns() - (self._zero_ns or 0))

    def _set_time(self, segment: str, server_ns: int, fresh: bool, received: int) -> None:
        kept = self.storage
        if kept["segment"] != segment:
            lost = [press for _, (_, press) in sorted(kept["messages"].items()) if press is not None]
            kept["messages"] = {}
            self._zero_ns = self._performance_ns() - server_ns
            kept |= {"segment": segment, "last": 0, "next": received + 1}
            if lost:
                for press in lost:
                    press.dropped = True
                text = ", ".join(f"{press.key} at {press.stamp_ns} ns" for press in lost)
                self.send({"t": "unheard", "text": text[:1900]})
        elif self._zero_ns is None or (fresh and abs(self.now_ns() - server_ns) > _RESTART_NS):
            self._zero_ns = self._performance_ns() - max(server_ns, kept["last"] + 1)
        kept["zero"] = (self._zero_ns or 0) + self._origin_ns

    def send(self, what: dict[str, Any], press: Press | None = None) -> int:
        """Number, keep and send it; 0 while the session's time is unknown."""
        if self._zero_ns is None:
            return 0
        kept = self.storage
        at, number = max(kept["last"] + 1, self.now_ns()), kept["next"]
        kept |= {"next": number + 1, "last": at}
        message = {"t": "n", "n": number, "at": at, "what": what}
        kept["messages"][number] = message, press
        if self.welcomed:
            self._say(message)
        return number

    def acknowledge(self, through: int) -> None:
        """Forget what is on the server's disk."""
        kept = self.storage
        for number in [number for number in kept["messages"] if number <= through]:
            _, press = kept["messages"].pop(number)
            if press is not None:
                press.safe = True

    # What is shown and done

    def _learn(self, message: dict[str, Any]) -> None:
        match message["t"]:
            case "rules":
                self._keys = [*message["actions"]]
            case "screen":
                self._screen, self._tick_ns = message, message["tick"]
                screen = message["screen"]
                self._playing = screen if screen["kind"] == "play" else None
                if screen["kind"] != "play":
                    self._show({"screen": message["id"]})
                elif "picture" in screen:
                    self._show({"episode": screen["episode"], "step": screen["step"]})
                self._tick_later()
            case "now":
                self._tick_ns = message["tick"]
                if message["step"] >= 0:
                    self._show({"episode": message["episode"], "step": message["step"], "node": message["node"]})
                self._tick_later()
            case "ask":
                self.send({"t": "asked", "number": message["number"]})
            case "over":
                self.finished = True
                self.person.end = f"over: {message['end']}"

    def _show(self, what: dict[str, Any]) -> None:
        submit_ns = self.now_ns()

        def flip() -> None:
            if not self.finished:
                self.send({"t": "shown", "submit": submit_ns, "flip": self.now_ns(), **what})

        self.schedule.after(0.016, flip)

    def _tick_later(self) -> None:
        due_ns = self._tick_ns
        if due_ns is None:
            return

        def tick() -> None:
            if self.finished or self._tick_ns != due_ns:
                return
            if self.now_ns() < due_ns:
                self._tick_later()
            elif self.send({"t": "tick"}):
                self._tick_ns = None

        self.schedule.after(max(0.001, (due_ns - self.now_ns()) / 1e9), tick)

    def act_later(self) -> None:
        """Press a key in a while."""
        self.schedule.after(0.03 + self.schedule.rng.random() * self.person.pause_s, self._act)

    def _act(self) -> None:
        if self.finished or self is not self.person.tab or self.person.end:
            return
        if self._screen:
            self._press(self.schedule.rng.choice(self._keys or ["1"]) if self._playing is not None else "enter")
        self.act_later()

    def _press(self, key: str) -> None:
        press = Press(key, self.now_ns())
        if not self.send({"t": "key", "key": key, "down": True, "stamp": press.stamp_ns}, press):
            return
        self.person.presses.append(press)

        def release() -> None:
            if not self.finished:
                self.send({"t": "key", "key": key, "down": False, "stamp": self.now_ns()})

        self.schedule.after(0.02, release)
