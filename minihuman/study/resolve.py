"""Which parts a session has for one participant: groups, orders and sessions applied, in the order they come."""

from minihuman.errors import AllocationError
from minihuman.study.allocation import Slot
from minihuman.study.protocol import Protocol

CONSENT, KEYBOARD, CLOSING = "consent", "keyboard_check", "closing"


def part_names(protocol: Protocol, slot: Slot, group: str, session: int) -> list[str]:
    """The names of a session's parts in order, keyboard check and closing included where they come by themselves.

    Raises:
        AllocationError: if the study has no such session.
    """
    if not protocol.designed:
        return _plain(protocol, group)
    if protocol.sessions:
        if session > len(protocol.sessions):
            raise AllocationError(
                f"study {protocol.study.name!r} has {len(protocol.sessions)} sessions, not {session}; "
                "choose another --session or add one to [[sessions]]"
            )
        listed = protocol.sessions[session - 1].parts
    else:
        listed = protocol.group(group).parts
    instead = protocol.group(group).instead
    names: list[str] = []
    for name in listed:
        chosen = instead.get(name, name)
        inside = _in_order(protocol, slot, chosen)
        names += [chosen] if inside is None else [instead.get(part, part) for part in inside]
    return _framed(protocol, [name for name in names if name], session)


def _plain(protocol: Protocol, group: str) -> list[str]:
    """A group that lists blocks: what belongs around them comes by itself."""
    study = protocol.study
    return [
        *([CONSENT] if study.consent else []),
        *([KEYBOARD] if protocol.keys.check else []),
        *protocol.group(group).blocks,
        *([CLOSING] if study.closing != "" else []),
    ]


def _in_order(protocol: Protocol, slot: Slot, name: str) -> list[str] | None:
    """The parts that an order stands for, in the slot's order; None for the name of a part."""
    for number, order in enumerate(protocol.orders):
        if order.name == name:
            return [order.parts[place] for place in slot.orders[number]]
    return None


def _framed(protocol: Protocol, names: list[str], session: int) -> list[str]:
    """Parts, with the consent of the first session, a keyboard check before the first block, and last words."""
    blocks = {block.name for block in protocol.blocks}
    if protocol.keys.check and KEYBOARD not in names:
        first = next((place for place, name in enumerate(names) if name in blocks), None)
        if first is not None:
            names = [*names[:first], KEYBOARD, *names[first:]]
    if protocol.study.consent and session == 1 and not _has(protocol, names, "agree"):
        names = [CONSENT, *names]
    if protocol.study.closing != "" and not _has(protocol, names, "closing"):
        names = [*names, CLOSING]
    return names


def _has(protocol: Protocol, names: list[str], what: str) -> bool:
    return any(page.name in names and getattr(page, what) for page in protocol.pages)
