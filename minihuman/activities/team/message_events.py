"""Events of messages in a team."""

from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent
from minihuman.experiment.machine.inputs import ActivityInput


@dataclass(frozen=True, slots=True)
class MessageShown(ActivityEvent):
    """Words or a mark, one's own or another's, came onto the screen."""

    episode: int
    step: int  # the latest then
    seat: int  # the author's
    text: str  # "" of another's in a log: it is in the author's alone
    cell: tuple[float, ...]  # x and z of the marked cell; empty for words
    digest: str  # salted; another for each message, even with the same words

    @property
    def words_to_others(self) -> str:
        """The words, empty for a mark."""
        return self.text


@dataclass(frozen=True, slots=True)
class MessageTyped(ActivityEvent):
    """Letters of a message were typed: in no table, as an answer's `TextTyped` are."""

    text: str

    @property
    def words_to_others(self) -> str:
        """The letters."""
        return self.text


@dataclass(frozen=True, slots=True)
class MessageGiven(ActivityInput):
    """Another seat's message, as it was shown there; in a replay without its words."""

    message: MessageShown
