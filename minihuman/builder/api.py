"""The builder's interface: JSON over the desk's server, below the desk's secret path, for the desk's own page only.

Every answer is JSON of a struct in `messages`; the page's types are generated from it. Study keys are sent as ``key``
in the query, since they contain slashes. All requests that change something are POSTs with the content type
``application/json`` (files: ``application/octet-stream``) from a page of the same origin.

    GET  api/studies                       -> Studies           cards and templates
    GET  api/study?key=                    -> Document          404 if there is no such file
    GET  api/form?table=blocks[&kind=]     -> Form              of any table: study, blocks.stimuli, questions.items
    GET  api/kinds                         -> Kinds             what can be added
    GET  api/check?key=                    -> CheckReport       takes seconds: creates the worlds, checks every text
    POST api/edit?key=     EditRequest     -> Document          the file has been written
    POST api/undo?key=     VersionRequest  -> Document
    POST api/redo?key=     VersionRequest  -> Document
    POST api/new           NewStudyRequest -> Document          201
    GET  api/media?key=                    -> Media             the files beside the protocol
    GET  api/media/file?key=&name=         -> the bytes
    POST api/media/file?key=&name=  bytes  -> Media             201; an existing file is refused unless &replace=1
    GET  api/table?key=&name=              -> Table             a CSV file beside the protocol
    POST api/table?key=    TableRequest    -> Table

A request that is refused changes nothing and answers with a `Refusal`: 400 (not_valid, not_editable), 403 (restricted,
not_trusted, another page), 404 (not_there), 409 (conflict, with the document as it is now; exists).

The page asks ``GET api/study`` again when it becomes visible, and every second while it is: an answer with another
``version`` means that the file was edited elsewhere. With ``&version=`` the answer is 204 while that is the version.
"""

import asyncio
from collections.abc import Callable
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from minihuman.builder import messages
from minihuman.builder.study import EditRefusedError, StudyFolder

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
        data: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data: Path) -> None:
        self._studies = StudyFolder(folder, data)

    def routes(self) -> list[Route]:
        """Return the routes, to be mounted below the builder's path."""
        return [
            self._get("/api/studies", lambda query: self._studies.list_studies()),
            self._get("/api/study", lambda query: self._studies.open(query["key"]).read()),
        ]

    def _get(self, path: str, answer: Callable[[dict[str, str]], msgspec.Struct]) -> Route:
        async def respond(request: Request) -> Response:
            return await _answer(partial(answer, dict(request.query_params)))

        return Route(path, respond, methods=["GET"])


async def _answer(build: Callable[[], msgspec.Struct], status: HTTPStatus = HTTPStatus.OK) -> Response:
    """Answer with what a function builds in another thread, or with its refusal."""
    try:
        content: Any = await asyncio.to_thread(build)
    except EditRefusedError as error:
        content = error.refusal
        status = _STATUS[error.refusal.error]
    except KeyError as error:
        status = HTTPStatus.BAD_REQUEST
        content = messages.Refusal("not_valid", f"the request lacks {error.args[0]!r}")
    return Response(msgspec.json.encode(content), status, media_type="application/json")
