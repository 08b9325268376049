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

MAX_DODGING_STATES = 50_000  # searching them takes a second or two
MOST_BYTES = 200_000_000  # of states: in a very large world, fewer are searched


def plan_among_obstacles(start: Row, rng_state: RngState, bound: NDArray[np.int32]) -> list[int] | None:
    """Return the fewest actions to the goal among moving obstacles; None if no actions lead there.

    Args:
        start: the state; it is not changed.
        rng_state: the state of the random stream; it is not changed.
        bound: for each pose [x, y, direction], a lower bound on the number of actions to the goal; FAR for no way.

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
    parents: list[tuple[int, int]] = [(-1, -1)]  # of each state: the number of the one before, and the action between
    limit = min(MAX_DODGING_STATES, MOST_BYTES // row.nbytes)
    waiting = [(least_steps, 0, 0, row, rng_state.copy())]  # of equal estimates, those with most actions come first
    visited = set()
    while waiting:
        _, minus_cost, number, row, stream = heapq.heappop(waiting)
        for action in (rewards.FORWARD, rewards.LEFT, rewards.RIGHT):
            next_row = row.copy()
            next_stream = stream.copy()
            status, reward = act(next_row, action, next_stream)
            if reward > 0:
                return actions_from_start(parents, number, action)
            next_row[fields.STEP] = 0
            state_bytes = next_row.tobytes() + next_stream.tobytes()
            if status != 0 or state_bytes in visited:
                continue
            visited.add(state_bytes)
            parents.append((number, action))
            if len(parents) > limit:
                raise WorldError(
                    f"no path around the obstacles was found after searching {limit} states; make the world smaller"
                )
            cost = 1 - minus_cost
            remaining = int(bound[next_row[fields.X], next_row[fields.Y], next_row[fields.DIRECTION]])
            heapq.heappush(waiting, (cost + remaining, -cost, len(parents) - 1, next_row, next_stream))
    return None


FIRST_LIMIT = 1 << 12  # states in the first search; each further search may have `LIMIT_GROWTH` times as many
LIMIT_GROWTH = 16
MAX_EXACT_STATES = 1 << 18  # states to search for a shortest plan, in half a second, before any plan will do
MANY_OBJECTS = 32  # with more objects a state takes longer, so fewer are searched
FAST_PLAN_STATES = 2, 5, 3  # the weights of the bound in the searches for any plan, in turn


def shortest_path(state: State, rng_state: RngState) -> list[int] | None:
    """Return the fewest actions that succeed, or some more if the fewest would take too long to find.

    Args:
        state: the state from which to start; it is not changed.
        rng_state: the random stream by which obstacles move; it is not changed.

    Returns:
        The actions, or None if no actions succeed.

    Raises:
        WorldError: if no actions were found within some seconds.
    """
    try:
        return plan(state, rng_state, limit=_most_states(state))
    except WorldError:
        if state.row[fields.TASK] in (rewards.DODGE, rewards.INSTRUCTED):
            raise
    return _fast_plan(state, *_lower_bounds(state))


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
        return plan_among_obstacles(row, rng_state, _lower_bounds(state)[0])
    poses, extra = _target_poses(state)
    sources = _pose_numbers(state, poses)
    if len(sources) == 0:
        return None
    bound = distances(row, sources, True)  # through doors and objects
    pose = (*state.position, state.direction)
    if bound[pose] >= FAR:
        return None
    if row[fields.TASK] == rewards.REACH:
        walking = distances(row, sources, False)  # doors and objects block
        if walking[pose] == bound[pose]:
            return descend(walking, *pose)
    return _search_within(row, bound, extra, limit)


def _search_within(row: Row, bound: NDArray[np.int32], extra: int, limit: int) -> list[int] | None:
    """Return the fewest actions that succeed, or None if there are none; search few states at first, then more.

    Args:
        row: the state.
        bound: for each pose [x, y, direction], a lower bound on the number of actions to success, minus ``extra``.
        extra: the number of actions to add to the bound.
        limit: the maximum number of states.

    Raises:
        WorldError: if no plan was found among ``limit`` states, though one may exist.
    """
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
        allowed = min(LIMIT_GROWTH * allowed, limit)


def _follow_instruction(state: State) -> list[int] | None:
    """Return actions that carry out a state's instruction, or None if certainly no actions do.

    Raises:
        WorldError: if the search gave up.
    """
    from minihuman.worlds.grid.babyai.expert import plan_instruction  # compiled: only where it is used

    instruction_plan = plan_instruction(state.row)
    if instruction_plan.found:
        return list(instruction_plan.actions)
    if instruction_plan.unsolvable:
        return None
    raise WorldError(
        "the search for a plan gave up, though one may exist; use a smaller world or a simpler instruction"
    )


def _instruction_bounds(state: State) -> PathLengthBounds:
    """Return bounds on the number of actions that carry out a state's instruction; unknown if no actions do.

    The upper bound is None if no plan was found.
    """
    from minihuman.worlds.grid.babyai.expert import plan_instruction

    instruction_plan = plan_instruction(state.row)
    if instruction_plan.unsolvable:
        return UNKNOWN_BOUNDS
    plan_length = len(instruction_plan.actions) if instruction_plan.found else None
    return PathLengthBounds(instruction_plan.at_least, plan_length)


def path_length_bounds(state: State, rng_state: RngState) -> PathLengthBounds:
    """Return bounds on the number of actions to success, with obstacles that move by ``rng_state``.

    Both are the exact number if it is found in time. Otherwise the first is a lower bound, and the second the length of
    some plan, or None if no plan was found. Both are unknown if no actions succeed.
    """
    if state.row[fields.TASK] == rewards.INSTRUCTED:
        return _instruction_bounds(state)
    bound, extra = _lower_bounds(state)
    at_least = int(bound[(*state.position, state.direction)]) + extra
    try:
        exact_plan = plan(state, rng_state, limit=_most_states(state))
    except WorldError:
        return PathLengthBounds(at_least, _fast_plan_length(state, bound, extra))
    if exact_plan is None:
        return UNKNOWN_BOUNDS
    return PathLengthBounds(len(exact_plan), len(exact_plan))


def _fast_plan_length(state: State, bound: NDArray[np.int32], extra: int) -> int | None:
    """Return the length of the plan of `_fast_plan`; None if it finds none, or if obstacles move.

    ``bound`` and ``extra`` are those of `_lower_bounds`.
    """
    if state.row[fields.TASK] == rewards.DODGE:
        return None
    try:
        actions = _fast_plan(state, bound, extra)
    except WorldError:
        return None
    return None if actions is None else len(actions)


def _fast_plan(state: State, bound: NDArray[np.int32], extra: int) -> list[int] | None:
    """Return actions that succeed, found soon but not always the fewest; None if there are none.

    ``bound`` and ``extra`` are those of `_lower_bounds`.

    Raises:
        WorldError: if no search with one of the weights in `FAST_PLAN_STATES` ended in time.
    """
    for weight in FAST_PLAN_STATES:
        outcome, actions = search(state.row, bound, extra, _most_states(state), np.zeros(6, np.uint64), weight)
        if outcome != FULL:
            if outcome == FOUND:
                return actions.tolist()
            return None
    raise WorldError("no path to the target was found; make the world smaller, or use fewer movable objects")


def _most_states(state: State) -> int:
    """Return the number of states that a search takes about half a second to visit."""
    return MAX_EXACT_STATES * MANY_OBJECTS // max(MANY_OBJECTS, int(state.row[fields.OBJECTS]))


def walk(state: State, poses: NDArray[np.int64]) -> list[int] | None:
    """Return the fewest turns and steps to one of the poses (n, 3: x, y, direction), or None if none can be reached.

    Doors and objects block the way.
    """
    steps = distances(state.row, _pose_numbers(state, poses), False)  # doors and objects block
    pose = (*state.position, state.direction)
    if steps[pose] >= FAR:
        return None
    return descend(steps, *pose)


def _lower_bounds(state: State) -> tuple[NDArray[np.int32], int]:
    """Return a lower bound on the number of actions from each pose to success, in two parts that add up.

    The parts are int32[width, height, 4], the actions from each pose to the nearest of `_target_poses` (FAR if there is
    no way), and the minimum number of actions after it.
    """
    poses, extra = _target_poses(state)
    return distances(state.row, _pose_numbers(state, poses), True), extra  # through doors and objects


def _target_poses(state: State) -> tuple[NDArray[np.int64], int]:
    """Return the poses of which the agent must reach one, and the minimum number of actions from there to success.

    The poses are int64[n, 3], with column, row and direction; some may lie outside the grid.
    """
    row = state.row
    task = int(row[fields.TASK])
    target = row[fields.TARGET : fields.TARGET + 4].tolist()
    kinds = state.kinds
    colours = state.colours
    if task in (rewards.REACH, rewards.DODGE):
        return _poses_in(np.argwhere(kinds == GOAL)), 0
    if task == rewards.MATCH:
        return _poses_in(np.array([target[:2]])), 0
    if task == rewards.STAND_BY:
        return _poses_in(np.add(target[:2], STEPS)), 1
    if task == rewards.PICK:
        cells = np.argwhere(state.identities == target[0])
        if len(cells):
            return (facing(cells), 1)
        return (_all_poses(state), 0)
    if task == rewards.FETCH:
        return facing(np.argwhere((kinds == target[0]) & (colours == target[1]))), 1
    if task == rewards.OPEN_DOOR:
        return facing(np.array([target[:2]])), 1
    if task == rewards.IN_ORDER and not is_open(row, *target[:2]):
        return facing(np.array([target[:2]])), 2
    if task == rewards.IN_ORDER:
        return facing(np.array([target[2:]])), 1
    assert task == rewards.PUT_NEAR
    return _all_poses(state), 0


def _pose_numbers(state: State, poses: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the numbers of those of the poses, int64[n, 3], that lie in the grid, as `distances` takes them."""
    x, y, direction = poses.T
    is_inside = (x >= 0) & (y >= 0) & (x < state.width) & (y < state.height)
    numbers: NDArray[np.int64] = (x * state.height + y) * 4 + direction
    return numbers[is_inside]


def _poses_in(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the poses in cells: for ``cells``, int64[n, 2] of columns and rows, int64[4 * n, 3] with the direction."""
    return np.array([(x, y, direction) for x, y in cells for direction in range(4)], np.int64).reshape(-1, 3)


def facing(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the four poses that face each cell from next to it; some may lie outside the grid.

    Args:
        cells: the column and row of each cell, int64[n, 2].

    Returns:
        The column, row and direction of each pose, int64[4 * n, 3], those of the first cell first.
    """
    poses = [(x - dx, y - dy, direction) for x, y in cells for direction, (dx, dy) in enumerate(STEPS)]
    return np.array(poses, np.int64).reshape(-1, 3)


def _all_poses(state: State) -> NDArray[np.int64]:
    return _poses_in(np.argwhere(np.ones(state.cells.shape, bool)))
