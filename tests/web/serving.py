"""`minihuman serve` as a program, and a line to it that can be long, slow to answer, or cut."""

import random
import re
import signal
import socket
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from http.client import HTTPConnection, HTTPException
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Literal

from tests.counts import PATIENCE_S
from tests.warm_start import start_program


class Serving:
    """A server on a port that stays the same when it is killed and started again."""

    def __init__(self, protocol: Path, data: Path, *, links: int = 1, options: tuple[str, ...] = ()) -> None:
        self.port = free_port()
        self._arguments = ["serve", str(protocol), "--data", str(data), "--port", str(self.port), *options]
        self.tokens = [re.sub(r".*#t=", "", line) for line in self._start(links)]

    def _start(self, links: int) -> list[str]:
        self._process = start_program(*self._arguments, "--links", str(links))
        assert self._process.stdout is not None
        lines: list[str] = []
        while len(lines) < max(1, links):
            line = self._process.stdout.readline()
            assert line, "the server ended before it had a link"
            if not links or "#t=" in line:
                lines.append(line.strip())
        return lines if links else []

    @property
    def pid(self) -> int:
        """Of the process that runs now."""
        return self._process.pid

    def kill(self) -> None:
        """As a power cut ends it."""
        self._process.send_signal(signal.SIGKILL)
        self._ended()

    def stop(self) -> int:
        """As an operator ends it."""
        return self.told(signal.SIGTERM)

    def told(self, what: signal.Signals) -> int:
        """Send a signal that ends it; its exit status."""
        self._process.send_signal(what)
        return self._ended()

    def _ended(self) -> int:
        with self._process as process:
            try:
                return process.wait(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()  # or it would be waited for without end
                raise

    def again(self) -> None:
        """Start it anew, on the same folder."""
        self._start(0)


def free_port(*, in_a_row: int = 2) -> int:
    """A port that nobody has, and neither those after it; none that the system gives to whoever connects somewhere."""
    lowest = int(Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split()[0])
    for _ in range(1_000):
        port = random.randrange(10_000, lowest - in_a_row)
        with suppress(OSError), ExitStack() as taken:
            for number in range(in_a_row):
                one = taken.enter_context(socket.socket())
                one.bind(("127.0.0.1", port + number))
            return port
    raise AssertionError("no port is free")


def listens(port: int) -> bool:
    """Whether something answers at a port of this machine."""
    with socket.socket() as line:
        return line.connect_ex(("127.0.0.1", port)) == 0


@contextmanager
def serving(protocol: Path, data: Path, *, links: int = 1, options: tuple[str, ...] = ()) -> Iterator[Serving]:
    served = Serving(protocol, data, links=links, options=options)
    try:
        yield served
    finally:
        with suppress(ProcessLookupError):
            served.kill()


SEGMENT_BYTES, RETRANSMIT_S = 1448, 0.2  # of Ethernet; Linux's least timeout
UPGRADE_DELAY_S = 30.0  # of a web socket's first request, where it is delayed


class Line:
    """A TCP proxy in front of a port: every byte takes ``one_way_s``, either way; it can be cut.

    ``loss`` is the share of TCP segments that get lost: what such a segment carries, and all behind it, comes a round
    trip and the shortest retransmission timeout later, as TCP hands nothing on out of order.
    ``upgrades`` says what becomes of web sockets, as at a middlebox that knows HTTP alone.
    Each direction of a connection has two threads, one that reads and one that writes when it is time.
    """

    def __init__(self, port: int, *, one_way_s: float, loss: float = 0.0) -> None:
        self.one_way_s, self.loss = one_way_s, loss
        self._chance = random.Random(port)
        self.bytes_down = self.bytes_up = 0
        self.deaf = False  # nothing comes down; what goes up arrives
        self.stalled = False  # nothing arrives on either side, until it is again
        self.upgrades: Literal["passed", "closed", "swallowed", "delayed"] = "passed"
        self._to = port
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._cut = False
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listening.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Break all connections; new ones are refused until it is mended."""
        self._cut = True
        with self._lock:
            for one in self._open:
                with suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        self._cut = False

    def close(self) -> None:
        self.cut()
        self._listening.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listening.accept()
            except OSError:
                return
            try:
                if self._cut:
                    raise OSError
                far = socket.create_connection(("127.0.0.1", self._to))
            except OSError:
                near.close()
                continue
            for one in (near, far):
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with self._lock:
                self._open |= {near, far}
            self._carry(near, far, down=False)
            self._carry(far, near, down=True)

    def _carry(self, source: socket.socket, target: socket.socket, *, down: bool) -> None:
        waiting: deque[tuple[float, bytes]] = deque()
        arrived = threading.Condition()

        def read() -> None:
            data = b"x"
            while data:
                try:
                    data = source.recv(65536)
                except OSError:
                    data = b""
                late_s = 0.0
                if not down and self.upgrades != "passed" and b"upgrade: websocket" in data.lower():
                    if self.upgrades == "swallowed":
                        continue
                    if self.upgrades == "delayed":
                        late_s = UPGRADE_DELAY_S
                    else:
                        data = b""
                due_s, segments = time.monotonic() + self.one_way_s + late_s, -(-len(data) // SEGMENT_BYTES)
                if self._chance.random() < 1 - (1 - self.loss) ** segments:
                    due_s += 2 * self.one_way_s + RETRANSMIT_S
                with arrived:
                    waiting.append((due_s, data))
                    arrived.notify()

        def write() -> None:
            while True:
                with arrived:
                    while not waiting:
                        arrived.wait()
                    due_s, data = waiting.popleft()
                time.sleep(max(0.0, due_s - time.monotonic()))
                while self.stalled and data and not self._cut:
                    time.sleep(0.02)
                try:
                    if self._cut or not data:
                        raise OSError
                    if down and self.deaf:
                        continue
                    target.sendall(data)
                    if down:
                        self.bytes_down += len(data)
                    else:
                        self.bytes_up += len(data)
                except OSError:
                    break
            for one in (source, target):
                with suppress(OSError):
                    one.shutdown(socket.SHUT_RDWR)
                one.close()
                with self._lock:
                    self._open.discard(one)

        for work in (read, write):
            threading.Thread(target=work, daemon=True).start()


@contextmanager
def line(port: int, *, rtt_ms: float = 0.0, loss: float = 0.0) -> Iterator[Line]:
    """A line to a port of this machine."""
    made = Line(port, one_way_s=rtt_ms / 2000, loss=loss)
    try:
        yield made
    finally:
        made.close()


class _StoreAndForward(BaseHTTPRequestHandler):
    """Hands on whole requests and whole answers, and knows nothing of web sockets."""

    protocol_version = "HTTP/1.1"
    upstream_port = 0

    def _forward(self) -> None:
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        own = {"connection", "upgrade", "host", "accept-encoding"}
        headers = {name: text for name, text in self.headers.items() if name.lower() not in own}
        upstream = HTTPConnection("127.0.0.1", self.upstream_port)
        try:
            upstream.request(self.command, self.path, body, headers | {"Host": self.headers["host"]})
            answer = upstream.getresponse()
            whole = answer.read()
        except (OSError, HTTPException):
            self.close_connection = True
            return
        finally:
            upstream.close()
        self.send_response(answer.status)
        for name, text in answer.getheaders():
            if name.lower() not in ("connection", "content-length", "transfer-encoding", "date", "server"):
                self.send_header(name, text)
        self.send_header("Content-Length", str(len(whole)))
        try:
            self.end_headers()
            self.wfile.write(whole)
        except OSError:  # the page does not wait for it any more
            self.close_connection = True

    def do_GET(self) -> None:
        """Hand on a request without a body."""
        self._forward()

    def do_POST(self) -> None:
        """Hand on a request with its body."""
        self._forward()

    def log_message(self, format: str, *arguments: object) -> None:
        """Write nothing."""


@contextmanager
def buffering_proxy(port: int) -> Iterator[int]:
    """An HTTP proxy in front of a port that buffers whatever it hands on; yields its own port."""
    handler = type("Handler", (_StoreAndForward,), {"upstream_port": port})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            thread.join()
