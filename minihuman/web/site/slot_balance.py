"""Describes how evenly imported records are distributed over slots and groups, as pages draw slots independently."""

from collections import Counter
from pathlib import Path

from minihuman.admin.enrolment_entries import SlotTaken, read_enrolment_log
from minihuman.experiment.protocol.protocol import Protocol

_MOST_NAMED = 10


def describe_slots(study: Path, protocol: Protocol) -> str:
    """Describe in one line how many slots are taken, which of them more than once, and the sizes of the groups.

    Args:
        study: the study's folder.
        protocol: the study's protocol.
    """
    taken_slots = [line for line in read_enrolment_log(study) if isinstance(line, SlotTaken)]
    counts = Counter(line.index + 1 for line in taken_slots)
    repeated = sorted(slot for slot in counts if counts[slot] > 1)
    parts = [f"slots: {len(counts)} of {protocol.study.participants} taken"]
    if repeated:
        named = ", ".join(f"{slot} ({counts[slot]} times)" for slot in repeated[:_MOST_NAMED])
        ellipsis = ", ..." if len(repeated) > _MOST_NAMED else ""
        parts.append(f"{len(repeated)} of them more than once: {named}{ellipsis}")
    groups = Counter(line.group for line in taken_slots)
    sizes = {group.name: groups[group.name] for group in protocol.groups}
    if len(sizes) > 1:
        parts.append("groups: " + ", ".join(f"{name} {size}" for name, size in sizes.items()))
    return "; ".join(parts)
