"""The builder's previews and trials, as routes below the builder's path; `study_api` has the routes of the file.

    POST api/preview?key=   ShowRequest -> Preview   a session of the file as it is now
    POST api/simulate?key=              -> SimulationRun  201; twenty simulated participants and their report
    GET  api/simulate?number=           -> SimulationRun
    GET  api/world?id=                  -> WorldInfo
    GET  api/world.png?id=                           a picture of a built-in world
    GET  api/cell.png?cell=                          a picture of a cell of a level: "Ky"
    GET  api/template.png?name=                      a picture of a template
    GET  api/page                       -> PageInfo  where the desk's other pages are

Requests that change something are refused unless they come from a page of the desk. A refusal is a `EditRefusal` of
`messages`.
"""

import asyncio
import tempfile
from collections.abc import Callable
from contextlib import closing
from functools import cache
from http import HTTPStatus
from pathlib import Path

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from minihuman.builder.card_pictures import BLANK_PNG, draw_cell, draw_template, draw_world
from minihuman.builder.messages import EditRefusal
from minihuman.builder.preview_process import PreviewProcess
from minihuman.builder.preview_server import Kind, PreviewRequest
from minihuman.builder.trial_runs import SimulatedTrial
from minihuman.errors import MinihumanError, ProtocolError
from minihuman.experiment.keys import assign_usual_keys
from minihuman.experiment.plan.dry_run import find_needed_actions
from minihuman.runtime.http_guard import is_own_request, read_length
from minihuman.web.server.desk import REPORTS_FOLDER, StudyEntry, find_studies
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import TEAM_WORLDS, WORLDS

_MAX_REQUEST_BYTES = 10_000  # of a request
MOVES = ("left", "right", "forward", "turn_left", "turn_right", "move_forward", "up", "down", "interact")


class ShowRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The session that the page asks for; the fields are those of `PreviewRequest`."""

    part: str = ""
    group: str = ""
    session: int = 1
    language: str = ""
    onward: bool = False
    kind: Kind = "preview"


class PageInfo(msgspec.Struct, frozen=True):
    """Where the desk's other pages are.

    Attributes:
        reports: the path below which reports are served.
        desk: the path of the desk's start page.
    """

    reports: str
    desk: str


class WorldInfo(msgspec.Struct, frozen=True):
    """A world as a block needs it.

    Attributes:
        id: the world's id.
        actions: the names of all its actions.
        usual_actions: the actions that a participant usually needs.
        default_keys: the keys that its actions usually have, physical key -> action.
        max_steps: the length of an episode; 0 if the world has no limit of its own.
    """

    id: str
    actions: list[str]
    usual_actions: list[str]
    default_keys: dict[str, str]
    max_steps: int


class PreviewApi:
    """The routes of the builder's page, its previews and its trials.

    Args:
        folder: the folder of the protocols.
        data_folder: the folder of the studies' data.
    """

    def __init__(self, folder: Path, data_folder: Path) -> None:
        self._folder = folder
        self._data = data_folder
        self._temporary = tempfile.TemporaryDirectory(prefix="minihuman-trials-", ignore_cleanup_errors=True)
        self._previews = PreviewProcess()
        self._trials: list[SimulatedTrial] = []

    def routes(self) -> list[Route]:
        """Return the routes, to be mounted below the builder's path."""
        return [
            Route("/api/preview", self._post(self._show), methods=["POST"]),
            Route("/api/simulate", self._post(self._simulate), methods=["POST"]),
            Route("/api/simulate", self._describe_trial, methods=["GET"]),
            Route("/api/world", _send_world_info),
            Route("/api/world.png", _send_world_picture),
            Route("/api/cell.png", _send_cell_picture),
            Route("/api/template.png", _send_template_picture),
            Route("/api/page", self._describe_page),
        ]

    def close(self) -> None:
        """End previews and simulations, and erase what they recorded."""
        self._previews.close()
        for trial in self._trials:
            trial.close()
        self._temporary.cleanup()

    def _post(self, answer: Callable[[Request, bytes], msgspec.Struct]) -> Callable[[Request], object]:
        """Return a handler of POST requests that encodes what ``answer`` returns for a request and its body.

        ``answer`` runs in another thread. The handler refuses requests that do not come from a page of the desk, and
        reports errors of ``answer`` as refusals.
        """

        async def respond(request: Request) -> Response:
            length = read_length(request.headers.get("content-length", "0"), _MAX_REQUEST_BYTES)
            if not is_own_request(request.headers) or length is None:
                refusal = EditRefusal("not_trusted", "the request is not of the desk's own page; reload the page")
                return _build_response(refusal, HTTPStatus.FORBIDDEN)
            body = await request.body()
            try:
                return _build_response(await asyncio.to_thread(answer, request, body), HTTPStatus.OK)
            except (MinihumanError, msgspec.DecodeError) as error:
                return _build_response(EditRefusal("not_valid", str(error)), HTTPStatus.BAD_REQUEST)

        return respond

    def _show(self, request: Request, body: bytes) -> msgspec.Struct:
        """Serve the session that the body asks for, of the study's file as it is now; return the `Preview`."""
        show_request = msgspec.json.decode(body, type=ShowRequest)
        protocol = self._find_study(request).protocol
        desk = request.headers.get("host", "")
        return self._previews.show(PreviewRequest(str(protocol), desk, **msgspec.structs.asdict(show_request)))

    def _simulate(self, request: Request, body: bytes) -> msgspec.Struct:
        """Start a simulation of the study that the request names; return its `SimulationRun`."""
        study = self._find_study(request)
        assert study.protocol is not None
        reports = self._data.parent / REPORTS_FOLDER
        trial = SimulatedTrial(len(self._trials), study.protocol, study.name, Path(self._temporary.name), reports)
        self._trials.append(trial)
        return trial.describe()

    async def _describe_trial(self, request: Request) -> Response:
        """Answer with the state of the simulation whose number the request has."""
        number = request.query_params.get("number", "")
        if not number.isdecimal() or int(number) >= len(self._trials):
            return _build_response(
                EditRefusal("not_there", "there is no such simulation; start it again"), HTTPStatus.NOT_FOUND
            )
        return _build_response(self._trials[int(number)].describe(), HTTPStatus.OK)

    async def _describe_page(self, request: Request) -> Response:
        """Answer with the paths of the desk's other pages, and start the process of previews, which is needed next."""
        await asyncio.to_thread(self._previews.start)
        desk = str(request.scope["root_path"]).rpartition("/")[0]
        return _build_response(PageInfo(request.app.state.reports_path, f"{desk}/"), HTTPStatus.OK)

    def _find_study(self, request: Request) -> StudyEntry:
        """Return the study that a request names.

        Raises:
            ProtocolError: if there is none, or it has no protocol.
        """
        key = request.query_params.get("key", "")
        for study in find_studies(self._folder, self._data):
            if study.key == key and study.protocol is not None:
                return study
        raise ProtocolError(f"there is no protocol {key!r} in the folder any more; reload the list of studies")


def _build_response(content: msgspec.Struct, status: HTTPStatus) -> Response:
    return Response(msgspec.json.encode(content), status, media_type="application/json")


async def _send_world_picture(request: Request) -> Response:
    """Answer with a picture of the built-in world that the request names, or a blank one for any other world."""
    world_id = request.query_params.get("id", "")
    if world_id not in _list_world_ids():
        return _build_png_response(BLANK_PNG)
    return _build_png_response(await asyncio.to_thread(draw_world, world_id))


async def _send_world_info(request: Request) -> Response:
    """Answer with the `WorldInfo` of the built-in world that the request names, or refuse any other world."""
    world_id = request.query_params.get("id", "")
    if world_id not in _list_world_ids():
        message = f"{world_id!r} is not a built-in world; its actions are in its own documentation"
        return _build_response(EditRefusal("not_there", message), HTTPStatus.NOT_FOUND)
    try:
        return _build_response(await asyncio.to_thread(_describe_world, world_id), HTTPStatus.OK)
    except (MinihumanError, TypeError, ValueError) as error:  # a world that cannot be made without options
        return _build_response(EditRefusal("not_valid", str(error)), HTTPStatus.BAD_REQUEST)


async def _send_cell_picture(request: Request) -> Response:
    """Answer with a picture of a cell of a level; a blank one if the cell does not have two characters."""
    cell = request.query_params.get("cell", "")
    if len(cell) != 2:
        return _build_png_response(BLANK_PNG)
    return _build_png_response(await asyncio.to_thread(draw_cell, cell))


async def _send_template_picture(request: Request) -> Response:
    """Answer with the picture for the card of the template that the request names, or a blank one."""
    return _build_png_response(await asyncio.to_thread(draw_template, request.query_params.get("name", "")))


def _build_png_response(png: bytes) -> Response:
    return Response(png, media_type="image/png")


@cache
def _list_world_ids() -> frozenset[str]:
    return frozenset(world.id for world in (*WORLDS, *TEAM_WORLDS))


@cache
def _describe_world(world_id: str) -> WorldInfo:
    """Describe a world for a new block that uses it.

    The usual actions are moves and those that the shortest path needs; all actions if the world has none of these.
    """
    with closing(World(world_id)) as world:
        useful = {*MOVES, *find_needed_actions(world)}
        names = list(world.action_names)
        usual = [name for name in names if name in useful] or names
        return WorldInfo(world_id, names, usual, dict(assign_usual_keys(world)), world.step_limit or 0)
