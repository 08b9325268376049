"""Moments: where a time of a session lies on the replay's timelines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from minihuman.recorded.episode import SessionLog

SESSION_TIME = "session_time"  # since the session's first segment began
PLAY_TIME = "play_time"  # since the session's first episode began, 0 before it: where a replay opens
STEP = "step"  # counts on through the session; every episode's first picture counts as one too
EPISODE = "episode"  # 1 for the session's first, 0 before it
ALIGNED = "aligned_time"  # several sessions: their n-th episodes begin together


@dataclass(frozen=True, slots=True, eq=False)
class Moments:
    """One session's rows in time. ``aligned_ns`` is when each episode begins on the common timeline, or None."""

    row_t_ns: NDArray[np.int64]  # every pose of every episode
    start_t_ns: NDArray[np.int64]  # (episodes,)
    numbers: NDArray[np.int64]  # (episodes,) 1 for the session's first
    aligned_ns: NDArray[np.int64] | None

    @classmethod
    def of(cls, log: SessionLog, *, aligned_ns: dict[int, int] | None = None) -> "Moments":
        """The moments of a session; ``aligned_ns`` maps an episode's number to its common beginning."""
        numbers = [episode.number for episode in log.episodes]
        rows = [episode.t_ns for episode in log.episodes]
        return cls(
            row_t_ns=np.concatenate(rows) if rows else np.zeros(0, np.int64),
            start_t_ns=np.array([episode.t_ns[0] for episode in log.episodes], np.int64),
            numbers=np.array(numbers, np.int64),
            aligned_ns=None if aligned_ns is None else np.array([aligned_ns[n] for n in numbers], np.int64),
        )

    @property
    def _first_ns(self) -> int:
        return int(self.start_t_ns[0]) if len(self.start_t_ns) else 0

    def columns(self, t_ns: ArrayLike) -> list[rr.TimeColumn]:
        """The timelines' values at these times, ns since the session began."""
        times = np.asarray(t_ns, np.int64)
        place = np.searchsorted(self.start_t_ns, times, side="right") - 1
        steps = np.searchsorted(self.row_t_ns, times, side="right") - 1
        episodes = np.where(place < 0, 0, self.numbers[place]) if len(self.numbers) else np.zeros(len(times), np.int64)
        columns = [
            rr.TimeColumn(SESSION_TIME, duration=times.astype("timedelta64[ns]")),
            rr.TimeColumn(PLAY_TIME, duration=np.maximum(times - self._first_ns, 0).astype("timedelta64[ns]")),
            rr.TimeColumn(STEP, sequence=np.maximum(steps, 0)),
            rr.TimeColumn(EPISODE, sequence=episodes),
        ]
        if self.aligned_ns is not None and len(self.numbers):
            since = times - self.start_t_ns[np.maximum(place, 0)] + self.aligned_ns[np.maximum(place, 0)]
            columns.append(rr.TimeColumn(ALIGNED, duration=since.astype("timedelta64[ns]")))
        return columns


def common_starts(logs: Sequence[SessionLog]) -> dict[int, int]:
    """When each episode begins on the common timeline, by number: a second after the longest one before it."""
    longest: dict[int, int] = {}
    for log in logs:
        for episode in log.episodes:
            number = episode.number
            longest[number] = max(longest.get(number, 0), int(episode.t_ns[-1] - episode.t_ns[0]))
    starts, now_ns = {}, 0
    for number in sorted(longest):
        starts[number] = now_ns
        now_ns += longest[number] + 1_000_000_000
    return starts
