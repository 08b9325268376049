"""Participant codes: the slot that a code names, and how often that slot was reassigned."""

import re

from minihuman.errors import AllocationError

_CODE = re.compile(r"(sub|model)-(?P<number>\d{2,9})")


MAX_SLOTS = 100_000  # in an allocation list; higher numbers are codes of participants who took a slot over


def parse_participant_code(code: str) -> int:
    """Return the index of the allocation slot that a participant's code names.

    It is 6 for "sub-07", and also for "sub-100007", the code of a participant who took over that slot.

    Raises:
        AllocationError: if the text is no participant code.
    """
    match = _CODE.fullmatch(code)
    if match is None or int(match["number"]) == 0:
        raise AllocationError(f"{code!r} is not a participant code; use 'sub-' and a number from 01, never a name")
    return (int(match["number"]) - 1) % MAX_SLOTS


def format_participant_code(index: int, before: int = 0, *, prefix: str = "sub") -> str:
    """Format the code of the participant in an allocation slot, such as "sub-07".

    Args:
        index: the slot's index, from 0.
        before: the number of participants who had the slot before; with 1, the code for index 6 is "sub-100007".
        prefix: "sub", or "model" for a language model in a participant's place.
    """
    return f"{prefix}-{before * MAX_SLOTS + index + 1:02d}"
