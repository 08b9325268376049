"""Previews and trials of a protocol: the real page of a disposable session, on a port of its own.

`PreviewServer` runs in a process of its own (`minihuman.builder.preview_process`), since the worlds of a protocol run
in it. Each preview has its own server and port, so its pages share neither storage nor origin with any other page;
only the desk may frame them. Sessions are recorded in a temporary folder, which is erased with the preview.
"""

import shutil
import tempfile
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import msgspec
import uvicorn
from starlette.types import ASGIApp

from minihuman.admin.protocol_file import read_protocol
from minihuman.builder.preview_focus import UnfocusedPage
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.allocation import build_allocation_list
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import WebSpec
from minihuman.experiment.words import LANGUAGES
from minihuman.web.arrivals import Admission, Arrival, Arrivals
from minihuman.web.message_codec import MAX_MESSAGE_BYTES
from minihuman.web.server.app import WebServer
from minihuman.web.server.process import HOST, open_listening_socket, require_browser_support
from minihuman.web.server.request_timeout import TimedHttpProtocol

MAX_PREVIEWS = 3  # of each kind; the oldest is closed
_STOP_S = 3.0
Kind = Literal["preview", "trial"]


class PreviewRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which session is shown, and to whom.

    Attributes:
        protocol: the path of the protocol's file.
        desk: the host and port whose pages may frame the session.
        part: the name of the part with which the session begins; "" for the first.
        group: the group of the participant; "" for that of the first slot.
        session: the number of the session.
        language: of the interface's words; "" for the study's.
        onward: whether the session goes on after the part.
        kind: a preview gives way to later previews, and a trial to later trials.
    """

    protocol: str
    desk: str
    part: str = ""
    group: str = ""
    session: int = 1
    language: str = ""
    onward: bool = False
    kind: Kind = "preview"


class Preview(msgspec.Struct, frozen=True):
    """A session that is served.

    Attributes:
        url: the address of its page.
        parts: the names of the whole session's parts, in order, those that come by themselves included.
        part: the part with which it begins.
        kind: the kind of this part.
        participant: the code of the participant whose session it shows.
        group: the participant's group.
    """

    url: str
    parts: tuple[str, ...]
    part: str
    kind: str
    participant: str
    group: str


def plan_preview(protocol: Protocol, request: PreviewRequest) -> tuple[SessionPlan, tuple[str, ...]]:
    """Return the plan of the session that a request asks for, and the names of all parts of the whole session.

    The plan is that of the group's first participant, with the same seeds, key maps and orders. It has all parts if the
    request names none; else that part, and the later ones if the request says ``onward``.

    Raises:
        ProtocolError: if the group has no such part.
    """
    plan = _plan_session(protocol, request)
    names = tuple(part.name for part in plan.parts)
    start = names.index(request.part) if request.part else 0
    end = len(names) if request.onward or not request.part else start + 1
    return msgspec.structs.replace(plan, parts=_select_parts(plan.parts, start, end)), names


def _plan_session(protocol: Protocol, request: PreviewRequest) -> SessionPlan:
    """Plan the whole session of the requested group, or of the first group that has the requested part.

    Raises:
        ProtocolError: if no group has the part.
    """
    groups = (request.group,) if request.group else tuple(group.name for group in protocol.groups)
    for group in groups:
        participant = enrol_participant(protocol, _find_first_slot(protocol, group), group)
        plan = expand_protocol(protocol, participant, session=request.session)
        if not request.part or any(part.name == request.part for part in plan.parts):
            return plan
    raise ProtocolError(
        f"part {request.part!r} is not in session {request.session} of {' or '.join(groups)}; add it to the group"
    )


def _find_first_slot(protocol: Protocol, group: str) -> int:
    """Return the index of a group's first slot on the allocation list; 0 if no slot has this group."""
    slots = build_allocation_list(protocol)
    return next((index for index, slot in enumerate(slots) if slot.group == group), 0)


def _select_parts(parts: Sequence[PlannedPart], start: int, end: int) -> tuple[PlannedPart, ...]:
    """Return the parts from index ``start`` to before ``end``.

    Where a part leads back to an earlier part, the index of the earlier part is renumbered; it is None if that part is
    omitted.
    """
    kept = []
    for part in parts[start:end]:
        back_to = getattr(part.plan, "back_to", None)
        if back_to is not None:
            renumbered = back_to - start if back_to >= start else None
            part = msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, back_to=renumbered))
        kept.append(part)
    return tuple(kept)


def change_language(protocol: Protocol, language: str) -> Protocol:
    """Return a protocol whose interface has another language's words; "" keeps the study's language.

    The texts that the study itself has do not change.

    Raises:
        ProtocolError: if the package has no words of the language.
    """
    if not language or language == protocol.study.language:
        return protocol
    if language not in LANGUAGES:
        raise ProtocolError(f"language is {language!r}; preview the study in one of {', '.join(LANGUAGES)}")
    return msgspec.structs.replace(protocol, study=msgspec.structs.replace(protocol.study, language=language))


class _PreviewArrivals(Arrivals):
    """Admits every visitor to one planned session, without enrolment."""

    def __init__(self, protocol: Protocol, data_folder: Path, plan: SessionPlan) -> None:
        super().__init__(protocol, data_folder)
        self._plan = plan

    def arrive(self, arrival: Arrival) -> Admission:
        """Admit the visitor to the planned session."""
        participant = self._plan.participant.id
        key = f"{participant}/{self._plan.session}"
        return Admission(key, participant, self._plan.session, None, self._plan, is_invited=True)


def _restrict_to_desk(protocol: Protocol, desk: str) -> Protocol:
    """Return a protocol whose page any browser can open, and only pages of ``desk`` (host and port) can frame."""
    web = WebSpec(
        image_size_px=protocol.web.image_size_px,
        image_encoding=protocol.web.image_encoding,
        require_keyboard=False,
        open_access=True,
        embed_in=(desk,),
    )
    return msgspec.structs.replace(protocol, web=web)


@dataclass
class _RunningPreview:
    """A preview with its server, the server's thread and the folder of its recordings."""

    server: uvicorn.Server
    thread: threading.Thread
    data_folder: Path

    def close(self) -> None:
        """Stop the server, and erase what was recorded."""
        self.server.should_exit = True
        self.thread.join(_STOP_S)
        shutil.rmtree(self.data_folder, ignore_errors=True)


@dataclass
class PreviewServer:
    """Serves previews and trials, each in a thread; keeps the latest few of each kind, and ends older ones."""

    _running: dict[Kind, deque[_RunningPreview]] = field(default_factory=lambda: {"preview": deque(), "trial": deque()})

    def show(self, request: PreviewRequest) -> Preview:
        """Read a protocol's file as it is now, and serve a session of it.

        Raises:
            ProtocolError: if the file is not valid, runs code of a folder that is not trusted, or has no such part.
        """
        protocol = change_language(read_protocol(Path(request.protocol)), request.language)
        require_browser_support(protocol)
        plan, names = plan_preview(protocol, request)
        data_folder = Path(tempfile.mkdtemp(prefix="minihuman-preview-"))
        allowed = _restrict_to_desk(protocol, request.desk)
        server = WebServer(_PreviewArrivals(allowed, data_folder, plan), data_folder)
        app: ASGIApp = server.app()
        if request.kind == "preview":
            app = UnfocusedPage(app)
        url = self._serve(request.kind, app, data_folder)
        part = plan.parts[0]
        return Preview(url, names, part.name, part.kind, plan.participant.id, plan.participant.group)

    def _serve(self, kind: Kind, app: ASGIApp, data_folder: Path) -> str:
        """Serve an application on a free port, and return its address.

        If more than `MAX_PREVIEWS` of this kind are served then, the oldest is closed.

        Args:
            kind: whether it is a preview or a trial.
            app: the application.
            data_folder: the folder of its recordings, which is erased when it is closed.
        """
        listening_socket = open_listening_socket(0)
        config = uvicorn.Config(
            app,
            http=TimedHttpProtocol,
            ws="websockets-sansio",
            ws_max_size=MAX_MESSAGE_BYTES,
            ws_per_message_deflate=False,
            access_log=False,
            log_level="error",
            timeout_graceful_shutdown=1,
        )
        server = uvicorn.Server(config)
        thread = threading.Thread(
            target=server.run, kwargs={"sockets": [listening_socket]}, name="minihuman-preview", daemon=True
        )
        thread.start()
        running = self._running[kind]
        running.append(_RunningPreview(server, thread, data_folder))
        if len(running) > MAX_PREVIEWS:
            threading.Thread(target=running.popleft().close, daemon=True).start()
        return f"http://{HOST}:{listening_socket.getsockname()[1]}/"

    def close(self) -> None:
        """Stop every preview, and erase what was recorded."""
        for running in self._running.values():
            while running:
                with suppress(OSError):
                    running.popleft().close()
