"""Files with all figures of a session or a study."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.dataset.tables import Tables
from minihuman.experiment.machine.events import KeyPressed
from minihuman.figures.figure_data import collect_learning_curves, find_reward_limits, name_measure, strip_events
from minihuman.figures.learning_curves import learning_figure
from minihuman.figures.occupancy import group_participants_by_group, occupancy_figure
from minihuman.figures.overview import overview_figure
from minihuman.figures.path_figures import session_paths
from minihuman.figures.style import save_figure
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.model.session_log import SessionLog

if TYPE_CHECKING:
    import pandas as pd


def draw_all_figures(tables: Tables, out: Path, *, each_session: bool = False) -> Iterator[Path]:
    """Draw the overview and paths of a single session, or the occupancy and rewards of several sessions together.

    Yield the paths of the files, which are written below the folder ``out``. With ``each_session``, the overview and
    paths of every session are drawn as well, which takes some seconds per session. Without an included episode, nothing
    is drawn.

    Raises:
        LogError: if the file or folder does not exist, or is a single log that cannot be read.
    """
    first: SessionLog | None = None
    all_sessions: list[SessionLog] = []
    for selected in tables.read_sessions():
        if not selected.places:
            continue
        if each_session:
            yield from draw_session(selected.session, out / _name_session(selected.log))
        first = first or selected.session
        all_sessions.append(_strip_session(selected.session))
    if first is not None and len(all_sessions) == 1 and not each_session:
        yield from draw_session(first, out / _name_session(first))
    if len(all_sessions) > 1:
        yield from draw_study(all_sessions, out)


def draw_session(log: SessionLog, out: Path) -> Iterator[Path]:
    """Draw the overview of a session, and its paths with a group of columns per block; yield the paths of the files."""
    yield from save_figure(overview_figure(log), out / "overview")
    yield from save_figure(session_paths(log), out / "paths")


def draw_study(logs: Sequence[SessionLog], out: Path) -> Iterator[Path]:
    """Draw the occupancy of each world, and the rewards by group in each block; yield the paths of the files."""
    for world in dict.fromkeys(episode.plan.world for log in logs for episode in log.episodes):
        groups = group_participants_by_group(logs, world)
        if groups:
            yield from save_figure(occupancy_figure(world, groups), out / f"occupancy_{_make_file_name(world)}")
    for block, episodes in collect_rewards(logs).groupby("block", sort=False):
        title = name_measure("reward", str(block))
        file_name = _make_file_name(str(block))
        means = episodes.groupby(["group", "participant"])["reward"].mean()
        by_group = {str(group): group_means.to_numpy(float) for group, group_means in means.groupby("group")}
        if len(by_group) > 1:
            # imported here, because it takes half a second, which figures of a single session need not spend
            from minihuman.figures.estimation import compare_every_pair, estimation_figure

            figure = estimation_figure(by_group, compare_every_pair(by_group), measure="mean reward", title=title)
            yield from save_figure(figure, out / f"estimation_{file_name}")
        figure = learning_figure(
            collect_learning_curves(episodes), measure="reward", limits=find_reward_limits(episodes), title=title
        )
        yield from save_figure(figure, out / f"learning_{file_name}")


def _strip_session(log: SessionLog) -> SessionLog:
    """Return a session without its key presses and pictures, so that a thousand sessions fit into memory."""
    keys = EventColumns.of(KeyPressed, ())
    segments = tuple(replace(segment, keys=keys) for segment in log.segments)
    return replace(log, episodes=tuple(map(strip_events, log.episodes)), segments=segments)


def collect_rewards(logs: Iterable[SessionLog]) -> "pd.DataFrame":
    """Return a table with a row per episode: its participant, session, group, block, number in the block, and reward.

    The columns are named as in the table "episodes".
    """
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


def _name_session(log: SessionLog) -> str:
    return f"{log.plan.participant.id}_ses-{log.plan.session:02d}"


def _make_file_name(text: str) -> str:
    """Return a file name made of the text after the last slash, with hyphens for unusual characters."""
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in text.rpartition("/")[2])
