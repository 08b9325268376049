"""Episodes that a notebook's cell sent back: they are played again, and become a session's log or `Episode` objects."""

import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from minihuman.api import open_session
from minihuman.notebook.cell_world import CellWorld
from minihuman.recorded_study import Episode, Session
from minihuman.web.page_data.imported_session import write_session
from minihuman.web.page_data.imports import require_same_steps
from minihuman.web.page_data.page_episodes import PageDataError, PageEpisode, require_consistent


def convert_columns(world: CellWorld, sent: Sequence[Mapping[str, Any]]) -> list[PageEpisode]:
    """Convert the episodes that a cell sent, and replay them to check them.

    Args:
        world: the cell's world, whose id, options and seeds are used instead of any that the cell sends.
        sent: the columns of each episode.

    Raises:
        PageDataError: if an episode is malformed, or replays differently.
    """
    episodes = [_convert(world, columns, number) for number, columns in enumerate(sent, 1)]
    require_consistent(episodes, "the cell", checks_world=False)
    return episodes


def _convert(world: CellWorld, columns: Mapping[str, Any], number: int) -> PageEpisode:
    """Convert the columns that a cell sent of one episode; their ``seed`` is the index of one of the world's seeds.

    ``number`` is the episode's number in messages, from 1.

    Raises:
        PageDataError: if the columns are malformed, or the world has no such seed.
    """
    try:
        episode = msgspec.convert(dict(columns), PageEpisode, strict=True)
    except msgspec.ValidationError as error:
        raise PageDataError(f"the cell: episode {number}: {error}") from error
    if not 0 <= episode.seed < len(world.seeds):
        raise PageDataError(f"the cell: episode {number} has layout {episode.seed} of {len(world.seeds)}")
    return msgspec.structs.replace(
        episode, world=world.id, options=world.options, seed=world.seeds[episode.seed], view=world.view
    )


def write_played(episodes: Sequence[PageEpisode], study: Path) -> Path | None:
    """Write replayed episodes as the log of a study's next participant.

    Returns:
        The log's path; None if the study has the episodes already.

    Raises:
        PageDataError: if the study has sessions that were not imported.
        LogError: if the log cannot be written.
    """
    log = write_session(episodes, study.absolute())
    if log is not None:
        require_same_steps(log, episodes)
    return log


class PlayedEpisodes:
    """The episodes that a cell has sent so far, which are opened like those of a study's session.

    Args:
        world: the cell's world.
    """

    def __init__(self, world: CellWorld) -> None:
        self._world = world
        self._played: list[PageEpisode] = []
        self._session: Session | None = None

    def receive(self, sent: Sequence[Mapping[str, Any]]) -> None:
        """Replay the episodes that the cell sent, and keep them instead of those before: the cell sends all again.

        Raises:
            PageDataError: if an episode is malformed, or replays differently.
        """
        self._played = convert_columns(self._world, sent)
        self._session = None

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Return the episodes in the order in which they were played; their evidence is "consistent"."""
        if not self._played:
            return ()
        if self._session is None:
            self._session = self._open()
        return self._session.all_episodes

    def _open(self) -> Session:
        """Write the episodes to a temporary log and open it; an opened session does not need the log any more."""
        folder = Path(tempfile.mkdtemp(prefix="minihuman-cell-"))
        try:
            log = write_played(self._played, folder / "notebook")
            assert log is not None, "the folder is new"
            return open_session(log)
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def save(self, study: Path) -> Path | None:
        """Write the episodes into a study's folder, and return the log's path; None if the study has them already.

        Raises:
            PageDataError: if nothing was played, or the study has sessions that were not imported.
            LogError: if the log cannot be written.
        """
        if not self._played:
            raise PageDataError("nothing to save: play an episode to its end first")
        return write_played(self._played, study)
