"""What an exporter receives: the included episodes one by one, the rows session by session, or the rows in a store."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from minihuman.dataset.person_facts import read_person_facts
from minihuman.dataset.selection import SelectedSession
from minihuman.dataset.sessions import SessionRows, StudySessions, build_episode_facts
from minihuman.dataset.tables import Tables
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.moved import warn_of_old_name

if TYPE_CHECKING:
    from minihuman.dataset.store import StudyStore


@dataclass(frozen=True, slots=True, eq=False)
class IncludedEpisode:
    """An included episode and the session it belongs to."""

    log: SessionLog
    episode: EpisodeLog
    stored_frames: bool = False  # whether to use the observations in the log instead of replaying
    person: Mapping[str, Any] = field(default_factory=dict)  # the laboratory's columns of the participant

    @property
    def facts(self) -> dict[str, Any]:
        """Return the facts that every exporter writes about an episode, such as participant, key map and outcome.

        ``session``, ``segment``, ``episode`` and ``attempt`` count from 1, as in the tables, so that they can be
        joined. ``options`` are the world's. ``person`` has the laboratory's own columns of the participant, which
        cannot collide with the others.
        """
        further = {"options": dict(self.episode.plan.options), "person": dict(self.person)}
        return build_episode_facts(self.log, self.episode) | further


class IncludedEpisodes:
    """The episodes that an export includes. Iterate over them only once, by one of the methods.

    Args:
        sessions: the study's sessions, with the selection that decides which episodes are included.
        on_included: called with the log's path and the facts of each episode when the episode is yielded.
        stored_frames: whether to use the observations stored in the logs instead of replaying the episodes.
        with_messages: whether an archive of logs also includes those that contain messages between participants.
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
        """Yield the included episodes in order, holding one session in memory at a time.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
            ParticipantsFileError: if `participants.csv` cannot be read, or does not fit the protocol.
        """
        facts_by_protocol: dict[str, dict[str, dict[str, Any]]] = {}
        for selected in self.sessions:
            plan = selected.log.plan
            if plan.protocol_sha256 not in facts_by_protocol:
                facts_by_protocol[plan.protocol_sha256] = read_person_facts(self.sessions.source, plan.protocol_toml)
            person = facts_by_protocol[plan.protocol_sha256].get(plan.participant.id, {})
            for episode in selected.episodes:
                included = IncludedEpisode(selected.session, episode, self._stored_frames, person)
                self._on_included(selected.log.path, included.facts)
                yield included

    def counted(self) -> Iterator[SelectedSession]:
        """Yield every selected session with its included and excluded episodes; one session is in memory at a time.

        Before a session is yielded, ``on_included`` is called for each of its included episodes.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
        """
        for selected in self.sessions:
            if selected.is_selected:
                for episode in selected.episodes:
                    self._on_included(selected.log.path, build_episode_facts(selected.log, episode))
                yield selected

    def rows(self) -> Iterator[SessionRows]:
        """Yield the rows of every table for each selected session, reading several sessions in parallel.

        Excluded rows carry their reason. Before a session is yielded, ``on_included`` is called for each of its
        included episodes.

        Raises:
            LogError: if the source does not exist, or is a single log that cannot be read.
            ReportError: if a protocol excludes by a measure that does not exist.
        """
        for session in self.sessions.rows(with_shortest=False):
            for facts in session.facts:
                self._on_included(session.path, facts)
            yield session

    def tables(self) -> Tables:
        """Open the rows of all sessions together as tables in a file, to be used in a ``with`` statement.

        Raises:
            LogError, ReportError: as for ``rows``.
        """
        tables = Tables(self.sessions)
        for path, facts in tables.included_facts():
            self._on_included(path, facts)
        return tables

    def store(self) -> "StudyStore":
        """Return the store behind these tables. This is the name from an earlier version.

        The next version removes it.
        """
        warn_of_old_name("IncludedEpisodes.store", "IncludedEpisodes.tables")
        return self.tables().store
