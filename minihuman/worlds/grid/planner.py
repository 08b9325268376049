"""The expert: shortest lists of actions on the real rules, turns counted."""

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import UNKNOWN, Bounds
from minihuman.worlds.grid.core.cells import GOAL
from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.directions import STEPS
from minihuman.worlds.grid.core.search import FAR, FOUND, FULL, distances, search
from minihuman.worlds.grid.core.state import OBJECTS, TARGET, TASK, State
from minihuman.worlds.grid.core.tasks import (
    DODGE,
    FETCH,
    FORWARD,
    IN_ORDER,
    INSTRUCTED,
    LEFT,
    MATCH,
    OPEN_DOOR,
    PICK,
    PUT_NEAR,
    REACH,
    RIGHT,
    STAND_BY,
    is_open,
)
from minihuman.worlds.grid.dodging import among_obstacles

FIRST_LIMIT = 1 << 12  # nodes of the first search; each next one may keep 16 times as many
MOST_STATES = 1 << 18  # nodes after which a way need no longer be the shortest; half a second,
MANY_OBJECTS = 32  # where there are no more things than this: with more, a node takes longer
HURRIED = 2, 5, 3  # how many times the bound counts then, one after the other


def way(state: State, words: Words) -> list[int] | None:
    """A list of actions that succeeds: the shortest, or where that takes too long to find, one a little longer.

    None if there is none.

    Raises:
        WorldError: if no such list was found in some seconds either.
    """
    try:
        return plan(state, words, limit=_most_states(state))
    except WorldError:
        if state.row[TASK] in (DODGE, INSTRUCTED):
            raise
    return _in_a_hurry(state, *_relaxed(state))


def plan(state: State, words: Words | None = None, *, limit: int = 1 << 20) -> list[int] | None:
    """The shortest list of actions that succeeds from this state, which is not changed; None if there is none.

    The step limit is not looked at. Doors, keys, boxes and things in the way are dealt with by search, which is
    exact and grows with the number of things that can be moved. Instructions are planned clause by clause, which
    need not be the shortest: ``instructions.planner`` says how short it can be at best.

    Args:
        state: Where to start.
        words: Where the random stream is, by which obstacles move; it is not changed. Without it, they are not planned.
        limit: States to look at before giving up; 2**20 take about a second and 200 MB.

    Raises:
        WorldError: if the search gave up, or obstacles move and it is not known how.
    """
    row = state.row
    if row[TASK] == INSTRUCTED:
        return _do_as_told(state)
    if row[TASK] == DODGE:
        if words is None:
            raise WorldError("obstacles move by chance in this world; no list of actions is sure to succeed")
        return among_obstacles(row, words, _relaxed(state)[0])
    poses, extra = _nearest(state)
    sources = _numbers(state, poses)
    if len(sources) == 0:
        return None
    bound = distances(row, sources, True)
    here = (*state.position, state.direction)
    if bound[here] >= FAR:
        return None
    if row[TASK] == REACH:
        walking = distances(row, sources, False)
        if walking[here] == bound[here]:
            return descend(walking, *here)
    allowed = min(FIRST_LIMIT, limit)
    while True:
        outcome, actions = search(row, bound, extra, allowed, np.zeros(6, np.uint64), 1)
        if outcome == FOUND:
            return [int(action) for action in actions]
        if outcome != FULL:
            return None
        if allowed == limit:
            raise WorldError(f"no plan among the first {limit} states; give plan() a larger limit, or a smaller world")
        allowed = min(16 * allowed, limit)


def _do_as_told(state: State) -> list[int] | None:
    from minihuman.worlds.grid.instructions.planner import plan_instruction  # compiled: only where it is used

    way = plan_instruction(state.row)
    if not way.found and not way.unsolvable:
        raise WorldError("no plan was found for this instruction in the states looked at; there may be one")
    return list(way.actions) if way.found else None


def _bounds_as_told(state: State) -> Bounds:
    from minihuman.worlds.grid.instructions.planner import plan_instruction

    way = plan_instruction(state.row)
    return UNKNOWN if way.unsolvable else Bounds(way.at_least, len(way.actions) if way.found else None)


def bounds(state: State, words: Words) -> Bounds:
    """How many actions success takes: the shortest list's number, or from the least there can be to what was found."""
    if state.row[TASK] == INSTRUCTED:
        return _bounds_as_told(state)
    table, extra = _relaxed(state)
    at_least = int(table[(*state.position, state.direction)]) + extra
    try:
        exact = plan(state, words, limit=_most_states(state))
        return UNKNOWN if exact is None else Bounds(len(exact), len(exact))
    except WorldError:
        pass
    try:
        found = None if state.row[TASK] == DODGE else _in_a_hurry(state, table, extra)
        return Bounds(at_least, None if found is None else len(found))
    except WorldError:
        return Bounds(at_least)


def _in_a_hurry(state: State, table: NDArray[np.int32], extra: int) -> list[int] | None:
    for weight in HURRIED:
        outcome, actions = search(state.row, table, extra, _most_states(state), np.zeros(6, np.uint64), weight)
        if outcome != FULL:
            return actions.tolist() if outcome == FOUND else None
    raise WorldError("no way was found to what is asked for; make the world smaller, or its movable things fewer")


def _most_states(state: State) -> int:
    return MOST_STATES * MANY_OBJECTS // max(MANY_OBJECTS, int(state.row[OBJECTS]))


def walk(state: State, poses: NDArray[np.int64]) -> list[int] | None:
    """The shortest list of turns and steps to one of the poses (n, 3: x, y, direction); None if there is none."""
    steps = distances(state.row, _numbers(state, poses), False)
    here = (*state.position, state.direction)
    return None if steps[here] >= FAR else descend(steps, *here)


def _relaxed(state: State) -> tuple[NDArray[np.int32], int]:
    """At least how many actions each pose is away from the last ones of a plan, and how many those are."""
    poses, extra = _nearest(state)
    return distances(state.row, _numbers(state, poses), True), extra


def _nearest(state: State) -> tuple[NDArray[np.int64], int]:
    """Poses of which one must be reached, and how many actions at least follow."""
    row = state.row
    task, target = int(row[TASK]), row[TARGET : TARGET + 4].tolist()
    kinds, colours = state.kinds, state.colours
    if task in (REACH, DODGE):
        return _standing(np.argwhere(kinds == GOAL)), 0
    if task == MATCH:
        return _standing(np.array([target[:2]])), 0
    if task == STAND_BY:
        return _standing(np.add(target[:2], ((1, 0), (-1, 0), (0, 1), (0, -1)))), 1
    if task == PICK:
        found = np.argwhere(state.cells >> 9 == target[0])
        return (facing(found), 1) if len(found) else (_anywhere(state), 0)
    if task == FETCH:
        return facing(np.argwhere((kinds == target[0]) & (colours == target[1]))), 1
    if task == OPEN_DOOR:
        return facing(np.array([target[:2]])), 1
    if task == IN_ORDER and not is_open(row, *target[:2]):
        return facing(np.array([target[:2]])), 2
    if task == IN_ORDER:
        return facing(np.array([target[2:]])), 1
    assert task == PUT_NEAR
    return _anywhere(state), 0


def _numbers(state: State, poses: NDArray[np.int64]) -> NDArray[np.int64]:
    """Pose numbers of the poses that lie in the grid."""
    x, y, direction = poses.T
    inside = (x >= 0) & (y >= 0) & (x < state.width) & (y < state.height)
    numbers: NDArray[np.int64] = (x * state.height + y) * 4 + direction
    return numbers[inside]


def _standing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.array([(x, y, direction) for x, y in cells for direction in range(4)], np.int64).reshape(-1, 3)


def facing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """The poses before cells (n, 2), looking at them."""
    poses = [(x - dx, y - dy, direction) for x, y in cells for direction, (dx, dy) in enumerate(STEPS)]
    return np.array(poses, np.int64).reshape(-1, 3)


def _anywhere(state: State) -> NDArray[np.int64]:
    return _standing(np.argwhere(np.ones(state.cells.shape, bool)))


def descend(steps: NDArray[np.int32], x: int, y: int, direction: int) -> list[int]:
    """Walk down the distances to where they are 0."""
    actions = []
    while steps[x, y, direction] > 0:
        dx, dy = STEPS[direction]
        choices = {
            FORWARD: (x + dx, y + dy, direction),
            LEFT: (x, y, (direction + 3) % 4),
            RIGHT: (x, y, (direction + 1) % 4),
        }
        for action, pose in choices.items():
            inside = 0 <= pose[0] < len(steps) and 0 <= pose[1] < steps.shape[1]
            if inside and steps[pose] == steps[x, y, direction] - 1:
                actions.append(action)
                x, y, direction = pose
                break
    return actions
