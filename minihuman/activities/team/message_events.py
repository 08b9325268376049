"""Events of messages within a team."""

from dataclasses import dataclass

from minihuman.experiment.machine.events import ActivityEvent
from minihuman.experiment.machine.inputs import ActivityInput


@dataclass(frozen=True, slots=True)
class MessageShown(ActivityEvent):
    """A message, the person's own or another's, appeared on the screen: words or a mark."""

    episode: int
    step: int  # the latest step at that time
    seat: int  # the author's
    text: str  # in a log, "" for another seat's message: its words are in its author's log alone
    cell: tuple[float, ...]  # x and z of the marked cell; empty for words
    digest: str  # salted; differs between messages, even with the same words

    @property
    def words_to_others(self) -> str:
        """Return the message's words; empty for a mark."""
        return self.text


@dataclass(frozen=True, slots=True)
class MessageTyped(ActivityEvent):
    """Letters of a message were typed, in a session whose messages keys edit. They are in no table."""

    text: str

    @property
    def words_to_others(self) -> str:
        """Return the letters that were typed."""
        return self.text


@dataclass(frozen=True, slots=True)
class MessageEdited(ActivityEvent):
    """The text in the field for a message settled after changes: the whole text, code point for code point."""

    text: str
    changes: tuple[str, ...] = ()  # how the text changed, as `TextChange` values
    keys: int = 0  # how many keys were pressed in the field; which ones is not recorded
    waited_ns: int = 0  # from the first of the changes to t_ns

    @property
    def words_to_others(self) -> str:
        """Return the text."""
        return self.text


@dataclass(frozen=True, slots=True)
class MessageGiven(ActivityInput):
    """A message of another seat, as that seat's screen showed it; in a replay it has no words."""

    message: MessageShown
