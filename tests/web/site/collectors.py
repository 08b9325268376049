"""Stand-ins of the collectors DataPipe and JATOS, written from what they publish of themselves (29 November 2026).

DataPipe: its API page and the source of its function `apiData` (github.com/jspsych/datapipe, October 2025), its FAQ on
sizes (April 2026). JATOS: the jatos.js reference and the configuration page of its documentation (JATOS 3.9).
"""

import functools
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from tests.web.site.static_site import listening

MAX_REQUEST_BYTES = 32 * 1024 * 1024  # of DataPipe's host, which answers nothing to a larger one
MAX_RESULT_BYTES = 5 * 1024 * 1024  # of a JATOS component's run, unless its administrator sets another
EXPERIMENT = "AbCdEf123456"


@dataclass
class DataPipe:
    """The files of one experiment.

    Attributes:
        max_sessions: the experiment's limit, which each file counts against; None for none.
        lost_answers: the number of coming files that are kept although the page gets no answer.
    """

    address: str = ""
    max_sessions: int | None = None
    lost_answers: int = 0
    files: dict[str, str] = field(default_factory=dict)
    answers: list[str] = field(default_factory=list)

    def take(self, body: bytes) -> tuple[int, str]:
        """Take a request; return the status and the message's name."""
        if len(body) > MAX_REQUEST_BYTES:
            return 413, "too large"
        parameters = json.loads(body)
        if not all(isinstance(parameters.get(name), str) for name in ("experimentID", "filename", "data")):
            return 400, "MISSING_PARAMETER"
        if parameters["experimentID"] != EXPERIMENT:
            return 400, "EXPERIMENT_NOT_FOUND"
        if self.max_sessions is not None and len(self.files) >= self.max_sessions:
            return 400, "SESSION_LIMIT_REACHED"
        if parameters["filename"] in self.files:
            return 400, "OSF_FILE_EXISTS"
        self.files[parameters["filename"]] = parameters["data"]
        return 201, "Success"

    def write_files(self, folder: Path) -> Path:
        """Write the files as OSF gives them out."""
        folder.mkdir()
        for name, text in self.files.items():
            (folder / name).write_text(text, encoding="utf-8")
        return folder


@contextmanager
def running_datapipe(**settings: Any) -> Iterator[DataPipe]:
    """Run a DataPipe of one experiment, on an address of its own."""
    pipe = DataPipe(**settings)

    class Handler(BaseHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

        def _answer(self, status: int, body: bytes = b"") -> None:
            self.send_response(status)
            self.send_header("access-control-allow-origin", "*")
            self.send_header("access-control-allow-headers", "content-type")
            self.send_header("content-length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def do_OPTIONS(self) -> None:
            self._answer(204)

        def do_POST(self) -> None:
            status, message = pipe.take(self.rfile.read(int(self.headers["content-length"])))
            pipe.answers.append(message)
            if pipe.lost_answers and status == 201:
                pipe.lost_answers -= 1
                self.close_connection = True
                return
            self._answer(status, json.dumps({"message": message}).encode())

    with listening(Handler) as address:
        pipe.address = f"{address}api/data/"
        yield pipe


JATOS_JS = """
// The parts of jatos.js that a component needs which only saves: none works before it has loaded.
const jatos = (() => {
  let ready = false;
  const waiting = [], parameters = {};
  const need = () => { if (!ready) throw new Error("jatos.js is not initialised; call it from jatos.onLoad"); };
  const send = async (what, body) => {
    need();
    const response = await fetch(`../${what}`, { method: "POST", body });
    if (!response.ok) throw `${what} answered ${response.status}`;
  };
  addEventListener("load", () => setTimeout(async () => {
    Object.assign(parameters, await (await fetch("../query")).json());
    ready = true;
    waiting.forEach((callback) => callback());
  }, 300));
  return {
    get urlQueryParameters() { return ready ? parameters : undefined; },
    onLoad: (callback) => { if (ready) callback(); else waiting.push(callback); },
    appendResultData: (data) => send("append", typeof data === "string" ? data : JSON.stringify(data)),
    endStudy: async (successful = true, message = "", showEndPage = true) => {
      await send("end", JSON.stringify([successful, message]));
      if (showEndPage) location.href = "../end-page";
    },
    abortStudy: async (message = "", showEndPage = true) => {
      await send("abort", message);
      if (showEndPage) location.href = "../end-page";
    },
  };
})();
"""


@dataclass
class Jatos:
    """A run of one component.

    Attributes:
        address: the study link, which leads to the component and keeps its parameters for itself.
        state: of the run: "started", "finished", "fail" or "aborted".
    """

    address: str = ""
    result_data: str = ""
    state: str = "started"
    message: str = ""

    def take(self, what: str, body: str) -> int:
        """Take a call of jatos.js; return the status."""
        if self.state != "started":
            return 403
        if what == "append":
            if len((self.result_data + body).encode()) > MAX_RESULT_BYTES:
                return 413
            self.result_data += body
        elif what == "end":
            successful, self.message = json.loads(body)
            self.state = "finished" if successful else "fail"
        elif what == "abort":
            self.state, self.message, self.result_data = "aborted", body, ""
        return 200

    def write_results(self, folder: Path) -> Path:
        """Write the result data as JATOS exports it: a text file for each component's run."""
        folder.mkdir()
        (folder / "jatos_results_data.txt").write_text(self.result_data, encoding="utf-8")
        return folder


@contextmanager
def running_jatos(site: Path) -> Iterator[Jatos]:
    """Run a JATOS with a site's folder as the assets of its only component."""
    run = Jatos()
    query: dict[str, str] = {}

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

        def translate_path(self, path: str) -> str:
            return super().translate_path("/" + urlsplit(path).path.removeprefix("/publix/run/component/"))

        def _answer(self, status: int, body: str = "", kind: str = "text/plain") -> None:
            self.send_response(status)
            self.send_header("content-type", kind)
            self.send_header("content-length", str(len(body.encode())))
            self.end_headers()
            self.wfile.write(body.encode())

        def do_GET(self) -> None:
            address = urlsplit(self.path)
            if address.path == "/publix/link":
                query.update(pair.split("=") for pair in address.query.split("&") if pair)
                self.send_response(303)
                self.send_header("location", "/publix/run/component/start")
                self.end_headers()
            elif address.path.endswith("/start"):
                self._answer(200, (site / "index.html").read_text(encoding="utf-8"), "text/html")
            elif address.path.endswith("/jatos.js"):
                self._answer(200, JATOS_JS, "text/javascript")
            elif address.path == "/publix/run/query":
                self._answer(200, json.dumps(query), "application/json")
            else:
                super().do_GET()

        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["content-length"])).decode()
            self._answer(run.take(self.path.rpartition("/")[2], body))

    with listening(functools.partial(Handler, directory=str(site))) as address:
        run.address = f"{address}publix/link"
        yield run
