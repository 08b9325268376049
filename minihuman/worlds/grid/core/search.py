"""Best-first search over what a grid world can become, on the world's own rules.

A node is what actions can change, packed into int32: agent x, y, direction, the object in hand, the object put down
last, and for each object the cell it lies in with its state. The cost of an action is 1 and the bound never
overestimates, so the first success found is a shortest one.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.cells import (
    DOOR,
    EMPTY,
    GOAL,
    LAVA,
    OPEN,
    WALL,
    identity_of,
    in_state,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.directions import ahead
from minihuman.worlds.grid.core.own import passes
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
    lift,
    put,
    where_is,
)
from minihuman.worlds.grid.core.tasks import DONE, DROP, FORWARD, LEFT, PICKUP, PUT_NEAR, RIGHT, STAND_BY, TOGGLE, front
from minihuman.worlds.kernels import kernel, part

FAR = 1 << 20  # more actions than any plan has
FOUND, NONE, FULL = 0, 1, 2  # how a search ends: a plan, no plan exists, too many nodes

_HELD, _LAST, _OBJECTS = 3, 4, 5  # places in a node, after x, y and direction
_STATE_BIT = 24  # a cell number plus one is in the bits below


@kernel()
def distances(row: Row, sources: NDArray[np.int64], through: bool) -> NDArray[np.int32]:
    """Actions from each pose (x, y, direction) to any source pose, turning and walking only; FAR without a way.

    Args:
        row: The state.
        sources: Pose numbers, (x * height + y) * 4 + direction.
        through: Doors and objects are walked through, which gives a lower bound; otherwise they bar the way.
    """
    width, height = np.int64(row[WIDTH]), np.int64(row[HEIGHT])
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
        x, y = (pose >> 2) // height, (pose >> 2) % height
        for move in range(3):  # the poses before a left turn, a right turn, a step forward
            from_x, from_y, before = x, y, direction
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


@part()
def stands(row: Row, code: int, through: bool) -> bool:
    """Whether an agent that has not yet succeeded can be in this cell."""
    kind = kind_of(code)
    if kind == WALL or kind == LAVA or kind == GOAL:
        return False
    return through or passes(row, code)


@part()
def stands_or_ends(row: Row, code: int, through: bool) -> bool:
    """Whether a step into this cell is possible and no failure."""
    return kind_of(code) == GOAL or stands(row, code, through)


@kernel()
def search(
    start: Row, bound: NDArray[np.int32], extra: int, limit: int, words: NDArray[np.uint64], weight: int
) -> tuple[int, NDArray[np.int64]]:
    """Find a shortest list of actions to success.

    Args:
        start: The state; it is not changed.
        bound: For each pose at least how many actions success takes from there, less ``extra``.
        extra: What to add to the bound.
        limit: Nodes that may be kept.
        words: Scratch for the rules, which take a random stream and draw nothing from it here.
        weight: How many times the bound counts: 1 finds a shortest list, more a list sooner.

    Returns:
        FOUND and the actions, or NONE or FULL and no actions.
    """
    row = start.copy()
    row[MAX_STEPS] = FAR
    row[PHASE] = PLAYING
    objects = row[OBJECTS]
    length = _OBJECTS + objects
    codes = object_codes(row)
    carriable = count_carriable(codes)
    may_drop = carriable > 1 or row[TASK] == PUT_NEAR
    nodes = np.empty((limit, length), np.int32)
    cost, parent, cause = np.empty(limit, np.int32), np.empty(limit, np.int32), np.empty(limit, np.int8)
    closed = np.zeros(limit, np.bool_)
    table = np.full(4 * limit, -1, np.int32)  # open addressing
    entry_node, entry_next = np.empty(4 * limit, np.int32), np.empty(4 * limit, np.int64)
    entries = 0
    none = np.empty(0, np.int64)

    store(row, nodes[0], 0)
    cost[0], parent[0], cause[0] = 0, -1, -1
    table[slot(nodes, table, 0)] = 0
    count = 1
    estimate = bound[row[X], row[Y], row[DIRECTION]] + extra
    if estimate >= FAR:
        return NONE, none
    estimate *= weight
    bucket = np.full(4096 + 16 * (estimate + objects * (row[WIDTH] + row[HEIGHT])), -1, np.int64)  # the newest entry
    dropped = False
    bucket[estimate] = 0
    entry_node[0], entry_next[0] = 0, -1
    entries = 1
    while estimate < len(bucket):
        if bucket[estimate] < 0:
            estimate += 1
            continue
        node = entry_node[bucket[estimate]]
        bucket[estimate] = entry_next[bucket[estimate]]
        if closed[node]:
            continue
        closed[node] = True
        for action in range(7):
            load(row, nodes[node], codes)
            last = nodes[node, _LAST]
            if not worth_trying(row, action, last, may_drop):
                continue
            held = identity_of(row[CARRYING])
            row[STEP] = 0
            row[PHASE] = PLAYING
            status, reward = act(row, action, words)
            if status > 0:
                if reward > 0:
                    return FOUND, actions_to(parent, cause, node, action)
                continue
            if count == limit or entries == len(entry_node):
                return FULL, none
            if action == DROP:
                last = held
            elif action == PICKUP:
                last = 0
            store(row, nodes[count], last)
            place = slot(nodes, table, count)
            known = table[place]
            if known < 0:
                known = count
                table[place] = count
                count += 1
            elif closed[known] or cost[known] <= cost[node] + 1:
                continue
            cost[known], parent[known], cause[known] = cost[node] + 1, node, action
            ahead = bound[row[X], row[Y], row[DIRECTION]] + extra
            worth = weight * ahead + cost[known]
            if worth < len(bucket):
                entry_node[entries], entry_next[entries] = known, bucket[worth]
                bucket[worth] = entries
                entries += 1
                estimate = min(estimate, worth)
            elif ahead < FAR:
                dropped = True
    return FULL if dropped else NONE, none


@part()
def worth_trying(row: Row, action: int, last: int, may_drop: bool) -> bool:
    """Whether a shortest plan can have this action here. What is left out never shortens a plan:

    closing a door; putting down the only thing there is to carry; taking up again what was put down last.
    """
    if action == LEFT or action == RIGHT or action == FORWARD:
        return True
    x, y = front(row)
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


@part()
def object_codes(row: Row) -> NDArray[np.int64]:
    """The code of each object, by identity - 1, wherever it is."""
    cells, objects = row[WIDTH] * row[HEIGHT], row[OBJECTS]
    codes = np.zeros(objects, np.int64)
    for k in range(objects):
        inside = int(row[HEADER + 2 * cells + k])
        if inside != 0:
            codes[identity_of(inside) - 1] = inside
    for k in range(objects):
        if where_is(row, k + 1) != NOWHERE:
            codes[k] = row[HEADER + where_is(row, k + 1)]
    if row[CARRYING] != EMPTY:
        codes[identity_of(row[CARRYING]) - 1] = row[CARRYING]
    return codes


@part()
def count_carriable(codes: NDArray[np.int64]) -> int:
    """How many objects can be carried."""
    count = 0
    for k in range(len(codes)):
        if codes[k] != 0 and kind_of(int(codes[k])) != DOOR:
            count += 1
    return count


@part()
def store(row: Row, node: NDArray[np.int32], last: int) -> None:
    """Pack what actions can change."""
    node[0], node[1], node[2] = row[X], row[Y], row[DIRECTION]
    node[_HELD] = identity_of(row[CARRYING])
    node[_LAST] = last
    for k in range(row[OBJECTS]):
        cell = where_is(row, k + 1)
        node[_OBJECTS + k] = 0 if cell == NOWHERE else cell + 1 | state_of(row[HEADER + cell]) << _STATE_BIT


@part()
def load(row: Row, node: NDArray[np.int32], codes: NDArray[np.int64]) -> None:
    """Bring a row to a node."""
    row[X], row[Y], row[DIRECTION] = node[0], node[1], node[2]
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


@part()
def slot(nodes: NDArray[np.int32], table: NDArray[np.int32], node: int) -> int:
    """Where in the table an equal node is, or the free place for this one."""
    key = 17
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


@part()
def actions_to(parent: NDArray[np.int32], cause: NDArray[np.int8], node: int, action: int) -> NDArray[np.int64]:
    """The actions from the start to a node, and the one after it."""
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
