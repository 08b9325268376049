"""The allocation list: who gets which group and which keys, settled from the study seed before anyone comes.

Groups come in permuted blocks whose size varies (one to three times the number of groups), so that the next group
cannot be guessed and the groups never drift apart. Key positions are balanced: among the participants of each
full block of as many as there are keys in the pool, every action lies on every key exactly once; within a block
the rows go to the participants whose group has had those positions least. Latin squares of parts are filled within
each group, one after the other. Where groups are drawn after an answer, each stratum has such a list of its own.
"""

import hashlib
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial

import msgspec

from minihuman.errors import AllocationError
from minihuman.study.chance import permutation, words
from minihuman.study.design import Order
from minihuman.study.protocol import Protocol
from minihuman.study.strata import strata_of


@dataclass(frozen=True, slots=True)
class Slot:
    """One place in the study."""

    index: int  # 0 for the first participant; with strata, those of each stratum's first place come first
    group: str
    positions: tuple[tuple[int, ...], ...]  # one row a draw: for each action, the index of its key in the pool
    kept: tuple[int, ...] = ()  # the row of the keys that a participant keeps; () where no block asks for it
    orders: tuple[tuple[int, ...], ...] = ()  # for each of the protocol's orders, the places of its parts
    stratum: str = ""  # whose answer it is for


def allocation(protocol: Protocol) -> tuple[Slot, ...]:
    """The whole list, ``study.participants`` slots long, each stratum's; a longer list begins with a shorter one."""
    asked = (
        *(protocol.study, protocol.keys, protocol.groups, protocol.blocks, protocol.orders, protocol.sessions),
        *(protocol.allocation, protocol.questions),
    )
    key = msgspec.json.encode(asked)
    if key not in _MADE:
        if len(_MADE) >= _KEPT:
            _MADE.clear()
            _DIGESTS.clear()
        _MADE[key] = _made(protocol)
    return _MADE[key]


_MADE: dict[bytes, tuple[Slot, ...]] = {}  # a list of thousands takes a second, and is asked for again and again
_DIGESTS: dict[int, tuple[tuple[Slot, ...], str]] = {}  # by the identity of a list, which it keeps alive
_KEPT = 8


def _made(protocol: Protocol) -> tuple[Slot, ...]:
    strata = strata_of(protocol)
    if strata is None:
        return _list(protocol, "")
    lists = [_list(protocol, f"-stratum-{name}") for name in strata.names]
    slots = [
        replace(slot, stratum=name)
        for its in zip(*lists, strict=True)
        for name, slot in zip(strata.names, its, strict=True)
    ]
    return tuple(replace(slot, index=index) for index, slot in enumerate(slots))


def _list(protocol: Protocol, of: str) -> tuple[Slot, ...]:
    """A list for all, or for one stratum; ``of`` sets its draws apart from the others'."""
    count = protocol.study.participants
    groups = _groups(protocol, count, of)
    draws = [_positions(protocol, f"{draw}{of}", groups) for draw in range(_draws(protocol))]
    kept = _positions(protocol, f"kept{of}", groups) if _keeps(protocol) else [()] * count
    orders = _orders(protocol, groups, of)
    return tuple(
        Slot(index, protocol.groups[groups[index]].name, tuple(rows[index] for rows in draws), kept[index], order)
        for index, order in enumerate(orders)
    )


def allocation_sha256(slots: tuple[Slot, ...]) -> str:
    """SHA-256 of the list in its canonical JSON form, hexadecimal: what every log holds.

    What a protocol does not ask for is left out, so that lists made before it could be asked for keep their hash.
    """
    if id(slots) not in _DIGESTS:
        if len(_DIGESTS) >= _KEPT:
            _DIGESTS.clear()
        _DIGESTS[id(slots)] = (slots, _digest(slots))
    return _DIGESTS[id(slots)][1]


def _digest(slots: tuple[Slot, ...]) -> str:
    asked = [name for name in ("kept", "orders", "stratum") if any(getattr(slot, name) for slot in slots)]
    fields = ["index", "group", "positions", *asked]
    rows = [{name: getattr(slot, name) for name in fields} for slot in slots]
    return hashlib.sha256(msgspec.json.encode(rows)).hexdigest()


def _draws(protocol: Protocol) -> int:
    """A draw for each place of a group's blocks, or for each block where parts are listed otherwise."""
    if protocol.designed:
        return len(protocol.blocks)
    return max((len(group.blocks) for group in protocol.groups), default=0)


def _keeps(protocol: Protocol) -> bool:
    return any(
        protocol.block_for(block.name, group.name).key_map == "kept"
        for block in protocol.blocks
        for group in protocol.groups
    )


def _orders(protocol: Protocol, groups: list[int], of: str) -> list[tuple[tuple[int, ...], ...]]:
    """For each slot, the order of each of the protocol's orders; Latin squares are filled within each group."""
    seen: Counter[int] = Counter()
    result = []
    for index, group in enumerate(groups):
        result.append(tuple(_order(protocol, order, group, seen[group], index, of) for order in protocol.orders))
        seen[group] += 1
    return result


def _order(protocol: Protocol, order: Order, group: int, place: int, index: int, of: str) -> tuple[int, ...]:
    count, seed = len(order.parts), protocol.study.seed
    match order.order:
        case "fixed":
            return tuple(range(count))
        case "shuffled":
            return permutation(count, seed=seed, purpose=f"order-{order.name}{of}", index=index)
    square = latin_square(count)
    rows = permutation(len(square), seed=seed, purpose=f"order-{order.name}-{group}{of}", index=place // len(square))
    return square[rows[place % len(square)]]


def latin_square(count: int) -> tuple[tuple[int, ...], ...]:
    """Orders of ``count`` things: each at each place equally often, and each right after each other one equally often.

    As many rows as things where that number is even, twice as many where it is odd (Williams 1949).
    """
    first = [0]
    for step in range(1, count):
        first.append((first[-1] + (step if step % 2 else -step)) % count)
    rows = [tuple((place + row) % count for place in first) for row in range(count)]
    return tuple(rows + [row[::-1] for row in rows]) if count % 2 else tuple(rows)


def slot_of(protocol: Protocol, index: int, stratum: str | None = None) -> Slot:
    """The slot of a participant: that place of the list, or of a stratum's; without a stratum the first one's.

    Raises:
        AllocationError: if the list is not that long, or there is no such stratum.
    """
    count = protocol.study.participants
    if not 0 <= index < count:
        raise AllocationError(
            f"participant {index + 1} is outside the list of {count}; raise $.study.participants in the protocol"
        )
    strata = strata_of(protocol)
    if strata is None:
        if stratum is not None:
            raise AllocationError(f"study {protocol.study.name!r} has no strata; leave {stratum!r} out")
        return allocation(protocol)[index]
    if stratum is not None and stratum not in strata.names:
        raise AllocationError(f"{stratum!r} is no stratum; there are {', '.join(strata.names)}")
    place = 0 if stratum is None else strata.names.index(stratum)
    return allocation(protocol)[index * len(strata.names) + place]


def _groups(protocol: Protocol, count: int, of: str) -> list[int]:
    """A group number for each slot, in permuted blocks of varying size."""
    seed = protocol.study.seed
    shares = [group for group, its in enumerate(protocol.groups) for _ in range(its.ratio)]
    result: list[int] = []
    block = 0
    while len(result) < count:
        repeats = 1 + int(words(1, seed=seed, purpose=f"group-block-size{of}", index=block)[0] % 3)
        members = [group for group in shares for _ in range(repeats)]
        order = permutation(len(members), seed=seed, purpose=f"group-block{of}", index=block)
        result += [members[place] for place in order]
        block += 1
    return result[:count]


def _positions(protocol: Protocol, draw: str, groups: list[int]) -> list[tuple[int, ...]]:
    """For each slot and one draw, where in the pool each action lies; columns for the most actions of any block."""
    pool, seed = len(protocol.keys.pool), protocol.study.seed
    actions = max((len(block.actions) for block in protocol.blocks), default=0)
    used = [[[0] * pool for _ in range(actions)] for _ in protocol.groups]
    result: list[tuple[int, ...]] = []
    for block, first in enumerate(range(0, len(groups), pool)):
        rows = _square(pool, actions, seed=seed, purpose=f"key-map-{draw}", index=block)
        for group in groups[first : first + pool]:
            counts = used[group]
            row = min(rows, key=partial(_times_used, counts))
            rows.remove(row)
            for action, key in enumerate(row):
                counts[action][key] += 1
            result.append(row)
    return result


def _times_used(counts: list[list[int]], row: tuple[int, ...]) -> int:
    return sum(counts[action][key] for action, key in enumerate(row))


def _square(pool: int, actions: int, *, seed: int, purpose: str, index: int) -> list[tuple[int, ...]]:
    """``pool`` rows of ``actions`` different keys each; every column holds every key exactly once."""
    keys = permutation(pool, seed=seed, purpose=f"{purpose}-keys", index=index)
    shifts = permutation(pool, seed=seed, purpose=f"{purpose}-shifts", index=index)[:actions]
    order = permutation(pool, seed=seed, purpose=f"{purpose}-order", index=index)
    return [tuple(keys[(row + shift) % pool] for shift in shifts) for row in order]
