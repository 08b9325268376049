"""Devices beside the keyboard that a session records: an eye tracker, a trigger box. What, not how."""

import re

import msgspec

_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,63}")


class Device(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A device whose samples go into the session's log, stamped on the session's clock."""

    name: str  # of its samples in the log: lower-case letters, digits, "-" and "_"
    source: str  # the plug-in that brings it; what follows a ":" is its own ("lsl:EyeTracker")
    channels: tuple[str, ...] = ()  # what each of a sample's numbers is
    units: tuple[str, ...] = ()  # of each, "" for none; none at all where no channel has one
    required: bool = True  # without it the session does not begin; else the facts in the log say that it is missing


def complaints(devices: tuple[Device, ...]) -> list[tuple[str, str]]:
    """Every (path, complaint) about values that have the right type but cannot be."""
    found = []
    names = [device.name for device in devices]
    for number, device in enumerate(devices):
        path = f"$.devices[{number}]"
        if not _NAME.fullmatch(device.name):
            found.append((f"{path}.name", f"is {device.name!r}; use lower-case letters, digits, '-' and '_'"))
        if device.name in names[:number]:
            found.append((f"{path}.name", f"is {device.name!r} again; give each its own name"))
        if not device.source:
            found.append((f"{path}.source", "is empty; name a plug-in, such as lsl:NAME"))
        if device.units and len(device.units) != len(device.channels):
            found.append((f"{path}.units", f"has {len(device.units)} for {len(device.channels)} channels"))
        if len(set(device.channels)) < len(device.channels):
            found.append((f"{path}.channels", "names one twice"))
    return found
