"""What was chosen out of a study: episodes one by one, or session by session."""

import abc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from minihuman.recorded.episode import Episode, SessionLog

T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """One episode that passed the filters, and the session it belongs to."""

    log: SessionLog
    episode: Episode
    stored_frames: bool = False  # take the observations that the log holds, do not play them again

    @property
    def facts(self) -> dict[str, Any]:
        """What travels with every exported episode: who, under which rule, with which keys, and how it ended."""
        plan = self.episode.plan
        return {
            "study": self.log.plan.study,
            "participant": self.log.plan.participant.id,
            "group": self.log.plan.participant.group,
            "session": self.log.plan.session,
            "player": self.log.player,
            "block": plan.block_name,
            "segment": self.episode.segment,
            "episode": self.episode.number,
            "attempt": self.episode.attempt,
            "world": plan.world,
            "seed": plan.seed,
            "outcome": self.episode.outcome_word,
            "mission": self.episode.start.mission,
            "key_map": dict(plan.key_map.keys),
            "action_names": list(self.episode.start.action_names),
            "protocol_sha256": self.log.plan.protocol_sha256,
        }


class Selection(abc.ABC):
    """The episodes that an export takes. To be gone through once, in one of two ways."""

    @abc.abstractmethod
    def __iter__(self) -> Iterator[Chosen]:
        """One episode after the other, one session in memory at a time."""

    @abc.abstractmethod
    def each_session(self, work: Callable[[SessionLog], T]) -> Iterator[T]:
        """What ``work`` makes of each session and its chosen episodes, several sessions worked on side by side.

        ``work`` may run in another process: it and its results can be pickled.
        """
