"""The experimenter's start page: studies, sessions due next, and buttons that start minihuman's commands.

The page makes no decisions: each button starts the process that the command line would start, and shows what it prints.
"""

import asyncio
import os
import re
import secrets
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TypeVar
from urllib.parse import parse_qsl, urlencode

import uvicorn
from jinja2 import Environment, PackageLoader, StrictUndefined
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, RedirectResponse, Response
from starlette.routing import Mount, Route, Router
from starlette.types import ASGIApp

from minihuman.admin.due import DueSession, list_due_sessions
from minihuman.admin.session_index import SessionRow, read_session_index
from minihuman.admin.status import list_problems
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.log.paths import PART_SUFFIX, require_folder
from minihuman.log.record.file_lock import is_being_recorded
from minihuman.runtime.http_guard import is_own_request, read_length
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from minihuman.web.http_security import build_headers
from minihuman.web.server.page_routes import HeaderMiddleware
from minihuman.web.server.process import HOST, open_listening_socket
from minihuman.web.server.request_timeout import TimedHttpProtocol

T = TypeVar("T")
REPORTS_FOLDER = "reports"  # beside the data folder
_NAME = re.compile(r"[a-z0-9_-]+")
_LINK = re.compile(r"https?://\S+")
_MAX_FORM_BYTES = 10_000
_SHOWN_BYTES = 20_000  # of what a command printed
_VERDICTS = {None: "running", 0: "done", 1: "failed", 2: "refused"}  # by exit status; any other: "ended"
_POLICY = "default-src 'self'; object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
_REPORT_POLICY = "sandbox allow-scripts allow-downloads; default-src 'self' 'unsafe-inline' data:; connect-src 'none'"


@dataclass(frozen=True, slots=True)
class StudyEntry:
    """A study with its protocol file, its recorded sessions, or both."""

    key: str  # identifies the study in the page's addresses
    name: str
    folder: Path  # of its sessions; need not exist
    protocol: Path | None = None
    problem: str = ""  # why its protocol cannot be read

    def sessions(self) -> list[SessionRow]:
        """Return the study's recorded sessions; empty if it has no folder."""
        if self.folder.is_dir():
            return list(read_session_index(self.folder))
        return []

    def due(self) -> tuple[DueSession, ...]:
        """Return the study's sessions that are expected next, including unfinished ones; empty if it has no folder."""
        if self.folder.is_dir():
            return list_due_sessions(self.folder)
        return ()

    def running(self) -> set[str]:
        """Return the codes of the study's participants whose sessions are being recorded now."""
        if not self.folder.is_dir():
            return set()
        parts = self.folder.rglob(f"*{PART_SUFFIX}")
        return {part.name.partition("_")[0] for part in parts if is_being_recorded(part)}

    def counts(self) -> Mapping[str, int]:
        """Return the number of the study's sessions in each state, by the word that ``describe_state`` returns."""
        running = self.running()
        return Counter(describe_state(row, running) for row in self.sessions())

    def command(self, action: str, form: Mapping[str, str]) -> list[str]:
        """Return the arguments of the command that a button starts.

        Args:
            action: the button's name, such as "next".
            form: the fields of the button's form by name.

        Raises:
            KeyError: if there is no such button, or it needs a protocol and the study has none.
        """
        folder = str(self.folder)
        protocol = str(self.protocol)
        data = f"--data={self.folder.parent}"
        reason_text = form.get("reason", "")
        session_number = form.get("session", 1)
        links = form.get("links", 1)
        reason = f"--reason={reason_text}"
        report_folder = self.folder.parent.parent / REPORTS_FOLDER / self.name
        code = form.get("participant", "")
        window = "--fullscreen"
        if form.get("windowed"):
            window = "--windowed"
        session = ["run", protocol, data, window, f"--participant={code}", f"--session={session_number}"]
        words = {
            "next": ["run", protocol, data, window, "--next-slot"],
            "session": session,
            "other day": [*session, "--any-day", reason],
            "replace": ["replace", f"--study={folder}", reason, "--", code],
            "check": ["check", protocol],
            "trust": ["check", protocol, "--trust"],
            "doctor": ["doctor", protocol, data, window],
            "serve": ["serve", protocol, data, "--port=0", f"--links={links}", "--watch"],
            "watch": ["watch", folder],
            "verify": ["verify", folder],
            "report": ["report", folder, f"--out={report_folder}"],
        }[action]
        if self.protocol is None and protocol in words:
            raise KeyError(action)
        return words


def describe_state(row: SessionRow, running: set[str]) -> str:
    """Return one word for a session's state: unreadable, ended, running or unfinished.

    ``running`` has the codes of the participants whose sessions are being recorded now.
    """
    summary = row.summary
    if summary is None:
        return "unreadable"
    if summary.complete or summary.end_reason in FINAL_END_REASONS:
        return "ended"
    if summary.participant in running:
        return "running"
    return "unfinished"


def find_studies(folder: Path, data: Path) -> list[StudyEntry]:
    """Find the studies that have a protocol in a folder, then other studies that have sessions in the data folder.

    Args:
        folder: the folder of the protocols, TOML files with a ``[study]`` table in it or in its subfolders.
        data: the folder that contains the studies' folders.
    """
    studies = []
    for path in sorted({*folder.glob("*.toml"), *folder.glob("[!.]*/*.toml")}):
        key = str(path.relative_to(folder))
        name = path.stem
        problem = ""
        try:
            with path.open("rb") as file:
                name = tomllib.load(file)["study"]["name"]
        except (KeyError, TypeError):
            continue  # a file of another program
        except (OSError, ValueError) as error:
            problem = f"{path.name} cannot be read: {error}"
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            problem = problem or f"study.name is {name!r}; use a-z, 0-9, - and _"
            name = path.stem
        studies.append(StudyEntry(key, name, data / name, path, problem))
    names = {study.name for study in studies}
    folders = sorted(path.parent for path in data.glob(f"*/{ENROLMENT_FILE_NAME}") if path.parent.name not in names)
    return studies + [StudyEntry(f"{path.name}/", path.name, path) for path in folders]


class CommandProcess:
    """A minihuman command that this process has started; one that records a session outlives this process.

    Args:
        words: the command's name and arguments, without the program's name.
        study: the study that the command is about; None if it is about this machine.
        output: the file to which the command's output is appended.
    """

    def __init__(self, words: list[str], study: StudyEntry | None, output: Path) -> None:
        self.words = words
        self.study = study
        self.started_at = datetime.now()
        self._output = output
        with output.open("ab") as file:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "minihuman", *words],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                start_new_session=True,  # Ctrl-C is for the page alone
            )

    @property
    def line(self) -> str:
        """Return the command line as a user would type it in a shell."""
        return shlex.join(["minihuman", *self.words])

    @property
    def verdict(self) -> str:
        """Return "running", or one word for how the command ended."""
        return _VERDICTS.get(self._process.poll(), "ended")

    def output(self) -> str:
        """Return the last part of what the command has printed."""
        with self._output.open("rb") as file:
            file.seek(max(0, self._output.stat().st_size - _SHOWN_BYTES))
            return file.read().decode(errors="replace")

    def links(self) -> list[str]:
        """Return the addresses in the output of a command that serves pages; empty for any other command."""
        if self.words[0] in ("watch", "serve"):
            return _LINK.findall(self.output())
        return []

    def last_line(self) -> str:
        """Return the last complete line that the command printed; "" if there is none."""
        *complete_lines, _ = self.output().split("\n")
        if not complete_lines:
            return ""
        return complete_lines[-1]

    def stop(self) -> None:
        """Terminate the command and wait until it has ended."""
        self._process.terminate()
        self._process.wait()


class StartPage:
    """The start page of one folder.

    Args:
        folder: the folder of the protocols.
        data: the folder of the studies' data.
        temporary: the folder for the commands' output.
        rooms: further applications that the page links to, by their paths below the page's own path.
    """

    def __init__(
        self, folder: Path, data: Path, temporary: Path, rooms: Mapping[str, ASGIApp] = MappingProxyType({})
    ) -> None:
        self._folder = folder
        self._data = data
        self._temporary = temporary
        self._rooms = rooms
        self._token = secrets.token_urlsafe(16)
        # a report may run scripts, which must not learn the token with which commands are started
        self._report_token = secrets.token_urlsafe(16)
        self._processes: list[CommandProcess] = []
        environment = Environment(
            loader=PackageLoader("minihuman.web.server"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
        )
        self._template = environment.get_template("desk.html.j2")
        self._files = {
            "desk.css": (environment.get_template("desk.css").render(), "text/css"),
            "desk.js": (environment.get_template("desk.js").render(), "text/javascript"),
        }

    @property
    def path(self) -> str:
        """Return the secret path of the page's address."""
        return f"/{self._token}/"

    @property
    def _reports_path(self) -> str:
        return f"/{self._report_token}"

    def app(self) -> Starlette:
        """Build the application, which answers only below its secret path and only to this machine's own name."""
        pages = Router(
            [
                Route("/", self._show_home),
                Route("/study", self._show_study),
                Route("/process/{number:int}", self._show_process),
                Route("/start", self._start_command, methods=["POST"]),
                Route("/process/{number:int}/stop", self._stop_command, methods=["POST"]),
                Route("/{name:str}", self._send_file),
            ]
        )
        reports = Router([Route("/{path:path}", self._send_report)])
        application = Starlette(
            routes=[
                Mount(self._reports_path, HeaderMiddleware(reports, build_headers(policy=_REPORT_POLICY))),
                *(Mount(f"{self.path}{path}", room) for path, room in self._rooms.items()),
                Mount(self.path.rstrip("/"), HeaderMiddleware(pages, build_headers(policy=_POLICY))),
            ],
            middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=[HOST])],
        )
        application.state.reports_path = self._reports_path  # rooms link to reports
        return application

    def close(self) -> None:
        """Stop all running commands except sessions."""
        for process in self._processes:
            if process.words[0] != "run" and process.verdict == "running":
                process.stop()

    def _render_page(self, kind: str, **values: object) -> HTMLResponse:
        return HTMLResponse(
            self._template.render(
                kind=kind,
                root=self.path,
                reports=self._reports_path,
                rooms=tuple(self._rooms),
                urlencode=urlencode,
                **values,
            )
        )

    def _show_home(self, _: Request) -> Response:
        """Answer with the list of studies and running commands."""
        return self._render_page(
            "home",
            studies=[(study, *self._try_to_read(study.counts)) for study in find_studies(self._folder, self._data)],
            folder=self._folder.resolve().name,
            doctor=self._find_latest(None, "doctor"),
            processes=[
                (number, process) for number, process in enumerate(self._processes) if process.verdict == "running"
            ],
        )

    def _show_study(self, request: Request) -> Response:
        """Answer with the page of one study: its sessions, those due next, its problems and its commands."""
        study = self._find_study(request.query_params.get("key", ""))
        sessions, problem = self._try_to_read(study.sessions)
        due, due_problem = self._try_to_read(study.due)
        problems: Sequence[str] | None = ()
        if sessions:
            problems, _ = self._try_to_read(partial(list_problems, study.folder))
        report = self._data.parent / REPORTS_FOLDER / study.name / "report.html"
        return self._render_page(
            "study",
            study=study,
            sessions=sessions or (),
            due=due or (),
            running=study.running(),
            problems=[text for text in (study.problem, problem, due_problem, *(problems or ())) if text],
            latest={command: self._find_latest(study, command) for command in ("check", "doctor", "verify", "report")},
            report=report.is_file(),
            processes=[(number, process) for number, process in enumerate(self._processes) if process.study == study],
        )

    def _show_process(self, request: Request) -> Response:
        number = request.path_params["number"]
        return self._render_page("process", number=number, process=self._get_process(number))

    async def _start_command(self, request: Request) -> Response:
        """Start the command of a button, and redirect to the page with its output."""
        _require_own_form(request)
        form = dict(parse_qsl((await request.body()).decode(errors="replace")))
        study = None
        words = ["doctor", "--windowed", f"--data={self._data}"]
        if form.get("study"):
            study = self._find_study(form["study"])
            try:
                words = study.command(form.get("action", ""), form)
            except KeyError:
                raise HTTPException(400, "there is no such button") from None
        number = len(self._processes)
        self._processes.append(CommandProcess(words, study, self._temporary / f"{number}.txt"))
        return RedirectResponse(f"{self.path}process/{number}", 303)

    async def _stop_command(self, request: Request) -> Response:
        _require_own_form(request)
        number = request.path_params["number"]
        await asyncio.to_thread(self._get_process(number).stop)
        return RedirectResponse(f"{self.path}process/{number}", 303)

    def _send_report(self, request: Request) -> Response:
        """Answer with a file below the folder of the reports."""
        reports = (self._data.parent / REPORTS_FOLDER).resolve()
        path = (reports / request.path_params["path"]).resolve()
        if not path.is_relative_to(reports) or not path.is_file():
            raise HTTPException(404)
        return FileResponse(path)

    def _send_file(self, request: Request) -> Response:
        name = request.path_params["name"]
        if name not in self._files:
            raise HTTPException(404)
        content, media_type = self._files[name]
        return Response(content, media_type=media_type)

    @staticmethod
    def _try_to_read(read: Callable[[], T]) -> tuple[T | None, str]:
        """Return the result of a function that reads files, and ""; if it fails, return None and the error's text."""
        try:
            return read(), ""
        except (MinihumanError, OSError) as error:
            return None, str(error)

    def _find_latest(self, study: StudyEntry | None, command: str) -> CommandProcess | None:
        """Return the latest process of a command for a study; None if there is none."""
        for process in reversed(self._processes):
            if process.study == study and process.words[0] == command:
                return process
        return None

    def _find_study(self, key: str) -> StudyEntry:
        for study in find_studies(self._folder, self._data):
            if study.key == key:
                return study
        raise HTTPException(404, "there is no such study")

    def _get_process(self, number: int) -> CommandProcess:
        if number >= len(self._processes):
            raise HTTPException(404, "there is no such command")
        return self._processes[number]


def _require_own_form(request: Request) -> None:
    """Refuse a request that was not sent by one of this page's own forms.

    Raises:
        HTTPException: if the request comes from another page, is not a form, or is too long.
    """
    if not is_own_request(request.headers):
        raise HTTPException(403, "this form is of another page")
    if read_length(request.headers.get("content-length", "0"), _MAX_FORM_BYTES) is None:
        raise HTTPException(413, "this form is too long")
    media_type = request.headers.get("content-type", "application/x-www-form-urlencoded")
    if media_type.partition(";")[0].strip() != "application/x-www-form-urlencoded":
        raise HTTPException(415, "this is no form")


def run_desk(
    folder: Path,
    data: Path,
    *,
    port: int,
    say: Callable[[str], None],
    rooms: Mapping[str, ASGIApp] = MappingProxyType({}),
) -> None:
    """Pass the start page's address to ``say``, and serve the page until SIGTERM or Ctrl-C.

    Args:
        folder: the folder of the protocols.
        data: the folder of the studies' data.
        port: the port; 0 selects a free one.
        say: receives the page's address.
        rooms: further applications that the page links to, as for `StartPage`.

    Raises:
        LogError: if the folder does not exist.
        ServeError: if the port is taken.
    """
    require_folder(folder, instead="the folder of the protocols")
    with (
        tempfile.TemporaryDirectory(prefix="minihuman-", ignore_cleanup_errors=True) as temporary,
        closing(StartPage(folder, data, Path(temporary), rooms)) as desk,
        closing(open_listening_socket(port)) as listening_socket,
        suppress(KeyboardInterrupt),
    ):
        say(f"http://{HOST}:{listening_socket.getsockname()[1]}{desk.path}")
        config = uvicorn.Config(
            desk.app(),
            access_log=False,
            http=TimedHttpProtocol,
            log_level="warning",
            timeout_graceful_shutdown=2,
        )
        uvicorn.Server(config).run(sockets=[listening_socket])
