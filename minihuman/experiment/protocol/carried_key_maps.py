"""Validation rules of key maps that carry over from one block to the next, which must have as many actions."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise, permutations, product

import msgspec

from minihuman.experiment.protocol.model import BlockSpec, GroupSpec, Protocol
from minihuman.experiment.protocol.validation_errors import FieldError


def check_carried_key_maps(protocol: Protocol) -> Iterator[FieldError]:
    """Yield a (path, message) for each key map that carries over to a block with a different number of actions.

    A session's first block draws its own map, so one block can serve both a group that carries over into it and a group
    that starts with it.
    """
    carried = {name for group in protocol.groups for name in group.blocks[1:]}
    for number, group in enumerate(protocol.groups):
        if group.blocks and group.blocks[0] not in carried:
            first = _find_group_block(protocol, group.blocks[0], group)
            if first is not None and first.key_map == "carry_over":
                message = f"is {first.name!r}, which carries a key map, but no group plays a block before it"
                yield f"$.groups[{number}].blocks[0]", message
        for place, (first_name, second_name) in enumerate(pairwise(group.blocks), 1):
            yield from _check_pair(protocol, f"$.groups[{number}].blocks[{place}]", group, first_name, second_name)
        for place, session in enumerate(protocol.sessions):
            for first_name, second_name in _list_block_pairs(protocol, group, session.parts):
                yield from _check_pair(protocol, f"$.sessions[{place}].parts", group, first_name, second_name)
        for first_name, second_name in _list_block_pairs(protocol, group, group.parts):
            yield from _check_pair(protocol, f"$.groups[{number}].parts", group, first_name, second_name)


def _check_pair(protocol: Protocol, path: str, group: GroupSpec, first: str, second: str) -> Iterator[FieldError]:
    """Yield an error if a block carries over the key map of a block with a different number of actions."""
    before = _find_group_block(protocol, first, group)
    block = _find_group_block(protocol, second, group)
    if before is None or block is None or block.key_map != "carry_over":
        return
    if len(before.actions) == len(block.actions):
        return
    counts = f"{len(block.actions)} actions carried from {len(before.actions)}"
    if path.endswith("]"):
        message = f"is {second!r}"
    else:
        message = f"has {second!r} after {first!r} in group {group.name!r}"
    yield path, f"{message} with {counts}; give both blocks as many, or use key_map = 'new'"


def _list_block_pairs(protocol: Protocol, group: GroupSpec, listed: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of blocks that can follow each other directly in some participant's order, each once."""
    known = {block.name for block in protocol.blocks}
    orders = {order.name: order for order in protocol.orders}
    pairs: list[tuple[str, str]] = []
    before: Sequence[str] = ()  # the blocks that may precede the next part
    for name in listed:
        chosen = group.replace_parts.get(name, name)
        order = orders.get(chosen)
        listed_units = ((chosen,),) if order is None else order.units
        played_units = [_list_played(unit, group, known) for unit in listed_units]
        units = [unit for unit in played_units if unit]
        if not units:
            continue
        for unit in units:
            pairs += pairwise(unit)
        if order is None or order.order == "fixed":
            first_units = units[:1]
            last_units = units[-1:]
            neighbours: Iterable[tuple[list[str], list[str]]] = pairwise(units)
        else:  # any unit may be the first or the last, and follow any other
            first_units = last_units = units
            neighbours = permutations(units, 2)
        pairs += product(before, [unit[0] for unit in first_units])
        pairs += [(unit[-1], next_unit[0]) for unit, next_unit in neighbours]
        before = [unit[-1] for unit in last_units]
    return list(dict.fromkeys(pairs))


def _list_played(unit: Sequence[str], group: GroupSpec, blocks: set[str]) -> list[str]:
    """Return the blocks in a unit of an order as a group plays it."""
    parts = [group.replace_parts.get(part, part) for part in unit]
    return [part for part in parts if part in blocks]


def _find_group_block(protocol: Protocol, name: str, group: GroupSpec) -> "BlockSpec | None":
    """Return a block as a group plays it; None if it does not exist, which is reported as an error elsewhere."""
    try:
        return next((protocol.block_for(name, group.name) for block in protocol.blocks if block.name == name), None)
    except msgspec.ValidationError:
        return None
