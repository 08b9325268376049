"""The port every device implements. A protocol names it under ``[[devices]]``; labs register theirs by entry point."""

import abc
from collections.abc import Sequence
from dataclasses import dataclass

from minihuman.errors import DeviceError
from minihuman.plugins import check_made, load
from minihuman.windows.port import Clock

GROUP = "minihuman.devices"


@dataclass(frozen=True, slots=True)
class Sample:
    """What a device gave at one moment."""

    t_ns: int  # when it was taken, on the session's clock
    values: tuple[float, ...] = ()  # one a channel; NaN where it has none
    text: str = ""  # what it says in words


class Device(abc.ABC):
    """A source of samples. Its calls come from a thread of its own, one after the other: none holds up a picture."""

    @abc.abstractmethod
    def open(self, clock: Clock) -> dict[str, str]:
        """Begin to sample by the session's clock; give what is to be known of the device, for the log.

        Raises:
            DeviceError: if it is not there, or cannot be used.
        """

    @abc.abstractmethod
    def read(self) -> Sequence[Sample]:
        """What came since the last call, the oldest first; returns at once."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let go of it. Called once, also after a failure."""


def make_device(source: str) -> Device:
    """Make a device by its plug-in's name; what follows a colon is the device's own ("lsl:EyeTracker").

    Raises:
        DeviceError: if there is no such plug-in, it cannot be imported, or its own part is wrong.
    """
    name, _, argument = source.partition(":")
    device = load(GROUP, name, DeviceError, what="device")(argument)
    check_made(device, Device, DeviceError, group=GROUP, name=name)
    assert isinstance(device, Device)  # checked just now
    return device
