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
        listed = protocol.sessions[session - 1].parts
    else:
        listed = protocol.group(group).parts
    replacements = protocol.group(group).replace_parts
    names: list[str] = []
    for name in listed:
        chosen = replacements.get(name, name)
        inside = _apply_order(protocol, slot, chosen)
        if inside is None:
            names.append(chosen)
        else:
            names += [replacements.get(part, part) for part in inside]
    return _add_debrief(protocol, _add_default_parts(protocol, [name for name in names if name], session), group)


def _surround_blocks(protocol: Protocol, group: str) -> list[str]:
    """Return a group's blocks with the consent, keyboard check and closing around them."""
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
            return [part for place in slot.orders[number] for part in order.units[place]]
    return None


def _add_default_parts(protocol: Protocol, names: list[str], session: int) -> list[str]:
    """Add consent to the first session, a keyboard check before the first block, and a closing page."""
    blocks = {block.name for block in protocol.blocks}
    if protocol.keys.keyboard_check and KEYBOARD not in names:
        first = next((place for place, name in enumerate(names) if name in blocks), None)
        if first is not None:
            names = [*names[:first], KEYBOARD, *names[first:]]
    if protocol.study.consent and session == 1 and not _has_page(protocol, names, "asks_consent"):
        names = [CONSENT, *names]
    if protocol.study.closing != "" and not _has_page(protocol, names, "closing"):
        names = [*names, CLOSING]
    return names


def _add_debrief(protocol: Protocol, names: list[str], group: str) -> list[str]:
    """Insert the debriefing page before the closing page, if the protocol discloses the partners only then."""
    teams = [protocol.block_for(name, group).team for name in names if is_block(protocol, name)]
    if DEBRIEF in names or not any(team and team.partner_disclosure == "debrief" for team in teams):
        return names
    ends_with_closing = names[-1] == CLOSING or _has_page(protocol, names[-1:], "closing")
    if ends_with_closing:
        return [*names[:-1], DEBRIEF, names[-1]]
    return [*names, DEBRIEF]


def _has_page(protocol: Protocol, names: list[str], role: str) -> bool:
    return any(page.name in names and getattr(page, role) for page in protocol.pages)


def is_block(protocol: Protocol, name: str) -> bool:
    """Return whether a part is a block."""
    return any(block.name == name for block in protocol.blocks)
