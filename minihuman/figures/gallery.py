"""All figures of a log or a study, as files."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.data.marks import select
from minihuman.data.opened import Skipped, opened
from minihuman.figures.files import save
from minihuman.figures.learning import learning_figure
from minihuman.figures.occupancy import occupancy_figure, tells_places
from minihuman.figures.overview import overview_figure
from minihuman.figures.paths import session_paths
from minihuman.recorded.episode import SessionLog


def draw_all(
    source: Path,
    out: Path,
    *,
    only: Iterable[str] = (),
    without: Iterable[str] = (),
    say: Callable[[str], None],
) -> Iterator[Path]:
    """Draw each session's paths and overview, then what many sessions show together; yield the files.

    ``say`` is told of every log that is left out, and why.

    Raises:
        LogError: if there is no such file or folder.
    """
    everyone: list[SessionLog] = []
    for found in opened(source):
        if isinstance(found, Skipped):
            say(found.line())
            continue
        log = select(found, only=only, without=without)
        if not log.episodes:
            say(f"skipped {log.path}: no episode is left in it")
            continue
        yield from draw_session(log, out / _name(log))
        everyone.append(log)
    if len(everyone) > 1:
        yield from draw_study(everyone, out)


def draw_session(log: SessionLog, out: Path) -> Iterator[Path]:
    """Draw one session: its overview, and its paths with a group of columns for each block."""
    yield from save(overview_figure(log), out / "overview")
    yield from save(session_paths(log), out / "paths")


def draw_study(logs: Sequence[SessionLog], out: Path) -> Iterator[Path]:
    """Draw where everybody was in each world, and each block's rewards by group over its episodes."""
    for world in dict.fromkeys(episode.plan.world for log in logs for episode in log.episodes):
        theirs = [
            [episode for episode in log.episodes if episode.plan.world == world and tells_places(episode)]
            for log in logs
        ]
        participants = [episodes for episodes in theirs if episodes]
        if participants:
            yield from save(occupancy_figure(world, participants), out / f"occupancy_{_file_name(world)}")
    for block, curves in learning_curves(logs).items():
        yield from save(learning_figure(curves, measure="reward"), out / f"learning_{_file_name(block)}")


def learning_curves(logs: Iterable[SessionLog]) -> dict[str, dict[str, NDArray[np.float64]]]:
    """Rewards by block and group, (participants, episodes in the block); NaN where an episode was not played."""
    rows: dict[str, dict[str, list[NDArray[np.float64]]]] = defaultdict(lambda: defaultdict(list))
    for log in logs:
        for block in dict.fromkeys(episode.plan.block_name for episode in log.episodes):
            played = [episode for episode in log.episodes if episode.plan.block_name == block]
            row = np.full(played[0].plan.episodes_in_block, np.nan)
            for episode in played:
                row[episode.plan.episode_in_block] = episode.return_
            rows[block][log.plan.participant.group].append(row)
    return {block: {group: np.stack(them) for group, them in groups.items()} for block, groups in rows.items()}


def _name(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def _file_name(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text.rpartition("/")[2])
