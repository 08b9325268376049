"""The expert with full knowledge of the world: plans actions that carry out an instruction under the world's own rules.

A plan is made clause by clause, and And in both orders. Each clause is first searched exactly, then with an
overestimating heuristic if that takes too many states; `InstructionPlan` says whether certainly no plan exists, or none
was found. If a search takes too many states, objects on the path of the distance heuristic are first put aside, one by
one.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai import encoding
from minihuman.worlds.grid.babyai.clause_search import (
    NOTHING,
    Sorts,
    codes_of,
    distance_heuristic,
    find_locks,
    heuristic_value_of,
    search_clause,
    sort_things,
)
from minihuman.worlds.grid.babyai.encoding import block, described_objects
from minihuman.worlds.grid.babyai.verifier import try_action
from minihuman.worlds.grid.core.cells import DOOR, EMPTY, LAVA, STEPS, WALL, identities_of, kinds_of
from minihuman.worlds.grid.core.rewards import DONE, DROP, PICKUP, RIGHT, cell_in_front
from minihuman.worlds.grid.core.rules import TERMINATED
from minihuman.worlds.grid.core.search import FAR, FOUND, NONE, distances
from minihuman.worlds.grid.core.state import CARRYING, MAX_STEPS, PHASE, PLAYING, STEP, Row, State, cell_at
from minihuman.worlds.grid.descent import descend

MOST_CLEARED = 24  # objects to move out of the way of one clause
LIMIT = 1 << 13  # states that each search of `do_to` may store
SPARED = 1 << 30  # a bit of no description in an object's number, which keeps the search from opening a box


def clear_way(row: Row, clause: int) -> list[int] | None:
    """Move the objects that block a clause out of the way, and set the row to the state after that.

    The row is changed even if the result is None.

    Returns:
        The actions, empty if nothing blocks; None if the clause is strict, the distance heuristic has no path, an
            object cannot be moved, or there are too many objects (`MOST_CLEARED`).
    """
    if block(row)[encoding.CLAUSES + clause * encoding.CLAUSE + encoding.STRICT]:
        return None
    actions: list[int] = []
    for _ in range(MOST_CLEARED):
        way = _path_cells(row, clause)
        if way is None:
            return None
        cells = State(row).cells.ravel()
        is_meant = described_objects(row) >> 2 * clause & 1
        blocking_cells = [
            cell
            for cell in way
            if identities_of(cells[cell]) > 0
            and kinds_of(cells[cell]) != DOOR
            and not (cell == way[-1] and is_meant[identities_of(cells[cell]) - 1])
        ]
        if not blocking_cells:
            return actions
        thing = identities_of(cells[blocking_cells[0]])
        # put down what the agent carries; pick up the object; put it down away from the path
        for make_part in (
            partial(put_down, way=way),
            partial(do_to, verb=encoding.PICK_UP, identity=thing),
            partial(put_down, way=way),
        ):
            part = make_part(row)
            if part is None or not _take_actions(row, part):
                return None
            actions += part
    return None


def _take_actions(row: Row, actions: list[int]) -> bool:
    """Take actions one after the other, which changes the row; return False as soon as one ends the episode."""
    for action in actions:
        status, _ = try_action(row, action)
        if status & TERMINATED:
            return False
    return True


class _Node(NamedTuple):
    """A state of the simplified world of the distance heuristic.

    ``unlocked`` has a bit for each lock, and ``hand`` is the class of the carried object.
    """

    unlocked: int
    hand: int
    x: int
    y: int
    direction: int

    @property
    def cell_ahead(self) -> tuple[int, int]:
        """Return the column and row of the cell ahead."""
        columns, rows = STEPS[self.direction]
        return self.x + columns, self.y + rows


def _path_cells(row: Row, clause: int) -> list[int] | None:
    """Return the cells (x * height + y) on a shortest path of the distance heuristic, whether they are free or not.

    Each cell is listed once. The last one is the cell on which the clause's last action acts. The result is None if
    there is no path.
    """
    codes = codes_of(row)
    locks = find_locks(row)
    sorts = sort_things(row, clause, codes, locks)
    table = distance_heuristic(row, clause, codes, locks, sorts, True)  # what is in the way costs something
    state = State(row)

    def distance(node: _Node) -> int:
        return int(table[node.unlocked, node.hand, (node.x * state.height + node.y) * 4 + node.direction])

    lock_at = {state.find(int(identity)): lock for lock, (identity, _) in enumerate(locks)}
    carried = identities_of(row[CARRYING])
    hand = int(sorts[carried - 1]) if carried else NOTHING
    node = _Node(0, hand, *state.position, state.direction)
    cells: list[int] = []
    while distance(node) < FAR:
        nearest = min(_successors(node, state, sorts, lock_at), key=distance)
        if distance(nearest) >= distance(node):
            x, y = node.cell_ahead  # where the last action of the clause takes effect
            cells.append(x * state.height + y)
            return list(dict.fromkeys(cells))  # a path may pass a cell twice, with another object in hand
        if (nearest.x, nearest.y) != (node.x, node.y):
            cells.append(nearest.x * state.height + nearest.y)
        node = nearest
    return None


def _successors(node: _Node, state: State, sorts: Sorts, lock_at: Mapping[tuple[int, int] | None, int]) -> list[_Node]:
    """Return the states of the simplified world that one action reaches from a state.

    Args:
        node: the state from which the action is taken.
        state: the state of the real world.
        sorts: the class of each object, as `sort_things` returns it.
        lock_at: the index of the lock in each cell with a locked door.
    """
    successors = [node._replace(direction=(node.direction + turn) % 4) for turn in (1, 3)]
    x, y = node.cell_ahead
    if 0 <= x < state.width and 0 <= y < state.height:
        code = int(state.cells[x, y])
        lock = lock_at.get((x, y), -1)
        if kinds_of(code) not in (WALL, LAVA) and (lock < 0 or node.unlocked >> lock & 1):
            successors.append(node._replace(x=x, y=y))
        if lock >= 0:
            successors.append(node._replace(unlocked=node.unlocked | 1 << lock))
        if node.hand == NOTHING and identities_of(code) > 0 and kinds_of(code) != DOOR:
            identity = identities_of(code)
            contents_identity = identities_of(int(state.contents[identity - 1]))
            successors.append(node._replace(hand=int(sorts[identity - 1])))
            if contents_identity:
                successors.append(node._replace(hand=int(sorts[contents_identity - 1])))
    if node.hand != NOTHING:
        successors.append(node._replace(hand=NOTHING))
    return successors


def do_to(row: Row, verb: int, identity: int) -> list[int] | None:
    """Return the actions that apply a verb to one object, whatever the instruction says; None if none are found."""
    trial = row.copy()
    numbers = block(trial)
    numbers[encoding.CLAUSES + encoding.VERB] = verb
    numbers[encoding.CLAUSES + encoding.STRICT] = 0
    description_bits = described_objects(trial)
    description_bits[:] = np.where(description_bits > 0, SPARED, 0)
    description_bits[identity - 1] = SPARED | 1
    codes = codes_of(trial)
    locks = find_locks(trial)
    sorts = sort_things(trial, 0, codes, locks)
    table = distance_heuristic(trial, 0, codes, locks, sorts, True)  # what is in the way costs something
    outcome, actions = search_clause(trial, 0, table, locks, sorts, 2, LIMIT)
    if outcome == FOUND:
        return [int(action) for action in actions]
    return None


def put_down(row: Row, way: list[int]) -> list[int] | None:
    """Return the actions that put down what the agent carries, off the path and, if possible, not next to a door.

    ``way`` has the numbers of the path's cells (x * height + y). The list is empty if the agent carries nothing, and
    the result is None if there is no place to put the object.
    """
    if row[CARRYING] == EMPTY:
        return []
    for barred in (_barred_cells(row, way, doors=True), _barred_cells(row, way, doors=False)):
        poses = _poses_facing_free_cells(row, barred)
        steps = distances(row, poses, False)  # doors and objects block
        state = State(row)
        pose = (*state.position, state.direction)
        if steps[pose] < FAR:
            return [*descend(steps, *pose), DROP]
    return None


def _barred_cells(row: Row, way: list[int], *, doors: bool) -> NDArray[np.bool_]:
    """Return bool[width, height], true in the cells of a path and, with ``doors``, in the cells next to a door."""
    state = State(row)
    barred = np.zeros(state.cells.shape, bool)
    barred.ravel()[way] = True
    if doors:
        for x, y in np.argwhere(state.kinds == DOOR):
            for i, j in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if 0 <= i < state.width and 0 <= j < state.height:
                    barred[i, j] = True
    return barred


def _poses_facing_free_cells(row: Row, barred: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the numbers of the poses that face an empty cell that is not barred, as `search.distances` takes them."""
    state = State(row)
    numbers = []
    for x, y in np.argwhere((state.cells == EMPTY) & ~barred).tolist():
        for direction, (dx, dy) in enumerate(STEPS):
            i = x - dx
            j = y - dy
            if 0 <= i < state.width and 0 <= j < state.height:
                numbers.append((i * state.height + j) * 4 + direction)
    return np.array(numbers, np.int64)


# States that a search may store: with the exact heuristic, and with an overestimating one of a low or a high weight
EXACT = 1 << 12
SOME = 1 << 14
MANY = 1 << 16


@dataclass(frozen=True, slots=True)
class InstructionPlan:
    """The result of planning an instruction.

    Attributes:
        actions: the actions that succeed; empty if none were found.
        at_least: a lower bound on the number of actions; None if certainly no plan exists.
        found: whether the actions succeed.
    """

    actions: tuple[int, ...]
    at_least: int | None
    found: bool

    @property
    def unsolvable(self) -> bool:
        """Return whether certainly no plan exists. If a plan is neither found nor ruled out, the search gave up."""
        return self.at_least is None

    @property
    def shortest(self) -> bool:
        """Return whether the actions are proven to be the fewest."""
        return self.found and len(self.actions) == self.at_least


def plan_instruction(row: Row) -> InstructionPlan:
    """Return a plan for a state's instruction. The state is not changed, and its step limit is ignored."""
    scratch = row.copy()
    scratch[MAX_STEPS] = FAR
    scratch[STEP] = 0
    scratch[PHASE] = PLAYING
    best: tuple[int, ...] | None = None
    unsolvable = True
    at_least = None
    for order in _orders(scratch):
        trial = scratch.copy()
        actions, certain, bound = _plan_in_order(trial, order)
        unsolvable &= certain
        if bound is not None:
            if at_least is None:
                at_least = bound
            else:
                at_least = min(at_least, bound)
        if actions is not None and (best is None or len(actions) < len(best)):
            best = actions
    if best is not None:
        return InstructionPlan(best, min(at_least or 0, len(best)), True)
    return InstructionPlan((), None if unsolvable else at_least or 0, False)


def plan_clause(row: Row, clause: int) -> tuple[int, ...] | None:
    """Return a plan for one clause of a state's instruction, or None if none is found. The state is not changed."""
    actions, _, _ = _plan_clause(row, clause)
    return actions


def _orders(row: Row) -> Iterator[tuple[int, ...]]:
    """Yield the orders in which the clauses that are not yet satisfied can be carried out, as numbers of clauses."""
    numbers = block(row)
    left = int(numbers[encoding.LEFT])
    right = int(numbers[encoding.RIGHT])
    earlier_part = tuple(range(left))
    later_part = tuple(range(left, left + right))
    if numbers[encoding.JOIN] == encoding.AFTER:
        earlier_part, later_part = later_part, earlier_part
    statuses = numbers[encoding.CLAUSES :].reshape(-1, encoding.CLAUSE)[:, encoding.STATUS]
    remaining = [
        tuple(clause for clause in part if statuses[clause] != encoding.SATISFIED)
        for part in (earlier_part, later_part)
    ]
    if numbers[encoding.JOIN] == encoding.ALONE:
        remaining = remaining[:1]
    choices = [(part, part[::-1]) if len(part) == 2 else (part,) for part in remaining]
    for first in choices[0]:
        for second in choices[1] if len(choices) > 1 else ((),):
            yield first + second


def _plan_in_order(row: Row, order: tuple[int, ...]) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Plan clauses one after the other, and set the row to the state after them.

    Returns:
        The actions, None if they were not found or do not succeed; whether it is certain that none exist in this order;
            and a lower bound on the number of actions for the first clause, None if it is impossible.
    """
    actions_made: list[int] = []
    bound: int | None = None
    for place, clause in enumerate(order):
        if block(row)[encoding.CLAUSES + clause * encoding.CLAUSE + encoding.STATUS] == encoding.SATISFIED:
            continue
        actions, certain, at_least = _plan_clause(row, clause)
        if place == 0:
            bound = at_least
        if actions is None:
            return None, certain and place == 0, bound
        if block(row)[encoding.FLAGS] & encoding.SAY_DONE:
            actions = (*actions, DONE)
        for action in actions:
            status, reward = try_action(row, action)
            actions_made.append(action)
            if status & TERMINATED:
                # a failure at the joint of two parts is a trap if each step of the first is one of the second
                trap = len(order) == 2 and not block(row)[encoding.FLAGS] & encoding.OWN_STEPS
                if reward > 0:
                    return (tuple(actions_made), False, bound)
                return (None, trap, bound)
    return None, False, bound


def _plan_clause(row: Row, clause: int) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Plan one clause without changing the row.

    Returns:
        The actions, None if none were found; whether there certainly are none; and a lower bound on their number, None
            if the distance heuristic has no path.
    """
    first_actions: list[int] = []
    codes = codes_of(row)
    locks = find_locks(row)
    sorts = sort_things(row, clause, codes, locks)
    table = distance_heuristic(row, clause, codes, locks, sorts, False)  # a lower bound
    at_least = int(heuristic_value_of(row, table, locks, sorts))
    if at_least >= FAR and row[CARRYING] != EMPTY:
        return _plan_after_dropping(row, clause)
    if at_least >= FAR:
        return None, True, None
    judged_hand = block(row)[encoding.CLAUSES + clause * encoding.CLAUSE + encoding.HELD]
    if judged_hand == 0 and row[CARRYING] != EMPTY and at_least <= 1:
        first_actions = [PICKUP]  # does nothing; the verifier knows what is in hand only from the second step on
    outcome, actions = search_clause(row, clause, table, locks, sorts, 1, EXACT)
    if outcome == FOUND:
        return (*first_actions, *actions.tolist()), False, at_least
    if outcome == NONE:
        return None, True, at_least
    return _plan_inexactly(row, clause), False, at_least


def _plan_inexactly(row: Row, clause: int) -> tuple[int, ...] | None:
    """Return a plan for one clause, found with an overestimating heuristic, which may first move objects away.

    Return None if no plan is found. The row is not changed.
    """
    trial = row.copy()
    # each search: weight of the heuristic, maximum number of states, whether objects are first moved out of the way
    for weight, limit, is_clearing in ((2, SOME, False), (2, SOME, True), (5, MANY, True), (5, MANY, False)):
        cleared: list[int] | None = []
        if is_clearing:
            trial = row.copy()
            cleared = clear_way(trial, clause)
        if cleared is None:
            continue
        start = trial if is_clearing else row
        codes = codes_of(start)
        locks = find_locks(start)
        sorts = sort_things(start, clause, codes, locks)
        guess = distance_heuristic(start, clause, codes, locks, sorts, True)
        outcome, actions = search_clause(start, clause, guess, locks, sorts, weight, limit)
        if outcome == FOUND:
            return (*cleared, *actions.tolist())
    return None


def _plan_after_dropping(row: Row, clause: int) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Plan one clause after the agent has dropped what it carries; return what `_plan_clause` returns."""
    trial = row.copy()
    turns: list[int] = []
    while int(cell_at(trial, *cell_in_front(trial))) != EMPTY:
        turns.append(RIGHT)
        if len(turns) == 4:
            return None, False, 0
        try_action(trial, RIGHT)
    turns.append(DROP)
    status, _ = try_action(trial, DROP)
    if (
        status & TERMINATED
        or block(trial)[encoding.CLAUSES + clause * encoding.CLAUSE + encoding.STATUS] == encoding.SATISFIED
    ):
        return tuple(turns), False, 1
    actions, certain, at_least = _plan_clause(trial, clause)
    if actions is None:
        return None, certain, at_least
    return (*turns, *actions), False, 1
