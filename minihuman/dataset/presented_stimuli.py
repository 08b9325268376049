"""What a session presented beside the pictures of worlds: pictures and sounds of the stimuli of its activities."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Literal

from minihuman.experiment.machine.activity import find_kind

if TYPE_CHECKING:
    from minihuman.log.model.session_log import EpisodeLog, SessionLog


@dataclass(frozen=True, slots=True)
class Presentation:
    """A picture that reached the display, or a sound that began."""

    kind: Literal["flip", "sound"]
    episode: "EpisodeLog"
    onset_ns: int  # session time
    stimuli: tuple[str, ...]  # the names of those in it, the front one last
    file: str = ""  # the protocol's file that began to be presented; "" for none
    duration_ms: float | None = None  # of a sound; None: not known


def list_presentations(log: "SessionLog") -> Iterator[Presentation]:
    """Yield the pictures and sounds that a session's activities presented, one kind of activity after the other."""
    for name in dict.fromkeys(part.kind for part in log.plan.parts):
        attribute = find_kind(name).presentations
        if attribute:
            module, _, function = attribute.partition(":")
            list_of_kind: Callable[[SessionLog], Iterable[Presentation]] = getattr(import_module(module), function)
            yield from list_of_kind(log)
