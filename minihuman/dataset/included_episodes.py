"""What an exporter receives: the included episodes one by one, rows session by session, or the rows in a store."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.dataset.selection import SelectedSession
from minihuman.dataset.sessions import SessionRows, StudySessions, build_episode_facts
from minihuman.dataset.tables import Tables
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.moved import warn_of_old_name

if TYPE_CHECKING:
    from minihuman.dataset.store import StudyStore


@dataclass(frozen=True, slots=True, eq=False)
class IncludedEpisode:
    """An included episode, and the session it belongs to."""

    log: SessionLog
    episode: EpisodeLog
    stored_frames: bool = False  # take the observations that the log holds, do not play them again

    @property
    def facts(self) -> dict[str, Any]:
        """Return the facts that every exported episode carries: participant, rule, keys, and how it ended.

        ``session``, ``segment``, ``episode`` and ``attempt`` count from 1, as in the tables: they join with them.
        """
        return build_episode_facts(self.log, self.episode) | {"options": dict(self.episode.plan.options)}


class IncludedEpisodes:
    """The episodes that an export includes. Iterate over them once, in one of two ways.

    Args:
        sessions: where they are, and what counts of them.
        on_included: called with each episode's log and facts as it is taken.
        stored_frames: whether observations are those that the logs hold.
        with_messages: whether an archive of logs takes those with messages between participants, too.
    """

    def __init__(
        self,
        sessions: StudySessions,
        *,
        on_included: Callable[[Path, Mapping[str, Any]], None] = lambda path, facts: None,
        stored_frames: bool = False,
        with_messages: bool = False,
        taken: Callable[[Path, Mapping[str, Any]], None] | None = None,
    ) -> None:
        if taken is not None:  # the name of an earlier version
            warn_of_old_name("IncludedEpisodes(taken=...)", "IncludedEpisodes(on_included=...)")
            on_included = taken
        self.sessions = sessions
        self.with_messages = with_messages
        self._on_included = on_included
        self._stored_frames = stored_frames

    def __iter__(self) -> Iterator[IncludedEpisode]:
        """Yield the included episodes in order, with one session in memory at a time.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        for selected in self.sessions:
            for episode in selected.episodes:
                item = IncludedEpisode(selected.session, episode, self._stored_frames)
                self._on_included(selected.log.path, item.facts)
                yield item

    def counted(self) -> Iterator[SelectedSession]:
        """Yield every selected session, one in memory at a time, with its included and excluded episodes.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        for selected in self.sessions:
            if selected.is_selected:
                for episode in selected.episodes:
                    self._on_included(selected.log.path, build_episode_facts(selected.log, episode))
                yield selected

    def rows(self) -> Iterator[SessionRows]:
        """Yield every session's rows of every table, several read side by side; excluded rows have their reason.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
            ReportError: if a protocol excludes by a measure that there is not.
        """
        for session in self.sessions.rows(with_shortest=False):
            for facts in session.facts:
                self._on_included(session.path, facts)
            yield session

    def tables(self) -> Tables:
        """Open the same rows in a file, those of many sessions together; use it in a ``with``.

        Raises:
            LogError, ReportError: as ``rows``.
        """
        tables = Tables(self.sessions)
        for path, facts in tables.included_facts():
            self._on_included(path, facts)
        return tables

    def store(self) -> "StudyStore":
        """Return the store of these tables: a name of an earlier version, which goes with the next one."""
        warn_of_old_name("IncludedEpisodes.store", "IncludedEpisodes.tables")
        return self.tables().store
