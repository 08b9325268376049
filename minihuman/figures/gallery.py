"""All figures of a log or a study, as files."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.data.study import Sessions
from minihuman.figures.drawn_from import learning_curves, light
from minihuman.figures.files import save
from minihuman.figures.learning import learning_figure
from minihuman.figures.occupancy import by_participant, occupancy_figure
from minihuman.figures.overview import overview_figure
from minihuman.figures.paths import session_paths
from minihuman.recorded.columns import EventColumns
from minihuman.recorded.episode import SessionLog
from minihuman.study.events import KeyPressed

if TYPE_CHECKING:
    import pandas as pd


def draw_all(sessions: Sessions, out: Path, *, each: bool = False) -> Iterator[Path]:
    """Draw a session's paths and overview, or what many sessions show together; yield the files.

    ``each`` draws every one of many sessions too, which takes some seconds a session.

    Raises:
        LogError: if there is no such file or folder.
    """
    first: SessionLog | None = None
    everyone: list[SessionLog] = []
    for counted in sessions:
        if not counted.places:
            continue
        if each:
            yield from draw_session(counted.session, out / _name(counted.log))
        first = first or counted.session
        everyone.append(_light(counted.session))
    if first is not None and len(everyone) == 1 and not each:
        yield from draw_session(first, out / _name(first))
    if len(everyone) > 1:
        yield from draw_study(everyone, out)


def draw_session(log: SessionLog, out: Path) -> Iterator[Path]:
    """Draw one session: its overview, and its paths with a group of columns for each block."""
    yield from save(overview_figure(log), out / "overview")
    yield from save(session_paths(log), out / "paths")


def draw_study(logs: Sequence[SessionLog], out: Path) -> Iterator[Path]:
    """Draw where everybody was in each world, and each block's rewards by group over its episodes."""
    for world in dict.fromkeys(episode.plan.world for log in logs for episode in log.episodes):
        participants = by_participant(logs, world)
        if participants:
            yield from save(occupancy_figure(world, participants), out / f"occupancy_{_file_name(world)}")
    for block, episodes in rewards(logs).groupby("block", sort=False):
        figure = learning_figure(learning_curves(episodes), measure="reward")
        yield from save(figure, out / f"learning_{_file_name(str(block))}")


def _light(log: SessionLog) -> SessionLog:
    """The session without its key presses and pictures shown, so that a thousand of them can be held at once."""
    keys = EventColumns.of(KeyPressed, ())
    segments = tuple(replace(one, keys=keys) for one in log.segments)
    return replace(log, episodes=tuple(map(light, log.episodes)), segments=segments)


def rewards(logs: Iterable[SessionLog]) -> "pd.DataFrame":
    """Every episode's reward with whose it is and where in its block, as in the table "episodes"."""
    import pandas as pd  # half a second: no figure of one session needs it

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
