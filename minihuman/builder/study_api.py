"""The builder's interface: JSON over the desk's server, below the desk's secret path, for the desk's own page only.

Every answer is JSON of a struct in `messages`; the page's types are generated from it. Study keys are sent as ``key``
in the query, since they contain slashes. All requests that change something are POSTs with the content type
``application/json`` (files: ``application/octet-stream``) from a page of the same origin.

    GET  api/studies                       -> Studies           cards and templates
    GET  api/study?key=                    -> Document          404 if there is no such file
    GET  api/form?table=blocks[&kind=]     -> FieldForm         of any table: study, blocks.stimuli, questions.items
    GET  api/kinds                         -> Kinds             what can be added
    GET  api/check?key=                    -> CheckReport       takes seconds: creates the worlds, checks every text
    POST api/edit?key=     EditRequest     -> Document          the file has been written
    POST api/undo?key=     VersionRequest  -> Document
    POST api/redo?key=     VersionRequest  -> Document
    POST api/new           NewStudyRequest -> Document          201
    GET  api/differences?key=&with=        -> Differences       of a new version from the old one
    GET  api/media?key=                    -> Media             the files beside the protocol
    GET  api/media/file?key=&name=         -> the bytes
    POST api/media/file?key=&name=  bytes  -> Media             201; an existing file is refused unless &replace=1
    GET  api/table?key=&name=              -> StimulusTable             a CSV file beside the protocol
    POST api/table?key=    TableRequest    -> StimulusTable
    POST api/import?folder=&path=   bytes  -> CopiedFile      201; into a new folder only
    GET  api/trust?key=                    -> TrustQuestion     the code that a study would run
    POST api/trust?key=    TrustRequest    -> Document
    GET  api/data?key=                     -> RecordedData      the sessions, and what can be asked of them
    GET  api/data/session?key=&log=        -> SessionDetails    episodes and answers
    GET  api/data/episode?key=&log=&episode=   -> EpisodeReplay
    GET  api/data/frame.png?key=&log=&episode=&step=  -> the bytes  what the participant saw after a step
    GET  api/data/paths.png?key=&log=      -> the bytes         a figure of a session's paths
    POST api/data/query?key=  QueryRequest -> QueryAnswer       of the tables; it changes nothing
    POST api/data/annotate?key=  AnnotationRequest -> RecordedData
    POST api/data/departure?key=  DepartureRequest -> Departure  withdraws or replaces a participant
    POST api/data/export?key=  ExportRequest -> DataExport      201; into a new folder beside the data

A request that is refused changes nothing and answers with an `EditRefusal`: 400 (not_valid, not_editable), 403
(restricted, not_trusted, another page), 404 (not_there), 409 (conflict, with the document as it is now; exists).

The page asks ``GET api/study`` again when it becomes visible, and every second while it is: an answer with another
``version`` means that the file was edited elsewhere. With ``&version=`` the answer is 204 while that is the version.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import TypeVar

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from minihuman.builder import data_messages, messages
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.form import build_form, list_kinds
from minihuman.builder.media import MAX_MEDIA_BYTES
from minihuman.builder.study_folder import StudyFolder
from minihuman.runtime.http_guard import is_own_request, read_length

Query = dict[str, str]
Body = TypeVar("Body", bound=msgspec.Struct)
_LONGEST_COUNT = 10  # digits of a number in a query
MAX_REQUEST_BYTES = 2**22  # of JSON: a protocol of a megabyte, escaped

_STATUS = {
    "conflict": HTTPStatus.CONFLICT,
    "exists": HTTPStatus.CONFLICT,
    "restricted": HTTPStatus.FORBIDDEN,
    "not_trusted": HTTPStatus.FORBIDDEN,
    "not_there": HTTPStatus.NOT_FOUND,
    "not_editable": HTTPStatus.BAD_REQUEST,
    "not_valid": HTTPStatus.BAD_REQUEST,
}


class BuilderApi:
    """The routes of the builder's interface for one folder of protocols.

    Args:
        folder: the folder of the protocols.
        data_folder: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data_folder: Path) -> None:
        self._studies = StudyFolder(folder, data_folder)

    def routes(self) -> list[Route]:
        """Return the routes, to be mounted below the builder's path."""
        return [
            self._get("/api/studies", lambda query: self._studies.list_studies()),
            self._get("/api/study", self._read_study),
            self._get("/api/form", lambda query: build_form(query["table"], query.get("kind", ""))),
            self._get("/api/kinds", lambda query: list_kinds()),
            self._get("/api/check", lambda query: self._studies.open(query["key"]).check()),
            self._get("/api/differences", lambda query: self._studies.compare(query["key"], query["with"])),
            self._get("/api/media", lambda query: self._studies.open(query["key"]).media().list_files()),
            self._get("/api/table", lambda query: self._studies.open(query["key"]).media().read_table(query["name"])),
            self._get("/api/data", lambda query: self._studies.open_data(query["key"]).describe()),
            self._get("/api/data/session", self._describe_session),
            self._get("/api/data/episode", self._describe_episode),
            self._post("/api/data/departure", data_messages.DepartureRequest, self._depart),
            Route("/api/data/frame.png", self._send_frame, methods=["GET"]),
            self._post("/api/data/query", data_messages.QueryRequest, self._query),
            self._post("/api/data/annotate", data_messages.AnnotationRequest, self._annotate),
            self._post("/api/data/export", data_messages.ExportRequest, self._export, HTTPStatus.CREATED),
            Route("/api/data/paths.png", self._send_paths, methods=["GET"]),
            Route("/api/media/file", self._send_file, methods=["GET"]),
            Route("/api/media/file", self._receive_file, methods=["POST"]),
            Route("/api/import", self._import_file, methods=["POST"]),
            self._get("/api/trust", lambda query: self._studies.open(query["key"]).ask_trust()),
            self._post("/api/trust", messages.TrustRequest, self._trust),
            self._post("/api/table", messages.TableRequest, self._write_table),
            self._post("/api/new", messages.NewStudyRequest, self._make, HTTPStatus.CREATED),
            self._post("/api/edit", messages.EditRequest, self._edit),
            self._post("/api/undo", messages.VersionRequest, self._undo),
            self._post("/api/redo", messages.VersionRequest, self._redo),
        ]

    def _read_study(self, query: Query) -> msgspec.Struct | None:
        study = self._studies.open(query["key"])
        if query.get("version") == study.version():
            return None
        return study.read()

    def _edit(self, query: Query, request: messages.EditRequest) -> msgspec.Struct:
        return self._studies.open(query["key"]).edit(request.version, request.edits)

    def _undo(self, query: Query, request: messages.VersionRequest) -> msgspec.Struct:
        return self._studies.open(query["key"]).undo(request.version)

    def _redo(self, query: Query, request: messages.VersionRequest) -> msgspec.Struct:
        return self._studies.open(query["key"]).redo(request.version)

    def _make(self, _: Query, request: messages.NewStudyRequest) -> msgspec.Struct:
        return self._studies.make(request)

    def _write_table(self, query: Query, request: messages.TableRequest) -> msgspec.Struct:
        return self._studies.open(query["key"]).media().write_table(request)

    def _query(self, query: Query, request: data_messages.QueryRequest) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).query(request.sql)

    def _annotate(self, query: Query, request: data_messages.AnnotationRequest) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).annotate(request)

    def _trust(self, query: Query, request: messages.TrustRequest) -> msgspec.Struct:
        return self._studies.open(query["key"]).trust(request.sha256)

    def _depart(self, query: Query, request: data_messages.DepartureRequest) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).depart(request)

    def _describe_session(self, query: Query) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).describe_session(query["log"])

    def _describe_episode(self, query: Query) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).describe_episode(query["log"], _parse_number(query["episode"]))

    def _export(self, query: Query, request: data_messages.ExportRequest) -> msgspec.Struct:
        return self._studies.open_data(query["key"]).export(request.format)

    async def _send_file(self, request: Request) -> Response:
        query = request.query_params
        return await _send_bytes(lambda: self._studies.open(query.get("key", "")).media().read(query.get("name", "")))

    async def _send_frame(self, request: Request) -> Response:
        query = request.query_params
        episode = _parse_number(query.get("episode", ""))
        step = _parse_number(query.get("step", ""))
        return await _send_bytes(
            lambda: (
                self._studies.open_data(query.get("key", "")).draw_step(query.get("log", ""), episode, step),
                "image/png",
            )
        )

    async def _send_paths(self, request: Request) -> Response:
        query = request.query_params
        return await _send_bytes(
            lambda: (self._studies.open_data(query.get("key", "")).draw_paths(query.get("log", "")), "image/png")
        )

    async def _receive_file(self, request: Request) -> Response:
        query = dict(request.query_params)
        content = await _read_body(request, "application/octet-stream", MAX_MEDIA_BYTES)
        if isinstance(content, Response):
            return content
        replace = query.get("replace") == "1"
        return await _answer(
            lambda: self._studies.open(query["key"]).media().write(query["name"], content, replace=replace),
            HTTPStatus.CREATED,
        )

    async def _import_file(self, request: Request) -> Response:
        query = dict(request.query_params)
        content = await _read_body(request, "application/octet-stream", MAX_MEDIA_BYTES)
        if isinstance(content, Response):
            return content
        return await _answer(
            lambda: self._studies.imports.write(query["folder"], query["path"], content), HTTPStatus.CREATED
        )

    def _get(self, path: str, answer: Callable[[Query], msgspec.Struct | None]) -> Route:
        """Return a route for GET requests at ``path``, which ``answer`` answers from the query; None is no content."""

        async def respond(request: Request) -> Response:
            return await _answer(partial(answer, dict(request.query_params)))

        return Route(path, respond, methods=["GET"])

    def _post(
        self,
        path: str,
        kind: type[Body],
        answer: Callable[[Query, Body], msgspec.Struct],
        status: HTTPStatus = HTTPStatus.OK,
    ) -> Route:
        """Return a route for POST requests that a function answers from the query and the JSON body.

        Args:
            path: the route's path.
            kind: the struct as which the body is decoded.
            answer: the function.
            status: the status of its answers.
        """

        async def respond(request: Request) -> Response:
            content = await _read_body(request, "application/json", MAX_REQUEST_BYTES)
            if isinstance(content, Response):
                return content
            try:
                body = msgspec.json.decode(content, type=kind)
            except (msgspec.DecodeError, UnicodeDecodeError) as error:
                return _build_refusal("not_valid", f"this is not a {kind.__name__}: {error}")
            return await _answer(partial(answer, dict(request.query_params), body), status)

        return Route(path, respond, methods=["POST"])


def _parse_number(text: str) -> int:
    """Parse a whole number in a query; return -1, which is no episode's or step's number, if the text is none."""
    return int(text) if text.isdecimal() and len(text) < _LONGEST_COUNT else -1


async def _read_body(request: Request, content_type: str, longest: int) -> bytes | Response:
    """Return the body of a request that comes from this server's page, or the response that refuses the request.

    Args:
        request: the request.
        content_type: the content type that it must have.
        longest: the largest length of its body in bytes.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    if not is_own_request(request.headers) or kind != content_type:
        return _build_refusal("not_trusted", "this is not a request of the builder's page")
    if read_length(request.headers.get("content-length", ""), longest) is None:
        return _build_refusal("not_valid", f"a request has {longest} bytes at most")
    return await request.body()


def _build_refusal(error: messages.RefusalReason, message: str) -> Response:
    content = msgspec.json.encode(messages.EditRefusal(error, message))
    return Response(content, _STATUS[error], media_type="application/json")


async def _send_bytes(read: Callable[[], tuple[bytes, str]]) -> Response:
    """Answer with the bytes and the media type that ``read``, run in another thread, returns, or with its refusal."""
    try:
        content, kind = await asyncio.to_thread(read)
    except EditRefusedError as error:
        return _build_refusal(error.refusal.error, error.refusal.message)
    return Response(content, media_type=kind)


async def _answer(build: Callable[[], msgspec.Struct | None], status: HTTPStatus = HTTPStatus.OK) -> Response:
    """Answer with the JSON of what ``build``, run in another thread, returns; with no content if that is None.

    If ``build`` raises an EditRefusedError, a KeyError or an OSError, the answer is a refusal. ``status`` is that of an
    answer with content.
    """
    try:
        content = await asyncio.to_thread(build)
    except EditRefusedError as error:
        return Response(msgspec.json.encode(error.refusal), _STATUS[error.refusal.error], media_type="application/json")
    except KeyError as error:
        return _build_refusal("not_valid", f"the request lacks {error.args[0]!r}")
    except OSError as error:
        return _build_refusal("not_valid", f"{error.filename or 'the file'}: {error.strerror}")
    if content is None:
        return Response(status_code=HTTPStatus.NO_CONTENT)
    return Response(msgspec.json.encode(content), status, media_type="application/json")
