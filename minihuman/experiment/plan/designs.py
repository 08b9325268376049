"""Interfaces of adaptive designs: of the episodes of a block, and of the participants of a study.

A design is pure: the same history, or statistics, and the same random numbers give the same decision, so that a log
proves each decision. A design rounds the numbers that its decisions depend on, since processors differ in the last bit.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import msgspec

from minihuman.errors import ProtocolError
from minihuman.plugins import call_plugin

GROUP = "minihuman.designs"
Outcome = Literal["", "success", "reward", "steps", "log_steps"]  # of an episode
Draw = Callable[[int], tuple[float, ...]]  # draws a number of random numbers in [0, 1), the same for the same decision


class DesignSpec(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A design as the protocol specifies it: its name and settings."""

    name: str
    settings: dict[str, Any] = {}


class PlayedEpisode(msgspec.Struct, frozen=True):
    """A completed episode of a block, as a design receives it."""

    options: dict[str, Any]  # of the world, as it was made
    seed: int
    outcome: str
    steps: int
    return_: float

    @property
    def success(self) -> bool:
        """Return whether the episode reached the goal."""
        return self.outcome == "goal"


@dataclass(frozen=True, slots=True)
class DesignDecision:
    """A design's decision about an episode, with its estimates at that time."""

    options: Mapping[str, Any] = field(default_factory=dict)  # of the world, beside the block's own; JSON values
    seed: int | None = None  # of the reset; None: the plan's
    stop: bool = False  # the block is over
    estimates: Mapping[str, float] = field(default_factory=dict)  # by name: {"threshold": 0.31}
    posterior: Any = ()  # the values from which the decision follows; the log has their 64-bit digest


class Design(ABC):
    """An adaptive design that decides between the episodes of a block.

    It has no state, clock or random numbers of its own.

    Args:
        settings: the settings from the protocol; invalid settings raise a ProtocolError.
    """

    version = 1  # increased when the same history leads to another decision
    needs_success = True  # whether it uses success, which the outcome rule of the block's world must then define

    @abstractmethod
    def __init__(self, settings: Mapping[str, Any]) -> None: ...

    @abstractmethod
    def decide(self, history: Sequence[PlayedEpisode], draw: Draw) -> DesignDecision:
        """Decide on the next episode.

        After the block's last episode, only the estimates of the decision are used.

        Args:
            history: the block's episodes so far, the latest last.
            draw: returns as many random numbers in [0, 1) as its argument asks for.
        """


class GroupAssignment(msgspec.Struct, frozen=True):
    """The statistics from which a design assigned a group."""

    design: str  # as the protocol names it
    version: int
    statistics: dict[str, Any]  # of the participants before; no codes


class EnrolledParticipant(msgspec.Struct, frozen=True):
    """A participant, as an enrolment design receives them."""

    group: str
    stratum: str = ""
    value: float | None = None  # the participant's outcome; None if the first session is not complete


@dataclass(frozen=True, slots=True)
class EnrolmentDecision:
    """An enrolment design's decision from its statistics."""

    group: str = ""  # of the next participant; "" if the design assigns none
    stop: bool = False  # no further participant is enrolled
    estimates: Mapping[str, float] = field(default_factory=dict)


class EnrolmentDesign(ABC):
    """An adaptive design that decides at a participant's enrolment.

    It has no state, clock or random numbers of its own.

    Args:
        settings: the settings from the protocol; invalid settings raise a ProtocolError.
    """

    version = 1  # increased when the same statistics lead to another decision
    outcome: Outcome = ""  # its mean over the block's episodes is `EnrolledParticipant.value`; "" for none
    block: str = ""  # the block whose episodes count; "" for all blocks

    @abstractmethod
    def __init__(self, settings: Mapping[str, Any]) -> None: ...

    @abstractmethod
    def compute_statistics(self, enrolled: Sequence[EnrolledParticipant], groups: Mapping[str, int]) -> dict[str, Any]:
        """Compute the statistics from which `decide` decides, as JSON values.

        A design for stopping includes ``look``, the number of the latest planned look, 0 before the first.

        Args:
            enrolled: the participants in order of enrolment.
            groups: the allocation ratio of each group by name.
        """

    @abstractmethod
    def decide(self, statistics: Mapping[str, Any], stratum: str, draw: Draw) -> EnrolmentDecision:
        """Decide on the next participant's group, or to stop enrolment.

        Args:
            statistics: the result of `compute_statistics`.
            stratum: the participant's stratum; "" without strata.
            draw: returns as many random numbers in [0, 1) as its argument asks for.
        """


def make_design(spec: DesignSpec) -> Design:
    """Return the design of a block, made from its name and settings.

    Raises:
        ProtocolError: if there is no design of that name, it is of another type, or a setting is invalid.
    """
    return call_plugin(GROUP, spec.name, Design, ProtocolError, spec.settings, noun="design")  # type: ignore[type-abstract]


def make_enrolment_design(spec: DesignSpec) -> EnrolmentDesign:
    """Return a design that decides at enrolment, made from its name and settings.

    Raises:
        ProtocolError: as `make_design` does.
    """
    return call_plugin(GROUP, spec.name, EnrolmentDesign, ProtocolError, spec.settings, noun="design")  # type: ignore[type-abstract]


SettingsType = TypeVar("SettingsType", bound=msgspec.Struct)


def read_design_settings(settings: Mapping[str, Any], kind: type[SettingsType]) -> SettingsType:
    """Return a design's settings as a struct of type ``kind``.

    Raises:
        ProtocolError: if a setting is unknown, missing or of another type.
    """
    try:
        return msgspec.convert(dict(settings), kind)
    except msgspec.ValidationError as error:
        raise ProtocolError(f"settings: {error}; the settings are {', '.join(kind.__struct_fields__)}") from None


def require_setting(holds: bool, complaint: str) -> None:
    """Require that a setting is valid; ``complaint`` says what is wrong with it, and what to write instead.

    Raises:
        ProtocolError: if ``holds`` is false.
    """
    if not holds:
        raise ProtocolError(f"settings: {complaint}")


def round_estimate(value: float) -> float:
    """Return a number rounded to six significant digits, so that every processor gives the same number."""
    return float(f"{value:.6g}")
