"""A session, as a notebook looks at it."""

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from minihuman.data.counted import Counted
from minihuman.data.selection import Selection
from minihuman.log.read.open_log import open_log
from minihuman.notebook.episode import Episode
from minihuman.notebook.tables import frame
from minihuman.recorded.segment import Segment

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


class Session:
    """One participant's session: its episodes, with what does not count left out unless it is asked for."""

    def __init__(self, counted: Counted, selection: Selection) -> None:
        self._counted = counted
        self._selection = selection

    @property
    def path(self) -> Path:
        """The log, or the folder with its segments."""
        return self._counted.log.path

    @property
    def study(self) -> str:
        """The study's name in the protocol."""
        return self._counted.log.plan.study

    @property
    def participant(self) -> str:
        """The participant's code."""
        return self._counted.log.plan.participant.id

    @property
    def group(self) -> str:
        """The group the participant was allocated to."""
        return self._counted.log.plan.participant.group

    @property
    def number(self) -> int:
        """Which of the participant's sessions, 1 for the first."""
        return self._counted.log.plan.session

    @property
    def player(self) -> str:
        """Whoever pressed the keys: human, or a simulated player's name."""
        return self._counted.log.player

    @property
    def started_at(self) -> str:
        """The wall clock when session time was 0, ISO 8601 UTC."""
        return self._counted.log.started_at

    @property
    def end_reason(self) -> str:
        """Why it ended: complete, quit and others; cut_off where the log broke off first."""
        return self._counted.log.end_reason

    @property
    def segments(self) -> tuple[Segment, ...]:
        """The stretches in which the program ran: more than one where the session was resumed."""
        return self._counted.log.segments

    @property
    def sessions(self) -> tuple["Session", ...]:
        """This one, as a study's are all of its sessions."""
        return (self,)

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """Those that count, in the order played."""
        counted = set(self._counted.places)
        return tuple(episode for place, episode in enumerate(self.everything) if place in counted)

    @property
    def everything(self) -> tuple[Episode, ...]:
        """Every episode that was begun; each says why it does not count, if it does not."""
        one = self._counted
        return tuple(
            Episode(episode, participant=self.participant, left_out=one.session_reason or reason)
            for episode, reason in zip(one.log.episodes, one.reasons, strict=True)
        )

    def table(self, name: str = "episodes", *, everything: bool = False) -> "pd.DataFrame":
        """One of the session's tables, such as "steps" or "episodes"; of what counts, or of everything.

        Raises:
            StoreError: if there is no such table.
        """
        return frame(self.path, self._selection, name, everything=everything)

    def figure(self, name: Literal["paths", "overview"] = "paths") -> "Figure":
        """The session's paths, a panel an episode, or its steps, times and keys at a glance."""
        from minihuman.figures.overview import overview_figure
        from minihuman.figures.paths import session_paths

        return (session_paths if name == "paths" else overview_figure)(self._counted.session)

    def __iter__(self) -> Iterator[Episode]:
        return iter(self.episodes)

    def __len__(self) -> int:
        return len(self._counted.places)

    def __repr__(self) -> str:
        begun = len(self._counted.log.episodes)
        return f"<session {self.number} of {self.participant} ({self.group}): {len(self)} of {begun} episodes count>"

    def _repr_html_(self) -> str:
        from minihuman.notebook.tables import as_html

        rows = [
            (
                one.number, one.attempt, one.block, one.outcome, one.steps, f"{one.reward:.3f}",
                f"{one.playing_s:.1f}", one.left_out,
            )
            for one in self.everything
        ]  # fmt: skip
        heads = ("episode", "attempt", "block", "outcome", "steps", "reward", "playing s", "left out")
        return as_html(repr(self).strip("<>"), heads, rows)


def open_session(path: Path, selection: Selection) -> Session:
    """Open one log, or a session's folder.

    Raises:
        LogError: if it cannot be read.
    """
    return Session(selection.judge(open_log(path)), selection)
