"""What enrolment fixes of a study: allocation, order and measures. The rest of the file may still be edited."""

from pathlib import Path
from typing import Any

import msgspec

from minihuman.admin.enrolment_entries import SlotTaken, list_taken_slots, read_enrolled, read_enrolment_log
from minihuman.builder.document import format_path, is_same_value
from minihuman.builder.messages import Restriction, Restrictions
from minihuman.builder.references import list_values
from minihuman.builder.toml_spans import Steps
from minihuman.errors import MinihumanError, ProtocolError
from minihuman.experiment.plan.allocation import allocation_sha256, build_allocation_list
from minihuman.experiment.protocol.protocol import decode_protocol

_ALLOCATION = "participants have been allocated by it"
_ORDER = "participants have begun in this order"
_MEASURES = "it was fixed before the data are seen"
_FIXED = {  # fields by pattern, each with the reason
    "study.name": "the data of the participants are under this name",
    "study.seed": _ALLOCATION,
    "keys.pool": _ALLOCATION,
    "groups": _ALLOCATION,
    "allocation": _ALLOCATION,
    "blocks.*.actions": _ALLOCATION,
    "blocks.*.key_map": _ALLOCATION,
    "sessions": _ORDER,
    "orders": _ORDER,
    "exclusions": _MEASURES,
    "analysis": _MEASURES,
    "design": _MEASURES,
}
WAY_OUT = "make a new version of the study, with a name and data of its own"


def find_restrictions(study_dir: Path, tree: dict[str, Any]) -> Restrictions:
    """Return the fields that the enrolment of participants has fixed.

    Args:
        study_dir: the folder of the study's data, which need not exist.
        tree: the protocol's values.
    """
    enrolled = count_enrolled(study_dir)
    if not enrolled:
        return Restrictions(0, [], "")
    fields = [
        Restriction(list(path), reason)
        for pattern, reason in _FIXED.items()
        for path, _ in list_values(tree, tuple(pattern.split(".")))
    ]
    people = "1 participant has" if enrolled == 1 else f"{enrolled} participants have"
    message = f"{people} enrolled: allocation, order and measures stay as they are. To change them, {WAY_OUT}."
    return Restrictions(enrolled, fields, message)


def count_enrolled(study_dir: Path) -> int:
    """Count the participants who have enrolled and have not withdrawn; 0 where the study has not begun."""
    if not study_dir.is_dir():
        return 0
    return len(read_enrolled(study_dir))


def find_violation(study_dir: Path, old: dict[str, Any], new: dict[str, Any], toml: bytes) -> tuple[Steps, str] | None:
    """Return the first restricted field that a change touches, with the reason; None if it touches none.

    Args:
        study_dir: the study's data.
        old: the values of the file as it is.
        new: the values of the file as it would be.
        toml: the file as it would be.
    """
    if not study_dir.is_dir():
        return None
    slots = list_taken_slots(read_enrolment_log(study_dir))
    if not slots:
        return None
    for pattern, reason in _FIXED.items():
        steps = tuple(pattern.split("."))
        before = _collect_by_owner(old, steps)
        after = _collect_by_owner(new, steps)
        for name, content in before.items():
            if name not in after or not is_same_value(content, after[name]):
                return _find_path(old, steps, name), f"{format_path(steps)} cannot be changed, as {reason}"
        if "*" not in steps and after.keys() > before.keys():
            return steps, f"{format_path(steps)} cannot be added, as {reason}"
    return _find_allocation_change(slots[-1], toml)


def _collect_by_owner(tree: dict[str, Any], pattern: Steps) -> dict[str, Any]:
    """Return the values that match a pattern, by the name of the table that has them.

    Names are compared instead of numbers, so that tables may be reordered. A table without a name has its number as
    text; a pattern without "*" has the one name "".
    """
    values = {}
    for path, content in list_values(tree, tuple(map(str, pattern))):
        owner = tree
        for step in path[:2]:
            owner = owner[step]  # type: ignore[index] # the path leads through tables and lists
        name = owner.get("name", path[1]) if "*" in pattern else ""
        values[str(name)] = content
    return values


def _find_path(tree: dict[str, Any], pattern: Steps, name: str) -> Steps:
    """Return the path that matches a pattern in the table called ``name``; the pattern itself if there is none."""
    for path, _ in list_values(tree, tuple(map(str, pattern))):
        if "*" not in pattern or tree[str(path[0])][path[1]].get("name") == name:
            return path
    return pattern


def _find_allocation_change(slot: SlotTaken, toml: bytes) -> tuple[Steps, str] | None:
    """Return a field and an error if a file's allocation list is not the one in use; None if it is, or has a mistake.

    Args:
        slot: the slot that was taken last, with the digest and the length of the list in use.
        toml: the bytes of the file.
    """
    try:
        protocol = decode_protocol(toml)
    except ProtocolError:
        return None  # reported as a mistake of the file, with which no session can begin
    if protocol.study.participants < slot.list_length:
        return ("study", "participants"), f"study.participants cannot be less than {slot.list_length} any more"
    study = msgspec.structs.replace(protocol.study, participants=slot.list_length)
    try:
        digest = allocation_sha256(build_allocation_list(msgspec.structs.replace(protocol, study=study)))
    except MinihumanError:
        return None
    if digest != slot.allocation_sha256:
        return ("groups",), f"this would change the allocation list, by which {slot.participant} was allocated"
    return None
