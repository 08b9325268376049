"""Imports files of a page's episodes into a study, and verifies such files without one."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import MinihumanError
from minihuman.log.read.session_reader import read_log
from minihuman.web.page_data.imported_session import write_session
from minihuman.web.page_data.page_episodes import (
    NOT_PROVED,
    PageDataError,
    PageEpisode,
    describe_difference,
    find_order_error,
    list_data_files,
    read_page_data,
    require_consistent,
    verify_episode,
)


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """The outcome of importing one file of page data.

    Attributes:
        file: the file.
        log: the session log written from the file; None if the file was refused or imported before.
        episodes: the number of episodes in the file; 0 if it was refused.
        steps: the number of steps in these episodes.
        error: the error for which the file was refused; None if it was not.
    """

    file: Path
    log: Path | None
    episodes: int
    steps: int
    error: MinihumanError | None = None

    @property
    def text(self) -> str:
        """Return the outcome as one sentence."""
        if self.error is not None:
            return str(self.error)
        if self.log is None:
            return "imported before; nothing was written"
        return f"{self.episodes} episodes, {self.steps} steps, consistent, not witnessed: {self.log}"


def import_files(paths: Iterable[Path], study: Path) -> Iterator[ImportedFile]:
    """Import files, or folders of files, into a study's folder as one session per file, and yield each outcome.

    A file that fails verification is refused.

    Raises:
        PageDataError: if a path has no files.
    """
    for path in paths:
        for file in list_data_files(path):
            yield _import_file(file, study)


def _import_file(file: Path, study: Path) -> ImportedFile:
    """Import one file as a session, and return the outcome; an error is part of the outcome."""
    try:
        episodes = _read_consistent_episodes(file)
        log = write_session(episodes, study.absolute())
        if log is not None:
            require_same_steps(log, episodes)
    except MinihumanError as error:
        return ImportedFile(file, None, 0, 0, error)  # without a log, episodes and steps
    return ImportedFile(file, log, len(episodes), sum(len(episode.actions) for episode in episodes))


def _read_consistent_episodes(file: Path) -> list[PageEpisode]:
    episodes = read_page_data(file)
    require_consistent(episodes, file)
    return episodes


def require_same_steps(log: Path, episodes: Sequence[PageEpisode]) -> None:
    """Require that the recorded session has the same actions and rewards as the page's data.

    Raises:
        PageDataError: if they differ.
    """
    recorded = read_log(log).episodes
    for number, (episode, played) in enumerate(zip(episodes, recorded, strict=False), 1):
        if tuple(played.actions) != episode.actions or tuple(played.rewards) != episode.rewards:
            raise PageDataError(
                f"{log}: episode {number} has other steps than the page's data; nothing else was imported"
            )
    if len(recorded) != len(episodes):
        raise PageDataError(f"{log} has {len(recorded)} episodes, the page's data {len(episodes)}")


def verify_page_data(file: Path) -> Iterator[tuple[str, bool]]:
    """Verify a file of page data; yield each finding as a line of text, with False if it reports a difference.

    Raises:
        PageDataError: if the file has no episodes, or one of them is malformed.
    """
    episodes = read_page_data(file)
    n_steps = 0
    differs = False
    for number, episode in enumerate(episodes, 1):
        verification = verify_episode(episode)
        n_steps += verification.steps
        difference = describe_difference(episode, verification)
        if difference:
            differs = True
            yield f"episode {number} ({episode.name}): {difference}", False
    order_error = find_order_error(episodes)
    if order_error:
        differs = True
        yield order_error, False
    if not differs:
        yield f"{len(episodes)} episodes, {n_steps} steps, consistent with the rules, not witnessed", True
        yield NOT_PROVED, True
