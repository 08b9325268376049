"""The exploring expert: does what is said on what it has seen alone.

It plans on what it knows; where that is not enough it looks for more: where much can be seen soon, then behind locked
doors whose key it knows, past things in the way, into boxes.
"""

import numpy as np

from minihuman.worlds.grid.core.cells import BOX, CLOSED, DOOR, EMPTY, GREY_WALL, LOCKED, in_state
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import (
    CARRYING,
    HEADER,
    HEIGHT,
    MAX_STEPS,
    OBJECTS,
    PHASE,
    PLAYING,
    STEP,
    TARGET,
    TASK,
    WIDTH,
    Row,
    State,
)
from minihuman.worlds.grid.core.tasks import (
    DODGE,
    DONE,
    IN_ORDER,
    INSTRUCTED,
    MATCH,
    OPEN_DOOR,
    PUT_NEAR,
    REACH,
    STAND_BY,
    TOGGLE,
)
from minihuman.worlds.grid.instructions.block import (
    AFTER,
    ALONE,
    CLAUSE,
    CLAUSES,
    FLAGS,
    JOIN,
    KIND,
    LEFT,
    OPEN,
    PICK_UP,
    PUT_NEXT,
    RIGHT,
    SATISFIED,
    SAY_DONE,
    STATUS,
    STRICT,
    THING,
    VERB,
    instructed_length,
)
from minihuman.worlds.grid.instructions.clearing import do_to, put_down
from minihuman.worlds.grid.instructions.memory import EXPERT, FOR_DOORS, Judgement, Memory, Noise, exact
from minihuman.worlds.grid.instructions.numbers import block, means
from minihuman.worlds.grid.instructions.planner import plan_clause
from minihuman.worlds.grid.instructions.rules import try_out
from minihuman.worlds.grid.planner import plan

THING_IN_WAY = 6  # about what it takes to put it aside


class Explorer:
    """One episode's explorer. Ask `action` before every step.

    Args:
        state: The world's state after its reset.
        view_size: Cells on a side of the agent's view.
        judgement: By what it judges from where to look; None: as well as is known.
        noise: How far off each of these judgements is, in actions.
        inside: The grid is seen from inside.
    """

    def __init__(
        self,
        state: State,
        view_size: int = 7,
        *,
        judgement: Judgement | None = None,
        noise: Noise = exact,
        inside: bool = False,
    ) -> None:
        self.memory = Memory(state.row, view_size, inside=inside)
        self._judgement, self._noise = judgement, noise
        self._plan: list[int] = []
        self._before = state.row.copy()  # the state when the plan was last looked at

    def action(self, state: State) -> int | None:
        """What to do now; None where nothing is left to try."""
        way = self.way(state)
        return way[0] if way else None

    def way(self, state: State) -> list[int]:
        """What to do from here, as far as it is decided; empty where nothing is left to try."""
        new = self.memory.look(state.row)
        moving = state.row[TASK] == DODGE  # by chance: what comes after an action cannot be worked out
        if self._plan and not moving and np.array_equal(_after(self._before, self._plan[0]), state.row):
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
            if known[TASK] == DODGE:
                self._where_things_are(known)
            found = plan(State(known)) if self._knows_what_it_is_about(known) else None
            return found or self._look_for_more(np.pad(known, (0, room_for_more)))
        for candidates in (self._ways(known), self._fetching(known)):
            if candidates:
                return min(candidates, key=len)
        return self._look_for_more(known)

    def _where_things_are(self, known: Row) -> None:
        """What moves by itself bars the way where it is in view now; where else it may be nobody knows."""
        known[TASK] = REACH
        cells = known[HEADER : HEADER + int(known[WIDTH]) * int(known[HEIGHT])]
        moving, in_view = cells >> 9 > 0, self.memory.in_view(known)
        cells[moving & in_view], cells[moving & ~in_view] = GREY_WALL, EMPTY

    def _knows_what_it_is_about(self, known: Row) -> bool:
        """Whether the cells that the task is about were seen; of a match, the things too that are compared."""
        task, target = int(known[TASK]), known[TARGET : TARGET + 4].tolist()
        about = {STAND_BY: (0,), OPEN_DOOR: (0,), MATCH: (0, 2), IN_ORDER: (0, 2), PUT_NEAR: (2,)}.get(task, ())
        cells = [target[place] * int(known[HEIGHT]) + target[place + 1] for place in about]
        things = range(1, int(known[OBJECTS]) + 1) if task == MATCH else ()
        return bool(self.memory.seen[cells].all()) and all(State(known).find(one) is not None for one in things)

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
        judgement = self._judgement or (FOR_DOORS if _seeks_doors(known) else EXPERT)
        allowed = _doors_left_alone(known) if _strict(known) else known
        nearest = self.memory.frontier(allowed, judgement=judgement, noise=self._noise)
        if nearest is not None:
            return nearest[0]
        return self._unlocking(known) or self._clearing(known, judgement) or self._opening_boxes(known)

    def _unlocking(self, known: Row) -> list[int]:
        state = State(known)
        found = []
        for x, y in np.argwhere((state.kinds == DOOR) & ((state.cells >> 7 & 3) == LOCKED)).tolist():
            actions = do_to(known, OPEN, int(state.cells[x, y]) >> 9)
            if actions is not None:
                found.append(actions)
        return min(found, key=len, default=[])

    def _clearing(self, known: Row, judgement: Judgement) -> list[int]:
        beyond = self.memory.frontier(known, passing=THING_IN_WAY, judgement=judgement)
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
                try_out(trial, action)
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
    return any(clause[STRICT] != 0 for clause in _active_lines(row))


def _seeks_doors(row: Row) -> bool:
    """Whether each clause that is to be done now is about a door."""
    kinds = [int(clause[THING + KIND]) for clause in _active_lines(row)]
    return bool(kinds) and all(kind == DOOR for kind in kinds)


def _active_lines(row: Row) -> list[Row]:
    """The numbers of the clauses that are to be done now."""
    if row[TASK] != INSTRUCTED:
        return []
    lines = block(row)[CLAUSES:].reshape(-1, CLAUSE)
    return [lines[clause] for clause in active(row)]


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
    try_out(after, action)
    return after
