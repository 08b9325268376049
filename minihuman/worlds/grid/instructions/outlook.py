"""Outlook: from every pose, about how many actions a clause takes, with keys and locked doors thought of.

A simplified world: nothing lies in the way (or costs something to pass), what is dropped is gone, a key lies where
it lay. Its states are poses, which locked doors are unlocked, and what sort of thing is in hand; the table is the
exact distance in it to doing the clause, found backwards from there.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import CLOSED, DOOR, KEY, LAVA, LOCKED, WALL, colour_of, kind_of, state_of
from minihuman.worlds.grid.core.directions import ahead
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import CARRYING, HEADER, HEIGHT, NOWHERE, OBJECTS, WIDTH, Row, where_is
from minihuman.worlds.grid.instructions.block import (
    CLAUSE,
    CLAUSES,
    GO_TO,
    OPEN,
    PICK_UP,
    VERB,
    block_of,
    means_of,
)
from minihuman.worlds.kernels import kernel, part

MOST_LOCKS = 4  # more locked doors are taken for closed ones
NOTHING, OTHER, MOVED, KEYS = 0, 1, 2, 3  # sorts of things in hand: none, any, one to be put somewhere, keys by colour

Table = NDArray[np.int32]  # by (unlocked, hand, cell, direction)
Locks = NDArray[np.int64]  # (locks, 2): identity of the door, its colour
Sorts = NDArray[np.int64]  # by identity - 1: what sort of thing an object is in hand


@kernel()
def find_locks(row: Row) -> Locks:
    """The locked doors for which there is a key."""
    keys = key_colours(row)
    locks = np.zeros((MOST_LOCKS, 2), np.int64)
    count = 0
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell == NOWHERE or count == MOST_LOCKS:
            continue
        code = row[HEADER + cell]
        if kind_of(code) == DOOR and state_of(code) == LOCKED and keys >> colour_of(code) & 1:
            locks[count, 0], locks[count, 1] = identity, colour_of(code)
            count += 1
    return locks[:count].copy()


@part()
def key_colours(row: Row) -> int:
    """The colours of all keys, lying, held or in boxes, as bits."""
    colours = 0
    cells = row[WIDTH] * row[HEIGHT]
    for identity in range(1, row[OBJECTS] + 1):
        cell = where_is(row, identity)
        if cell != NOWHERE:
            if kind_of(row[HEADER + cell]) == KEY:
                colours |= 1 << colour_of(row[HEADER + cell])
            inside = row[HEADER + 2 * cells + identity - 1]
            if inside != 0 and kind_of(inside) == KEY:
                colours |= 1 << colour_of(inside)
    if kind_of(row[CARRYING]) == KEY:
        colours |= 1 << colour_of(row[CARRYING])
    return colours


@kernel()
def sort_things(row: Row, clause: int, codes: NDArray[np.int64], locks: Locks) -> Sorts:
    """What sort of thing each object is in hand, for a clause."""
    sorts = np.full(len(codes), OTHER, np.int64)
    verb = row[block_of(row) + CLAUSES + clause * CLAUSE + VERB]
    for k in range(len(codes)):
        code = int(codes[k])
        if verb > PICK_UP and row[means_of(row) + k] >> 2 * clause & 1:
            sorts[k] = MOVED
        elif kind_of(code) == KEY:
            for lock in range(len(locks)):
                if locks[lock, 1] == colour_of(code):
                    sorts[k] = KEYS + lock
                    break
    return sorts


@part()
def opens(row: Row, hand: int, lock: int, locks: Locks, sorts: Sorts, codes: NDArray[np.int64]) -> bool:
    """Whether a sort of thing opens a lock."""
    if hand >= KEYS:
        return locks[hand - KEYS, 1] == locks[lock, 1]
    if hand == MOVED:
        for k in range(len(codes)):
            if sorts[k] == MOVED and kind_of(int(codes[k])) == KEY and colour_of(int(codes[k])) == locks[lock, 1]:
                return True
    return False


@kernel()
def outlook(row: Row, clause: int, codes: NDArray[np.int64], locks: Locks, sorts: Sorts, careful: bool) -> Table:
    """The table of a clause; FAR where it cannot be done even in the simplified world.

    ``careful`` charges for doors and things in the way what they take about; else the table never overestimates.
    """
    width, height = np.int64(row[WIDTH]), np.int64(row[HEIGHT])
    cells = width * height
    hands, sets = KEYS + len(locks), 1 << len(locks)
    steps = np.full((sets, hands, cells * 4), FAR, np.int32)
    span = 16
    queue = np.empty((span, steps.size), np.int32)
    waiting = np.zeros(span, np.int64)
    lock_at = np.full(cells, -1, np.int64)
    for lock in range(len(locks)):
        lock_at[where_is(row, locks[lock, 0])] = lock
    cost = np.ones(cells, np.int64)
    for cell in range(cells):
        code = row[HEADER + cell]
        kind = kind_of(code)
        if kind == WALL or kind == LAVA:
            cost[cell] = 0
        elif kind == DOOR and state_of(code) == LOCKED and lock_at[cell] < 0 and len(locks) < MOST_LOCKS:
            cost[cell] = 0  # no key opens it
        elif careful and kind == DOOR:
            cost[cell] = 2 if state_of(code) == CLOSED else 1
        elif careful and code >> 9 > 0:
            cost[cell] = 5
    goal(row, clause, codes, locks, sorts, cost, lock_at, steps)
    flat = steps.reshape(-1)
    at_most = 0
    for state in range(len(flat)):
        if flat[state] < FAR:
            queue[flat[state] % span, waiting[flat[state] % span]] = state
            waiting[flat[state] % span] += 1
            at_most = max(at_most, flat[state])
    distance = 0
    last = at_most
    while distance <= last:
        place = distance % span
        while waiting[place] > 0:
            waiting[place] -= 1
            state = queue[place, waiting[place]]
            if flat[state] != distance:
                continue
            pose = state % (cells * 4)
            hand = state // (cells * 4) % hands
            unlocked = state // (cells * 4 * hands)
            direction = pose & 3
            cell = pose >> 2
            x, y = cell // height, cell % height
            here = state - pose
            for move in range(5 + hands + len(locks)):
                before, added = -1, 1
                if move < 2:
                    before = here + cell * 4 + ((direction + 1 + 2 * move) & 3)
                elif move == 2:
                    enters = cost[cell] > 0 and (lock_at[cell] < 0 or unlocked >> lock_at[cell] & 1)
                    from_x, from_y = ahead(x, y, direction ^ 2)
                    if enters and from_x >= 0 and from_y >= 0 and from_x < width and from_y < height:
                        behind = from_x * height + from_y
                        if cost[behind] > 0:
                            before, added = here + behind * 4 + direction, cost[cell]
                elif move == 3:
                    if hand >= MOVED:
                        extra = lies_ahead(row, x, y, direction, hand, codes, locks, sorts)
                        if extra > 0:
                            before, added = state - hand * cells * 4, extra
                elif move == 4:
                    continue
                elif move < 5 + hands:
                    if hand == NOTHING and move > 5:
                        before = state + (move - 5) * cells * 4
                else:
                    lock = move - 5 - hands
                    i, j = ahead(x, y, direction)
                    next_cell = i * height + j
                    faced = next_cell >= 0 and next_cell < cells and lock_at[next_cell] == lock
                    if faced and unlocked >> lock & 1 and opens(row, hand, lock, locks, sorts, codes):
                        before = state - (1 << lock) * hands * cells * 4
                if before >= 0 and distance + added < flat[before]:
                    flat[before] = distance + added
                    slot = (distance + added) % span
                    if waiting[slot] < queue.shape[1]:
                        queue[slot, waiting[slot]] = before
                        waiting[slot] += 1
                    last = max(last, distance + added)
        distance += 1
    return steps


@part()
def lies_ahead(
    row: Row, x: int, y: int, direction: int, hand: int, codes: NDArray[np.int64], locks: Locks, sorts: Sorts
) -> int:
    """Actions to take up something of a sort from what is ahead: 1, 2 if it is in a box, 0 if there is none."""
    i, j = ahead(x, y, direction)
    if i < 0 or j < 0 or i >= row[WIDTH] or j >= row[HEIGHT]:
        return 0
    identity = row[HEADER + i * row[HEIGHT] + j] >> 9
    if identity == 0:
        return 0
    if sorts[identity - 1] == hand and kind_of(int(codes[identity - 1])) != DOOR:
        return 1
    inside = row[HEADER + 2 * row[WIDTH] * row[HEIGHT] + identity - 1]
    return 2 if inside != 0 and sorts[(inside >> 9) - 1] == hand else 0


@part()
def goal(
    row: Row,
    clause: int,
    codes: NDArray[np.int64],
    locks: Locks,
    sorts: Sorts,
    cost: NDArray[np.int64],
    lock_at: NDArray[np.int64],
    steps: Table,
) -> None:
    """Write into the table what the last action takes from where the clause can be done."""
    width, height = row[WIDTH], row[HEIGHT]
    verb = row[block_of(row) + CLAUSES + clause * CLAUSE + VERB]
    for x in range(width):
        for y in range(height):
            for direction in range(4):
                i, j = ahead(x, y, direction)
                if cost[x * height + y] == 0 or i < 0 or j < 0 or i >= width or j >= height:
                    continue
                pose = (x * height + y) * 4 + direction
                code = row[HEADER + i * height + j]
                identity = code >> 9
                meant = identity > 0 and row[means_of(row) + identity - 1] >> 2 * clause & 1 != 0
                for unlocked in range(steps.shape[0]):
                    for hand in range(steps.shape[1]):
                        if verb == GO_TO:
                            if meant:
                                steps[unlocked, hand, pose] = 0
                        elif verb == OPEN:
                            if meant and kind_of(code) == DOOR:
                                lock = lock_at[i * height + j]
                                if lock >= 0 and unlocked >> lock & 1 == 0:
                                    if opens(row, hand, lock, locks, sorts, codes):
                                        steps[unlocked, hand, pose] = 1
                                elif state_of(code) != LOCKED or lock >= 0:
                                    steps[unlocked, hand, pose] = 1
                        elif verb == PICK_UP:
                            if meant and hand == NOTHING:
                                steps[unlocked, hand, pose] = 1
                        else:
                            free = hand == MOVED and cost[i * height + j] > 0 and kind_of(code) != DOOR
                            if free and is_next_to(row, i, j, 2 << 2 * clause):
                                steps[unlocked, hand, pose] = cost[i * height + j]


@part()
def is_next_to(row: Row, x: int, y: int, meant: int) -> bool:
    """Whether something meant lies beside a cell now."""
    for k in range(4):
        i, j = ahead(x, y, k)
        if i >= 0 and j >= 0 and i < row[WIDTH] and j < row[HEIGHT]:
            identity = row[HEADER + i * row[HEIGHT] + j] >> 9
            if identity > 0 and row[means_of(row) + identity - 1] & meant:
                return True
    return False
