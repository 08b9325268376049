"""The port of every kind of activity, and the row by which a kind is known."""

import abc
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import msgspec

from minihuman.study.events import EndReason, KindEvent, Noted, PartEnd, PauseReason
from minihuman.study.inputs import ForPart, Input
from minihuman.study.plan import Part
from minihuman.study.play import Play
from minihuman.study.screens import Screen
from minihuman.study.stage import Stage


@dataclass(frozen=True, slots=True)
class Ended:
    """How a part ended, and where the session goes on."""

    end: PartEnd = "done"
    back_to: int | None = None  # a part's index; None: the next part
    reason: EndReason | None = None  # the whole session ends, for this reason
    detail: str = ""


class Want:
    """What a part waits for that no key gives; a kind of activity adds what is to be known of it.

    Whoever seats the session answers with an input for the part.
    """


class Outside(abc.ABC):
    """Answers what parts want, whoever seats the session: in a window, in a browser, or nobody."""

    @abc.abstractmethod
    def answer(self, want: Want, play: Play | None, t_ns: int) -> ForPart | None:
        """An input for the session; None where there is nothing to say yet.

        Args:
            want: what is waited for.
            play: the episode that is played; None where none is.
            t_ns: the session's time.
        """

    @abc.abstractmethod
    def close(self) -> None:
        """Let go of processes."""


class Activity(abc.ABC):
    """One part of a session while it runs. No clock, file or window: time comes with the inputs.

    Args:
        number: the part's index in the plan.
        part: its kind, name and plan.
        stage: the session around it; events are said there.
    """

    phase: StrEnum
    ended: Ended | None = None  # set when it is over
    next_tick_ns: int | None = None  # when it wants a Tick, if nothing else comes before
    playing = False  # whether it can be paused now
    real_time = False  # whether time, not a key, makes steps now
    play: Play | None = None  # the episode that is being played, for players who may look at its world
    coming: Play | None = None  # the one that is about to be, its world reset: for whoever prepares its pictures
    wants: Want | None = None  # what it waits for from outside

    def __init__(self, number: int, part: Part, stage: Stage) -> None:
        self.number = number
        self.part = part
        self.stage = stage

    @abc.abstractmethod
    def begin(self) -> None:
        """Start; ``ended`` may be set at once if there is nothing to do."""

    @abc.abstractmethod
    def receive(self, happened: Input) -> None:
        """Deal with an input: a key that the session has no use for, text, a pointer, a picture shown, time passed."""

    @abc.abstractmethod
    def screen(self) -> Screen:
        """What should be seen now."""

    def suspend(self, reason: PauseReason) -> None:  # noqa: B027 - most kinds have nothing to stop
        """Stop until ``resume``: a pause, a question or another window is in front."""

    def resume(self) -> None:
        """Go on."""
        self.stage.say(Noted(self.stage.now_ns, "phase", self.phase))

    def stop(self) -> None:  # noqa: B027
        """The session ends in the middle of this part."""

    @staticmethod
    def input_of(event: KindEvent) -> Input | None:
        """What from outside led to an event of the kind's own; None if nothing did. By it a log is played again."""
        return None


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of activity: one row of the registry.

    What other layers know of a kind is named by "module:attribute" and loaded when it is needed, so that this one
    imports none of them.
    """

    name: str
    plan: type[msgspec.Struct]  # a PlayPlan's subclass for a kind of block
    activity: type[Activity]
    messages: str = ""  # a tuple of minihuman.log.kinds.Row, one for each event of its own
    browser: bool = True  # whether it can be done in a browser
    block_field: str = ""  # the plan's field that names a block of the protocol, if it has one
    drawings: str = ""  # a tuple of minihuman.windows.drawings.Drawing, one for each screen of its own

    def read(self, plan: Any) -> msgspec.Struct:
        """A part's plan from what JSON gave."""
        return msgspec.convert(plan, self.plan)
