"""Carried key maps: whether each goes on from a block with as many actions, in every group and every order."""

from collections.abc import Iterator, Sequence
from itertools import pairwise, permutations, product
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:
    from minihuman.study.design import Complaint
    from minihuman.study.protocol import Block, Group, Protocol


def carry_complaints(protocol: "Protocol") -> Iterator["Complaint"]:
    """Every (path, complaint) about a carried key map that is for another number of actions than the one before it.

    A session's first block draws its own, so one block can serve the group that carries into it and the group that
    starts with it.
    """
    carried = {name for group in protocol.groups for name in group.blocks[1:]}
    for number, group in enumerate(protocol.groups):
        if group.blocks and group.blocks[0] not in carried:
            first = _block(protocol, group.blocks[0], group)
            if first is not None and first.key_map == "carry":
                what = f"is {first.name!r}, which carries a key map, but no group plays a block before it"
                yield f"$.groups[{number}].blocks[0]", what
        for place, pair in enumerate(pairwise(group.blocks), 1):
            yield from _pair(protocol, f"$.groups[{number}].blocks[{place}]", group, *pair)
        for place, listed in enumerate(day.parts for day in protocol.sessions):
            for pair in _following(protocol, group, listed):
                yield from _pair(protocol, f"$.sessions[{place}].parts", group, *pair)
        for pair in _following(protocol, group, group.parts):
            yield from _pair(protocol, f"$.groups[{number}].parts", group, *pair)


def _pair(protocol: "Protocol", path: str, group: "Group", first: str, second: str) -> Iterator["Complaint"]:
    before, block = _block(protocol, first, group), _block(protocol, second, group)
    if before is None or block is None or block.key_map != "carry" or len(before.actions) == len(block.actions):
        return
    counts = f"{len(block.actions)} actions carried from {len(before.actions)}"
    what = f"is {second!r}" if path.endswith("]") else f"has {second!r} after {first!r} in group {group.name!r}"
    yield path, f"{what} with {counts}; give both blocks as many, or use key_map = 'fresh'"


def _following(protocol: "Protocol", group: "Group", listed: Sequence[str]) -> list[tuple[str, str]]:
    """The blocks that may be played one right after the other, whatever a participant's order is."""
    known = {block.name for block in protocol.blocks}
    orders = {order.name: order for order in protocol.orders}
    pairs: list[tuple[str, str]] = []
    before: Sequence[str] = ()  # any of these may have been the last
    for name in listed:
        chosen = group.instead.get(name, name)
        order = orders.get(chosen)
        parts = [chosen] if order is None else [group.instead.get(part, part) for part in order.parts]
        blocks = [part for part in parts if part in known]
        if not blocks:
            continue
        varies = order is not None and order.order != "fixed"
        pairs += product(before, blocks if varies else blocks[:1])
        pairs += permutations(blocks, 2) if varies else pairwise(blocks)
        before = blocks if varies else blocks[-1:]
    return list(dict.fromkeys(pairs))


def _block(protocol: "Protocol", name: str, group: "Group") -> "Block | None":
    """The block of a name as a group has it; None where there is none, which is a complaint of its own."""
    try:
        return next((protocol.block_for(name, group.name) for block in protocol.blocks if block.name == name), None)
    except msgspec.ValidationError:
        return None
