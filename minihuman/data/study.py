"""A study's sessions as a selection sees them, one after the other or side by side, with an account of what counts."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from minihuman.data.counted import Account, Counted
from minihuman.data.facts import episode_facts
from minihuman.data.measured import Measured
from minihuman.data.opened import Skipped, each_log, worth_reading
from minihuman.data.quality import Quality, quality_of
from minihuman.data.selection import Selection
from minihuman.errors import LogError
from minihuman.recorded.episode import SessionLog
from minihuman.study.plan import SessionPlan

if TYPE_CHECKING:
    from minihuman.data.rows import Rows

T = TypeVar("T")


class Sessions:
    """The sessions of a log, or of all logs below a folder. Going through them fills the ``account``.

    A log that cannot be read, a second log of the same session and whoever withdrew are skipped by name, and the rest
    goes on; ``say`` is told of each at once.
    """

    def __init__(
        self,
        source: Path,
        selection: Selection | None = None,
        *,
        say: Callable[[str], None] = lambda line: None,
        processes: int | None = None,
    ) -> None:
        self.source = source
        self.selection = Selection() if selection is None else selection
        self.account = Account(str(self.selection))
        self._say = say
        self.processes = processes

    def __iter__(self) -> Iterator[Counted]:
        """One session in memory at a time.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        return self._go_through(self.selection.judge, processes=1)

    def each(self, work: Callable[[Counted], T]) -> Iterator[T]:
        """What ``work`` makes of each session with an episode that counts, several worked on side by side.

        ``work`` may run in another process: it and its results can be pickled.

        Raises:
            LogError: as ``__iter__``.
        """
        for result in self._go_through(partial(_worked, self.selection, work), processes=self.processes):
            self.account.add(result.account)
            yield from result.made

    def rows(self, *, with_shortest: bool) -> Iterator["SessionRows"]:
        """Every session's rows of every table, those that do not count with the reason.

        Raises:
            LogError: as ``__iter__``.
            ReportError: if a protocol excludes by a measure that there is not.
        """
        work = partial(read_rows, selection=self.selection, with_shortest=with_shortest)
        for found in self._go_through(work, processes=self.processes):
            self.account.add(found.account)
            if found.rows.count("participants"):
                yield found

    def _go_through(self, work: Callable[[SessionLog], T], *, processes: int | None) -> Iterator[T]:
        paths, skipped = worth_reading(self.source)
        for one in skipped:
            self.skip(one)
        for found in each_log(paths, work, processes=processes):
            if isinstance(found, Skipped):
                if not self.source.is_dir():
                    raise LogError(found.reason)
                self.skip(found)
            else:
                if isinstance(found, Counted):
                    self.account.take(found)
                yield found

    def skip(self, one: Skipped) -> None:
        """Put what cannot be read into the account, and say so."""
        self.account.skipped.append(one)
        self._say(one.line())


@dataclass(frozen=True, slots=True)
class SessionRows:
    """One session's plan and rows, and what counts of it."""

    path: Path
    plan: SessionPlan
    rows: "Rows"
    facts: tuple[dict[str, Any], ...]  # of each episode that counts
    account: Account
    quality: Quality


def readable(sources: Iterable[Path], selection: Selection) -> tuple[list[SessionLog], Account]:
    """Every session of several logs and folders, with the episodes that count, and the account of them.

    Raises:
        LogError: if there is no such file or folder, or no session to be read in them.
    """
    account, logs = Account(str(selection)), list[SessionLog]()
    for source in sources:
        sessions = Sessions(source, selection)
        logs += [counted.session for counted in sessions if counted.places]
        account.add(sessions.account)
    if not logs:
        raise LogError(f"there is nothing to show: {'; '.join(account.lines())}")
    return logs, account


def read_rows(log: SessionLog, *, selection: Selection, with_shortest: bool) -> SessionRows:
    """Make a session's rows.

    Raises:
        LogError: if the marks beside the log cannot be understood.
        ProtocolError: if the protocol in the log cannot be understood.
        ReportError: if the protocol excludes by a measure that there is not.
    """
    from minihuman.data.tables import session_tables  # here, as importing Arrow takes longer than many a command

    measured = Measured.of(log, selection.planner(log.plan, with_shortest=with_shortest))
    counted = selection.judge(log, measured=measured)
    facts = tuple(episode_facts(log, episode) for episode in counted.episodes)
    return SessionRows(log.path, log.plan, session_tables(counted, measured), facts, _account(counted), quality_of(log))


@dataclass(frozen=True, slots=True)
class _Worked(Generic[T]):
    made: tuple[T, ...]  # one, or none where no episode counts
    account: Account


def _worked(selection: Selection, work: Callable[[Counted], T], log: SessionLog) -> _Worked[T]:
    counted = selection.judge(log)
    return _Worked((work(counted),) if counted.places else (), _account(counted))


def _account(counted: Counted) -> Account:
    account = Account()
    account.take(counted)
    return account
