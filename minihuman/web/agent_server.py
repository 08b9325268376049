"""Servers through which programs in any language take part in a study in place of a participant.

The sessions are offered over a small HTTP interface, and as tools of the Model Context Protocol for language models
that play by calling tools (extra ``mcp``). A program begins a session, receives each screen as JSON with its picture as
PNG, and answers it. These sessions are recorded and verified like those of language models. The numbers of connections
and sessions, the sizes of requests and their durations are bounded, and requests from web pages are refused. A session
is identified by a secret of 128 bits. If a program stays away, its log remains, and a session begun under the same name
resumes it.
"""

import base64
import json
import queue
import secrets
import threading
import time
from dataclasses import dataclass, field
from http.server import ThreadingHTTPServer
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.errors import MinihumanError
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import ModelSpec
from minihuman.log.paths import MODELS_FOLDER
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import GroupCommit
from minihuman.runtime.http_guard import LOCAL_HOSTS, GuardedHandler, GuardedServer, is_named, read_length
from minihuman.runtime.model_run import ModelRun
from minihuman.runtime.model_sessions import play_participant, require_playable
from minihuman.simulation.chat_client import ChatAnswer, ModelClient, ModelUnavailableError
from minihuman.simulation.model_conversation import RULES, Prompt

if TYPE_CHECKING:
    from mcp.server.mcpserver import MCPServer

MAX_BODY_BYTES = 65_536
MAX_NAME = 40
MAX_SESSIONS = 64  # at a time, and ended ones that are remembered
MAX_CONNECTIONS = 224  # each has two threads
ANSWER_WAIT_S = 60.0  # for the screen after an answer
REQUEST_S = 120.0  # from one answer to the next, and for a client to take one


class ProgramClient(ModelClient):
    """Hands screens to a program and takes its answers; screens are numbered, so that no answer is used twice.

    Args:
        name: the program's name, which is logged as the model's.
        timeout_s: the longest time to wait for the answer to a screen, in seconds.
    """

    def __init__(self, name: str, timeout_s: float) -> None:
        self.model = name
        self._timeout_s = timeout_s
        self._changed = threading.Condition()
        self._answers: queue.Queue[str] = queue.Queue()
        self._prompt: Prompt | None = None
        self._number = 0
        self.over = ""  # how the session ended; "" while it runs

    def ask(self, prompt: Prompt) -> ChatAnswer:
        """Show the program a screen, wait for its answer, and return the answer.

        Raises:
            ModelUnavailableError: if the program does not answer in time.
        """
        with self._changed:
            self._prompt = prompt
            self._number += 1
            self._changed.notify_all()
        began_s = time.perf_counter()
        try:
            text = self._answers.get(timeout=self._timeout_s)
        except queue.Empty:
            raise ModelUnavailableError("the program stayed away", temporary=False) from None
        return ChatAnswer(
            text,
            reasoning="",
            model=self.model,
            finish_reason="",
            prompt_tokens=0,
            completion_tokens=0,
            latency_ms=(time.perf_counter() - began_s) * 1_000,
        )

    def close(self) -> None:
        """Do nothing, since this client holds no resources."""

    def end(self, reason: str) -> None:
        """Record that the session is over, and why."""
        with self._changed:
            self._prompt = None
            self.over = reason
            self._changed.notify_all()

    def answer(self, number: int, text: str) -> bool:
        """Take the program's answer to the screen with a number.

        Returns:
            Whether the answer was taken; False, without an effect, if that screen is not waiting for an answer.
        """
        with self._changed:
            if self._prompt is None or number != self._number:
                return False
            self._prompt = None
        self._answers.put(text)
        return True

    def read_screen(self) -> dict[str, Any]:
        """Wait for a screen that needs an answer, and return it as a dictionary of JSON values.

        If the session ends, return only the last screen's number and, as ``"over"``, the reason. Without a screen or
        the end within ``ANSWER_WAIT_S``, return only that number, with ``"over": None``.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._prompt is not None or self.over, ANSWER_WAIT_S)
            if self._prompt is None:
                return {"number": self._number, "over": self.over or None}
            prompt = self._prompt
            rule = self._prompt.rule
            picture_png = None
            if prompt.picture is not None:
                picture_png = base64.b64encode(prompt.picture).decode()
            return {
                "number": self._number,
                "over": None,
                "screen": rule.screen,
                "read": prompt.read,
                "text": prompt.text,
                "picture_png": picture_png,
                "observation": prompt.observation,
                "keys": rule.keys,
                "actions": dict(rule.named),
                "buttons": rule.buttons,
                "options": len(rule.targets),
                "may_wait": rule.may_wait,
            }


class BadRequestError(MinihumanError, ValueError):
    """A program's request is invalid; the message is meant for the program."""


class TooManySessionsError(MinihumanError, BlockingIOError):
    """The limit of concurrent sessions is reached."""


@dataclass(slots=True)
class ProgramSessions:
    """Runs the sessions of programs that take part in a study.

    Args:
        protocol: the study.
        data: the data folder.

    Raises:
        SimulationError: if the study has parts that a program cannot take.
    """

    protocol: Protocol
    data: Path
    clients: dict[str, ProgramClient] = field(default_factory=dict)  # by secret; the last ended sessions', too
    threads: list[threading.Thread] = field(default_factory=list)
    lock: threading.Lock = field(default_factory=threading.Lock)
    group_commit: GroupCommit = field(default_factory=GroupCommit)

    def __post_init__(self) -> None:
        """Refuse a study that programs cannot take part in."""
        require_playable(self.protocol)

    def begin(self, name: object) -> tuple[str, ProgramClient]:
        """Begin a program's session, or resume an unfinished session of that name; return its secret and its client.

        Raises:
            BadRequestError: if the name is not valid.
            TooManySessionsError: if too many sessions are running.
        """
        if not (isinstance(name, str) and name.isprintable() and 0 < len(name) <= MAX_NAME):
            raise BadRequestError(f"name is not a text of 1 to {MAX_NAME} printable characters; send such a name")
        with self.lock:
            self.threads = [thread for thread in self.threads if thread.is_alive()]
            ended_secrets = [secret for secret, client in self.clients.items() if client.over]
            for ended_secret in ended_secrets[:-MAX_SESSIONS]:  # all but the latest
                del self.clients[ended_secret]
            if len(self.threads) >= MAX_SESSIONS:
                raise TooManySessionsError(f"{MAX_SESSIONS} sessions run already; try again later")
            secret = secrets.token_urlsafe(16)
            client = self.clients[secret] = ProgramClient(name, self.protocol.model.timeout_s)
            thread = threading.Thread(target=self._play_session, args=(client,), daemon=True)
            self.threads.append(thread)
            thread.start()
        return secret, client

    def _play_session(self, client: ProgramClient) -> None:
        """Run a program's session to its end, and tell the program how it ended."""
        data = self.data / MODELS_FOLDER

        def make_client(_: ModelSpec) -> ProgramClient:
            return client

        run = ModelRun(f"http:{client.model}", make_client, group_commit=self.group_commit)
        try:
            reason = "complete"  # without a log: the participant had completed all sessions before
            logs = play_participant(self.protocol, data, run)
            if logs:
                reason = read_log(logs[-1]).end_reason
            client.end(reason)
        except MinihumanError as error:
            client.end(type(error).__name__)
        except Exception:
            client.end("internal_error")
            raise


class AgentRequestHandler(GuardedHandler):
    """Answers a program's requests; `make_agent_server` sets the sessions that it serves."""

    programs: ProgramSessions
    host: str  # a name by which requests may address this machine, in addition to the local ones
    protocol_version = "HTTP/1.1"
    request_s = REQUEST_S
    timeout = REQUEST_S

    def do_GET(self) -> None:  # noqa: N802 - the library's name
        """Reply with the screen that is waiting for an answer."""
        if self._refuse_if_remote():
            return
        client = self._find_client()
        if client is not None:
            self._reply(200, client.read_screen())

    def do_POST(self) -> None:  # noqa: N802 - the library's name
        """Begin a session, or answer the screen of one."""
        if self._refuse_if_remote():
            return
        body = self._read_body()
        if body is None:
            return
        if self.path == "/sessions":
            self._begin_session(body)
            return
        client = self._find_client()
        if client is not None:
            self._answer_screen(client, body)

    def _begin_session(self, body: dict[str, Any]) -> None:
        """Begin a session, and reply with its secret and its first screen."""
        try:
            secret, client = self.programs.begin(body.get("name"))
        except BadRequestError as error:
            self._reply(400, {"error": str(error)})
        except TooManySessionsError as error:
            self._reply(503, {"error": str(error)})
        else:
            self._reply(201, {"session": f"/sessions/{secret}", **client.read_screen()})

    def _answer_screen(self, client: ProgramClient, body: dict[str, Any]) -> None:
        """Answer a screen, and reply with the next one."""
        number = body.get("number")
        answer = body.get("answer")
        if not isinstance(number, int) or not isinstance(answer, str):
            self._reply(400, {"error": 'send {"number": the screen\'s, "answer": a text}'})
        elif not client.answer(number, answer.encode("utf-8", "replace").decode()):
            self._reply(409, {"error": f"screen {number} does not wait for an answer", **client.read_screen()})
        else:
            self._reply(200, client.read_screen())

    def _find_client(self) -> ProgramClient | None:
        """Return the client of the session in the request's path; if there is none, reply 404 and return None."""
        client = self.programs.clients.get(self.path.removeprefix("/sessions/"))
        if client is None:
            self._reply(404, {"error": "this session does not exist; begin a session with POST /sessions"})
        return client

    def _refuse_if_remote(self) -> bool:
        """Refuse a request that does not come from a program on this machine, and return whether it was refused.

        Requests from web pages and requests that address the server by an unknown host name are refused, too.
        """
        is_local = is_named(self.headers.get("Host", ""), (*LOCAL_HOSTS, self.host)) and "Origin" not in self.headers
        if not is_local:
            self._refuse(403, "only programs on this machine may play; ask for http://127.0.0.1 and the port")
        return not is_local

    def _refuse(self, status: int, error: str) -> None:
        self.close_connection = True  # a body may follow that is not read
        self._reply(status, {"error": error})

    def _read_body(self) -> dict[str, Any] | None:
        """Return the request's body as a JSON object; reply with an error and return None if it is not a valid one."""
        length = read_length(self.headers.get("Content-Length", ""), MAX_BODY_BYTES)
        if length is None:
            self._refuse(413, f"send a body of at most {MAX_BODY_BYTES} bytes with its length")
            return None
        if self.headers.get_content_type() != "application/json":
            self._refuse(415, "send JSON, with the header Content-Type: application/json")
            return None
        try:
            body = json.loads(self.rfile.read(length))
        except (ValueError, RecursionError):
            body = None
        if not isinstance(body, dict):
            self._reply(400, {"error": "send a JSON object"})
            return None
        return body

    def _reply(self, status: int, values: dict[str, Any]) -> None:
        """Send a response with an HTTP status, and with values as a JSON object."""
        content = json.dumps(values).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)


def make_agent_server(programs: ProgramSessions, *, port: int, host: str = "127.0.0.1") -> ThreadingHTTPServer:
    """Return the HTTP server through which programs take part, on ``port`` of ``host``; ``serve_forever`` runs it.

    ``POST /sessions`` with ``{"name": ...}`` begins a session, ``POST /sessions/SECRET`` with ``{"number": n, "answer":
    ...}`` answers its screen, and ``GET /sessions/SECRET`` reads the screen again. Each request returns the next
    screen.
    """
    handler = type("BoundHandler", (AgentRequestHandler,), {"programs": programs, "host": host})
    return GuardedServer((host, port), handler, max_connections=MAX_CONNECTIONS)


_INSTRUCTIONS = (
    f"{RULES.partition('. ')[0]}. Call begin once, with a name of your own, then answer with each screen's number "
    "until over says how the session ended. A screen's text ends with what can be answered."
)


def make_mcp_server(programs: ProgramSessions) -> "MCPServer":
    """Return a server of the Model Context Protocol; its ``run()`` serves one client on standard input and output.

    Raises:
        ImportError: if the package ``mcp`` is not installed.
    """
    from mcp.server.mcpserver import MCPServer  # the extra mcp
    from mcp.server.mcpserver.exceptions import ToolError

    server = MCPServer("minihuman", instructions=_INSTRUCTIONS)

    def find_client(session: str) -> ProgramClient:
        if session not in programs.clients:
            raise ToolError("this session does not exist; begin a session first")
        return programs.clients[session]

    @server.tool(structured_output=False)
    def begin(name: str) -> list[Any]:
        """Begin a session, or resume an unfinished session of that name; return its secret and its first screen."""
        try:
            secret, client = programs.begin(name)
        except (BadRequestError, TooManySessionsError) as error:
            raise ToolError(str(error)) from error  # of any other exception the client gets the tool's name alone
        return _wait_for_screen(client, session=secret)

    @server.tool(structured_output=False)
    def answer(session: str, number: int, answer: str) -> list[Any]:
        """Answer the screen with that number; return the next screen."""
        client = find_client(session)
        if not client.answer(number, answer):
            raise ToolError(f"screen {number} does not wait for an answer; call read_screen")
        return _wait_for_screen(client)

    @server.tool(structured_output=False)
    def read_screen(session: str) -> list[Any]:
        """Return the screen that is waiting for an answer."""
        return _wait_for_screen(find_client(session))

    return server


def _wait_for_screen(client: ProgramClient, **more: str) -> list[Any]:
    """Wait for a client's screen; return its JSON text, which has the fields ``more``, too, and its picture, if any."""
    from mcp.server.mcpserver import Image

    screen = client.read_screen()
    png = screen.pop("picture_png", None)
    content: list[Any] = [json.dumps(more | screen)]
    if png is not None:
        content.append(Image(data=base64.b64decode(png), format="png"))
    return content
