"""All figures of a log or a study, as files."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from minihuman.figures.files import save
from minihuman.figures.learning import learning_figure
from minihuman.figures.occupancy import occupancy_figure
from minihuman.figures.overview import overview_figure
from minihuman.figures.paths import session_paths
from minihuman.log.episode import Episode, SessionLog
from minihuman.marks import select
from minihuman.opened import Skipped, opened


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
            say(f"skipped {found.path}: {found.reason}")
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


def draw_study(logs: Iterable[SessionLog], out: Path) -> Iterator[Path]:
    """Draw where everybody was in each world, and each block's rewards by group over its episodes."""
    places: dict[str, list[list[Episode]]] = defaultdict(list)
    rewards: dict[str, dict[str, list[NDArray[np.float64]]]] = defaultdict(lambda: defaultdict(list))
    for log in logs:
        for world in dict.fromkeys(episode.plan.world for episode in log.episodes):
            theirs = [episode for episode in log.episodes if episode.plan.world == world and episode.start.map]
            places[world] += [theirs] if theirs else []
        for block in dict.fromkeys(episode.plan.block_name for episode in log.episodes):
            played = [episode for episode in log.episodes if episode.plan.block_name == block]
            row = np.full(played[0].plan.episodes_in_block, np.nan)
            for episode in played:
                row[episode.plan.episode_in_block] = episode.return_
            rewards[block][log.plan.participant.group].append(row)
    for world, participants in places.items():
        if participants:
            yield from save(occupancy_figure(world, participants), out / f"occupancy_{_file_name(world)}")
    for block, groups in rewards.items():
        curves = {group: np.stack(rows) for group, rows in groups.items()}
        yield from save(learning_figure(curves, measure="reward"), out / f"learning_{_file_name(block)}")


def _name(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def _file_name(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text.rpartition("/")[2])
