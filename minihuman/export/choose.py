"""Which episodes of which logs an export takes."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import ExportError, MinihumanError
from minihuman.export.port import Chosen
from minihuman.log.episode import Episode, SessionLog
from minihuman.log.read import open_log


@dataclass(frozen=True, slots=True)
class Filters:
    """What to take. Empty means everything; several values of one field mean any of them."""

    outcomes: tuple[str, ...] = ()
    blocks: tuple[str, ...] = ()
    participants: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()  # only episodes that carry one of these marks
    without_tags: tuple[str, ...] = ()  # no episode that carries one of these marks

    def takes_session(self, log: SessionLog) -> bool:
        """Whether any of its episodes can pass."""
        return not self.participants or log.plan.participant.id in self.participants

    def takes(self, episode: Episode, tags: frozenset[str]) -> bool:
        """Whether an episode with these marks passes."""
        return (
            (not self.outcomes or (episode.outcome or "cut_off") in self.outcomes)
            and (not self.blocks or episode.plan.block_name in self.blocks)
            and (not self.tags or not tags.isdisjoint(self.tags))
            and tags.isdisjoint(self.without_tags)
        )
