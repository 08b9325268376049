"""The names of a session's parts in order, with groups, orders and replacements resolved and default parts added."""

from minihuman.errors import AllocationError
from minihuman.experiment.plan.allocation import AllocationSlot
from minihuman.experiment.protocol.protocol import Protocol

CONSENT = "consent"
KEYBOARD = "keyboard_check"
DEBRIEF = "debrief"
CLOSING = "closing"


def list_part_names(protocol: Protocol, slot: AllocationSlot, group: str, session: int) -> list[str]:
    """Return the names of a session's parts in order, default parts such as the keyboard check included.

    ``slot`` has the order in which the participant does the parts of each of the protocol's orders; ``session`` is the
    session's number, from 1.

    Raises:
        AllocationError: if the study has no such session.
    """
    if not protocol.lists_parts:  # groups list only blocks, so all other parts are added
        return _add_debrief(protocol, _surround_blocks(protocol, group), group)
    if protocol.sessions:
        if session > len(protocol.sessions):
            raise AllocationError(
                f"study {protocol.study.name!r} has {len(protocol.sessions)} sessions, not {session}; "
                "choose another number with --session, or add one to [[sessions]]"
            )
        listed_names = protocol.sessions[session - 1].parts
    else:
        listed_names = protocol.group(group).parts
    replacements = protocol.group(group).replace_parts
    names: list[str] = []
    for listed_name in listed_names:
        name = replacements.get(listed_name, listed_name)
        ordered_names = _apply_order(protocol, slot, name)
        if ordered_names is None:
            names.append(name)
        else:
            names += [replacements.get(ordered_name, ordered_name) for ordered_name in ordered_names]
    names = [name for name in names if name]  # a part that is replaced by "" is left out
    return _add_debrief(protocol, _add_default_parts(protocol, names, session), group)


def _surround_blocks(protocol: Protocol, group: str) -> list[str]:
    """Return the names of a group's blocks, with the consent, keyboard check and closing that the protocol asks for."""
    parts: list[str] = []
    if protocol.study.consent:
        parts.append(CONSENT)
    if protocol.keys.keyboard_check:
        parts.append(KEYBOARD)
    parts += protocol.group(group).blocks
    if protocol.study.closing != "":
        parts.append(CLOSING)
    return parts


def _apply_order(protocol: Protocol, slot: AllocationSlot, name: str) -> list[str] | None:
    """Return the parts that an order stands for, in the slot's order; None if the name is not an order's."""
    for number, order in enumerate(protocol.orders):
        if order.name == name:
            return [part for index in slot.orders[number] for part in order.units[index]]
    return None


def _add_default_parts(protocol: Protocol, names: list[str], session: int) -> list[str]:
    """Return a session's parts with consent at the beginning, a keyboard check before the first block, and closing.

    Consent is added to the first session only. A part is added only if the protocol asks for it and lists none like it.
    """
    if protocol.keys.keyboard_check and KEYBOARD not in names:
        first_block = next((index for index, name in enumerate(names) if is_block(protocol, name)), None)
        if first_block is not None:
            names = [*names[:first_block], KEYBOARD, *names[first_block:]]
    if protocol.study.consent and session == 1 and not _has_page(protocol, names, "asks_consent"):
        names = [CONSENT, *names]
    if protocol.study.closing != "" and not _has_page(protocol, names, "closing"):
        names = [*names, CLOSING]
    return names


def _add_debrief(protocol: Protocol, names: list[str], group: str) -> list[str]:
    """Return the parts with a debriefing before the closing page, if a block discloses its partners only there."""
    teams = [protocol.block_for(name, group).team for name in names if is_block(protocol, name)]
    if DEBRIEF in names or not any(team and team.partner_disclosure == "debrief" for team in teams):
        return names
    ends_with_closing = names[-1] == CLOSING or _has_page(protocol, names[-1:], "closing")
    if ends_with_closing:
        return [*names[:-1], DEBRIEF, names[-1]]
    return [*names, DEBRIEF]


def _has_page(protocol: Protocol, names: list[str], role: str) -> bool:
    """Return whether any of the named parts is a page whose field ``role``, "asks_consent" or "closing", is true."""
    return any(page.name in names and getattr(page, role) for page in protocol.pages)


def is_block(protocol: Protocol, name: str) -> bool:
    """Return whether ``name`` is the name of one of the protocol's blocks."""
    return any(block.name == name for block in protocol.blocks)
