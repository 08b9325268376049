"""The allocation list: who gets which group and which keys, settled from the study seed before anyone comes.

Groups come in permuted blocks whose size varies (one to three times the number of groups), so that the next group
cannot be guessed and the groups never drift apart. Key positions are balanced: among the participants of each
full block of as many as there are keys in the pool, every action lies on every key exactly once; within a block
the rows go to the participants whose group has had those positions least.
"""

import hashlib
from dataclasses import dataclass
from functools import partial

import msgspec

from minihuman.errors import AllocationError
from minihuman.study.chance import permutation, words
from minihuman.study.protocol import Protocol


@dataclass(frozen=True, slots=True)
class Slot:
    """One place in the study."""

    index: int  # 0 for the first participant
    group: str
    positions: tuple[tuple[int, ...], ...]  # one row a draw: for each action, the index of its key in the pool


def allocation(protocol: Protocol) -> tuple[Slot, ...]:
    """The whole list, ``study.participants`` slots long; a longer list begins with a shorter one."""
    count = protocol.study.participants
    groups = _groups(protocol, count)
    draws = [_positions(protocol, draw, groups) for draw in range(max(len(group.blocks) for group in protocol.groups))]
    return tuple(
        Slot(index, protocol.groups[groups[index]].name, tuple(rows[index] for rows in draws)) for index in range(count)
    )


def allocation_sha256(slots: tuple[Slot, ...]) -> str:
    """SHA-256 of the list in its canonical JSON form, hexadecimal: what every log holds."""
    return hashlib.sha256(msgspec.json.encode(slots)).hexdigest()


def slot_of(protocol: Protocol, index: int) -> Slot:
    """The slot of a participant.

    Raises:
        AllocationError: if the list is not that long.
    """
    count = protocol.study.participants
    if not 0 <= index < count:
        raise AllocationError(
            f"participant {index + 1} is outside the list of {count}; raise $.study.participants in the protocol"
        )
    return allocation(protocol)[index]


def _groups(protocol: Protocol, count: int) -> list[int]:
    """A group number for each slot, in permuted blocks of varying size."""
    kinds, seed = len(protocol.groups), protocol.study.seed
    result: list[int] = []
    block = 0
    while len(result) < count:
        repeats = 1 + int(words(1, seed=seed, purpose="group-block-size", index=block)[0] % 3)
        members = [group for group in range(kinds) for _ in range(repeats)]
        order = permutation(len(members), seed=seed, purpose="group-block", index=block)
        result += [members[place] for place in order]
        block += 1
    return result[:count]


def _positions(protocol: Protocol, draw: int, groups: list[int]) -> list[tuple[int, ...]]:
    """For each slot and one draw, where in the pool each action lies; columns for the most actions of any block."""
    pool, seed = len(protocol.keys.pool), protocol.study.seed
    actions = max(len(block.actions) for block in protocol.blocks)
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
