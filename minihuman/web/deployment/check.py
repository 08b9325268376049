"""Checks that servers with one database and one object store lose nothing while they are restarted and killed.

The servers are processes on this machine. The participants are simulated pages without a browser. They play a short
study made for the check, so no study's own questions and eligibility rules matter.
"""

import asyncio
import json
import random
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import WebSocketException
from websockets.typing import Origin

from minihuman.admin.recruitment import Recruitment, hash_link_token
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.verify.log import find_log_differences
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.worlds.adapters.world import World

_PART_HEAD = struct.Struct("<BI")  # whether a part is a picture, and its size in bytes
_FACTS = {"browser": "simulated", "window_px": "1366 x 768", "mouse": True, "touch": False}
_POLL_S = 0.1
_PAUSE_S = 5.0  # from one restart to the next
_KEY_PERIOD_S = 2.0  # the mean time between two key presses of a page
_TIMEOUT_S = 1_800.0
_TOML = """
[study]
name = "{name}"
version = "1"
seed = 1
participants = {participants}
[keys]
pool = ["1", "2", "3"]
keyboard_check = false
[web]
image_size_px = [96, 96]
max_concurrent_sessions = 10000
[[groups]]
name = "everyone"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
computed = "server"
"""


class DeploymentCheckError(MinihumanError, RuntimeError):
    """The servers could not be started, or the participants could not take part."""


@dataclass(frozen=True, slots=True)
class CheckResult:
    """The counts of a deployment check.

    Args:
        participants: the number of simulated participants.
        complete: participants whose session is complete.
        interrupted: sessions running when a server was stopped or killed, summed over all such moments.
        moved: participants who were connected to several servers.
        acknowledged: key presses that a server acknowledged.
        lost: acknowledged key presses that are in no log.
        twice: sessions with two different logs.
        differences: logs that replay differently from how they were recorded.
    """

    participants: int
    complete: int
    interrupted: int
    moved: int
    acknowledged: int
    lost: int
    twice: int
    differences: int

    @property
    def passed(self) -> bool:
        """Return whether every session exists once, contains every acknowledged key press, and replays as recorded."""
        return self.complete == self.participants and self.lost == self.twice == self.differences == 0

    def __str__(self) -> str:
        """Summarise the check in one line."""
        return (
            f"{self.complete} of {self.participants} participants complete, {self.moved} on several servers; "
            f"{self.interrupted} sessions interrupted; {self.acknowledged} key presses acknowledged, {self.lost} lost; "
            f"{self.twice} sessions twice; {self.differences} logs that replay differently"
        )


class _Server:
    """A process that runs `minihuman serve`."""

    def __init__(self, protocol: Path, data: Path) -> None:
        words = ["serve", str(protocol), "--data", str(data), "--port", "0", "--links", "0"]
        self._command = [sys.executable, "-m", "minihuman", *words]
        self.start()

    def start(self) -> None:
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True, encoding="utf-8")
        address_line = next((line for line in self._process.stdout or () if "http://" in line), None)
        if address_line is None:
            raise DeploymentCheckError("a server ended before it served; see its message above")
        self.host = address_line.split("http://")[1].strip().rstrip("/")

    def stop(self, *, kill: bool = False) -> None:
        with self._process:
            if kill:
                self._process.kill()
            else:
                self._process.terminate()


class _Page:
    """A simulated page, which presses keys at random and resends unacknowledged messages to any server.

    Args:
        token: the token of the participant's link.
        find_host: returns the host and port of the server to connect to next.
        rng: draws the keys and the times of presses.
    """

    def __init__(self, token: str, find_host: Callable[[], str], rng: random.Random) -> None:
        self.token = token
        self.end = ""
        self.acknowledged: Counter[tuple[str, int]] = Counter()  # key and time in ns
        self.hosts: set[str] = set()
        self._find_host = find_host
        self._rng = rng
        self._stream = f"{rng.getrandbits(64):x}"
        self._segment = ""
        self._zero_s = 0.0
        self._last_ns = 0  # the time of the last message
        self._last_number = 0  # of the last message
        self._heard = 0  # the number of the server's last message
        self._unacknowledged: dict[int, dict[str, Any]] = {}
        self._screen = ""  # the kind of the present screen; "" before the first
        self._due_ns: int | None = None  # the time at which the server wants a tick

    async def take_part(self) -> None:
        """Connect, and reconnect until the session has ended."""
        while not self.end:
            with suppress(OSError, WebSocketException, TimeoutError):
                await self._converse(self._find_host())
            await asyncio.sleep(0.2 + 0.6 * self._rng.random())  # so that not all pages reconnect at once

    async def _converse(self, host: str) -> None:
        """Connect to a server, say hello, and play until the connection or the session ends."""
        self._screen = ""
        self._due_ns = None
        self._heard = 0
        settings: dict[str, Any] = {"max_size": None, "compression": None, "ping_interval": None, "open_timeout": 60}
        async with connect(f"ws://{host}/socket", origin=Origin(f"http://{host}"), **settings) as socket:
            hello = {"t": "hello", "version": MESSAGE_VERSION, "token": self.token, "stream": self._stream}
            hello |= {"first": min(self._unacknowledged, default=self._last_number + 1), "segment": self._segment}
            await socket.send(json.dumps({**hello, "last": self._last_ns, "facts": _FACTS}))
            acting = asyncio.create_task(self._keep_acting(socket))
            try:
                async for received in socket:
                    for message in self._read_messages(received):
                        await self._handle_message(message, socket, host)
                    if self.end:
                        return
            finally:
                acting.cancel()
                await asyncio.gather(acting, return_exceptions=True)

    def _now_ns(self) -> int:
        return max(self._last_ns + 1, round((time.monotonic() - self._zero_s) * 1e9))

    async def _send_numbered(self, socket: ClientConnection, **fields: Any) -> None:
        """Send a message under the next number, and keep it until the server acknowledges it."""
        self._last_number += 1
        self._last_ns = self._now_ns()
        message = {"t": "n", "n": self._last_number, "at": self._last_ns, "what": fields}
        self._unacknowledged[self._last_number] = message
        await socket.send(json.dumps(message))

    async def _keep_acting(self, socket: ClientConnection) -> None:
        """Press keys, send ticks and acknowledge messages until the task is cancelled."""
        acknowledged = 0
        next_press_s = time.monotonic() + _KEY_PERIOD_S * self._rng.random()
        while True:
            await asyncio.sleep(_POLL_S)
            if self._due_ns is not None and self._due_ns <= self._now_ns():
                self._due_ns = None
                await self._send_numbered(socket, t="tick")
            if self._heard > acknowledged:
                acknowledged = self._heard
                await socket.send(json.dumps({"t": "heard", "n": acknowledged}))
            if self._screen and time.monotonic() >= next_press_s:
                next_press_s = time.monotonic() + _KEY_PERIOD_S * (0.6 + 0.8 * self._rng.random())  # 0.6 to 1.4 periods
                key = "enter"
                if self._screen == "play":
                    key = self._rng.choice("123")
                for down in (True, False):
                    await self._send_numbered(socket, t="key", key=key, down=down, stamp=self._now_ns())

    def _read_messages(self, received: str | bytes) -> Iterator[dict[str, Any]]:
        """Yield the messages in a text or a batch; of a picture, only record the number, to acknowledge it."""
        if isinstance(received, str):
            yield json.loads(received)
            return
        position = 0
        while position < len(received):
            is_picture, size = _PART_HEAD.unpack_from(received, position)
            begin = position + _PART_HEAD.size
            end = begin + size
            part = received[begin:end]
            position = end
            if is_picture:
                self._heard = int.from_bytes(part[:4], "little")
            else:
                yield json.loads(part)

    async def _handle_message(self, message: dict[str, Any], socket: ClientConnection, host: str) -> None:
        """Update the page's state with a message of the server, and answer it if it needs an answer."""
        if "n" in message and "m" in message:
            self._heard = message["n"]
            message = message["m"]
        match message["t"]:
            case "welcome":
                self.hosts.add(host)
                await self._adopt_welcome(message, socket)
            case "acked":
                acknowledged = [number for number in self._unacknowledged if number <= message["through"]]
                for number in acknowledged:
                    content = self._unacknowledged.pop(number)["what"]
                    if content["t"] == "key" and content["down"]:
                        self.acknowledged[content["key"], content["stamp"]] += 1
            case "screen":
                self._screen = message["screen"]["kind"]
                self._due_ns = message["tick"]
                if self._screen != "play":
                    at_ns = self._now_ns()
                    await self._send_numbered(socket, t="shown", submit=at_ns, flip=at_ns, screen=message["id"])
            case "now":
                self._due_ns = message["tick"]
            case "ask":
                await self._send_numbered(socket, t="asked", number=message["number"])
            case "over" | "refused":
                self.end = message.get("end") or message["reason"]

    async def _adopt_welcome(self, welcome: dict[str, Any], socket: ClientConnection) -> None:
        """Adopt a server's clock and message numbers, and resend the messages that it has not received."""
        if welcome["segment"] != self._segment:
            self._unacknowledged.clear()
            self._segment = welcome["segment"]
            self._last_ns = 0
            self._last_number = welcome["heard"]
            self._zero_s = time.monotonic() - welcome["now"] / 1e9
        if welcome["heard"] > self._last_number:
            self._last_number = welcome["heard"]
            self._last_ns = max(self._last_ns, welcome["taken"])
        for number in sorted(self._unacknowledged):
            if number > welcome["heard"]:
                await socket.send(json.dumps(self._unacknowledged[number]))
        if self._last_ns == 0:  # this page has sent no message of the segment yet; a first one begins a new session
            await self._send_numbered(socket, t="tick")


def check_deployment(
    data: Path, participants: int, *, servers: int = 2, on_progress: Callable[[str], None] = print
) -> CheckResult:
    """Serve a short study, restart each server in turn, kill the first, and count what was lost or duplicated.

    Args:
        data: the folder with register.url and logs.url, which name the database and the store.
        participants: the number of simulated participants.
        servers: the number of servers; two are started if it is less.
        on_progress: receives lines of text about the check's progress.

    Raises:
        DeploymentCheckError: if no database or store is named, a server does not start, or too few finish in time.
    """
    for path in (data / URL_FILE_NAME, data / STORE_URL_FILE_NAME):
        if not path.is_file():
            raise DeploymentCheckError(f"{path} does not exist; write the address into it, as docs/web.md says")
    name = f"check-{uuid4().hex[:8]}"
    with tempfile.TemporaryDirectory(prefix="minihuman-check-") as root:
        folders = [Path(root) / f"server-{number}" for number in range(max(2, servers))]
        gathered = Path(root) / "gathered"  # gets all logs from the store
        for folder in (*folders, gathered):
            _make_data_folder(folder, data)
        protocol = Path(root) / f"{name}.toml"
        toml = _TOML.format(name=name, participants=participants)
        protocol.write_text(toml, encoding="utf-8", newline="\n")
        recruits = Recruitment(folders[0] / name)
        tokens = recruits.issue(participants)
        on_progress(f"study {name}: {len(folders)} servers, {participants} simulated participants")
        running: list[_Server] = []
        try:
            running.extend(_Server(protocol, folder) for folder in folders)
            pages, interrupted = asyncio.run(_play_study(running, tokens, on_progress))
        finally:
            for server in running:
                server.stop()
        for folder in (*folders, gathered):
            sync_logs(folder, f"{name}/")
        codes = {token: recruits.find_participant(hash_link_token(token)) for token in tokens}
        return _count_losses(gathered / name, folders, pages, codes, interrupted)


def _make_data_folder(folder: Path, data: Path) -> None:
    """Make a data folder with the same database and store as the existing one ``data``."""
    folder.mkdir()
    for file_name in (URL_FILE_NAME, STORE_URL_FILE_NAME):
        shutil.copyfile(data / file_name, folder / file_name)


async def _play_study(
    servers: list[_Server], tokens: list[str], on_progress: Callable[[str], None]
) -> tuple[list[_Page], int]:
    """Let all participants play while servers restart; return the pages and the number of interruptions of sessions.

    Raises:
        DeploymentCheckError: if not all participants finish in time, or none could play.
    """
    rng = random.Random(1)
    interrupted: list[_Page] = []  # a page once for each interruption
    pages = [_Page(token, lambda: rng.choice(servers).host, random.Random(n)) for n, token in enumerate(tokens)]

    async def restart_servers() -> None:
        while sum(bool(page.acknowledged) for page in pages) < len(pages) / 2:
            if all(page.end for page in pages):  # no participant is left to interrupt
                return
            await asyncio.sleep(_POLL_S)
        stops = [(number, "restarted") for number in range(len(servers))]
        stops.append((0, "killed"))
        for number, stop in stops:
            present = [page for page in pages if page.acknowledged and not page.end]
            interrupted.extend(present)
            on_progress(f"server {number + 1} {stop}, {len(present)} participants in a session")
            await asyncio.to_thread(servers[number].stop, kill=stop == "killed")
            await asyncio.to_thread(servers[number].start)
            await asyncio.sleep(_PAUSE_S)

    with suppress(TimeoutError):
        async with asyncio.timeout(_TIMEOUT_S), asyncio.TaskGroup() as group:
            group.create_task(restart_servers())
            for page in pages:
                group.create_task(page.take_part())
                await asyncio.sleep(_POLL_S)
    if not all(page.end for page in pages) or not any(page.acknowledged for page in pages):
        ends = Counter(page.end or f"not within {_TIMEOUT_S:g} s" for page in pages)
        raise DeploymentCheckError(f"participants could not take part; how many ended how: {dict(ends)}")
    return pages, len(interrupted)


def _count_presses(log: Path) -> Counter[tuple[str, int]]:
    """Count the key presses in a log by key and time in nanoseconds."""
    events = (event for event in read_events(log) if isinstance(event, KeyPressed))
    # the difference is the time of the press itself, which the page sent as its stamp
    return Counter((event.key, event.t_ns - event.waited_ns) for event in events if event.down)


def _count_losses(
    gathered: Path, folders: list[Path], pages: list[_Page], codes: dict[str, str | None], interrupted: int
) -> CheckResult:
    """Count the acknowledged key presses that no log contains, and the other counts of the check's result.

    Args:
        gathered: the study's folder with all logs of the store.
        folders: the servers' data folders.
        pages: the pages of all participants.
        codes: each participant's code by the token of the participant's link; None for one who never arrived.
        interrupted: the number of interruptions of sessions.
    """
    logs = {log.name.partition("_")[0]: log for log in gathered.rglob("*.mcap")}
    n_lost = 0
    for page in pages:
        log_path = logs.get(codes[page.token] or "")
        pressed: Counter[tuple[str, int]] = Counter()
        if log_path is not None:
            pressed = _count_presses(log_path)
        n_lost += (page.acknowledged - pressed).total()
    differing_logs = [log for log in logs.values() if any(True for _ in find_log_differences(log, World))]
    return CheckResult(
        participants=len(pages),
        complete=sum(page.end == "complete" for page in pages),
        interrupted=interrupted,
        moved=sum(len(page.hosts) > 1 for page in pages),
        acknowledged=sum(page.acknowledged.total() for page in pages),
        lost=n_lost,
        twice=_count_double_sessions([gathered, *folders]),
        differences=len(differing_logs),
    )


def _count_double_sessions(folders: list[Path]) -> int:
    """Count the complete sessions that have logs with different contents."""
    contents: dict[str, set[bytes]] = {}
    for folder in folders:
        for log in folder.rglob("*.mcap"):
            if read_log(log).end_reason == "complete":
                session = log.name.partition("_other")[0].removesuffix(".mcap")  # a second log is ..._other-DIGEST.mcap
                contents.setdefault(session, set()).add(log.read_bytes())
    return sum(len(of_session) > 1 for of_session in contents.values())
