"""Which episodes of which logs an export takes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

from minihuman.errors import LogError
from minihuman.export.port import Chosen
from minihuman.log.episode import Episode, SessionLog
from minihuman.log.read import open_log
from minihuman.log.study_folder import sessions
from minihuman.marks import select


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
            (not self.outcome or (episode.outcome or "cut_off") in self.outcome)
            and (not self.block or episode.plan.block_name in self.block)
            and (not self.participant or log.plan.participant.id in self.participant)
        )


def chosen(source: Path, filters: Filters, skipped: Callable[[str], None]) -> Iterator[Chosen]:
    """Every episode of a log, or of all logs below a folder, that passes; one session in memory at a time.

    ``skipped`` is told about each log below a folder that cannot be read: its path and the reason.

    Raises:
        LogError: if the source does not exist, or is a single log that cannot be read.
    """
    if not source.is_dir():
        yield from _episodes(open_log(source), filters)
        return
    for row in sessions(source):
        try:
            if row.summary is None:
                raise LogError(row.problem)
            log = open_log(row.path)
        except (LogError, OSError) as error:
            skipped(str(error))
            continue
        yield from _episodes(log, filters)


def _episodes(log: SessionLog, filters: Filters) -> Iterator[Chosen]:
    for episode in select(log, only=filters.tag, without=filters.without_tag).episodes:
        if filters.takes(log, episode):
            yield Chosen(log, episode)
