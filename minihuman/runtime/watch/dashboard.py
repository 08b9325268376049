"""The dashboard's HTTP server: on this machine only, behind a secret path, from the standard library."""

import json
import secrets
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from importlib.resources import files
from pathlib import Path
from threading import Lock
from urllib.parse import parse_qs, urlsplit

import msgspec

from minihuman.admin.recruitment import Recruitment
from minihuman.admin.status import format_status
from minihuman.errors import LogError
from minihuman.runtime.http_guard import (
    LOCAL_HOSTS,
    GuardedHandler,
    GuardedServer,
    is_named,
    is_own_request,
    read_length,
)
from minihuman.runtime.session_loop import CommandRequest, send_command
from minihuman.runtime.watch.running_sessions import LowPriorityWorker, RunningSessions, ThrottledCall
from minihuman.storage.system import now_text

ADDRESS = "127.0.0.1"
_MAX_BODY_BYTES = 10_000
_CONTENT_TYPES = {"": "text/html", "css": "text/css", "js": "text/javascript"}
_HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Content-Security-Policy": "default-src 'self'; object-src 'none'; base-uri 'none'; frame-ancestors 'none'",
}


class _RecruitmentSwitch(msgspec.Struct, frozen=True):
    open: bool


class DashboardServer:
    """Serves the dashboard of one study until it is stopped.

    Args:
        study_dir: the study's folder.
        port: the port; 0 selects a free one.

    Raises:
        LogError: if the folder does not exist, or the port is taken.
    """

    def __init__(self, study_dir: Path, port: int = 0) -> None:
        self._study_dir = study_dir
        self._sessions = RunningSessions(study_dir)
        self._recruits = Recruitment(study_dir)
        self._status = ThrottledCall(self._format_status)
        self._one_at_a_time = Lock()
        self._low_priority = LowPriorityWorker()  # the participants come first
        secret = secrets.token_urlsafe(16)
        try:
            self._server = GuardedServer((ADDRESS, port), _make_handler_class(f"/{secret}/", self._answer))
        except OSError as error:
            raise LogError(f"port {port} is not available ({error.strerror}); choose another with --port") from error
        self.url = f"http://{ADDRESS}:{self._server.server_port}/{secret}/"

    def serve(self) -> None:
        """Answer requests until ``stop`` is called."""
        self._server.serve_forever()

    def stop(self) -> None:
        """End ``serve`` from another thread."""
        self._server.shutdown()
        self._server.server_close()

    def _answer(self, path: str, query: dict[str, list[str]], body: bytes | None) -> tuple[str, bytes] | None:
        """Carry out a request; return the content type and the content of the answer.

        A request with a body sends a command to a session, or opens or closes recruitment.

        Args:
            path: the path below the secret prefix; "" is the page.
            query: the values of each name in the query.
            body: the body of a POST request; None for a GET request.

        Returns:
            None if there is nothing at the path, or no such session.
        """
        name = query.get("session", [""])[0]
        with self._one_at_a_time:
            match path, body:
                case "" | "page.css" | "page.js" as file_name, None:
                    kind = _CONTENT_TYPES[file_name.rpartition(".")[2]]
                    return f"{kind}; charset=utf-8", (files(__package__) / (file_name or "page.html")).read_bytes()
                case "state", None:
                    return "application/json", self._low_priority(lambda: json.dumps(self._build_state()).encode())
                case "picture", None:
                    return "image/png", self._low_priority(lambda: self._sessions.picture(name))
                case "ask", bytes():
                    log = self._sessions.log_of(name)
                    if log is None:
                        return None
                    request = msgspec.json.decode(body, type=CommandRequest)
                    send_command(log, msgspec.structs.replace(request, at=now_text()))
                    return "application/json", b"{}"
                case "recruit", bytes():
                    self._recruits.recruit(msgspec.json.decode(body, type=_RecruitmentSwitch).open)
                    return "application/json", b"{}"
        return None

    def _format_status(self) -> list[str]:
        try:
            return list(format_status(self._study_dir))
        except LogError as error:
            return [str(error)]

    def _build_state(self) -> dict[str, object]:
        """Return the state of the study that the page shows, as JSON values."""
        return {
            "study": self._study_dir.name,
            "sessions": self._sessions.look(),
            "status": self._status(),
            "recruiting": self._count_recruits(),
        }

    def _count_recruits(self) -> dict[str, object] | None:
        """Return whether recruitment is open, and its counts; None for a study that offers no links."""
        if not self._recruits.begun:
            return None
        standing = self._recruits.standing()
        participants = set(standing.came.values())
        n_reading = sum(not (self._study_dir / code).exists() for code in participants)  # nothing is recorded yet
        n_links = len(standing.issued)
        return {"open": standing.recruiting, "links": n_links, "came": len(participants), "reading": n_reading}


AnswerRequest = Callable[[str, dict[str, list[str]], bytes | None], tuple[str, bytes] | None]


def _make_handler_class(prefix: str, answer: AnswerRequest) -> type[GuardedHandler]:
    class Handler(GuardedHandler):
        """Passes on requests below the secret prefix, and answers all others with 404."""

        def do_GET(self) -> None:  # noqa: N802 - the library's name
            """Answer a request for a page, the state or a picture."""
            self._respond(None)

        def do_POST(self) -> None:  # noqa: N802 - the library's name
            """Answer a request that changes something, if it comes from the dashboard's own page."""
            length = read_length(self.headers.get("Content-Length", ""), _MAX_BODY_BYTES)
            is_json = self.headers.get_content_type() == "application/json"
            headers = {name.lower(): content for name, content in self.headers.items()}
            if length is None or not is_json or not is_own_request(headers):
                self.close_connection = True  # a body may follow that is not read
                self._send(HTTPStatus.BAD_REQUEST, "text/plain", b"this is not a request of the page")
                return
            self._respond(self.rfile.read(length))

        def _respond(self, body: bytes | None) -> None:
            url = urlsplit(self.path)
            response = None
            if url.path.startswith(prefix) and is_named(self.headers.get("Host", ""), LOCAL_HOSTS):
                with suppress(msgspec.DecodeError):
                    response = answer(url.path.removeprefix(prefix), parse_qs(url.query), body)
            if response is None:
                self._send(HTTPStatus.NOT_FOUND, "text/plain", b"there is nothing here")
            else:
                self._send(HTTPStatus.OK, *response)

        def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
            self.send_response(status)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            for name, header in _HEADERS.items():
                self.send_header(name, header)
            self.end_headers()
            self.wfile.write(content)

    return Handler
