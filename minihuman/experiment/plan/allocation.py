"""Allocation of participants to groups, key maps and orders, all drawn from the study seed before enrolment.

Groups come in permuted blocks of varying size (one to three times the number of groups), so the next group cannot be
predicted and group sizes stay close. Key positions are balanced: within each full block of as many participants as
the key pool has keys, every action is on every key exactly once; rows go to the participants whose group has had
those positions least often. Latin squares of parts (Williams 1949) are filled within each group. With stratified
allocation each stratum has its own list.
"""

import hashlib
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial

import msgspec

from minihuman.errors import AllocationError
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import OrderSpec
from minihuman.experiment.protocol.strata import build_strata


@dataclass(frozen=True, slots=True)
class AllocationSlot:
    """One participant's slot in the allocation list."""

    index: int  # 0 for the first participant; with strata, those of each stratum's first place come first
    group: str
    positions: tuple[tuple[int, ...], ...]  # one row a draw: for each action, the index of its key in the pool
    kept: tuple[int, ...] = ()  # the row of the keys that a participant keeps; () where no block asks for it
    orders: tuple[tuple[int, ...], ...] = ()  # for each of the protocol's orders, the places of its parts
    stratum: str = ""  # whose answer it is for


def build_allocation_list(protocol: Protocol) -> tuple[AllocationSlot, ...]:
    """Build the list of ``study.participants`` slots, for each stratum if there are strata.

    A longer list begins with a shorter one.
    """
    tables = (
        *(protocol.study, protocol.keys, protocol.groups, protocol.blocks, protocol.orders, protocol.sessions),
        *(protocol.allocation, protocol.questions),
    )
    key = msgspec.json.encode(tables)
    if key not in _LISTS:
        if len(_LISTS) >= _MAX_CACHED_LISTS:
            _LISTS.clear()
            _DIGESTS.clear()
        _LISTS[key] = _build_lists(protocol)
    return _LISTS[key]


_LISTS: dict[
    bytes, tuple[AllocationSlot, ...]
] = {}  # a list of thousands takes a second, and is asked for again and again
_DIGESTS: dict[int, tuple[tuple[AllocationSlot, ...], str]] = {}  # by the identity of a list, which it keeps alive
_MAX_CACHED_LISTS = 8


def _build_lists(protocol: Protocol) -> tuple[AllocationSlot, ...]:
    strata = build_strata(protocol)
    if strata is None:
        return _list(protocol, "")
    lists = [_list(protocol, f"-stratum-{name}") for name in strata.names]
    slots = [
        replace(slot, stratum=name)
        for slots_of_strata in zip(*lists, strict=True)
        for name, slot in zip(strata.names, slots_of_strata, strict=True)
    ]
    return tuple(replace(slot, index=index) for index, slot in enumerate(slots))


def _list(protocol: Protocol, suffix: str) -> tuple[AllocationSlot, ...]:
    """Build the list of all participants or of one stratum; ``suffix`` gives its draws their own random streams."""
    count = protocol.study.participants
    groups = _groups(protocol, count, suffix)
    draws = [_positions(protocol, f"{draw}{suffix}", groups) for draw in range(_draws(protocol))]
    maps = {
        protocol.block_for(block.name, group.name).key_map for block in protocol.blocks for group in protocol.groups
    }
    if "constant" in maps:
        constant_rows = _positions(protocol, f"kept{suffix}", groups)
    else:
        constant_rows = [()] * count
    orders = _orders(protocol, groups, suffix)
    return tuple(
        AllocationSlot(
            index,
            protocol.groups[groups[index]].name,
            tuple(rows[index] for rows in draws),
            constant_rows[index],
            order,
        )
        for index, order in enumerate(orders)
    )


def allocation_sha256(slots: tuple[AllocationSlot, ...]) -> str:
    """Return the SHA-256 of the list's canonical JSON form in hexadecimal, which every log holds.

    Fields that a protocol does not use are left out, so that lists from before these fields existed keep their hash.
    """
    if id(slots) not in _DIGESTS:
        if len(_DIGESTS) >= _MAX_CACHED_LISTS:
            _DIGESTS.clear()
        _DIGESTS[id(slots)] = (slots, _digest(slots))
    return _DIGESTS[id(slots)][1]


def _digest(slots: tuple[AllocationSlot, ...]) -> str:
    used_fields = [name for name in ("kept", "orders", "stratum") if any(getattr(slot, name) for slot in slots)]
    fields = ["index", "group", "positions", *used_fields]
    rows = [{name: getattr(slot, name) for name in fields} for slot in slots]
    return hashlib.sha256(msgspec.json.encode(rows)).hexdigest()


def _draws(protocol: Protocol) -> int:
    """Return the number of draws of key maps.

    There is one for each position in a group's blocks, or one for each block if the protocol lists parts otherwise.
    """
    if protocol.lists_parts:
        return len(protocol.blocks)
    return max((len(group.blocks) for group in protocol.groups), default=0)


def _orders(protocol: Protocol, groups: list[int], suffix: str) -> list[tuple[tuple[int, ...], ...]]:
    """Draw, for each slot, every order of the protocol; Latin squares are filled within each group."""
    group_sizes: Counter[int] = Counter()
    result = []
    for index, group in enumerate(groups):
        result.append(
            tuple(_order(protocol, order, group, group_sizes[group], index, suffix) for order in protocol.orders)
        )
        group_sizes[group] += 1
    return result


def _order(protocol: Protocol, order: OrderSpec, group: int, place: int, index: int, suffix: str) -> tuple[int, ...]:
    count = len(order.parts)
    seed = protocol.study.seed
    match order.order:
        case "fixed":
            return tuple(range(count))
        case "shuffled":
            return draw_permutation(count, seed=seed, purpose=f"order-{order.name}{suffix}", index=index)
    square = build_latin_square(count)
    rows = draw_permutation(
        len(square), seed=seed, purpose=f"order-{order.name}-{group}{suffix}", index=place // len(square)
    )
    return square[rows[place % len(square)]]


def build_latin_square(count: int) -> tuple[tuple[int, ...], ...]:
    """Build orders of ``count`` elements, balanced for position and for immediate succession.

    There are as many rows as elements if that number is even, and twice as many if it is odd (Williams 1949).
    """
    first = [0]
    for step in range(1, count):
        first.append((first[-1] + (step if step % 2 else -step)) % count)
    rows = [tuple((place + row) % count for place in first) for row in range(count)]
    if count % 2:
        return tuple(rows + [row[::-1] for row in rows])
    return tuple(rows)


def find_slot(protocol: Protocol, index: int, stratum: str | None = None) -> AllocationSlot:
    """Return the slot of a participant at an index of the list, or of a stratum's list.

    In a study with strata, None stands for the first stratum.

    Raises:
        AllocationError: if the list is too short or there is no such stratum.
    """
    count = protocol.study.participants
    if not 0 <= index < count:
        raise AllocationError(
            f"the study has {count} slots and none for participant {index + 1}; raise $.study.participants in the "
            "protocol"
        )
    strata = build_strata(protocol)
    if strata is None:
        if stratum is not None:
            raise AllocationError(f"study {protocol.study.name!r} has no strata; remove the stratum {stratum!r}")
        return build_allocation_list(protocol)[index]
    if stratum is not None and stratum not in strata.names:
        raise AllocationError(f"{stratum!r} is not a stratum; use one of {', '.join(strata.names)}")
    place = 0 if stratum is None else strata.names.index(stratum)
    return build_allocation_list(protocol)[index * len(strata.names) + place]


def _groups(protocol: Protocol, count: int, suffix: str) -> list[int]:
    """Draw a group number for each slot, in permuted blocks of varying size."""
    seed = protocol.study.seed
    shares = [group for group, spec in enumerate(protocol.groups) for _ in range(spec.allocation_ratio)]
    result: list[int] = []
    block = 0
    while len(result) < count:
        repeats = 1 + int(draw_words(1, seed=seed, purpose=f"group-block-size{suffix}", index=block)[0] % 3)
        members = [group for group in shares for _ in range(repeats)]
        order = draw_permutation(len(members), seed=seed, purpose=f"group-block{suffix}", index=block)
        result += [members[place] for place in order]
        block += 1
    return result[:count]


def _positions(protocol: Protocol, draw: str, groups: list[int]) -> list[tuple[int, ...]]:
    """Draw, for each slot, the key position of each action.

    Rows have as many columns as the block with the most actions needs.
    """
    pool = len(protocol.keys.pool)
    seed = protocol.study.seed
    actions = max((len(block.actions) for block in protocol.blocks), default=0)
    used = [[[0] * pool for _ in range(actions)] for _ in protocol.groups]
    result: list[tuple[int, ...]] = []
    for block, first in enumerate(range(0, len(groups), pool)):
        rows = _build_key_square(pool, actions, seed=seed, purpose=f"key-map-{draw}", index=block)
        for group in groups[first : first + pool]:
            counts = used[group]
            row = min(rows, key=partial(_count_uses, counts))
            rows.remove(row)
            for action, key in enumerate(row):
                counts[action][key] += 1
            result.append(row)
    return result


def _count_uses(counts: list[list[int]], row: tuple[int, ...]) -> int:
    return sum(counts[action][key] for action, key in enumerate(row))


def _build_key_square(pool: int, actions: int, *, seed: int, purpose: str, index: int) -> list[tuple[int, ...]]:
    """Build ``pool`` rows of ``actions`` different keys each, in which every column contains every key exactly once."""
    keys = draw_permutation(pool, seed=seed, purpose=f"{purpose}-keys", index=index)
    shifts = draw_permutation(pool, seed=seed, purpose=f"{purpose}-shifts", index=index)[:actions]
    order = draw_permutation(pool, seed=seed, purpose=f"{purpose}-order", index=index)
    return [tuple(keys[(row + shift) % pool] for shift in shifts) for row in order]
