"""All figures of a log or a study, as files."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import pandas as pd

from minihuman.data.study import Sessions
from minihuman.figures.files import save
from minihuman.figures.learning import learning_curves, learning_figure
from minihuman.figures.occupancy import occupancy_figure, tells_places
from minihuman.figures.overview import overview_figure
from minihuman.figures.paths import session_paths
from minihuman.recorded.episode import SessionLog


def draw_all(sessions: Sessions, out: Path) -> Iterator[Path]:
    """Draw each session's paths and overview, then what many sessions show together; yield the files.

    Raises:
        LogError: if there is no such file or folder.
    """
    everyone: list[SessionLog] = []
    for counted in sessions:
        if counted.places:
            yield from draw_session(counted.session, out / _name(counted.log))
            everyone.append(counted.session)
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
    for block, episodes in rewards(logs).groupby("block", sort=False):
        figure = learning_figure(learning_curves(episodes), measure="reward")
        yield from save(figure, out / f"learning_{_file_name(str(block))}")


def rewards(logs: Iterable[SessionLog]) -> pd.DataFrame:
    """Every episode's reward with whose it is and where in its block, as in the table "episodes"."""
    columns = ["participant", "session", "group", "block", "episode_in_block", "reward"]
    rows = [
        (
            log.plan.participant.id, log.plan.session, log.plan.participant.group, episode.plan.block_name,
            episode.plan.episode_in_block + 1, episode.return_,
        )
        for log in logs for episode in log.episodes
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=columns)


def _name(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def _file_name(text: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text.rpartition("/")[2])
