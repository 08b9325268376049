"""The planner: shortest lists of actions under the real rules, with turns counted, and bounds on their length.

Among moving obstacles, it plans with the moves that they will make by the world's own random stream. No player knows
that stream: the plan is the shortest one that could have succeeded in hindsight.
"""

import heapq

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import UNKNOWN_BOUNDS, PathLengthBounds, actions_from_start
from minihuman.worlds.grid.core import rewards
from minihuman.worlds.grid.core import state as fields
from minihuman.worlds.grid.core.cells import GOAL, STEPS
from minihuman.worlds.grid.core.rewards import is_open
from minihuman.worlds.grid.core.rules import act
from minihuman.worlds.grid.core.search import FAR, FOUND, FULL, distances, search
from minihuman.worlds.grid.core.state import Row, State
from minihuman.worlds.grid.descent import descend
from minihuman.worlds.rng import RngState

MAX_DODGING_STATES = 50_000  # a second or two
MOST_BYTES = 200_000_000  # of states: fewer are looked at in a world that is very large


def plan_among_obstacles(start: Row, rng_state: RngState, bound: NDArray[np.int32]) -> list[int] | None:
    """Return the fewest actions to the goal among moving obstacles; None if there is no way even without obstacles.

    Args:
        start: the state; it is not changed.
        rng_state: the state of the random stream; it is not changed.
        bound: for each pose, a lower bound on the number of actions to the goal.

    Raises:
        WorldError: if the search gave up.
    """
    row = start.copy()
    row[fields.MAX_STEPS] = FAR
    row[fields.STEP] = 0
    row[fields.PHASE] = fields.PLAYING
    least_steps = int(bound[row[fields.X], row[fields.Y], row[fields.DIRECTION]])
    if least_steps >= FAR:
        return None
    parents: list[tuple[int, int]] = [(-1, -1)]  # of each state: the one before, and the action between
    most = min(MAX_DODGING_STATES, MOST_BYTES // row.nbytes)
    waiting = [(least_steps, 0, 0, row, rng_state.copy())]
    visited = set()
    while waiting:
        _, minus_cost, number, row, stream = heapq.heappop(waiting)
        for action in (rewards.FORWARD, rewards.LEFT, rewards.RIGHT):
            after = row.copy()
            next_stream = stream.copy()
            status, reward = act(after, action, next_stream)
            if reward > 0:
                return actions_from_start(parents, number, action)
            after[fields.STEP] = 0
            known = after.tobytes() + next_stream.tobytes()
            if status != 0 or known in visited:
                continue
            visited.add(known)
            parents.append((number, action))
            if len(parents) > most:
                raise WorldError(
                    f"no path around the obstacles was found after searching {most} states; make the world smaller"
                )
            cost = 1 - minus_cost
            left = int(bound[after[fields.X], after[fields.Y], after[fields.DIRECTION]])
            heapq.heappush(waiting, (cost + left, -cost, len(parents) - 1, after, next_stream))
    return None


FIRST_LIMIT = 1 << 12  # nodes of the first search; each next one may keep 16 times as many
MAX_EXACT_STATES = 1 << 18  # nodes after which a way need no longer be the shortest; half a second,
MANY_OBJECTS = 32  # where there are no more things than this: with more, a node takes longer
FAST_PLAN_STATES = 2, 5, 3  # how many times the bound counts then, one after the other


def shortest_path(state: State, rng_state: RngState) -> list[int] | None:
    """Return the fewest actions that succeed, or a few more if the fewest would take too long to find.

    Return None if no actions succeed.

    Raises:
        WorldError: if no such actions were found within some seconds.
    """
    try:
        return plan(state, rng_state, limit=_most_states(state))
    except WorldError:
        if state.row[fields.TASK] in (rewards.DODGE, rewards.INSTRUCTED):
            raise
    return _fast_plan(state, *_relaxed(state))


def plan(state: State, rng_state: RngState | None = None, *, limit: int = 1 << 20) -> list[int] | None:
    """Return the fewest actions that succeed from a state, or None if there are none.

    The state is not changed, and its step limit is ignored. Doors, keys, boxes and obstacles are handled by a search,
    which is exact, and whose time grows with the number of movable objects. Instructions are planned clause by clause,
    which need not give the shortest plan: ``babyai.expert`` gives a lower bound.

    Args:
        state: the state from which to start.
        rng_state: the random stream by which obstacles move; it is not changed. None if no obstacles move.
        limit: the number of states to search before giving up; 2**20 take about a second and 200 MB.

    Raises:
        WorldError: if the search gave up, or obstacles move and no stream is given.
    """
    row = state.row
    if row[fields.TASK] == rewards.INSTRUCTED:
        return _follow_instruction(state)
    if row[fields.TASK] == rewards.DODGE:
        if rng_state is None:
            raise WorldError(
                "obstacles move at random in this world, so no fixed plan is sure to succeed; pass rng_state to plan "
                "for one course of events"
            )
        return plan_among_obstacles(row, rng_state, _relaxed(state)[0])
    poses, extra = _nearest(state)
    sources = _numbers(state, poses)
    if len(sources) == 0:
        return None
    bound = distances(row, sources, True)
    pose = (*state.position, state.direction)
    if bound[pose] >= FAR:
        return None
    if row[fields.TASK] == rewards.REACH:
        walking = distances(row, sources, False)
        if walking[pose] == bound[pose]:
            return descend(walking, *pose)
    return _search_within(row, bound, extra, limit)


def _search_within(row: Row, bound: NDArray[np.int32], extra: int, limit: int) -> list[int] | None:
    """Search for the fewest actions, at first among few states, then among more, up to ``limit``."""
    allowed = min(FIRST_LIMIT, limit)
    while True:
        outcome, actions = search(row, bound, extra, allowed, np.zeros(6, np.uint64), 1)
        if outcome == FOUND:
            return [int(action) for action in actions]
        if outcome != FULL:
            return None
        if allowed == limit:
            raise WorldError(
                f"no plan was found in the first {limit} states; give plan() a larger limit, or make the world smaller"
            )
        allowed = min(16 * allowed, limit)


def _follow_instruction(state: State) -> list[int] | None:
    from minihuman.worlds.grid.babyai.expert import plan_instruction  # compiled: only where it is used

    way = plan_instruction(state.row)
    if not way.found and not way.unsolvable:
        raise WorldError(
            "the search for a plan gave up, though one may exist; use a smaller world or a simpler instruction"
        )
    return list(way.actions) if way.found else None


def _instruction_bounds(state: State) -> PathLengthBounds:
    from minihuman.worlds.grid.babyai.expert import plan_instruction

    way = plan_instruction(state.row)
    if way.unsolvable:
        return UNKNOWN_BOUNDS
    return PathLengthBounds(way.at_least, len(way.actions) if way.found else None)


def path_length_bounds(state: State, rng_state: RngState) -> PathLengthBounds:
    """Return the exact number of actions to success as both bounds, or a lower bound and the length of a known plan."""
    if state.row[fields.TASK] == rewards.INSTRUCTED:
        return _instruction_bounds(state)
    table, extra = _relaxed(state)
    at_least = int(table[(*state.position, state.direction)]) + extra
    try:
        exact = plan(state, rng_state, limit=_most_states(state))
        if exact is None:
            return UNKNOWN_BOUNDS
        return PathLengthBounds(len(exact), len(exact))
    except WorldError:
        pass
    try:
        if state.row[fields.TASK] == rewards.DODGE:
            actions = None
        else:
            actions = _fast_plan(state, table, extra)
        return PathLengthBounds(at_least, None if actions is None else len(actions))
    except WorldError:
        return PathLengthBounds(at_least)


def _fast_plan(state: State, table: NDArray[np.int32], extra: int) -> list[int] | None:
    for weight in FAST_PLAN_STATES:
        outcome, actions = search(state.row, table, extra, _most_states(state), np.zeros(6, np.uint64), weight)
        if outcome != FULL:
            if outcome == FOUND:
                return actions.tolist()
            return None
    raise WorldError("no path to the target was found; make the world smaller, or use fewer movable objects")


def _most_states(state: State) -> int:
    return MAX_EXACT_STATES * MANY_OBJECTS // max(MANY_OBJECTS, int(state.row[fields.OBJECTS]))


def walk(state: State, poses: NDArray[np.int64]) -> list[int] | None:
    """Return the fewest turns and steps to one of the poses (n, 3: x, y, direction), or None if none can be reached."""
    steps = distances(state.row, _numbers(state, poses), False)
    pose = (*state.position, state.direction)
    if steps[pose] >= FAR:
        return None
    return descend(steps, *pose)


def _relaxed(state: State) -> tuple[NDArray[np.int32], int]:
    """Return a lower bound on the actions from each pose to a pose of `_nearest`, and the number needed there."""
    poses, extra = _nearest(state)
    return distances(state.row, _numbers(state, poses), True), extra


def _nearest(state: State) -> tuple[NDArray[np.int64], int]:
    """Return the poses of which the agent must reach one, and the minimum number of actions that it takes there."""
    row = state.row
    task = int(row[fields.TASK])
    target = row[fields.TARGET : fields.TARGET + 4].tolist()
    kinds = state.kinds
    colours = state.colours
    if task in (rewards.REACH, rewards.DODGE):
        return _standing(np.argwhere(kinds == GOAL)), 0
    if task == rewards.MATCH:
        return _standing(np.array([target[:2]])), 0
    if task == rewards.STAND_BY:
        return _standing(np.add(target[:2], ((1, 0), (-1, 0), (0, 1), (0, -1)))), 1
    if task == rewards.PICK:
        cells = np.argwhere(state.identities == target[0])
        if len(cells):
            return (facing(cells), 1)
        return (_anywhere(state), 0)
    if task == rewards.FETCH:
        return facing(np.argwhere((kinds == target[0]) & (colours == target[1]))), 1
    if task == rewards.OPEN_DOOR:
        return facing(np.array([target[:2]])), 1
    if task == rewards.IN_ORDER and not is_open(row, *target[:2]):
        return facing(np.array([target[:2]])), 2
    if task == rewards.IN_ORDER:
        return facing(np.array([target[2:]])), 1
    assert task == rewards.PUT_NEAR
    return _anywhere(state), 0


def _numbers(state: State, poses: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of those poses that lie in the grid."""
    x, y, direction = poses.T
    inside = (x >= 0) & (y >= 0) & (x < state.width) & (y < state.height)
    numbers: NDArray[np.int64] = (x * state.height + y) * 4 + direction
    return numbers[inside]


def _standing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.array([(x, y, direction) for x, y in cells for direction in range(4)], np.int64).reshape(-1, 3)


def facing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the poses next to cells (n, 2) that face them."""
    poses = [(x - dx, y - dy, direction) for x, y in cells for direction, (dx, dy) in enumerate(STEPS)]
    return np.array(poses, np.int64).reshape(-1, 3)


def _anywhere(state: State) -> NDArray[np.int64]:
    return _standing(np.argwhere(np.ones(state.cells.shape, bool)))
