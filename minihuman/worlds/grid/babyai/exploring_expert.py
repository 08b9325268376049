"""The exploring expert: carries out an instruction knowing only what it has seen.

It plans with what it knows. If that is not enough, it looks for more: first where much can be seen soon, then behind
locked doors whose key it knows, past objects in the way, and in boxes.
"""

import numpy as np

from minihuman.worlds.grid.babyai import encoding
from minihuman.worlds.grid.babyai.encoding import block, described_objects, instructed_length
from minihuman.worlds.grid.babyai.expert import do_to, plan_clause, put_down
from minihuman.worlds.grid.babyai.verifier import try_action
from minihuman.worlds.grid.belief_state import (
    DOOR_WEIGHTS,
    EXPERT_WEIGHTS,
    ExploredGrid,
    FrontierWeights,
    Noise,
    no_noise,
)
from minihuman.worlds.grid.core import rewards, state as fields
from minihuman.worlds.grid.core.cells import (
    BOX,
    CLOSED,
    DOOR,
    EMPTY,
    GREY_WALL,
    LOCKED,
    identities_of,
    in_state,
    kinds_of,
)
from minihuman.worlds.grid.core.search import FAR
from minihuman.worlds.grid.core.state import Row, State
from minihuman.worlds.grid.planner import plan

THING_IN_WAY = 6  # about the number of actions in which a thing is put aside


class Explorer:
    """The explorer of one episode. Call `action` before every step.

    Args:
        state: the world's state after its reset.
        view_size: the number of cells on a side of the agent's view.
        judgement: the weights by which it chooses where to look; None for the best known ones.
        noise: a function that takes a number of poses and returns an error for each, in actions, which is added to the
            cost of looking from there.
        inside: whether the agent's view is first-person instead of from above.
    """

    def __init__(
        self,
        state: State,
        view_size: int = 7,
        *,
        judgement: FrontierWeights | None = None,
        noise: Noise = no_noise,
        inside: bool = False,
    ) -> None:
        self.memory = ExploredGrid(state.row, view_size, inside=inside)
        self._judgement = judgement
        self._noise = noise
        self._plan: list[int] = []
        self._before = state.row.copy()  # the state when `way` was last called

    def action(self, state: State) -> int | None:
        """Return the next action in the world's current state, or None if nothing is left to try."""
        actions = self.way(state)
        return actions[0] if actions else None

    def way(self, state: State) -> list[int]:
        """Look, plan anew if needed, and return the actions planned from the state; empty if nothing is left to try."""
        has_new = self.memory.look(state.row)
        is_random = state.row[fields.TASK] == rewards.DODGE  # things move by chance, so no plan knows the next state
        if self._plan and not is_random and np.array_equal(_state_after(self._before, self._plan[0]), state.row):
            self._plan.pop(0)  # its first action was taken, with the expected effect
        elif not np.array_equal(self._before, state.row):
            self._plan = []
        if not self._plan or has_new:
            self._plan = self._decide(state.row)
        self._before = state.row.copy()
        return self._plan

    def _decide(self, row: Row) -> list[int]:
        """Return actions that do the task, or else look for more, given what the agent has seen; empty if none help."""
        belief = self.memory.known(row)
        belief[fields.MAX_STEPS] = FAR
        belief[fields.STEP] = 0
        belief[fields.PHASE] = fields.PLAYING
        if belief[fields.TASK] != rewards.INSTRUCTED:
            room_for_more = instructed_length(int(belief[fields.WIDTH]), int(belief[fields.HEIGHT])) - len(belief)
            if belief[fields.TASK] == rewards.DODGE:
                self._fix_obstacles(belief)
            if self._has_seen_task(belief):
                actions = plan(State(belief))
            else:
                actions = None
            return actions or self._look_for_more(np.pad(belief, (0, room_for_more)))
        for candidates in (self._plan_clauses(belief), self._plan_fetching(belief)):
            if candidates:
                return min(candidates, key=len)
        return self._look_for_more(belief)

    def _fix_obstacles(self, belief: Row) -> None:
        """Turn the visible moving obstacles of a belief into walls, and remove the others, which may have moved since.

        The task of the belief becomes to reach the goal.
        """
        belief[fields.TASK] = rewards.REACH
        cells = belief[fields.HEADER : fields.HEADER + int(belief[fields.WIDTH]) * int(belief[fields.HEIGHT])]
        moving = identities_of(cells) > 0
        in_view = self.memory.in_view(belief)
        cells[moving & in_view] = GREY_WALL
        cells[moving & ~in_view] = EMPTY

    def _has_seen_task(self, belief: Row) -> bool:
        """Return whether the cells that the task names have been seen, and for MATCH also the objects to compare."""
        task = int(belief[fields.TASK])
        target = belief[fields.TARGET : fields.TARGET + 4].tolist()
        offsets = {  # by task: where the column of each such cell is in the target; its row follows
            rewards.STAND_BY: (0,),
            rewards.OPEN_DOOR: (0,),
            rewards.MATCH: (0, 2),
            rewards.IN_ORDER: (0, 2),
            rewards.PUT_NEAR: (2,),
        }.get(task, ())
        cells = [target[offset] * int(belief[fields.HEIGHT]) + target[offset + 1] for offset in offsets]
        if not self.memory.seen[cells].all():
            return False
        things = range(1, int(belief[fields.OBJECTS]) + 1) if task == rewards.MATCH else ()
        return all(State(belief).find(identity) is not None for identity in things)

    def _plan_clauses(self, belief: Row) -> list[list[int]]:
        """Return a plan for each clause that is due now and can be planned with what the agent has seen."""
        plans = []
        must_say_done = block(belief)[encoding.FLAGS] & encoding.SAY_DONE
        for clause in active(belief):
            actions = plan_clause(belief, clause)
            if actions is not None:
                plans.append([*actions, rewards.DONE] if must_say_done else list(actions))
        return plans

    def _plan_fetching(self, belief: Row) -> list[list[int]]:
        """Return plans for picking up known objects that clauses want put next to others, if none is carried yet."""
        plans = []
        for clause in active(belief):
            if block(belief)[encoding.CLAUSES + clause * encoding.CLAUSE + encoding.VERB] != encoding.PUT_NEXT:
                continue
            movable = (described_objects(belief) >> 2 * clause & 1).nonzero()[0] + 1
            if identities_of(belief[fields.CARRYING]) in movable:
                continue
            for identity in movable.tolist():
                if State(belief).find(identity) is not None:
                    actions = do_to(belief, encoding.PICK_UP, identity)
                    if actions is not None:
                        plans.append(actions)
        return plans

    def _look_for_more(self, belief: Row) -> list[int]:
        """Return actions that lead to a view of unseen cells, or towards one; empty if nothing is left to try."""
        judgement = self._judgement or (DOOR_WEIGHTS if _seeks_doors(belief) else EXPERT_WEIGHTS)
        if _is_strict(belief):
            allowed = _lock_closed_doors(belief)
        else:
            allowed = belief
        nearest = self.memory.frontier(allowed, judgement=judgement, noise=self._noise)
        if nearest is not None:
            return nearest[0]
        return self._plan_unlocking(belief) or self._plan_clearing(belief, judgement) or self._plan_opening_box(belief)

    def _plan_unlocking(self, belief: Row) -> list[int]:
        """Return the shortest plan that opens a locked door; empty if there is none."""
        state = State(belief)
        locked = state.identities[(state.kinds == DOOR) & (state.states == LOCKED)].tolist()
        plans = (do_to(belief, encoding.OPEN, identity) for identity in locked)
        return min((actions for actions in plans if actions is not None), key=len, default=[])

    def _plan_clearing(self, belief: Row, judgement: FrontierWeights) -> list[int]:
        """Return actions that move the first object out of the way to unseen cells; empty if they fail."""
        beyond = self.memory.frontier(belief, passing=THING_IN_WAY, judgement=judgement)
        if beyond is None:
            return []
        _, path, _ = beyond
        cells = State(belief).cells.ravel()
        occupied = [cell for cell in path if identities_of(cells[cell]) > 0 and kinds_of(cells[cell]) != DOOR]
        if not occupied:
            return []
        trial = belief.copy()
        actions: list[int] = []
        for step in range(3):  # put down what is carried, pick up the object, and put it down elsewhere
            if step != 1:
                part = put_down(trial, path)
            else:
                part = do_to(trial, encoding.PICK_UP, identities_of(cells[occupied[0]]))
            if part is None:
                return []
            for action in part:
                try_action(trial, action)
            actions += part
        return actions

    def _plan_opening_box(self, belief: Row) -> list[int]:
        """Return the shortest plan that opens a box which the instruction does not describe; empty if there is none."""
        state = State(belief)
        boxes = [
            identity
            for identity in state.identities[state.kinds == BOX].tolist()
            if not described_objects(belief)[identity - 1]
        ]
        plans = (do_to(belief, encoding.PICK_UP, identity) for identity in boxes)
        opened = ([*actions[:-1], rewards.TOGGLE] for actions in plans if actions is not None)
        return min(opened, key=len, default=[])


def _is_strict(row: Row) -> bool:
    """Return whether any of the clauses that are due now is strict, so that acting on another object is a failure."""
    return any(clause[encoding.STRICT] != 0 for clause in _active_clauses(row))


def _seeks_doors(row: Row) -> bool:
    """Return whether there are clauses that are due now, and each of them is about a door."""
    kinds = [int(clause[encoding.THING + encoding.KIND]) for clause in _active_clauses(row)]
    return bool(kinds) and all(kind == DOOR for kind in kinds)


def _active_clauses(row: Row) -> list[Row]:
    """Return the encoded clauses that are due now; [] for a task without an instruction."""
    if row[fields.TASK] != rewards.INSTRUCTED:
        return []
    clauses = block(row)[encoding.CLAUSES :].reshape(-1, encoding.CLAUSE)
    return [clauses[number] for number in active(row)]


def _lock_closed_doors(belief: Row) -> Row:
    """Return a copy of the state in which every closed door is locked."""
    locked = belief.copy()
    state = State(locked)
    for x, y in np.argwhere((state.kinds == DOOR) & (state.states == CLOSED)).tolist():
        state.cells[x, y] = in_state(int(state.cells[x, y]), LOCKED)
    return locked


def active(row: Row) -> tuple[int, ...]:
    """Return the numbers of the clauses that are due now; () if all are satisfied.

    They are the unsatisfied clauses of the part to be carried out first, or, if it has none, those of the other part.
    """
    numbers = block(row)
    n_first = int(numbers[encoding.LEFT])
    n_second = int(numbers[encoding.RIGHT])
    groups = [range(n_first), range(n_first, n_first + n_second)]
    if numbers[encoding.JOIN] == encoding.AFTER:
        groups.reverse()
    elif numbers[encoding.JOIN] == encoding.ALONE:
        groups = groups[:1]
    for group in groups:
        waiting = tuple(
            k for k in group if numbers[encoding.CLAUSES + k * encoding.CLAUSE + encoding.STATUS] != encoding.SATISFIED
        )
        if waiting:
            return waiting
    return ()


def _state_after(row: Row, action: int) -> Row:
    """Return a copy of a state after an action that was taken in it."""
    row_after = row.copy()
    try_action(row_after, action)
    return row_after
