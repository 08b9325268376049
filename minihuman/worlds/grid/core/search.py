"""Best-first search over the states that a grid world can reach under its own rules.

A node is the part of the state that actions can change, packed into int32: the agent's x, y and direction, the object
in hand, the object put down last, and for each object its cell and state. An action costs 1 and the heuristic never
overestimates, so the first success found is a shortest one.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    DOOR,
    EMPTY,
    GOAL,
    LAVA,
    OPEN,
    WALL,
    ahead,
    identity_of,
    in_state,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.rewards import (
    DONE,
    DROP,
    FORWARD,
    LEFT,
    PICKUP,
    PUT_NEAR,
    RIGHT,
    STAND_BY,
    TOGGLE,
    cell_in_front,
)
from minihuman.worlds.grid.core.rules import act
from minihuman.worlds.grid.core.state import (
    CARRYING,
    DIRECTION,
    HEADER,
    HEIGHT,
    MAX_STEPS,
    NOWHERE,
    OBJECTS,
    PHASE,
    PLAYING,
    STEP,
    TASK,
    WIDTH,
    Row,
    X,
    Y,
    can_enter,
    contents_index,
    lift,
    put,
    where_is,
)
from minihuman.worlds.kernels import device_function, kernel
from minihuman.worlds.rng import RngState

FAR = 1 << 20  # more actions than any plan has
# how a search ends: a plan, no plan exists, too many nodes
FOUND = 0
NONE = 1
FULL = 2

# places in a node, after x, y and direction
_HELD = 3
LAST = 4
_OBJECTS = 5
_STATE_BIT = 24  # a cell number plus one is in the bits below


@kernel("(int32[::1], int64[::1], boolean)")
def distances(row: Row, sources: NDArray[np.int64], through: bool) -> NDArray[np.int32]:
    """Return the number of turns and steps from each pose (x, y, direction) to the nearest source; FAR without a path.

    Args:
        row: the state.
        sources: the numbers of the source poses, (x * height + y) * 4 + direction.
        through: whether doors and objects can be walked through, which gives a lower bound; if not, they block.
    """
    width = np.int64(row[WIDTH])
    height = np.int64(row[HEIGHT])
    steps = np.full(width * height * 4, FAR, np.int32)  # by pose number (x * height + y) * 4 + direction
    queue = np.empty(len(steps), np.int64)
    tail = 0
    for pose in sources:
        if steps[pose] == FAR:
            steps[pose] = 0
            queue[tail] = pose
            tail += 1
    head = 0
    while head < tail:
        pose = queue[head]
        head += 1
        direction = pose & 3
        x = (pose >> 2) // height
        y = (pose >> 2) % height
        for move in range(3):  # the poses before a left turn, a right turn, a step forward
            from_x = x
            from_y = y
            before = direction
            if move < 2:
                before = (direction + 1 + 2 * move) & 3
            else:
                from_x, from_y = ahead(x, y, direction ^ 2)
                if not stands_or_ends(row, row[HEADER + x * height + y], through):
                    continue
            if from_x < 0 or from_y < 0 or from_x >= width or from_y >= height:
                continue
            other = (from_x * height + from_y) * 4 + before
            if steps[other] == FAR and stands(row, row[HEADER + from_x * height + from_y], through):
                steps[other] = steps[pose] + 1
                queue[tail] = other
                tail += 1
    return steps.reshape((width, height, 4))


@device_function()
def stands(row: Row, code: int, through: bool) -> bool:
    """Return whether the agent can stand in a cell without ending the episode; ``through`` is as in `distances`."""
    kind = kind_of(code)
    if kind == WALL or kind == LAVA or kind == GOAL:
        return False
    return through or can_enter(row, code)


@device_function()
def stands_or_ends(row: Row, code: int, through: bool) -> bool:
    """Return whether the agent can step into a cell without failing; the step may end the episode with success."""
    return kind_of(code) == GOAL or stands(row, code, through)


class Frontier(NamedTuple):
    """The nodes that a search has reached, and those to expand next, in buckets by the estimated length of the plan."""

    nodes: NDArray[np.int32]  # (limit, length of a node)
    cost: NDArray[np.int32]  # actions from the start
    parent: NDArray[np.int32]  # -1 at the start
    cause: NDArray[np.int8]  # the action from the parent
    closed: NDArray[np.bool_]  # expanded
    table: NDArray[np.int32]  # open addressing: nodes by their content
    bucket: NDArray[np.int64]  # by estimate: the newest entry, -1 for none
    entry_node: NDArray[np.int32]
    entry_next: NDArray[np.int64]
    counters: NDArray[np.int64]


_N_NODES, _N_ENTRIES, _ESTIMATE, _DROPPED = range(4)  # places in the counters


@device_function()
def open_frontier(row: Row, limit: int, estimate: int) -> Frontier:
    """Return a frontier that holds only the given state, with space for ``limit`` nodes.

    ``estimate`` is the estimated length of the plan from that state, already multiplied by the search's weight.
    """
    # far more estimates than plans reach; `push` notes an estimate that has no bucket
    n_buckets = (1 << 14) + 16 * (estimate + row[OBJECTS] * (row[WIDTH] + row[HEIGHT]))
    frontier = Frontier(
        np.empty((limit, _OBJECTS + row[OBJECTS]), np.int32),
        np.empty(limit, np.int32),
        np.empty(limit, np.int32),
        np.empty(limit, np.int8),
        np.zeros(limit, np.bool_),
        np.full(4 * limit, -1, np.int32),
        np.full(n_buckets, -1, np.int64),
        np.empty(4 * limit, np.int32),
        np.empty(4 * limit, np.int64),
        np.zeros(4, np.int64),
    )
    store(row, frontier.nodes[0], 0)
    frontier.cost[0] = 0
    frontier.parent[0] = -1
    frontier.cause[0] = -1
    frontier.table[slot(frontier.nodes, frontier.table, 0)] = 0
    frontier.bucket[estimate] = 0
    frontier.entry_node[0] = 0
    frontier.entry_next[0] = -1
    frontier.counters[_N_NODES] = 1
    frontier.counters[_N_ENTRIES] = 1
    frontier.counters[_ESTIMATE] = estimate
    return frontier


@device_function(force_inline=True)
def pop(frontier: Frontier) -> int:
    """Remove the newest of the nodes with the lowest estimate, and return its number; return -1 if none is left."""
    bucket = frontier.bucket
    estimate = frontier.counters[_ESTIMATE]
    while estimate < len(bucket):
        entry = bucket[estimate]
        if entry < 0:
            estimate += 1
            continue
        bucket[estimate] = frontier.entry_next[entry]
        node = int(frontier.entry_node[entry])
        if not frontier.closed[node]:
            frontier.closed[node] = True
            frontier.counters[_ESTIMATE] = estimate
            return node
    frontier.counters[_ESTIMATE] = estimate
    return -1


@device_function(force_inline=True)
def push(
    frontier: Frontier, row: Row, node: int, action: int, carried_before: int, heuristic: int, weight: int
) -> bool:
    """Add the state after an action, unless it is known at no higher cost; return False if there is no space.

    Args:
        frontier: the nodes that the search has reached.
        row: the state after the action.
        node: the node in which the action was taken.
        action: the action.
        carried_before: the identity of the object in hand before the action.
        heuristic: the estimated number of actions from the state to success; FAR if success is impossible.
        weight: the factor by which the heuristic is multiplied.
    """
    nodes = frontier.nodes
    cost = frontier.cost
    counters = frontier.counters
    count = counters[_N_NODES]
    entry = counters[_N_ENTRIES]
    if count == len(nodes) or entry == len(frontier.entry_node):
        return False
    last = int(nodes[node, LAST])
    if action == DROP:
        last = carried_before
    elif action == PICKUP:
        last = 0
    store(row, nodes[count], last)
    place = slot(nodes, frontier.table, count)
    known = int(frontier.table[place])
    if known < 0:
        known = count
        frontier.table[place] = count
        counters[_N_NODES] = count + 1
    elif frontier.closed[known] or cost[known] <= cost[node] + 1:
        return True
    cost[known] = cost[node] + 1
    frontier.parent[known] = node
    frontier.cause[known] = action
    if heuristic >= FAR:
        return True
    estimate = weight * heuristic + cost[known]
    if estimate >= len(frontier.bucket):
        counters[_DROPPED] = 1
        return True
    frontier.entry_node[entry], frontier.entry_next[entry] = known, frontier.bucket[estimate]
    frontier.bucket[estimate] = entry
    counters[_N_ENTRIES] = entry + 1
    counters[_ESTIMATE] = min(counters[_ESTIMATE], estimate)
    return True


@device_function()
def exhausted(frontier: Frontier) -> int:
    """Return the outcome of a search with nothing left to expand: NONE, or FULL if an estimate had no bucket."""
    if frontier.counters[_DROPPED]:
        return FULL
    return NONE


@kernel("(int32[::1], int32[:, :, ::1], int64, int64, uint64[::1], int64)")
def search(
    start: Row, bound: NDArray[np.int32], extra: int, limit: int, rng_state: RngState, weight: int
) -> tuple[int, NDArray[np.int64]]:
    """Search for a shortest list of actions to success.

    Args:
        start: the state; it is not changed.
        bound: for each pose, a lower bound on the number of actions to success, minus ``extra``.
        extra: the number of actions to add to the bound.
        limit: the maximum number of nodes.
        rng_state: scratch space for the rules, which take a random stream but do not draw from it here.
        weight: the factor by which the bound is multiplied: 1 finds a shortest list, a larger one finds a list sooner.

    Returns:
        FOUND and the actions, or NONE or FULL and no actions.
    """
    row = start.copy()
    row[MAX_STEPS] = FAR
    row[PHASE] = PLAYING
    codes = object_codes(row)
    may_drop = count_carriable(codes) > 1 or row[TASK] == PUT_NEAR
    none = np.empty(0, np.int64)
    heuristic = bound[row[X], row[Y], row[DIRECTION]] + extra
    if heuristic >= FAR:
        return NONE, none
    frontier = open_frontier(row, limit, weight * heuristic)
    node = pop(frontier)
    while node >= 0:
        for action in range(7):
            load(row, frontier.nodes[node], codes)
            if not may_shorten_plan(row, action, frontier.nodes[node, LAST], may_drop):
                continue
            carried_before = identity_of(row[CARRYING])
            row[STEP] = 0
            row[PHASE] = PLAYING
            status, reward = act(row, action, rng_state)
            if status > 0:
                if reward > 0:
                    return FOUND, actions_to_node(frontier.parent, frontier.cause, node, action)
                continue
            heuristic = bound[row[X], row[Y], row[DIRECTION]] + extra
            if not push(frontier, row, node, action, carried_before, heuristic, weight):
                return FULL, none
        node = pop(frontier)
    return exhausted(frontier), none


@device_function()
def may_shorten_plan(row: Row, action: int, last: int, may_drop: bool) -> bool:
    """Return whether a shortest plan can have an action in this state.

    It never closes a door, picks up the object that was put down last (``last`` is its identity, 0 for none), or puts
    anything down unless ``may_drop``, which is False if one object alone can be carried and need not be put anywhere.
    """
    if action == LEFT or action == RIGHT or action == FORWARD:
        return True
    x, y = cell_in_front(row)
    if x < 0 or y < 0 or x >= row[WIDTH] or y >= row[HEIGHT]:
        return action == DONE and row[TASK] == STAND_BY
    code = row[HEADER + x * row[HEIGHT] + y]
    if action == PICKUP:
        return row[CARRYING] == EMPTY and identity_of(code) > 0 and identity_of(code) != last
    if action == DROP:
        return may_drop and row[CARRYING] != EMPTY and code == EMPTY
    if action == TOGGLE:
        return identity_of(code) > 0 and not (kind_of(code) == DOOR and state_of(code) == OPEN)
    return row[TASK] == STAND_BY


@device_function()
def object_codes(row: Row) -> NDArray[np.int64]:
    """Return the code of each object, by identity - 1, wherever it is; 0 for an object that is gone."""
    objects = row[OBJECTS]
    codes = np.zeros(objects, np.int64)
    for k in range(objects):
        inside = int(row[contents_index(row, k + 1)])
        if inside != 0:
            codes[identity_of(inside) - 1] = inside
    for k in range(objects):
        if where_is(row, k + 1) != NOWHERE:
            codes[k] = row[HEADER + where_is(row, k + 1)]
    if row[CARRYING] != EMPTY:
        codes[identity_of(row[CARRYING]) - 1] = row[CARRYING]
    return codes


@device_function()
def count_carriable(codes: NDArray[np.int64]) -> int:
    """Return the number of objects that are not doors, and so perhaps can be carried."""
    count = 0
    for k in range(len(codes)):
        if codes[k] != 0 and kind_of(int(codes[k])) != DOOR:
            count += 1
    return count


@device_function()
def store(row: Row, node: NDArray[np.int32], last: int) -> None:
    """Pack the part of the state that actions can change into a node.

    ``last`` is the identity of the object that was put down last, or 0.
    """
    node[0] = row[X]
    node[1] = row[Y]
    node[2] = row[DIRECTION]
    node[_HELD] = identity_of(row[CARRYING])
    node[LAST] = last
    for k in range(row[OBJECTS]):
        cell = where_is(row, k + 1)
        node[_OBJECTS + k] = 0 if cell == NOWHERE else cell + 1 | state_of(row[HEADER + cell]) << _STATE_BIT


@device_function()
def load(row: Row, node: NDArray[np.int32], codes: NDArray[np.int64]) -> None:
    """Set the row to the state that is packed in a node; ``codes`` has the code of each object, by identity - 1."""
    row[X] = node[0]
    row[Y] = node[1]
    row[DIRECTION] = node[2]
    row[CARRYING] = EMPTY if node[_HELD] == 0 else codes[node[_HELD] - 1]
    height = row[HEIGHT]
    for k in range(row[OBJECTS]):
        cell = where_is(row, k + 1)
        if cell != NOWHERE:
            lift(row, cell // height, cell % height)
    for k in range(row[OBJECTS]):
        packed = int(node[_OBJECTS + k])
        if packed != 0:
            cell = (packed & (1 << _STATE_BIT) - 1) - 1
            put(row, cell // height, cell % height, in_state(int(codes[k]), packed >> _STATE_BIT))


@device_function()
def slot(nodes: NDArray[np.int32], table: NDArray[np.int32], node: int) -> int:
    """Return the index in the hash table of a node with the same content as node ``node``, or else of a free place.

    ``table`` has the numbers of nodes by a hash of their content, and -1 in its free places.
    """
    key = 17  # a hash of the node's numbers
    for number in nodes[node]:
        key = (key * 1000003 ^ int(number)) & 0x7FFFFFFFFFFF
    place = (key ^ key >> 21) % len(table)
    while table[place] >= 0:
        known = table[place]
        same = True
        for k in range(nodes.shape[1]):
            if nodes[known, k] != nodes[node, k]:
                same = False
                break
        if same:
            return place
        place = (place + 1) % len(table)
    return place


@device_function()
def actions_to_node(parent: NDArray[np.int32], cause: NDArray[np.int8], node: int, action: int) -> NDArray[np.int64]:
    """Return the actions from the start to a node, followed by one more action.

    ``parent`` has the node before each node, and ``cause`` the action that led from there.
    """
    length = 1
    at = node
    while parent[at] >= 0:
        length += 1
        at = parent[at]
    actions = np.empty(length, np.int64)
    actions[length - 1] = action
    at = node
    for k in range(length - 2, -1, -1):
        actions[k] = cause[at]
        at = parent[at]
    return actions
