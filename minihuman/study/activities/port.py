"""The port of every kind of activity, and the row by which a kind is known."""

import abc
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import msgspec

from minihuman.study.events import EndReason, Noted, PartEnd, PauseReason
from minihuman.study.inputs import Input
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


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of activity: one row of the registry."""

    name: str
    plan: type[msgspec.Struct]
    activity: type[Activity]

    def read(self, plan: Any) -> msgspec.Struct:
        """A part's plan from what JSON gave."""
        return msgspec.convert(plan, self.plan)
