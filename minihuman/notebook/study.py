"""A study, as a notebook looks at it."""

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from minihuman.data.counted import Account
from minihuman.data.opened import worth_reading
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.data.table_file import TableFile
from minihuman.errors import LogError
from minihuman.log.paths import sessions_in
from minihuman.notebook.episode import Episode
from minihuman.notebook.session import Session, open_session
from minihuman.notebook.tables import as_html, frame

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

_SHOWN = 20  # participants in a notebook's cell


class Study:
    """A study's sessions. They are read when they are asked for, and their tables are kept beside the study."""

    def __init__(self, path: Path, selection: Selection) -> None:
        self.path = path
        self.selection = selection

    @cached_property
    def _opened(self) -> tuple[tuple[Session, ...], Account]:
        found = Sessions(self.path, self.selection)
        return tuple(Session(counted, self.selection) for counted in found), found.account

    @property
    def sessions(self) -> tuple[Session, ...]:
        """Every session that can be read, in order of path; all of them are held in memory from then on."""
        return self._opened[0]

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Every session's episodes that count."""
        return tuple(episode for session in self.sessions for episode in session.episodes)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What counts, and what was left out and why, a line a fact."""
        return tuple(self._opened[1].lines())

    def table(self, name: str = "episodes", *, everything: bool = False) -> "pd.DataFrame":
        """One of the study's tables, such as "steps", "episodes" or "participants"; of what counts, or of everything.

        Raises:
            StoreError: if there is no such table.
            LogError: if there is no such folder.
        """
        return frame(self.path, self.selection, name, everything=everything)

    def query(self, sql: str) -> "pd.DataFrame":
        """What DuckDB's SQL says of the study's tables: of everything; what counts is where ``left_out`` is null.

        Raises:
            StoreError: if it is no SQL, or asks for what is not there.
        """
        from minihuman.data.store import Store

        with Store(Sessions(self.path, self.selection), with_shortest=True) as store:
            tables: TableFile = store.tables
            found: pd.DataFrame = tables.query(sql).to_pandas()
            return found

    def figure(self, name: Literal["learning", "occupancy"] = "learning", *, of: str = "") -> "Figure":
        """How rewards change over a block's episodes, by group, or where everybody was in a world.

        ``of`` names the block or the world; by default the last that was played.

        Raises:
            LogError: if nothing that counts was played there.
        """
        from minihuman.figures.drawn_from import learning_curves
        from minihuman.figures.gallery import rewards
        from minihuman.figures.learning import learning_figure
        from minihuman.figures.occupancy import by_participant, occupancy_figure

        logs = [session._counted.session for session in self.sessions]
        played = [episode for log in logs for episode in log.episodes]
        if name == "learning":
            of = of or (played[-1].plan.block_name if played else "")
            episodes = rewards(logs)
            curves = learning_curves(episodes[episodes["block"] == of])
            if curves:
                return learning_figure(curves, measure="reward")
        else:
            of = of or (played[-1].plan.world if played else "")
            participants = by_participant(logs, of)
            if participants:
                return occupancy_figure(of, participants)
        raise LogError(f"{self.path} has no episode of {of!r} that counts and can be drawn")

    def __getitem__(self, participant: str) -> Session:
        """A participant's first session.

        Raises:
            KeyError: if there is none.
        """
        for session in self.sessions:
            if session.participant == participant:
                return session
        raise KeyError(participant)

    def __iter__(self) -> Iterator[Session]:
        return iter(self.sessions)

    def __len__(self) -> int:
        return len(worth_reading(self.path)[0])

    def __repr__(self) -> str:
        return f"<study {self.path.name}: {len(self)} sessions>"

    def _repr_html_(self) -> str:
        rows = [
            (one.participant, one.group, one.number, len(one), one.end_reason) for one in self.sessions[:_SHOWN]
        ]  # fmt: skip
        more = f"; the first {_SHOWN} are shown" if len(self.sessions) > _SHOWN else ""
        caption = f"{self.path.name}: {'; '.join(self.left_out)}{more}"
        return as_html(caption, ("participant", "group", "session", "episodes that count", "ended"), rows)


def open(path: Path | str, selection: Selection | None = None) -> Study | Session:
    """Open a study's folder, one session's folder, or one log.

    What does not count (marked exclude, not played to an end, left out by the protocol's own rules) is left out unless
    a ``selection`` says otherwise.

    Raises:
        LogError: if there is nothing of that name, or a single log cannot be read.
    """
    path, selection = Path(path), Selection() if selection is None else selection
    if path.is_file() or (path.is_dir() and len(sessions_in(path)) == 1):
        return open_session(path, selection)
    if not path.is_dir():
        raise LogError(f"{path} does not exist; name a session log, or a folder of them")
    return Study(path, selection)
