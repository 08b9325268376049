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
from itertools import chain

import msgspec

from minihuman.errors import AllocationError
from minihuman.experiment.plan.random_streams import draw_permutation, draw_words
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.specs import OrderSpec
from minihuman.experiment.protocol.strata import build_strata


@dataclass(frozen=True, slots=True)
class AllocationSlot:
    """One participant's slot in the allocation list."""

    index: int  # from 0; with strata, the first slots of all strata come first, then the second ones, and so on
    group: str
    positions: tuple[tuple[int, ...], ...]  # one row per draw: for each action, the index of its key in the pool
    kept: tuple[int, ...] = ()  # the row of a key map that is constant in the whole study; () if no block has one
    orders: tuple[tuple[int, ...], ...] = ()  # for each of the protocol's orders, the order of its parts' indices
    stratum: str = ""  # the slot's stratum; "" without strata


def build_allocation_list(protocol: Protocol) -> tuple[AllocationSlot, ...]:
    """Build the list of ``study.participants`` slots; with strata, that many for each stratum.

    If only the number of participants grows, the new list begins with the old one.
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
        _LISTS[key] = _build_list(protocol)
    return _LISTS[key]


# lists by the encoded tables that determine them: a list of thousands of slots takes a second, and is often requested
_LISTS: dict[bytes, tuple[AllocationSlot, ...]] = {}
# a list and its hash, by the identity of the list, which this keeps alive
_DIGESTS: dict[int, tuple[tuple[AllocationSlot, ...], str]] = {}
_MAX_CACHED_LISTS = 8
_MAX_BLOCK_REPEATS = 3  # the largest size of a permuted block, as a multiple of the smallest


def _build_list(protocol: Protocol) -> tuple[AllocationSlot, ...]:
    """Build a study's allocation list; the lists of its strata, if any, are interleaved."""
    strata = build_strata(protocol)
    if strata is None:
        return _build_stratum_list(protocol, "")
    lists = []
    for name in strata.names:
        slots = _build_stratum_list(protocol, f"-stratum-{name}")
        lists.append([replace(slot, stratum=name) for slot in slots])
    interleaved = chain.from_iterable(zip(*lists, strict=True))
    return tuple(replace(slot, index=index) for index, slot in enumerate(interleaved))


def _build_stratum_list(protocol: Protocol, suffix: str) -> tuple[AllocationSlot, ...]:
    """Build the list of a study without strata, or of one stratum; ``suffix`` names the stratum's random streams."""
    n_slots = protocol.study.participants
    groups = _draw_groups(protocol, n_slots, suffix)
    draws = [_draw_positions(protocol, f"{draw}{suffix}", groups) for draw in range(_count_draws(protocol))]
    constant_rows: list[tuple[int, ...]] = [()] * n_slots
    if _has_constant_key_map(protocol):
        constant_rows = _draw_positions(protocol, f"kept{suffix}", groups)
    orders = _draw_orders(protocol, groups, suffix)
    slots = []
    for index in range(n_slots):
        group = protocol.groups[groups[index]].name
        positions = tuple(rows[index] for rows in draws)
        slots.append(AllocationSlot(index, group, positions, constant_rows[index], orders[index]))
    return tuple(slots)


def _has_constant_key_map(protocol: Protocol) -> bool:
    """Return whether any group plays a block whose key map is the same in the whole study."""
    return any(
        protocol.block_for(block.name, group.name).key_map == "constant"
        for block in protocol.blocks
        for group in protocol.groups
    )


def allocation_sha256(slots: tuple[AllocationSlot, ...]) -> str:
    """Return the SHA-256 of an allocation list's canonical JSON form in hexadecimal, which every log contains.

    Fields that a protocol does not use are left out, so that lists from before these fields existed keep their hash.
    """
    if id(slots) not in _DIGESTS:
        if len(_DIGESTS) >= _MAX_CACHED_LISTS:
            _DIGESTS.clear()
        _DIGESTS[id(slots)] = (slots, _digest_slots(slots))
    return _DIGESTS[id(slots)][1]


def _digest_slots(slots: tuple[AllocationSlot, ...]) -> str:
    """Return the SHA-256 of an allocation list; fields that no slot uses are left out, as in earlier versions."""
    fields = ["index", "group", "positions"]
    for name in ("kept", "orders", "stratum"):
        if any(getattr(slot, name) for slot in slots):
            fields.append(name)
    rows = [{name: getattr(slot, name) for name in fields} for slot in slots]
    return hashlib.sha256(msgspec.json.encode(rows)).hexdigest()


def _count_draws(protocol: Protocol) -> int:
    """Return the number of draws of key maps.

    There is one for each position in the groups' lists of blocks or, if the protocol lists parts, one for each block.
    """
    if protocol.lists_parts:
        return len(protocol.blocks)
    return max((len(group.blocks) for group in protocol.groups), default=0)


def _draw_orders(protocol: Protocol, groups: list[int], suffix: str) -> list[tuple[tuple[int, ...], ...]]:
    """Return each slot's orders of parts, one for each order of the protocol; each group fills its own Latin squares.

    ``groups`` has the index of each slot's group, and ``suffix`` names the random streams of a stratum.
    """
    group_sizes: Counter[int] = Counter()
    rows = []
    for index, group in enumerate(groups):
        group_place = group_sizes[group]
        rows.append(tuple(_draw_order(protocol, order, group, group_place, index, suffix) for order in protocol.orders))
        group_sizes[group] += 1
    return rows


def _draw_order(
    protocol: Protocol, order: OrderSpec, group: int, group_place: int, index: int, suffix: str
) -> tuple[int, ...]:
    """Return the sequence in which a slot's participant does the parts of an order, as indices into ``order.parts``.

    Args:
        protocol: the study's protocol.
        order: the order, whose parts may be fixed, shuffled or in a Latin square.
        group: the index of the slot's group.
        group_place: the index of the slot among those of its group.
        index: the index of the slot in the list.
        suffix: names the random streams of a stratum.
    """
    count = len(order.parts)
    seed = protocol.study.seed
    match order.order:
        case "fixed":
            return tuple(range(count))
        case "shuffled":
            return draw_permutation(count, seed=seed, purpose=f"order-{order.name}{suffix}", index=index)
    square = build_latin_square(count)
    n_full_squares, row = divmod(group_place, len(square))
    shuffled_rows = draw_permutation(
        len(square), seed=seed, purpose=f"order-{order.name}-{group}{suffix}", index=n_full_squares
    )
    return square[shuffled_rows[row]]


def build_latin_square(count: int) -> tuple[tuple[int, ...], ...]:
    """Return orders of the elements 0 to count - 1, balanced for position and for immediate succession.

    There are as many rows as elements if that number is even, and twice as many if it is odd (Williams 1949).
    """
    first_row = [0]
    for step in range(1, count):
        shift = step if step % 2 else -step  # alternately forward and back
        first_row.append((first_row[-1] + shift) % count)
    rows = []
    for offset in range(count):
        rows.append(tuple((element + offset) % count for element in first_row))
    if count % 2:
        rows += [row[::-1] for row in rows]
    return tuple(rows)


def find_slot(protocol: Protocol, index: int, stratum: str | None = None) -> AllocationSlot:
    """Return the slot at an index of the allocation list, or of the list of ``stratum`` in a study with strata.

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
    slots = build_allocation_list(protocol)
    strata = build_strata(protocol)
    if strata is None:
        if stratum is not None:
            raise AllocationError(f"study {protocol.study.name!r} has no strata; remove the stratum {stratum!r}")
        return slots[index]
    if stratum is None:
        stratum = strata.names[0]
    elif stratum not in strata.names:
        raise AllocationError(f"{stratum!r} is not a stratum; use one of {', '.join(strata.names)}")
    stratum_slots = slots[strata.names.index(stratum) :: len(strata.names)]  # the strata's lists are interleaved
    return stratum_slots[index]


def _draw_groups(protocol: Protocol, count: int, suffix: str) -> list[int]:
    """Return the index of the group of each of ``count`` slots, drawn in permuted blocks of varying size.

    A permuted block has each group one to three times, multiplied by the group's allocation ratio. ``suffix`` names the
    random streams of a stratum.
    """
    seed = protocol.study.seed
    groups: list[int] = []
    n_blocks = 0
    while len(groups) < count:
        (size_word,) = draw_words(1, seed=seed, purpose=f"group-block-size{suffix}", index=n_blocks)
        repeats = 1 + int(size_word % _MAX_BLOCK_REPEATS)
        block: list[int] = []
        for group, spec in enumerate(protocol.groups):
            block += [group] * (spec.allocation_ratio * repeats)
        order = draw_permutation(len(block), seed=seed, purpose=f"group-block{suffix}", index=n_blocks)
        groups += [block[position] for position in order]
        n_blocks += 1
    return groups[:count]


def _draw_positions(protocol: Protocol, draw: str, groups: list[int]) -> list[tuple[int, ...]]:
    """Return a row for each slot, drawn at random, with the index in the key pool of each action's key.

    A row has as many actions as the block with the most actions. In each run of as many slots as the pool has keys,
    each row of a square is used once, by the slot whose group has used its keys least.

    Args:
        protocol: the study's protocol.
        draw: names the random streams of the draw.
        groups: the index of each slot's group.
    """
    n_keys = len(protocol.keys.pool)
    n_actions = max((len(block.actions) for block in protocol.blocks), default=0)
    uses_by_group = [_zero_uses(n_actions, n_keys) for _ in protocol.groups]
    positions: list[tuple[int, ...]] = []
    for square, first_slot in enumerate(range(0, len(groups), n_keys)):
        rows = _build_key_square(n_keys, n_actions, seed=protocol.study.seed, purpose=f"key-map-{draw}", index=square)
        for group in groups[first_slot : first_slot + n_keys]:
            uses = uses_by_group[group]
            row = min(rows, key=partial(_count_uses, uses))
            rows.remove(row)
            for action, key in enumerate(row):
                uses[action][key] += 1
            positions.append(row)
    return positions


def _zero_uses(n_actions: int, n_keys: int) -> list[list[int]]:
    """Return a table of zeros, with a row for each action and a column for each key."""
    return [[0] * n_keys for _ in range(n_actions)]


def _count_uses(uses: list[list[int]], row: tuple[int, ...]) -> int:
    """Return how often a group has used a row's keys for their actions; ``uses[action][key]`` counts each use."""
    return sum(uses[action][key] for action, key in enumerate(row))


def _build_key_square(n_keys: int, n_actions: int, *, seed: int, purpose: str, index: int) -> list[tuple[int, ...]]:
    """Return ``n_keys`` rows, each for one slot, with the index of a different key for each of ``n_actions`` actions.

    Each column, which is for an action, contains each key exactly once. The random numbers depend on ``seed``,
    ``purpose`` and ``index``, the number of the square.
    """
    keys = draw_permutation(n_keys, seed=seed, purpose=f"{purpose}-keys", index=index)
    shifts = draw_permutation(n_keys, seed=seed, purpose=f"{purpose}-shifts", index=index)
    column_shifts = shifts[:n_actions]
    rows = []
    for row in draw_permutation(n_keys, seed=seed, purpose=f"{purpose}-order", index=index):
        rows.append(tuple(keys[(row + shift) % n_keys] for shift in column_shifts))
    return rows
