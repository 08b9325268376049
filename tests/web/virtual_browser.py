"""A page's own modules, whole, in Node before a session's host in Python: one virtual clock, no socket, no browser."""

import base64
import json
import secrets
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from minihuman.experiment.machine.session import KEY_RULES, SessionMachine
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.web import messages
from minihuman.web.computed import PageWorld
from minihuman.web.eligibility import get_page_texts
from minihuman.web.key_codes import KEY_CODES
from minihuman.web.message_codec import decode_page_message
from minihuman.web.outbox import PageSettings
from minihuman.web.page_presence import find_sign_interval_ms
from minihuman.web.page_protocol import PageProtocol, PageSession, ServerMessages, StreamNames
from minihuman.web.session_host import SessionHost
from minihuman.worlds.source_digest import kernels_digest
from tests.programs import running

PROGRAM = Path(__file__).parent / "page" / "virtual_page.js"
SETTLE_MS = 4000  # after the last act: repeats have ended, everything was sent and answered
CODES = {name: code for code, name in KEY_CODES.items()}
Act = tuple[float, str, str]  # when, in ms; "down", "up", "focus" or "blur"; the key


@dataclass(frozen=True)
class Line:
    """The latency of a connection, one way each, and what is added to it, in turn."""

    up_ms: float
    down_ms: float
    jitter_ms: tuple[float, ...] = (0.0,)


@dataclass
class Played:
    """What came of a script: the session, what it logged, and where the page was at the end."""

    host: SessionHost
    recorder: MemoryRecorder
    page: dict[str, Any]


class VirtualConnection(PageSession):
    """A page's session on the virtual clock."""

    def __init__(self, plan: SessionPlan) -> None:
        self.recorder = MemoryRecorder()
        facts = {"window": "web", "key_rules": KEY_RULES}
        session = SessionMachine(plan, PageWorld, facts, picture_px=(84, 84), renders_steps=False)
        self.host = SessionHost(session, self.recorder, PageWorld, PageSettings(picture_px=(84, 84)))
        self._streams = StreamNames()
        self._protocol: PageProtocol | None = None
        self._at_ns = 0

    @property
    def outgoing(self) -> ServerMessages:
        return self.host.outgoing

    def now_ns(self) -> int:
        return max(self._at_ns, self.host.last_at_ns + 1)

    def safe(self) -> int:
        return self.host.safe()

    def take(self, numbered: messages.NumberedMessage, *, more: bool = False) -> None:
        if self._streams.incoming.take(numbered.n) and not self.host.over:
            self.host.receive(numbered.n, numbered.at, numbered.what, more=more)

    def hear(self, now_s: float) -> None:
        """Take no note: no seat waits for this page."""

    def record_act(self) -> None:
        """Take no note: nothing is typed here."""

    def bid_farewell(self, *, is_left: bool) -> None:
        """Take no note: no seat waits for this page."""

    def spend(self, n_bytes: int, *, number: int, is_text: bool = False) -> bool:
        return True

    def forget(self) -> None:
        self._streams.life = ""
        self.host.restart()

    def answer(self, text: str, at_ms: float) -> list[object]:
        """Take a text, and return what is sent back, as the program reads it."""
        self._at_ns = round(at_ms * 1e6)
        texts = text.split("\n")
        if self._protocol is None:
            hello = decode_page_message(texts.pop(0))
            assert isinstance(hello, messages.Hello)
            return [self._greet(hello)]
        self._protocol.begin_text(at_ms / 1e3)
        answers: list[object] = []
        for place, line in enumerate(texts, 1):
            if answer := self._protocol.receive(line, more=place < len(texts)):
                answers.append(answer)
        self._protocol.end_text()
        while self.host.grow():
            pass
        self.host.outbox.send_prefetched()
        return [*answers, *({"bytes": base64.b64encode(batch).decode()} for batch in self._protocol.take_batches())]

    def _greet(self, hello: messages.Hello) -> str:
        self._streams.receive_stream(hello.stream, hello.first)
        self._streams.life = secrets.token_hex(4)
        self.host.restart(computes=bool(hello.kernels) and hello.kernels == kernels_digest())
        language = self.host.session.plan.language
        welcome = messages.Welcome(
            "virtual",
            self._streams.life,
            False,
            0,
            self.now_ns(),
            dict(KEY_CODES),
            {},
            "",
            get_page_texts(language),
            0,
            False,
            sign_ms=find_sign_interval_ms(self.host.session.plan),
        )
        self._protocol = PageProtocol(self, welcome, 0, 0.0)
        return self._protocol.encode_welcome()


class VirtualBrowser:
    """The program that runs the page's modules, for one script after the other."""

    def __init__(self, to_program: IO[str], from_program: IO[str]) -> None:
        self._to_program = to_program
        self._from_program = from_program

    def play(self, plan: SessionPlan, acts: Sequence[Act], line: Line) -> Played:
        """Play a script of acts."""
        connection = VirtualConnection(plan)
        named = [
            (t_ms, what, (CODES[key], key if len(key) == 1 else key.title()) if key else None)
            for t_ms, what, key in acts
        ]
        self._write(
            {
                "acts": named,
                "line": {"up_ms": line.up_ms, "down_ms": line.down_ms, "jitter": line.jitter_ms},
                "until_ms": acts[-1][0] + SETTLE_MS,
            }
        )
        while True:
            request = json.loads(self._from_program.readline())
            if "page" in request:
                return Played(connection.host, connection.recorder, request["page"])
            self._write(connection.answer(request["text"], request["at_ms"]))

    def _write(self, message: object) -> None:
        self._to_program.write(json.dumps(message) + "\n")
        self._to_program.flush()


@contextmanager
def virtual_browser() -> Iterator[VirtualBrowser]:
    """A program that is ended at the end."""
    with running(["node", str(PROGRAM)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        yield VirtualBrowser(program.stdin, program.stdout)
        program.stdin.close()
