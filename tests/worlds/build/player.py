"""Plays cases in the page's modules, in Node, Chromium or Firefox: it hands them out over HTTP on this machine."""

import json
import queue
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any, Literal

import minihuman
from tests.counts import PATIENCE_S
from tests.web.browser import browsing
from tests.web.firefox import firefox_at

Engine = Literal["node", "chromium", "firefox"]
PAGE_FOLDER = Path(minihuman.__file__).parent / "web/page"
_SCRIPT = Path(__file__).with_name("player.mjs")
_KINDS = {".js": "text/javascript", ".mjs": "text/javascript", ".json": "application/json", ".wasm": "application/wasm"}
_HTML = b'<!DOCTYPE html><title>player</title><script type="module" src="/player.mjs"></script>'


class PagePlayer:
    """Cases that go out, and the digests that come back, in turn.

    Args:
        folder: of the cases' arrays.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._cases: queue.Queue[Sequence[dict[str, Any]] | None] = queue.Queue()
        self._digests: queue.Queue[dict[str, str] | str] = queue.Queue()

    def submit(self, cases: Sequence[dict[str, Any]]) -> None:
        """Hand cases out; their digests are the next ones."""
        self._cases.put(cases)

    def digests(self) -> dict[str, str]:
        """The digests of the cases that were handed out first, by their ids."""
        found = self._digests.get(timeout=10 * PATIENCE_S)
        assert isinstance(found, dict), found
        return found

    def end(self) -> None:
        """Tell the page that nothing follows."""
        self._cases.put(None)

    def answer(self, path: str) -> tuple[str, bytes]:
        """What is at an address."""
        top, _, rest = path.lstrip("/").partition("?")[0].partition("/")
        if top == "next":
            return _KINDS[".json"], json.dumps(self._cases.get()).encode()
        files = {"player.mjs": _SCRIPT, "page": PAGE_FOLDER / rest, "files": self._folder / rest}
        if (file := files.get(top)) is None or not file.is_file():
            return "text/html", _HTML
        return _KINDS.get(file.suffix, "application/octet-stream"), file.read_bytes()

    def take(self, path: str, body: bytes) -> None:
        """Take an answer of the page's."""
        self._digests.put(json.loads(body) if path == "/done" else f"the page failed: {body.decode()}")


class _Server(ThreadingHTTPServer):
    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a browser that has gone; print what else failed."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)  # type: ignore[arg-type] # as it was called


@contextmanager
def page_player(engine: Engine, folder: Path, *, simd: bool = False) -> Iterator[PagePlayer]:
    """Play in an engine, by the modules with or without SIMD instructions; ``folder`` is of the cases' arrays."""
    player = PagePlayer(folder)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def do_GET(self) -> None:
            self._respond(*player.answer(self.path))

        def do_POST(self) -> None:
            player.take(self.path, self.rfile.read(int(self.headers["Content-Length"])))
            self._respond("text/plain", b"")

        def log_message(self, format: str, *arguments: object) -> None:
            """Say nothing."""

        def _respond(self, kind: str, content: bytes) -> None:
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

    server = _Server(("127.0.0.1", 0), Handler)
    address, asked = f"http://127.0.0.1:{server.server_port}", "simd" if simd else "plain"
    with ExitStack() as stack:
        stack.callback(server.server_close)
        stack.callback(server.shutdown)
        Thread(target=server.serve_forever, daemon=True).start()
        match engine:
            case "node":
                node = shutil.which("node")
                assert node is not None
                process = subprocess.Popen([node, str(_SCRIPT), address, str(PAGE_FOLDER / "world.js"), asked])
                stack.callback(process.wait)
            case "chromium":
                stack.enter_context(browsing())(f"{address}/?simd={asked}")
            case "firefox":
                temporary = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
                stack.enter_context(firefox_at(f"{address}/?simd={asked}", Path(temporary) / "profile"))
        stack.callback(player.end)
        yield player
