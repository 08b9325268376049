"""The all-seeing expert for instructions: lists of actions that do what is said, on the world's own rules.

A plan is made clause by clause, And in both orders. Each clause is searched exactly first, and with a careful guess
where that takes too many states; `Way` says what is certain: that there is no way, or that none was found.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from minihuman.worlds.grid.core.cells import EMPTY
from minihuman.worlds.grid.core.rules import TERMINATED
from minihuman.worlds.grid.core.search import FAR, FOUND, NONE
from minihuman.worlds.grid.core.state import CARRYING, MAX_STEPS, PHASE, PLAYING, STEP, Row, cell_at
from minihuman.worlds.grid.core.tasks import DONE, DROP, PICKUP, RIGHT, front
from minihuman.worlds.grid.instructions.block import (
    AFTER,
    ALONE,
    CLAUSE,
    CLAUSES,
    FLAGS,
    HELD,
    JOIN,
    LEFT,
    OWN_STEPS,
    SATISFIED,
    SAY_DONE,
    STATUS,
)
from minihuman.worlds.grid.instructions.block import RIGHT as RIGHT_PART
from minihuman.worlds.grid.instructions.clearing import clear_way
from minihuman.worlds.grid.instructions.numbers import block
from minihuman.worlds.grid.instructions.outlook import find_locks, outlook, sort_things
from minihuman.worlds.grid.instructions.rules import try_out
from minihuman.worlds.grid.instructions.search import codes_of, search_clause, worth_of

EXACT, SOME, MANY = 1 << 12, 1 << 14, 1 << 16  # states looked at: exactly, guessing, and guessing boldly


@dataclass(frozen=True, slots=True)
class Way:
    """What a planner found.

    Attributes:
        actions: What to do; empty where nothing was found.
        at_least: No list of actions is shorter. Where there is certainly no way it is None.
        found: Whether the actions succeed.
    """

    actions: tuple[int, ...]
    at_least: int | None
    found: bool

    @property
    def unsolvable(self) -> bool:
        """Whether there is certainly no way; not found and not unsolvable is given up."""
        return self.at_least is None

    @property
    def shortest(self) -> bool:
        """Whether the actions are proven to be as few as can be."""
        return self.found and len(self.actions) == self.at_least


def plan_instruction(row: Row) -> Way:
    """A way to do the instruction of a state, which is not changed. The step limit is not looked at."""
    scratch = row.copy()
    scratch[MAX_STEPS], scratch[STEP], scratch[PHASE] = FAR, 0, PLAYING
    best: tuple[int, ...] | None = None
    unsolvable = True
    at_least = None
    for order in _orders(scratch):
        trial = scratch.copy()
        actions, certain, bound = _in_order(trial, order)
        unsolvable &= certain
        if bound is not None:
            at_least = bound if at_least is None else min(at_least, bound)
        if actions is not None and (best is None or len(actions) < len(best)):
            best = actions
    if best is not None:
        return Way(best, min(at_least or 0, len(best)), True)
    return Way((), None if unsolvable else at_least or 0, False)


def plan_clause(row: Row, clause: int) -> tuple[int, ...] | None:
    """A way to do one clause of a state's instruction; None if none was found. The state is not changed."""
    actions, _, _ = _clause(row, clause)
    return actions


def _orders(row: Row) -> Iterator[tuple[int, ...]]:
    """The orders in which the clauses can be done."""
    numbers = block(row)
    left, right = int(numbers[LEFT]), int(numbers[RIGHT_PART])
    one, other = tuple(range(left)), tuple(range(left, left + right))
    if numbers[JOIN] == AFTER:
        one, other = other, one
    waiting = [tuple(k for k in part if numbers[CLAUSES + k * CLAUSE + STATUS] != SATISFIED) for part in (one, other)]
    if numbers[JOIN] == ALONE:
        waiting = waiting[:1]
    choices = [(part, part[::-1]) if len(part) == 2 else (part,) for part in waiting]
    for first in choices[0]:
        for second in choices[1] if len(choices) > 1 else ((),):
            yield first + second


def _in_order(row: Row, order: tuple[int, ...]) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Do clauses one after the other: the actions, whether failing was certain, the first clause's bound."""
    done: list[int] = []
    bound: int | None = None
    for place, clause in enumerate(order):
        if block(row)[CLAUSES + clause * CLAUSE + STATUS] == SATISFIED:
            continue
        actions, certain, at_least = _clause(row, clause)
        if place == 0:
            bound = at_least
        if actions is None:
            return None, certain and place == 0, bound
        if block(row)[FLAGS] & SAY_DONE:
            actions = (*actions, DONE)
        for action in actions:
            status, reward = try_out(row, action)
            done.append(action)
            if status & TERMINATED:
                return (tuple(done), False, bound) if reward > 0 else (None, _is_trap(row, order), bound)
    return None, False, bound


def _is_trap(row: Row, order: tuple[int, ...]) -> bool:
    """Whether a failure at the joint of two parts cannot be got round: each step of the first is one of the second."""
    return len(order) == 2 and not block(row)[FLAGS] & OWN_STEPS


def _clause(row: Row, clause: int) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Do one clause: the actions, whether there certainly are none, at least how many there are."""
    first: list[int] = []
    codes, locks = codes_of(row), find_locks(row)
    sorts = sort_things(row, clause, codes, locks)
    table = outlook(row, clause, codes, locks, sorts, False)
    at_least = int(worth_of(row, table, locks, sorts))
    if at_least >= FAR and row[CARRYING] != EMPTY:
        return _after_dropping(row, clause)
    if at_least >= FAR:
        return None, True, None
    if block(row)[CLAUSES + clause * CLAUSE + HELD] == 0 and row[CARRYING] != EMPTY and at_least <= 1:
        first = [PICKUP]  # does nothing: what is in hand from the start counts as put down from the second step on
    outcome, actions = search_clause(row, clause, table, locks, sorts, 1, EXACT)
    if outcome == FOUND:
        return (*first, *actions.tolist()), False, at_least
    if outcome == NONE:
        return None, True, at_least
    return _guessing(row, clause), False, at_least


def _guessing(row: Row, clause: int) -> tuple[int, ...] | None:
    """Do one clause with more states, with a guess that overestimates, with the way cleared first."""
    trial = row.copy()
    for weight, limit, clears in ((2, SOME, False), (2, SOME, True), (5, MANY, True), (5, MANY, False)):
        cleared: list[int] | None = []
        if clears:
            trial = row.copy()
            cleared = clear_way(trial, clause)
        if cleared is None:
            continue
        start = trial if clears else row
        codes, locks = codes_of(start), find_locks(start)
        sorts = sort_things(start, clause, codes, locks)
        guess = outlook(start, clause, codes, locks, sorts, True)
        outcome, actions = search_clause(start, clause, guess, locks, sorts, weight, limit)
        if outcome == FOUND:
            return (*cleared, *actions.tolist())
    return None


def _after_dropping(row: Row, clause: int) -> tuple[tuple[int, ...] | None, bool, int | None]:
    """Do one clause once what is in hand lies before the agent."""
    trial = row.copy()
    turns: list[int] = []
    while int(cell_at(trial, *front(trial))) != EMPTY:
        turns.append(RIGHT)
        if len(turns) == 4:
            return None, False, 0
        try_out(trial, RIGHT)
    turns.append(DROP)
    status, _ = try_out(trial, DROP)
    if status & TERMINATED or block(trial)[CLAUSES + clause * CLAUSE + STATUS] == SATISFIED:
        return tuple(turns), False, 1
    actions, certain, at_least = _clause(trial, clause)
    if actions is None:
        return None, certain, at_least
    return (*turns, *actions), False, 1
