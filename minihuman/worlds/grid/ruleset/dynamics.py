"""The effects of actions, rules and goals of a world of rules, as kernels on one row of int32.

The dynamics and all numbers (tiles, colours, directions, actions, kinds of rules and goals) are those of
XLand-MiniGrid 0.9.3 (Nikulin et al., 2023, https://arxiv.org/abs/2312.12044), including the oddities of its steps: a
rule is tested only after the actions that its kind names, and a pick-up that fails tests what is in hand all the same.

A tile is its kind and its colour in one byte: ``kind | colour << 4``. A row is a header, then four numbers per rule,
then the tiles, row by row. The outermost tiles are walls, which no rule names, so no access needs a test of bounds.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import device_function, inline, kernel

Row = NDArray[np.int32]

TILE_KINDS = (
    *("empty", "floor", "wall", "ball", "square", "pyramid", "goal", "key", "locked door", "closed door", "open door"),
    *("hex", "star"),
)
EMPTY, FLOOR, WALL, BALL, SQUARE, PYRAMID, GOAL_TILE, KEY, DOOR_LOCKED, DOOR_CLOSED, DOOR_OPEN, HEX, STAR = range(13)
TILE_COLOURS = (
    *("none", "red", "green", "blue", "purple", "yellow", "grey", "black", "orange", "white", "brown", "pink"),
)
GREY = 6
BLACK = 7
BLACK_FLOOR = FLOOR | BLACK << 4
GREY_WALL = WALL | GREY << 4

UP, RIGHT, DOWN, LEFT = range(4)
FORWARD, TURN_RIGHT, TURN_LEFT, PICK_UP, PUT_DOWN, TOGGLE = range(6)
ACTION_NAMES = ("forward", "right", "left", "pickup", "drop", "toggle")

# kinds of rules: what is tested, then the input tiles and the product
NO_RULE, HOLD, AGENT_NEAR, TILE_NEAR, TILE_NEAR_UP, TILE_NEAR_RIGHT, TILE_NEAR_DOWN, TILE_NEAR_LEFT = range(8)
AGENT_NEAR_UP, AGENT_NEAR_RIGHT, AGENT_NEAR_DOWN, AGENT_NEAR_LEFT = range(8, 12)
# kinds of goals
NO_GOAL, GOAL_HOLD, GOAL_ON_TILE, GOAL_AGENT_NEAR, GOAL_TILE_NEAR, GOAL_TILE_AT, GOAL_AGENT_AT = range(7)
GOAL_TILE_NEAR_UP, GOAL_TILE_NEAR_RIGHT, GOAL_TILE_NEAR_DOWN, GOAL_TILE_NEAR_LEFT = range(7, 11)
GOAL_AGENT_NEAR_UP, GOAL_AGENT_NEAR_RIGHT, GOAL_AGENT_NEAR_DOWN, GOAL_AGENT_NEAR_LEFT = range(11, 15)

HEIGHT, WIDTH, Y, X, DIRECTION, POCKET, STEP, MAX_STEPS, PHASE, RULES, TASK, FAILED = range(12)
GOAL = 12  # 12..15: the kind of the goal and three numbers: tiles, or a row and a column
HEADER = 16
PER_RULE = 4  # a rule's kind, its input tiles (the second is 0 where there is one), and its product

NEW, PLAYING, OVER = range(3)
# bits of a step's status
TERMINATED = 1
TRUNCATED = 2
CHANGED = 4  # a rule changed something
# a negative status: nothing happened
NO_SUCH_ACTION = -1
NOT_PLAYING = -2


def ruleset_row_length(height: int, width: int, most_rules: int) -> int:
    """Return the length of a row of state, which has a header, ``most_rules`` rules, and the tiles of the grid."""
    return HEADER + PER_RULE * most_rules + height * width


@inline
def first_cell(row: Row) -> int:
    """Return the index in the row of state of the grid's first tile."""
    return len(row) - row[HEIGHT] * row[WIDTH]


@inline
def cell_index(row: Row, y: int, x: int) -> int:
    """Return the index in the row of state of the tile in row ``y`` and column ``x`` of the grid."""
    return len(row) - row[HEIGHT] * row[WIDTH] + y * row[WIDTH] + x


@inline
def offset(row: Row, direction: int) -> int:
    """Return what to add to a tile's index in the row of state to get that of its neighbour in a direction."""
    # up and down (0 and 2) are a row of tiles away, right and left (1 and 3) one tile
    return (direction - 1) * row[WIDTH] if direction % 2 == 0 else 2 - direction


@inline
def is_walkable(tile: int) -> bool:
    """Return whether the agent can stand on a tile: floor, a goal tile or an open door."""
    kind = tile & 15
    return kind == FLOOR or kind == GOAL_TILE or kind == DOOR_OPEN


@inline
def is_pickable(tile: int) -> bool:
    """Return whether the agent can pick up a tile: a ball, square, pyramid, key, hex or star of any colour."""
    kind = tile & 15
    return (BALL <= kind <= PYRAMID) or kind == KEY or kind == HEX or kind == STAR


@inline
def go_forward(row: Row) -> None:
    """Move the agent one tile in its direction without a check of that tile."""
    if row[DIRECTION] % 2 == 0:  # up or down
        row[Y] += row[DIRECTION] - 1
    else:
        row[X] += 2 - row[DIRECTION]


@device_function()
def use_hand(row: Row, action: int, front: int) -> None:
    """Pick up the tile in front, put down what is carried, or toggle a door; do nothing if that is not possible.

    ``front`` is the index in the row of the tile in front of the agent.
    """
    tile = row[front]
    kind = tile & 15
    if action == PICK_UP:
        if is_pickable(tile) and row[POCKET] & 15 == EMPTY:
            row[POCKET] = tile
            row[front] = BLACK_FLOOR
    elif action == PUT_DOWN:
        if kind == FLOOR and row[POCKET] & 15 != EMPTY:
            row[front] = row[POCKET]
            row[POCKET] = EMPTY
    elif kind == DOOR_OPEN:
        row[front] = DOOR_CLOSED | tile >> 4 << 4  # in the same colour
    elif kind == DOOR_CLOSED or (kind == DOOR_LOCKED and row[POCKET] == (KEY | tile >> 4 << 4)):
        row[front] = DOOR_OPEN | tile >> 4 << 4


@device_function()
def act_alone(row: Row, action: int) -> int:
    """Apply an action without the rules; return the index in the row of the tile that the action is about.

    This is the tile in front for picking up, putting down and toggling, and otherwise the tile on which the agent then
    stands.
    """
    direction = row[DIRECTION]
    here = cell_index(row, row[Y], row[X])
    if action == TURN_RIGHT:
        row[DIRECTION] = (direction + 1) % 4
        return here
    if action == TURN_LEFT:
        row[DIRECTION] = (direction + 3) % 4
        return here
    front = here + offset(row, direction)
    if action == FORWARD:
        if not is_walkable(row[front]):
            return here
        go_forward(row)
    else:
        use_hand(row, action, front)
    return front


@device_function()
def apply_agent_near(row: Row, here: int, first: int, last: int, tile: int, product: int) -> int:
    """Replace the given tile next to the agent, in the directions from ``first`` to ``last``, by the product.

    ``here`` is the index in the row of the agent's tile. Return `CHANGED` if a tile was replaced, and otherwise 0.
    """
    status = 0
    for direction in range(first, last + 1):
        near = here + offset(row, direction)
        if row[near] == tile:
            row[near] = product
            status = CHANGED
    return status


@device_function()
def apply_tile_near(row: Row, place: int, first: int, last: int, a: int, b: int, product: int) -> int:
    """Replace the tile that was put down by floor, and each neighbour that makes a pair with it by the product.

    Args:
        row: the state.
        place: the index in the row of the tile that was put down.
        first: the first of the directions (UP to LEFT) in which tile b may lie from tile a.
        last: the last of these directions.
        a: the first input.
        b: the second input.
        product: what replaces the tile next to ``place``, which itself becomes floor.

    Returns:
        `CHANGED` if tiles were replaced, and otherwise 0.
    """
    tile = row[place]
    if tile != a and tile != b:
        return 0
    matches = 0  # bit `direction`: the tile there and the one at `place` are a and b, in an allowed direction
    for direction in range(4):
        near = row[place + offset(row, direction)]
        ahead = first <= direction <= last and tile == a and near == b
        behind = first <= (direction + 2) % 4 <= last and tile == b and near == a
        matches |= (ahead or behind) << direction
    for direction in range(4):
        if matches >> direction & 1:
            row[place + offset(row, direction)] = product
            row[place] = BLACK_FLOOR
    return CHANGED if matches else 0


@device_function()
def apply_rules(row: Row, action: int, place: int) -> int:
    """Apply all rules in turn after an action; return `CHANGED` if any rule changed something, and otherwise 0.

    ``place`` is the index in the row of the tile that the action was about.
    """
    status = 0
    here = cell_index(row, row[Y], row[X])
    for rule in range(HEADER, HEADER + PER_RULE * row[RULES], PER_RULE):
        kind = row[rule]
        a = row[rule + 1]
        product = row[rule + 3]
        if kind == HOLD:
            if action == PICK_UP and row[POCKET] == a:
                row[POCKET] = product
                status = CHANGED
        elif kind == AGENT_NEAR:
            if action == FORWARD:
                status |= apply_agent_near(row, here, UP, LEFT, a, product)
        elif kind >= AGENT_NEAR_UP:
            if action == FORWARD or action == PUT_DOWN:
                direction = kind - AGENT_NEAR_UP
                status |= apply_agent_near(row, here, direction, direction, a, product)
        elif kind == TILE_NEAR:
            if action == PUT_DOWN:
                status |= apply_tile_near(row, place, UP, LEFT, a, row[rule + 2], product)
        elif kind >= TILE_NEAR_UP and action == PUT_DOWN:
            direction = kind - TILE_NEAR_UP
            status |= apply_tile_near(row, place, direction, direction, a, row[rule + 2], product)
    return status


@device_function()
def is_beside(row: Row, place: int, direction: int, tile: int) -> bool:
    """Return whether a tile lies next to the index ``place`` in the row: in one direction, or in any for -1."""
    if direction >= 0:
        return row[place + offset(row, direction)] == tile
    above = row[place - row[WIDTH]] == tile
    below = row[place + row[WIDTH]] == tile
    return above or below or row[place - 1] == tile or row[place + 1] == tile


@device_function()
def is_tile_near(row: Row, place: int, direction: int, a: int, b: int) -> bool:
    """Return whether tiles a and b lie side by side, one of them at the index ``place`` in the row.

    Tile b must lie in the given direction from tile a; -1 stands for any direction.
    """
    tile = row[place]
    if direction < 0:
        if tile == a:
            return is_beside(row, place, -1, b)
        return tile == b and is_beside(row, place, -1, a)
    if tile == b and is_beside(row, place, (direction + 2) % 4, a):
        return True
    return tile == a and is_beside(row, place, direction, b)


@device_function()
def has_reached_goal(row: Row, action: int, place: int) -> bool:
    """Return whether the goal is reached after an action on the tile at the index ``place`` in the row."""
    kind = row[GOAL]
    a = row[GOAL + 1]
    if kind == GOAL_TILE_AT:
        return row[cell_index(row, row[GOAL + 2], row[GOAL + 3])] == a
    if kind == GOAL_AGENT_AT:
        return row[Y] == a and row[X] == row[GOAL + 2]
    if kind == GOAL_HOLD:
        return action == PICK_UP and row[POCKET] == a
    here = cell_index(row, row[Y], row[X])
    if kind == GOAL_ON_TILE:
        return action == FORWARD and row[here] == a
    if kind == GOAL_AGENT_NEAR:
        return action == FORWARD and is_beside(row, here, -1, a)
    if kind >= GOAL_AGENT_NEAR_UP:
        return (action == FORWARD or action == PUT_DOWN) and is_beside(row, here, kind - GOAL_AGENT_NEAR_UP, a)
    if kind == NO_GOAL or action != PUT_DOWN:
        return False
    direction = -1 if kind == GOAL_TILE_NEAR else kind - GOAL_TILE_NEAR_UP
    return is_tile_near(row, place, direction, a, row[GOAL + 2])


@device_function()
def step_row(row: Row, action: int) -> int:
    """Take a valid action during an episode; return the status, with the bits TERMINATED, TRUNCATED and CHANGED."""
    place = act_alone(row, action)
    status = 0
    if action == FORWARD or action == PICK_UP or action == PUT_DOWN:
        status = apply_rules(row, action, place)
    row[STEP] += 1
    if has_reached_goal(row, action, place):
        status |= TERMINATED
    if row[STEP] == row[MAX_STEPS]:
        status |= TRUNCATED
    if status & (TERMINATED | TRUNCATED):
        row[PHASE] = OVER
    return status


@device_function()
def view_row(row: Row, image: NDArray[np.uint8]) -> None:
    """Write the agent's view into an image, uint8[size, size, 2], as `see_tiles` does."""
    size = image.shape[0]
    half = size // 2
    direction = row[DIRECTION]
    forward_y = direction - 1 if direction % 2 == 0 else 0
    forward_x = 2 - direction if direction % 2 == 1 else 0
    cells = first_cell(row)
    height = row[HEIGHT]
    width = row[WIDTH]
    for i in range(size):
        far = size - 1 - i
        y = row[Y] + far * forward_y - half * forward_x
        x = row[X] + far * forward_x + half * forward_y
        for j in range(size):
            inside = (0 <= y < height) and (0 <= x < width)
            tile = row[cells + y * width + x] if inside else 0
            image[i, j, 0] = tile & 15
            image[i, j, 1] = tile >> 4
            y += forward_x
            x -= forward_y


@kernel("(int32[::1], uint8[:, :, ::1])", hold_gil=True)
def see_tiles(row: Row, image: NDArray[np.uint8]) -> None:
    """Fill ``image`` (size, size, 2: kind, colour; indexed [down, right]) with the agent's view.

    The agent is in the middle of the bottom row and looks up. Nothing hides anything; outside the grid all is 0.
    """
    view_row(row, image)


@kernel("(int32[::1], int64)", hold_gil=True)
def act_by_rules(row: Row, action: int) -> int:
    """Take an action without observing; return its status: bits, or NOT_PLAYING or NO_SUCH_ACTION if it was refused."""
    if row[PHASE] != PLAYING:
        return NOT_PLAYING
    if action < 0 or action > TOGGLE:
        return NO_SUCH_ACTION
    return step_row(row, action)


@kernel("(int32[::1], int64, uint8[:, :, ::1])", hold_gil=True)
def step_by_rules(row: Row, action: int, image: NDArray[np.uint8]) -> int:
    """Take an action and observe the result; return the status as `act_by_rules` does."""
    if row[PHASE] != PLAYING:
        return NOT_PLAYING
    if action < 0 or action > TOGGLE:
        return NO_SUCH_ACTION
    status = step_row(row, action)
    view_row(row, image)
    return status


@inline
def earned(row: Row, status: int) -> float:
    """Return the reward of a step: ``1 - 0.9 * step / max_steps`` if it reached the goal, and otherwise 0."""
    return 1.0 - 0.9 * (row[STEP] / row[MAX_STEPS]) if status & TERMINATED else 0.0
