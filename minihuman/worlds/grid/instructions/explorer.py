"""The exploring expert: does what is said on what it has seen alone.

It plans on what it knows; where that is not enough it looks for more: where much can be seen soon, then behind locked
doors whose key it knows, past things in the way, into boxes.
"""

import numpy as np

from minihuman.worlds.grid.core.cells import BOX, CLOSED, DOOR, LOCKED, in_state
from minihuman.worlds.grid.core.rules import act
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import CARRYING, HEIGHT, MAX_STEPS, PHASE, PLAYING, STEP, TASK, WIDTH, Row, State
from minihuman.worlds.grid.core.tasks import DONE, INSTRUCTED, TOGGLE
from minihuman.worlds.grid.instructions.block import (
    AFTER,
    ALONE,
    CLAUSE,
    CLAUSES,
    FLAGS,
    JOIN,
    LEFT,
    OPEN,
    PICK_UP,
    PUT_NEXT,
    RIGHT,
    SATISFIED,
    SAY_DONE,
    STATUS,
    STRICT,
    VERB,
    instructed_length,
)
from minihuman.worlds.grid.instructions.clearing import do_to, put_down
from minihuman.worlds.grid.instructions.memory import Memory
from minihuman.worlds.grid.instructions.numbers import block, means
from minihuman.worlds.grid.instructions.planner import plan_clause
from minihuman.worlds.grid.planner import plan

THING_IN_WAY = 6  # about what it takes to put it aside


class Explorer:
    """One episode's explorer. Ask `action` before every step.

    Args:
        state: The world's state after its reset.
        view_size: Cells on a side of the agent's view.
    """

    def __init__(self, state: State, view_size: int = 7) -> None:
        self.memory = Memory(state.row, view_size)
        self._plan: list[int] = []
        self._before = state.row.copy()  # the state when the plan was last looked at

    def action(self, state: State) -> int | None:
        """What to do now; None where nothing is left to try."""
        way = self.way(state)
        return way[0] if way else None

    def way(self, state: State) -> list[int]:
        """What to do from here, as far as it is decided; empty where nothing is left to try."""
        new = self.memory.look(state.row)
        if self._plan and np.array_equal(_after(self._before, self._plan[0]), state.row):
            self._plan.pop(0)  # done, as it was to be
        elif not np.array_equal(self._before, state.row):
            self._plan = []
        if not self._plan or new:
            self._plan = self._decide(state.row)
        self._before = state.row.copy()
        return self._plan

    def _decide(self, row: Row) -> list[int]:
        known = self.memory.known(row)
        known[MAX_STEPS], known[STEP], known[PHASE] = FAR, 0, PLAYING
        if known[TASK] != INSTRUCTED:
            room_for_more = instructed_length(int(known[WIDTH]), int(known[HEIGHT])) - len(known)
            return plan(State(known)) or self._look_for_more(np.pad(known, (0, room_for_more)))
        for candidates in (self._ways(known), self._fetching(known)):
            if candidates:
                return min(candidates, key=len)
        return self._look_for_more(known)

    def _ways(self, known: Row) -> list[list[int]]:
        """How to do each clause that is to be done now, of those that can be on what is known."""
        found = []
        for clause in active(known):
            actions = plan_clause(known, clause)
            if actions is not None:
                found.append([*actions, DONE] if block(known)[FLAGS] & SAY_DONE else list(actions))
        return found

    def _fetching(self, known: Row) -> list[list[int]]:
        """How to take up what is to be put next to something not found yet."""
        found = []
        for clause in active(known):
            if block(known)[CLAUSES + clause * CLAUSE + VERB] != PUT_NEXT:
                continue
            movable = (means(known) >> 2 * clause & 1).nonzero()[0] + 1
            if int(known[CARRYING]) >> 9 in movable:
                continue
            for identity in movable.tolist():
                if State(known).find(identity) is not None:
                    actions = do_to(known, PICK_UP, identity)
                    if actions is not None:
                        found.append(actions)
        return found

    def _look_for_more(self, known: Row) -> list[int]:
        nearest = self.memory.frontier(_doors_left_alone(known) if _strict(known) else known)
        if nearest is not None:
            return nearest[0]
        return self._unlocking(known) or self._clearing(known) or self._opening_boxes(known)

    def _unlocking(self, known: Row) -> list[int]:
        state = State(known)
        found = []
        for x, y in np.argwhere((state.kinds == DOOR) & ((state.cells >> 7 & 3) == LOCKED)).tolist():
            actions = do_to(known, OPEN, int(state.cells[x, y]) >> 9)
            if actions is not None:
                found.append(actions)
        return min(found, key=len, default=[])

    def _clearing(self, known: Row) -> list[int]:
        beyond = self.memory.frontier(known, passing=THING_IN_WAY)
        if beyond is None:
            return []
        _, way, _ = beyond
        cells = State(known).cells.ravel()
        lying = [cell for cell in way if cells[cell] >> 9 > 0 and cells[cell] & 15 != DOOR]
        if not lying:
            return []
        trial = known.copy()
        actions: list[int] = []
        for step in range(3):
            part = put_down(trial, way) if step != 1 else do_to(trial, PICK_UP, int(cells[lying[0]]) >> 9)
            if part is None:
                return []
            for action in part:
                act(trial, action, np.zeros(6, np.uint64))
            actions += part
        return actions

    def _opening_boxes(self, known: Row) -> list[int]:
        state = State(known)
        found = []
        for x, y in np.argwhere(state.kinds == BOX).tolist():
            identity = int(state.cells[x, y]) >> 9
            actions = do_to(known, PICK_UP, identity)
            if actions is not None and not means(known)[identity - 1]:
                found.append([*actions[:-1], TOGGLE])
        return min(found, key=len, default=[])


def _strict(row: Row) -> bool:
    """Whether a clause that is to be done now fails where something else is done."""
    lines = block(row)[CLAUSES:].reshape(-1, CLAUSE) if row[TASK] == INSTRUCTED else ()
    return any(bool(lines[clause][STRICT]) for clause in active(row)) if len(lines) else False


def _doors_left_alone(known: Row) -> Row:
    """The state with every closed door as good as locked."""
    alone = known.copy()
    state = State(alone)
    for x, y in np.argwhere((state.kinds == DOOR) & ((state.cells >> 7 & 3) == CLOSED)).tolist():
        state.cells[x, y] = in_state(int(state.cells[x, y]), LOCKED)
    return alone


def active(row: Row) -> tuple[int, ...]:
    """The clauses that are to be done now."""
    numbers = block(row)
    left, right = int(numbers[LEFT]), int(numbers[RIGHT])
    both = [range(left), range(left, left + right)]
    if numbers[JOIN] == AFTER:
        both.reverse()
    for part in both[:1] if numbers[JOIN] == ALONE else both:
        waiting = tuple(k for k in part if numbers[CLAUSES + k * CLAUSE + STATUS] != SATISFIED)
        if waiting:
            return waiting
    return ()


def _after(row: Row, action: int) -> Row:
    """The state after an action."""
    after = row.copy()
    act(after, action, np.zeros(6, np.uint64))
    return after
