"""Clearing the way: where a search takes too many states, what lies in the way is put aside first, one by one.

The way is what the outlook says it would be if nothing barred it; each thing found on it is carried to a place off
the way.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import DOOR, EMPTY, LAVA, WALL
from minihuman.worlds.grid.core.directions import STEPS
from minihuman.worlds.grid.core.rules import TERMINATED
from minihuman.worlds.grid.core.search import FAR, FOUND, distances
from minihuman.worlds.grid.core.state import CARRYING, Row, State
from minihuman.worlds.grid.core.tasks import DROP
from minihuman.worlds.grid.instructions.block import CLAUSE, CLAUSES, PICK_UP, STRICT, VERB
from minihuman.worlds.grid.instructions.numbers import block, means
from minihuman.worlds.grid.instructions.outlook import NOTHING, find_locks, outlook, sort_things
from minihuman.worlds.grid.instructions.rules import try_out
from minihuman.worlds.grid.instructions.search import codes_of, search_clause
from minihuman.worlds.grid.planner import descend

MOST_CLEARED = 24
LIMIT = 1 << 13  # states of each search on the way
SPARED = 1 << 30  # a meaning that keeps a box from being opened


def clear_way(row: Row, clause: int) -> list[int] | None:
    """Put aside what lies in the way of a clause: the actions, done in the row. None if something cannot be."""
    if block(row)[CLAUSES + clause * CLAUSE + STRICT]:
        return None
    actions: list[int] = []
    for _ in range(MOST_CLEARED):
        way = _way(row, clause)
        if way is None:
            return None
        cells = State(row).cells.ravel()
        wanted = means(row) >> 2 * clause & 1
        lying = [
            cell
            for cell in way
            if cells[cell] >> 9 > 0
            and cells[cell] & 15 != DOOR
            and not (cell == way[-1] and wanted[(cells[cell] >> 9) - 1])
        ]
        if not lying:
            return actions
        thing = int(cells[lying[0]] >> 9)
        for each in (
            partial(put_down, way=way),
            partial(do_to, verb=PICK_UP, identity=thing),
            partial(put_down, way=way),
        ):
            part = each(row)
            if part is None or not _do(row, part):
                return None
            actions += part
    return None


def _do(row: Row, actions: list[int]) -> bool:
    for action in actions:
        status, _ = try_out(row, action)
        if status & TERMINATED:
            return False
    return True


def _way(row: Row, clause: int) -> list[int] | None:
    """The cells that the outlook's way goes through, what lies in it or not, and where something is put down."""
    codes, locks = codes_of(row), find_locks(row)
    sorts = sort_things(row, clause, codes, locks)
    table = outlook(row, clause, codes, locks, sorts, True)
    state = State(row)
    inside = state.contents.tolist()
    lock_at = {state.find(int(identity)): lock for lock, (identity, _) in enumerate(locks)}
    held = int(row[CARRYING]) >> 9
    unlocked, hand = 0, int(sorts[held - 1]) if held else NOTHING
    x, y = state.position
    direction = state.direction
    cells: list[int] = []
    while table[unlocked, hand, (x * state.height + y) * 4 + direction] < FAR:
        here = (unlocked, hand, x, y, direction)
        ahead = x + STEPS[direction][0], y + STEPS[direction][1]
        after = [(unlocked, hand, x, y, (direction + turn) % 4) for turn in (1, 3)]
        if 0 <= ahead[0] < state.width and 0 <= ahead[1] < state.height:
            code = int(state.cells[ahead])
            lock = lock_at.get(ahead, -1)
            if code & 15 not in (WALL, LAVA) and (lock < 0 or unlocked >> lock & 1):
                after.append((unlocked, hand, *ahead, direction))
            if lock >= 0:
                after.append((unlocked | 1 << lock, hand, x, y, direction))
            if hand == NOTHING and code >> 9 > 0 and code & 15 != DOOR:
                within = inside[(code >> 9) - 1] >> 9
                after += [(unlocked, int(sorts[one - 1]), x, y, direction) for one in (code >> 9, within) if one]
        if hand != NOTHING:
            after.append((unlocked, NOTHING, x, y, direction))

        def value(at: tuple[int, ...]) -> int:
            return int(table[at[0], at[1], (at[2] * state.height + at[3]) * 4 + at[4]])

        best = min(after, key=value)
        if value(best) >= value(here):
            cells.append(ahead[0] * state.height + ahead[1])
            return list(dict.fromkeys(cells))
        if best[2:4] != (x, y):
            cells.append(best[2] * state.height + best[3])
        unlocked, hand, x, y, direction = best
    return None


def do_to(row: Row, verb: int, identity: int) -> list[int] | None:
    """The actions to do something to one object, whatever the instruction says of it; None if they were not found."""
    trial = row.copy()
    numbers = block(trial)
    numbers[CLAUSES + VERB], numbers[CLAUSES + STRICT] = verb, 0
    meant = means(trial)
    meant[:] = np.where(meant > 0, SPARED, 0)
    meant[identity - 1] = SPARED | 1
    codes, locks = codes_of(trial), find_locks(trial)
    sorts = sort_things(trial, 0, codes, locks)
    outcome, actions = search_clause(trial, 0, outlook(trial, 0, codes, locks, sorts, True), locks, sorts, 2, LIMIT)
    return [int(action) for action in actions] if outcome == FOUND else None


def put_down(row: Row, way: list[int]) -> list[int] | None:
    """The actions to put down what is in hand: off the way and not before a door, where there is such a place."""
    if row[CARRYING] == EMPTY:
        return []
    for barred in (_barred(row, way, doors=True), _barred(row, way, doors=False)):
        poses = _facing_free(row, barred)
        steps = distances(row, poses, False)
        state = State(row)
        here = (*state.position, state.direction)
        if steps[here] < FAR:
            return [*descend(steps, *here), DROP]
    return None


def _barred(row: Row, way: list[int], *, doors: bool) -> NDArray[np.bool_]:
    state = State(row)
    barred = np.zeros(state.cells.shape, bool)
    barred.ravel()[way] = True
    if doors:
        for x, y in np.argwhere(state.kinds == DOOR):
            for i, j in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if 0 <= i < state.width and 0 <= j < state.height:
                    barred[i, j] = True
    return barred


def _facing_free(row: Row, barred: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Pose numbers from which a free cell that is not barred lies ahead."""
    state = State(row)
    numbers = []
    for x, y in np.argwhere((state.cells == EMPTY) & ~barred).tolist():
        for direction, (dx, dy) in enumerate(STEPS):
            i, j = x - dx, y - dy
            if 0 <= i < state.width and 0 <= j < state.height:
                numbers.append((i * state.height + j) * 4 + direction)
    return np.array(numbers, np.int64)
