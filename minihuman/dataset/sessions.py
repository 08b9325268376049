"""Read a study's sessions under a selection, in sequence or in parallel, and summarize what is included."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from minihuman.dataset.log_files import SkippedLog, list_readable_logs, map_logs
from minihuman.dataset.recording_quality import RecordingQuality, measure_recording_quality
from minihuman.dataset.selection import SelectedSession, Selection, SelectionSummary, format_version
from minihuman.dataset.session_measures import SessionMeasures
from minihuman.errors import LogError
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.moved import forward_names

if TYPE_CHECKING:
    from minihuman.dataset.rows import SessionTables


def build_episode_facts(log: SessionLog, episode: EpisodeLog) -> dict[str, Any]:
    """Return the facts of one episode; ``session``, ``segment``, ``episode`` and ``attempt`` count from 1."""
    plan = episode.plan
    return {
        "study": log.plan.study,
        "version": format_version(log.plan),
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
        "player": log.player,
        "block": plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
        "world": plan.world,
        "seed": plan.seed,
        "outcome": episode.outcome_word,
        "mission": episode.start.mission,
        "key_map": dict(plan.key_map.keys),
        "action_names": list(episode.start.action_names),
        "protocol_sha256": log.plan.protocol_sha256,
    }


T = TypeVar("T")


class StudySessions:
    """The sessions of a log, or of all logs below a folder. Iterating over them fills the ``account``.

    Unreadable logs, further logs of the same session and withdrawn participants are skipped, and the rest is read.

    Args:
        source: the log or the folder.
        selection: the rule for what is included; None for the default selection.
        say: called at once with a line about each skipped log.
        processes: the largest number of processes that read logs; None for the number of processors.
        engine: "local" for processes of this machine, or "ray" for a Ray cluster.
        from_logs: whether to ignore the cache and build the tables from the logs.
    """

    def __init__(
        self,
        source: Path,
        selection: Selection | None = None,
        *,
        say: Callable[[str], None] = lambda line: None,
        processes: int | None = None,
        engine: str = "local",
        from_logs: bool = False,
    ) -> None:
        self.source = source
        self.from_logs = from_logs
        self.selection = Selection() if selection is None else selection
        self.account = SelectionSummary(str(self.selection))
        self._say = say
        self.processes = processes
        self.engine = engine

    def __iter__(self) -> Iterator[SelectedSession]:
        """Yield the sessions, holding one in memory at a time.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        return self._work_on_logs(self.selection.judge, processes=1)

    def each(self, work: Callable[[SelectedSession], T]) -> Iterator[T]:
        """Yield the result of ``work`` for each session with an included episode, working on several in parallel.

        ``work`` can run in another process, so it and its results must be picklable.

        Raises:
            LogError: as for ``__iter__``.
        """
        for result in self._work_on_logs(partial(_process_session, self.selection, work), processes=self.processes):
            self.account.add(result.account)
            yield from result.outputs

    def rows(self, *, with_shortest: bool) -> Iterator["SessionRows"]:
        """Yield the rows of every table for each selected session; excluded rows carry the reason.

        ``with_shortest`` also computes the fewest possible steps, which requires the worlds themselves.

        Raises:
            LogError: as for ``__iter__``.
            ReportError: if a protocol excludes by a measure that does not exist.
        """
        work = partial(read_session_rows, selection=self.selection, with_shortest=with_shortest)
        for session in self._work_on_logs(work, processes=self.processes):
            self.account.add(session.account)
            if session.rows.count("participants"):
                yield session

    def _work_on_logs(self, work: Callable[[SessionLog], T], *, processes: int | None) -> Iterator[T]:
        """Yield the result of ``work`` for each readable log; record skipped logs and selected sessions in the account.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        paths, skipped = list_readable_logs(self.source)
        for log in skipped:
            self.skip(log)
        engine = "local" if processes == 1 else self.engine
        for outcome in map_logs(paths, work, processes=processes, engine=engine):
            if isinstance(outcome, SkippedLog):
                if not self.source.is_dir():
                    raise LogError(outcome.reason)
                self.skip(outcome)
                continue
            if isinstance(outcome, SelectedSession):
                self.account.take(outcome)
            yield outcome

    def skip(self, log: SkippedLog) -> None:
        """Record a skipped log in the account, and report it with ``say``; its path is made relative to the study."""
        log = log.relative_to(self.source)
        self.account.skipped.append(log)
        self._say(log.line())


@dataclass(frozen=True, slots=True)
class SessionRows:
    """One session's plan and rows, and how much of the session is included."""

    path: Path
    plan: SessionPlan
    rows: "SessionTables"
    facts: tuple[dict[str, Any], ...]  # of each included episode
    account: SelectionSummary
    quality: RecordingQuality


def read_selected_sessions(sources: Iterable[Path], selection: Selection) -> tuple[list[SessionLog], SelectionSummary]:
    """Read every session in several logs and folders; return the sessions with included episodes, and a summary.

    Raises:
        LogError: if there is no such file or folder, or it holds no session with an included episode.
    """
    account = SelectionSummary(str(selection))
    logs = list[SessionLog]()
    for source in sources:
        sessions = StudySessions(source, selection)
        logs += [selected.session for selected in sessions if selected.places]
        account.add(sessions.account)
    if not logs:
        raise LogError(
            f"no session to show was found ({'; '.join(account.lines())}); name other logs, or select other episodes"
        )
    return logs, account


def read_session_rows(log: SessionLog, *, selection: Selection, with_shortest: bool) -> SessionRows:
    """Build a session's rows of every table.

    ``with_shortest`` also computes the fewest possible steps, which requires the worlds themselves.

    Raises:
        LogError: if the annotations beside the log are not valid.
        ProtocolError: if the protocol in the log cannot be decoded.
        ReportError: if the protocol excludes by a measure that does not exist.
    """
    from minihuman.dataset.session_tables import build_session_tables

    measured = SessionMeasures.of(log, selection.planner(log.plan, with_shortest=with_shortest))
    session = selection.judge(log, measured=measured)
    facts = tuple(build_episode_facts(log, episode) for episode in session.episodes)
    return SessionRows(
        path=log.path,
        plan=log.plan,
        rows=build_session_tables(session, measured),
        facts=facts,
        account=_summarize_selection(session),
        quality=measure_recording_quality(log),
    )


@dataclass(frozen=True, slots=True)
class _SessionResult(Generic[T]):
    outputs: tuple[T, ...]  # one, or none if no episode is included
    account: SelectionSummary


def _process_session(selection: Selection, work: Callable[[SelectedSession], T], log: SessionLog) -> _SessionResult[T]:
    """Return the result of ``work`` for a session, or no result if none of its episodes is included."""
    session = selection.judge(log)
    if not session.places:
        return _SessionResult((), _summarize_selection(session))
    return _SessionResult((work(session),), _summarize_selection(session))


def _summarize_selection(session: SelectedSession) -> SelectionSummary:
    """Return the selection summary of one session."""
    account = SelectionSummary()
    account.take(session)
    return account


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
