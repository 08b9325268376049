"""The recorded sessions of a study, as the page shows them: sessions, queries, annotations and exports.

Each answer has the command that does the same. A log is named by its path in the study's folder, and is opened only if
the session index lists it.
"""

import io
import shlex
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from minihuman.admin.enrolment_entries import AuditNote
from minihuman.admin.session_index import SessionRow
from minihuman.admin.withdrawal import replace_participant, withdraw_participant
from minihuman.builder import episode_replay
from minihuman.builder.data_messages import (
    AnnotationRequest,
    DataExport,
    Departure,
    DepartureRequest,
    EpisodeReplay,
    QueryAnswer,
    QueryExample,
    RecordedData,
    RecordedSession,
    SessionDetails,
    SessionNote,
)
from minihuman.builder.edit_errors import EditRefusedError
from minihuman.builder.messages import EditRefusal, RefusalReason
from minihuman.dataset.annotations import Annotation, add_annotation, read_annotations
from minihuman.errors import MinihumanError
from minihuman.exporters.exporter import list_exporters
from minihuman.log.read.session_reader import read_log
from minihuman.storage.system import now_text
from minihuman.web.server.desk import StudyEntry, describe_state

MOST_ROWS = 200  # of a query's result that the page shows
EXPORTS_FOLDER = "exports"  # beside the data folder
EXAMPLES = (
    QueryExample(
        "Episodes and mean reward of each participant",
        'select participant, "group", count(*) as episodes, avg(reward) as mean_reward\n'
        "from episodes group by all order by all",
    ),
    QueryExample(
        "How episodes ended, by block",
        "select block, outcome, count(*) as episodes\nfrom episodes group by all order by all",
    ),
    QueryExample(
        "Sessions, and why one is excluded",
        "select participant, session, started_at, end_reason, episodes, exclusion_reason\n"
        "from participants order by participant, session",
    ),
)
_DOTS_PER_INCH = 130
_DRAWING = threading.Lock()  # matplotlib's settings are those of the whole process


class RecordedStudy:
    """The recorded sessions of a study, each named by the path of its log in the study's folder.

    Args:
        study_entry: the study.
    """

    def __init__(self, study_entry: StudyEntry) -> None:
        self._study_entry = study_entry
        self._folder = study_entry.folder

    def describe(self) -> RecordedData:
        """Describe every recorded session, and list example queries and the formats of exports.

        Raises:
            EditRefusedError: if the folder cannot be read.
        """
        with _refuse_errors():
            running = self._study_entry.running()
            sessions = [self._describe_session(row, running) for row in self._study_entry.sessions()]
            return RecordedData(_format_path(self._folder), sessions, list(EXAMPLES), list(list_exporters()))

    def draw_paths(self, log: str) -> bytes:
        """Draw the paths of a session's episodes as a PNG; ``log`` is the log's path in the study's folder.

        Raises:
            EditRefusedError: if there is no such log, or it has nothing to draw.
        """
        # here, as matplotlib takes a second that no other view needs
        from matplotlib.backends.backend_agg import FigureCanvasAgg

        from minihuman.figures.path_figures import session_paths
        from minihuman.figures.style import figure_style

        with _refuse_errors():
            session = read_log(self._find_log(log))
            if not session.episodes:
                raise _refuse("not_there", f"{log} has no episodes to draw")
            png = io.BytesIO()
            with _DRAWING, figure_style():
                FigureCanvasAgg(session_paths(session)).print_figure(
                    png, dpi=_DOTS_PER_INCH, format="png", bbox_inches="tight"
                )
            return png.getvalue()

    def describe_session(self, log: str) -> SessionDetails:
        """Return the episodes and the answers of a session, which the path of its log in the study's folder names.

        Raises:
            EditRefusedError: if there is no such log, or it cannot be read.
        """
        with _refuse_errors():
            return episode_replay.describe_session(read_log(self._find_log(log)))

    def describe_episode(self, log: str, number: int) -> EpisodeReplay:
        """Return episode ``number`` of a session step by step; ``log`` is the log's path in the study's folder.

        Raises:
            EditRefusedError: if there is no such log or episode.
        """
        with _refuse_errors():
            return episode_replay.describe_episode(read_log(self._find_log(log)), number)

    def draw_step(self, log: str, number: int, step: int) -> bytes:
        """Draw what the participant saw after step ``step`` of episode ``number``, as a PNG; step 0 is the reset.

        Raises:
            EditRefusedError: if there is no such step, or the world no longer shows what was seen.
        """
        with _refuse_errors():
            return episode_replay.draw_step(self._find_log(log), number, step)

    def depart(self, request: DepartureRequest) -> Departure:
        """Withdraw a participant and erase their data, or free the slot of one whose data are kept.

        Raises:
            EditRefusedError: if there is no such participant, a session of theirs is running, or there is no reason.
        """
        arguments = [request.participant, f"--study={_format_path(self._folder)}", f"--reason={request.reason}"]
        if request.experimenter:
            arguments.append(f"--experimenter={request.experimenter}")
        with _refuse_errors():
            if not request.reason.strip():
                raise _refuse("not_valid", "a departure has no reason; write why, for the enrolment log")
            note = AuditNote(request.reason.strip(), request.experimenter)
            lines = self._carry_out_departure(request, note)
        if request.kind == "withdraw":
            arguments.append("--erase")
        return Departure(lines, _format_command(request.kind, *arguments), self.describe())

    def _carry_out_departure(self, request: DepartureRequest, note: AuditNote) -> list[str]:
        """Withdraw or replace a participant; return the lines that report it, as the command prints them."""
        if request.kind == "replace":
            replace_participant(self._folder, request.participant, note)
            return [f"The next session offers {request.participant}'s slot; their data stay."]
        withdrawal = withdraw_participant(self._folder, request.participant, seal=None, note=note)
        return [withdrawal.line(), *withdrawal.left]

    def query(self, sql: str) -> QueryAnswer:
        """Answer a query in SQL of the study's tables, with the first `MOST_ROWS` rows; the query changes nothing.

        Raises:
            EditRefusedError: if the tables cannot answer it.
        """
        from minihuman.dataset.tables import answer_query, select

        with _refuse_errors(), select(self._folder) as tables:
            answer = answer_query(tables, sql)
            rows = [[_format_cell(cell) for cell in row.values()] for row in answer.slice(0, MOST_ROWS).to_pylist()]
            notes = [*(log.line() for log in tables.account.skipped), *tables.account.notes]
        return QueryAnswer(
            list(answer.column_names),
            rows,
            answer.num_rows,
            notes,
            _format_command("query", _format_path(self._folder), sql),
        )

    def annotate(self, request: AnnotationRequest) -> RecordedData:
        """Annotate a session or an episode, or take an annotation back; return the sessions as they are then.

        Raises:
            EditRefusedError: if there is no such log or episode, the tag is not valid, or there is no reason.
        """
        with _refuse_errors():
            path = self._find_log(request.log)
            if not request.note.strip():
                raise _refuse("not_valid", "an annotation has no reason; write why, for those who read the data later")
            annotation = Annotation(
                request.tag, now_text(), request.episode, request.note.strip(), taken_back=request.take_back
            )
            add_annotation(read_log(path), annotation)
        return self.describe()

    def export(self, format_name: str) -> DataExport:
        """Export the study into a new folder beside the data.

        Raises:
            EditRefusedError: if the format is unknown, or nothing can be exported.
        """
        from minihuman.api import export

        with _refuse_errors():
            out = self._find_export_folder(format_name)
            export(format_name, self._folder, out)
        return DataExport(
            _format_path(out),
            _format_command("export", format_name, _format_path(self._folder), f"--out={_format_path(out)}"),
        )

    def _find_export_folder(self, format_name: str) -> Path:
        """Return the path of a folder for a new export, which does not exist yet.

        Raises:
            EditRefusedError: if the format is unknown.
        """
        if format_name not in list_exporters():
            raise _refuse("not_valid", f"there is no format {format_name!r}; choose {', '.join(list_exporters())}")
        folder = self._folder.parent.parent / EXPORTS_FOLDER
        out = folder / f"{self._study_entry.name}-{format_name}"
        number = 2
        while out.exists():
            out = folder / f"{self._study_entry.name}-{format_name}-{number}"
            number += 1
        return out

    def _find_log(self, log: str) -> Path:
        """Return the path of a log that is named by its path in the study's folder.

        Raises:
            EditRefusedError: if the session index does not list it.
        """
        for row in self._study_entry.sessions():
            if row.path.relative_to(self._folder).as_posix() == log:
                return row.path
        raise _refuse("not_there", f"the study has no log {log!r} any more; reload the page")

    def _describe_session(self, row: SessionRow, running: set[str]) -> RecordedSession:
        """Describe a session for the page; if its log cannot be read, with the problem and mostly empty fields.

        Args:
            row: the session's row in the session index.
            running: the sessions of the study that are running, as the study's entry lists them.
        """
        log = row.path.relative_to(self._folder).as_posix()
        state = describe_state(row, running)
        replay = _format_command("replay", _format_path(row.path))
        if row.summary is None:  # the file's name for the participant; nothing is known but the state and the problem
            return RecordedSession(log, row.path.name, "", 0, state, "", 0, 0, 0.0, [], row.problem, replay, "", "")
        summary = row.summary
        notes, problem = _read_notes(row.path)
        return RecordedSession(
            log=log,
            participant=summary.participant,
            group=summary.group,
            session=summary.session,
            state=state,
            started_at=summary.started_at,
            episodes_completed=summary.episodes_completed,
            episodes_planned=summary.episodes_planned,
            minutes=summary.duration_s / 60,
            notes=notes,
            problem=problem,
            replay_command=replay,
            annotate_command=_format_command("annotate", _format_path(row.path)),
            film_command=_format_command("film", _format_path(row.path)),
        )


def _read_notes(log: Path) -> tuple[list[SessionNote], str]:
    """Return the annotations of a log that are in force, and why they cannot be read, "" if they can."""
    try:
        annotations = read_annotations(log)
    except MinihumanError as error:
        return [], str(error)
    in_force: dict[tuple[int | None, str], SessionNote] = {}
    for annotation in annotations:
        key = (annotation.episode, annotation.tag)
        in_force.pop(key, None)  # so that a repeated annotation comes last
        if not annotation.taken_back:
            in_force[key] = SessionNote(annotation.tag, annotation.episode, annotation.note)
    return list(in_force.values()), ""


def _format_cell(cell: object) -> str:
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell:.6g}"
    return str(cell)


def _format_path(path: Path) -> str:
    """Return a path relative to the working directory if it is inside, as users type commands there; else unchanged.

    A desk that runs in the root directory was not started there by a user, so its paths are unchanged, too.
    """
    working_directory = Path.cwd()
    is_root = working_directory == Path(working_directory.anchor)
    if not is_root and path.is_relative_to(working_directory):
        return str(path.relative_to(working_directory))
    return str(path)


def _format_command(*arguments: str) -> str:
    return shlex.join(["minihuman", *arguments])


def _refuse(reason: RefusalReason, message: str) -> EditRefusedError:
    return EditRefusedError(EditRefusal(reason, message))


@contextmanager
def _refuse_errors() -> Iterator[None]:
    """Replace an error of the package that is raised in the context by an EditRefusedError with its message."""
    try:
        yield
    except EditRefusedError:
        raise
    except MinihumanError as error:
        raise _refuse("not_valid", str(error)) from error
