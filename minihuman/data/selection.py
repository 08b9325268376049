"""Which episodes of which logs an export takes."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from minihuman.data.chosen import Chosen, Selection
from minihuman.data.marks import select
from minihuman.data.opened import Skipped, each_log, opened
from minihuman.errors import LogError
from minihuman.recorded.episode import Episode, SessionLog

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Filters:
    """What to take. Empty means everything; several values of one field mean any of them."""

    outcome: tuple[str, ...] = ()
    block: tuple[str, ...] = ()
    participant: tuple[str, ...] = ()
    tag: tuple[str, ...] = ()  # only episodes that carry one of these marks
    without_tag: tuple[str, ...] = ()  # no episode that carries one of these marks

    def __str__(self) -> str:
        """The filters in force, as the command line takes them."""
        return " ".join(
            f"--{field.name.replace('_', '-')} {value}" for field in fields(self) for value in getattr(self, field.name)
        )

    def takes(self, log: SessionLog, episode: Episode) -> bool:
        """Whether an episode passes, its marks aside."""
        return (
            (not self.outcome or episode.outcome_word in self.outcome)
            and (not self.block or episode.plan.block_name in self.block)
            and (not self.participant or log.plan.participant.id in self.participant)
        )


def chosen(
    source: Path, filters: Filters, skipped: Callable[[str], None], *, stored_frames: bool = False
) -> Iterator[Chosen]:
    """Every episode of a log, or of all logs below a folder, that passes; one session in memory at a time.

    ``skipped`` is told about each log below a folder that cannot be read, and why.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
    """
    for found in opened(source):
        if isinstance(found, Skipped):
            _skip(found, source, skipped)
        else:
            session = _filtered(found, filters)
            yield from (Chosen(session, episode, stored_frames) for episode in session.episodes)


class SelectionOf(Selection):
    """The episodes of a log, or of all logs below a folder, that pass the filters.

    Args:
        source: the log or folder.
        filters: what passes.
        skipped: is told of each log below a folder that cannot be read, and why.
        taken: is told of each episode's log and facts as it is taken.
        stored_frames: whether observations are those that the logs hold.
    """

    def __init__(
        self,
        source: Path,
        filters: Filters,
        *,
        skipped: Callable[[str], None],
        taken: Callable[[Path, Mapping[str, Any]], None],
        stored_frames: bool = False,
    ) -> None:
        self._source = source
        self._filters = filters
        self._skipped = skipped
        self._taken = taken
        self._stored_frames = stored_frames

    def __iter__(self) -> Iterator[Chosen]:
        """As the port says.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        for item in chosen(self._source, self._filters, self._skipped, stored_frames=self._stored_frames):
            self._taken(item.log.path, item.facts)
            yield item

    def each_session(self, work: Callable[[SessionLog], T]) -> Iterator[T]:
        """As the port says.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        for result in each_log(self._source, partial(_worked, filters=self._filters, work=work)):
            if isinstance(result, Skipped):
                _skip(result, self._source, self._skipped)
            elif result is not None:
                for facts in result.facts:
                    self._taken(result.path, facts)
                yield result.made


@dataclass(frozen=True, slots=True)
class _Worked(Generic[T]):
    path: Path
    facts: tuple[Mapping[str, Any], ...]  # of each episode taken
    made: T


def _worked(log: SessionLog, filters: Filters, work: Callable[[SessionLog], T]) -> _Worked[T] | None:
    """What came of one session; None where none of its episodes passes."""
    session = _filtered(log, filters)
    if not session.episodes:
        return None
    facts = tuple(Chosen(session, episode).facts for episode in session.episodes)
    return _Worked(log.path, facts, work(session))


def _skip(found: Skipped, source: Path, skipped: Callable[[str], None]) -> None:
    if not source.is_dir():
        raise LogError(found.reason)
    skipped(found.reason)


def _filtered(log: SessionLog, filters: Filters) -> SessionLog:
    tagged = select(log, only=filters.tag, without=filters.without_tag)
    return replace(tagged, episodes=tuple(episode for episode in tagged.episodes if filters.takes(log, episode)))
