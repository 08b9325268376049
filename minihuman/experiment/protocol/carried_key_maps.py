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
    for number, group in enumerate(protocol.groups):
        path = f"$.groups[{number}]"
        yield from _check_first_block(protocol, f"{path}.blocks[0]", group)
        for index, (previous_name, name) in enumerate(pairwise(group.blocks), 1):
            yield from _check_pair(protocol, f"{path}.blocks[{index}]", group, previous_name, name)
        for index, session in enumerate(protocol.sessions):
            for previous_name, name in _list_block_pairs(protocol, group, session.parts):
                yield from _check_pair(protocol, f"$.sessions[{index}].parts", group, previous_name, name)
        for previous_name, name in _list_block_pairs(protocol, group, group.parts):
            yield from _check_pair(protocol, f"{path}.parts", group, previous_name, name)


def _check_first_block(protocol: Protocol, path: str, group: GroupSpec) -> Iterator[FieldError]:
    """Yield an error if a group's first block carries over a key map although no group plays a block before it."""
    later_names = {name for other_group in protocol.groups for name in other_group.blocks[1:]}
    if not group.blocks or group.blocks[0] in later_names:
        return
    first_block = _find_group_block(protocol, group.blocks[0], group)
    if first_block is not None and first_block.key_map == "carry_over":
        yield path, f"is {first_block.name!r}, which carries a key map, but no group plays a block before it"


def _check_pair(protocol: Protocol, path: str, group: GroupSpec, previous_name: str, name: str) -> Iterator[FieldError]:
    """Yield an error if a block carries over the key map of a previous block with a different number of actions.

    ``path`` is that of the block in the list of a group's blocks, or that of a list of parts.
    """
    previous_block = _find_group_block(protocol, previous_name, group)
    block = _find_group_block(protocol, name, group)
    if previous_block is None or block is None or block.key_map != "carry_over":
        return
    if len(previous_block.actions) == len(block.actions):
        return
    counts = f"{len(block.actions)} actions carried from {len(previous_block.actions)}"
    if path.endswith("]"):
        message = f"is {name!r}"
    else:
        message = f"has {name!r} after {previous_name!r} in group {group.name!r}"
    yield path, f"{message} with {counts}; give both blocks as many, or use key_map = 'new'"


def _list_block_pairs(protocol: Protocol, group: GroupSpec, listed: Sequence[str]) -> list[tuple[str, str]]:
    """Return the pairs of blocks that can follow each other directly in some participant's order, each once.

    ``listed`` has the names of parts and orders as a session or group lists them, before the group's replacements.
    """
    block_names = {block.name for block in protocol.blocks}
    orders = {order.name: order for order in protocol.orders}
    pairs: list[tuple[str, str]] = []
    possible_previous: Sequence[str] = ()  # the blocks that may precede the next part
    for listed_name in listed:
        name = group.replace_parts.get(listed_name, listed_name)
        order = orders.get(name)
        listed_units = ((name,),) if order is None else order.units
        block_units = [_list_unit_blocks(unit, group, block_names) for unit in listed_units]
        units = [unit for unit in block_units if unit]
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
        pairs += product(possible_previous, [unit[0] for unit in first_units])
        pairs += [(unit[-1], next_unit[0]) for unit, next_unit in neighbours]
        possible_previous = [unit[-1] for unit in last_units]
    return list(dict.fromkeys(pairs))


def _list_unit_blocks(unit: Sequence[str], group: GroupSpec, block_names: set[str]) -> list[str]:
    """Return the names of the blocks in a unit of an order, with a group's replacements."""
    replaced_names = [group.replace_parts.get(part, part) for part in unit]
    return [name for name in replaced_names if name in block_names]


def _find_group_block(protocol: Protocol, name: str, group: GroupSpec) -> "BlockSpec | None":
    """Return a block with a group's overrides; None if it does not exist or an override is not valid.

    Both are reported as errors elsewhere.
    """
    try:
        return next((protocol.block_for(name, group.name) for block in protocol.blocks if block.name == name), None)
    except msgspec.ValidationError:
        return None
