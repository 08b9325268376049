"""Recorded data as objects for use in a notebook: ``Study``, ``Session`` and ``Episode``.

Data are read when they are requested; a study's tables are cached beside it.
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.dataset.activity_tables import PERSON_TABLE
from minihuman.dataset.log_files import list_participant_logs, list_readable_logs
from minihuman.dataset.measures import playing_s
from minihuman.dataset.selection import SelectedSession, Selection, SelectionSummary
from minihuman.dataset.table_catalogue import TABLES
from minihuman.dataset.table_queries import has_world_columns
from minihuman.dataset.tables import answer_query, select
from minihuman.errors import LogError, QueryError
from minihuman.log.model.session_log import EpisodeLog as Recorded, Segment
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.pose import Map

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def read_table_frame(source: Path, selection: Selection, name: str, *, with_excluded: bool) -> "pd.DataFrame":
    """Return a table of ``source``, a study's folder or a log: its included rows, or all with ``with_excluded``.

    Raises:
        QueryError: if there is no table named ``name``.
    """
    if name not in (*TABLES, PERSON_TABLE):
        raise QueryError(f"table {name!r} does not exist; the tables are {', '.join([*TABLES, PERSON_TABLE])}")
    with select(source, selection) as tables:
        tables.require((name,), shortest_paths=has_world_columns(name), with_account=False)
        return tables.frame(name, included=not with_excluded)


def format_html_table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return the HTML of a small table: its caption, the heads of its columns and its rows of cells."""
    from minihuman.reporting.template import CAPTIONED_TABLE, Table, render_template  # Jinja, which only notebooks need

    table = Table(heads, [tuple(map(str, row)) for row in rows], words=0)
    return render_template(CAPTIONED_TABLE, {"caption": caption, "its": table})


def check_figure_name(name: str, names: Sequence[str]) -> None:
    """Check that there is a figure with a name.

    Raises:
        ValueError: if there is none; the message lists the existing figures.
    """
    if name not in names:
        raise ValueError(f"figure {name!r} does not exist; the figures are {', '.join(map(repr, names))}")


@dataclass(frozen=True, slots=True, eq=False)
class ReplayedStep:
    """One replayed step: the observation, the action taken in response, and its result."""

    step: int  # 1 for the first
    observation: Any  # before the action
    action: str
    reward: float
    terminated: bool
    truncated: bool


class Episode:
    """One played episode. Times are in seconds of session time, since the session's first segment began."""

    def __init__(self, recorded: Recorded, *, participant: str, exclusion: str) -> None:
        self.recorded = recorded  # everything: hashes, key presses, pictures shown
        self.participant = participant
        self.exclusion = exclusion  # why it is excluded; "" if it is included

    @property
    def number(self) -> int:
        """The number in the session, starting at 1, as on the screen, in tables and in figures."""
        return self.recorded.number

    @property
    def attempt(self) -> int:
        """The number of the attempt: 1, or more if an interrupted episode was restarted."""
        return self.recorded.attempt

    @property
    def block(self) -> str:
        """The block's name in the protocol."""
        return self.recorded.plan.block_name

    @property
    def world(self) -> str:
        """The world's Gymnasium id."""
        return self.recorded.plan.world

    @property
    def seed(self) -> int:
        """The seed with which the world was reset."""
        return self.recorded.plan.seed

    @property
    def mission(self) -> str:
        """The mission as shown to the participant."""
        return self.recorded.start.mission

    @property
    def outcome(self) -> str:
        """The episode's ending: goal, timeout, failure, ended, abandoned, agent_failed, or cut_off with the log."""
        return self.recorded.outcome_word

    @property
    def reward(self) -> float:
        """The sum of the rewards."""
        return self.recorded.return_

    @property
    def steps(self) -> int:
        """The number of steps."""
        return len(self.recorded.actions)

    @property
    def playing_s(self) -> float:
        """The time in seconds from the reset to the last step, without pauses."""
        return playing_s(self.recorded)

    @property
    def path(self) -> NDArray[np.float64]:
        """The agent's poses, shape (steps + 1, 4): x, y, z in cells or metres, and heading in radians; NaN if unknown.

        The ground plane is x and z, and y points up. A heading of 0 is along +x; it grows counter-clockwise seen from
        above.
        """
        return self.recorded.poses

    @property
    def times_s(self) -> NDArray[np.float64]:
        """The times of the reset and of each step, shape (steps + 1,)."""
        return np.asarray(self.recorded.t_ns / 1e9)

    @property
    def actions(self) -> tuple[str, ...]:
        """The name of the action in each step."""
        names = self.recorded.start.action_names
        return tuple(names[action] for action in self.recorded.actions)

    @property
    def keys(self) -> tuple[str, ...]:
        """The key that caused each step; "" for a tick's no-op."""
        return tuple(self.recorded.step_keys)

    @property
    def rewards(self) -> NDArray[np.float64]:
        """The reward of each step."""
        return self.recorded.rewards

    @property
    def reaction_ms(self) -> NDArray[np.float64]:
        """The time in milliseconds from the flip of the picture to the key press, per step.

        NaN for a step without a key.
        """
        return self.recorded.rt_ms

    @property
    def map(self) -> Map | None:
        """The floor plan's walls and objects; None if the world has no floor plan."""
        return self.recorded.start.map

    def frames(self) -> list[NDArray[np.uint8]]:
        """Render the pictures that were shown again in the world, and compare them by hash with the recording.

        Returns:
            One picture for the reset and one for each step, as uint8[height, width, 3].

        Raises:
            LogError: if the world now renders a different picture, and the log holds no pictures.
            WorldError: if the world cannot be run here, and the log holds no pictures.
        """
        from minihuman.replay.frames import render_frames

        return render_frames(self.recorded)

    def play_back(self) -> Iterator[ReplayedStep]:
        """Replay the episode in its world, and yield each step whose observation has the hash that was recorded.

        Raises:
            LogError: at the first step whose observation differs.
            WorldError: if the world cannot be created here.
        """
        from minihuman.worlds.adapters.world import World

        recorded = self.recorded
        with closing(World(recorded.plan.world, recorded.world_options)) as world:
            observation_hash = world.reset(recorded.plan.seed).observation_hash
            for index, action in enumerate(recorded.actions):
                self._require_recorded_observation(observation_hash, index)
                observation = copy.deepcopy(world.observation)  # as a world may use its arrays again
                world_step = world.step(int(action))
                observation_hash = world_step.observation_hash
                yield ReplayedStep(
                    step=index + 1,
                    observation=observation,
                    action=recorded.start.action_names[action],
                    reward=world_step.reward,
                    terminated=bool(recorded.terminated[index]),
                    truncated=bool(recorded.truncated[index]),
                )
            self._require_recorded_observation(observation_hash, self.steps)

    def figure(self) -> "Figure":
        """Draw the agent's path over the floor plan."""
        from minihuman.figures.path_figures import paths_figure

        return paths_figure([(self.world, [self.recorded])], across=1)

    def _require_recorded_observation(self, observation_hash: int, step: int) -> None:
        """Check the hash of the observation after ``step`` steps against the recording.

        Raises:
            LogError: if it differs.
        """
        if observation_hash != int(self.recorded.observation_hashes[step]):
            raise LogError(
                f"{self.participant}: {self.recorded.name} step {step}: the observation of {self.world} differs from "
                "the recorded one; run: minihuman verify"
            )

    def __repr__(self) -> str:
        why = f", excluded: {self.exclusion}" if self.exclusion else ""
        return f"<{self.recorded.name} of {self.participant}: {self.block}, {self.outcome}, {self.steps} steps{why}>"


class Session:
    """One participant's session and its included episodes."""

    def __init__(self, selected: SelectedSession, selection: Selection) -> None:
        self._selected = selected
        self._selection = selection

    @property
    def path(self) -> Path:
        """The log, or the folder with its segments."""
        return self._selected.log.path

    @property
    def study(self) -> str:
        """The study's name in the protocol."""
        return self._selected.log.plan.study

    @property
    def participant(self) -> str:
        """The participant's code."""
        return self._selected.log.plan.participant.id

    @property
    def group(self) -> str:
        """The group the participant was allocated to."""
        return self._selected.log.plan.participant.group

    @property
    def number(self) -> int:
        """The number among the participant's sessions, starting at 1."""
        return self._selected.log.plan.session

    @property
    def player(self) -> str:
        """The source of the key presses: human, or the name of a simulated participant."""
        return self._selected.log.player

    @property
    def started_at(self) -> str:
        """The wall-clock time at which session time was 0, in ISO 8601 and UTC."""
        return self._selected.log.started_at

    @property
    def end_reason(self) -> str:
        """The reason why the session ended, such as complete or quit; cut_off if the log stops in the middle."""
        return self._selected.log.end_reason

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The segments, one per run of the program: more than one if the session was resumed."""
        return self._selected.log.segments

    @property
    def sessions(self) -> tuple["Session", ...]:
        """This session alone, so that a session can be used in place of a study."""
        return (self,)

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """The included episodes, in the order in which they were played."""
        included = set(self._selected.places)
        return tuple(episode for index, episode in enumerate(self.all_episodes) if index in included)

    @property
    def all_episodes(self) -> tuple[Episode, ...]:
        """All episodes that began; ``exclusion`` is the reason why an episode is excluded."""
        selected = self._selected
        return tuple(
            Episode(episode, participant=self.participant, exclusion=selected.session_reason or reason)
            for episode, reason in zip(selected.log.episodes, selected.reasons, strict=True)
        )

    def table(self, name: str = "episodes", *, with_excluded: bool = False) -> "pd.DataFrame":
        """Read the session's table named ``name``, such as "steps": the included rows, or all with ``with_excluded``.

        Raises:
            QueryError: if there is no such table.
        """
        return read_table_frame(self.path, self._selection, name, with_excluded=with_excluded)

    def figure(self, name: Literal["paths", "overview"] = "paths") -> "Figure":
        """Draw the session's paths, one panel per episode, or an overview of its steps, times and keys.

        Raises:
            ValueError: if there is no figure with that name.
            LogError: if no episode is included.
        """
        from minihuman.figures.overview import overview_figure
        from minihuman.figures.path_figures import session_paths

        check_figure_name(name, ("paths", "overview"))
        if name == "paths":
            return session_paths(self._selected.session)
        return overview_figure(self._selected.session)

    def __iter__(self) -> Iterator[Episode]:
        return iter(self.episodes)

    def __len__(self) -> int:
        return len(self._selected.places)

    def __repr__(self) -> str:
        n_begun = len(self._selected.log.episodes)
        return (
            f"<session {self.number} of {self.participant} ({self.group}): {len(self)} of {n_begun} episodes included>"
        )

    def _repr_html_(self) -> str:
        rows = [
            (
                episode.number, episode.attempt, episode.block, episode.outcome, episode.steps, f"{episode.reward:.3f}",
                f"{episode.playing_s:.1f}", episode.exclusion,
            )
            for episode in self.all_episodes
        ]  # fmt: skip
        heads = ("episode", "attempt", "block", "outcome", "steps", "reward", "playing s", "excluded")
        return format_html_table(repr(self).strip("<>"), heads, rows)


def read_session(path: Path, selection: Selection) -> Session:
    """Read one log, or a session's folder; ``selection`` is the rule for which episodes are included.

    Raises:
        LogError: if it cannot be read.
    """
    return Session(selection.judge(read_log(path)), selection)


_MAX_SHOWN_SESSIONS = 20  # rows of a study's table in a notebook's cell


class Study:
    """A study's sessions, each read when it is requested; their tables are cached beside the study.

    Iterating reads one session after the other and keeps none in memory. ``sessions`` and ``episodes`` read all and
    keep them.
    """

    def __init__(self, path: Path, selection: Selection) -> None:
        self.path = path
        self.selection = selection

    @cached_property
    def _opened(self) -> tuple[tuple[Session, ...], SelectionSummary]:
        tables = select(self.path, self.selection)
        return tuple(Session(session, self.selection) for session in tables.read_sessions()), tables.account

    @property
    def sessions(self) -> tuple[Session, ...]:
        """All readable sessions, in the order of their paths; they stay in memory."""
        return self._opened[0]

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """The included episodes of every session."""
        return tuple(episode for session in self.sessions for episode in session.episodes)

    @property
    def exclusions(self) -> tuple[str, ...]:
        """The facts about what is included, and what is excluded and why, one line each."""
        return tuple(self._opened[1].lines())

    def table(self, name: str = "episodes", *, with_excluded: bool = False) -> "pd.DataFrame":
        """Read the study's table named ``name``, such as "episodes": the included rows, or all with ``with_excluded``.

        Raises:
            QueryError: if there is no such table.
            LogError: if there is no such folder.
        """
        return read_table_frame(self.path, self.selection, name, with_excluded=with_excluded)

    def query(self, sql: str) -> "pd.DataFrame":
        """Query the study's tables in DuckDB's SQL; ``exclusion_reason`` is null in included rows.

        Raises:
            QueryError: if it is not valid SQL, or names a table or column that does not exist.
        """
        with select(self.path, self.selection) as tables:
            answer: pd.DataFrame = answer_query(tables, sql).to_pandas()
            return answer

    def figure(self, name: Literal["learning", "occupancy"] = "learning", *, of: str = "") -> "Figure":
        """Draw rewards over a block's episodes by group, or where participants were in a world.

        ``of`` names the block or the world; by default it is the last one played.

        Raises:
            ValueError: if there is no figure with that name.
            LogError: if no included episode was played in that block or world.
        """
        check_figure_name(name, ("learning", "occupancy"))
        from minihuman.figures.figure_data import collect_learning_curves, find_reward_limits, name_measure
        from minihuman.figures.gallery import collect_rewards
        from minihuman.figures.learning_curves import learning_figure
        from minihuman.figures.occupancy import group_participants_by_group, occupancy_figure

        logs = [session._selected.session for session in self.sessions]
        episode_plans = [episode.plan for log in logs for episode in log.episodes]
        block_or_world = of
        if name == "learning":
            if not block_or_world and episode_plans:
                block_or_world = episode_plans[-1].block_name
            rewards = collect_rewards(logs)
            episodes = rewards[rewards["block"] == block_or_world]
            curves = collect_learning_curves(episodes)
            if curves:
                title = name_measure("reward", block_or_world)
                return learning_figure(curves, measure="reward", limits=find_reward_limits(episodes), title=title)
        else:
            if not block_or_world and episode_plans:
                block_or_world = episode_plans[-1].world
            groups = group_participants_by_group(logs, block_or_world)
            if groups:
                return occupancy_figure(block_or_world, groups)
        raise LogError(
            f"{self.path} has no included episode of {block_or_world!r} that can be drawn; choose another block or "
            "world"
        )

    def __getitem__(self, key: str | tuple[str, int]) -> Session:
        """Read a participant's session: ``study["sub-01"]`` is the first, and ``study["sub-01", 2]`` is the second.

        Raises:
            KeyError: if there is no such session.
        """
        number: int | None = None
        if isinstance(key, str):
            participant = key
        else:
            participant, number = key
        for path in list_participant_logs(self.path, participant):
            for selected in select(path, self.selection).read_sessions():
                session = Session(selected, self.selection)
                if session.participant == participant and number in (None, session.number):
                    return session
        raise KeyError(key)

    def __iter__(self) -> Iterator[Session]:
        selected = select(self.path, self.selection).read_sessions()
        return (Session(session, self.selection) for session in selected)

    def __len__(self) -> int:
        return len(list_readable_logs(self.path)[0])

    def __repr__(self) -> str:
        return f"<study {self.path.name}: {len(self)} sessions>"

    def _repr_html_(self) -> str:
        rows = [
            (session.participant, session.group, session.number, len(session), session.end_reason)
            for session in self.sessions[:_MAX_SHOWN_SESSIONS]
        ]  # fmt: skip
        notes = list(self.exclusions)
        if len(self.sessions) > _MAX_SHOWN_SESSIONS:
            notes.append(f"the first {_MAX_SHOWN_SESSIONS} are shown")
        caption = f"{self.path.name}: {'; '.join(notes)}"
        return format_html_table(caption, ("participant", "group", "session", "included episodes", "ended"), rows)
