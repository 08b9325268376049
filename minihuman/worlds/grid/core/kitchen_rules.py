"""The dynamics of the kitchen as kernels on one row of int32: cooks, counters, pots, and the objects on them.

Source: Overcooked-AI 1.1.0 (Carroll et al., 2019, https://arxiv.org/abs/1910.05789), whose order of effects is kept:
hands act cook by cook; then all cooks move, or all stay if any two would meet or pass through each other; then pots
cook. Under the rules of 2019, with which its human data were recorded, a pot starts by itself at the third ingredient,
takes only one kind of ingredient, and its clock continues after the soup is ready.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import device_function, inline, kernel

Row = NDArray[np.int32]

WIDTH, HEIGHT, COOKS, STEP, MAX_STEPS, PHASE = range(6)
AUTOMATIC = 6  # 1: the rules of 2019
VALUES = 7  # by recipe (onions + 4 * tomatoes): what delivering it earns
TIMES = VALUES + 16  # by recipe: steps that it cooks
COOK = TIMES + 16  # four numbers a cook: column, line, direction, what it holds; then terrain, then what lies there

NEW, PLAYING, OVER = range(3)
# bits of a step's status
ENDED = 1
EARNED = 2
UP, DOWN, RIGHT, LEFT, STAY, INTERACT = range(6)
FLOOR, POT, COUNTER, ONIONS, TOMATOES, DISHES, HATCH = range(7)  # terrain
NOTHING, ONION, TOMATO, DISH, SOUP = range(5)  # kinds of things; of a soup the bits above say more
FULL = 3  # ingredients
BASE_LAYERS = 16  # of an observation, besides five a cook
URGENT = 40  # steps before the end from which on the last layer is 1
# shaping rewards
PLACED = 3.0
DISH_TAKEN = 3.0
SOUP_TAKEN = 5.0


def kitchen_row_length(width: int, height: int, cooks: int) -> int:
    """Return the length of the row of state of a kitchen of ``width`` by ``height`` cells."""
    return COOK + 4 * cooks + 2 * width * height


@inline
def terrain_index(row: Row) -> int:
    """Return the index in the row at which the terrain begins, cell by cell (x * height + y)."""
    return COOK + 4 * row[COOKS]


@inline
def soup(onions: int, tomatoes: int, clock: int) -> int:
    """Return the number that encodes a soup of some onions and tomatoes.

    The clock is -1 before the soup cooks, and afterwards the number of steps for which it has cooked.
    """
    # the kind is in bits 0 to 2, onions in 3 and 4, tomatoes in 5 and 6, and the clock plus 1 above them
    return SOUP | onions << 3 | tomatoes << 5 | clock + 1 << 7


@inline
def kind_of(thing: int) -> int:
    """Return the kind of an object from its number."""
    return thing & 7


@inline
def onions_in(thing: int) -> int:
    """Return the number of onions in a soup."""
    return thing >> 3 & 3


@inline
def tomatoes_in(thing: int) -> int:
    """Return the number of tomatoes in a soup."""
    return thing >> 5 & 3


@inline
def clock_of(thing: int) -> int:
    """Return the clock of a soup: -1 before it cooks, then the number of steps it has cooked."""
    return (thing >> 7) - 1


@inline
def recipe_of(thing: int) -> int:
    """Return the recipe of a soup: onions + 4 * tomatoes."""
    return thing >> 3 & 15


@device_function()
def is_ready(row: Row, thing: int) -> bool:
    """Return whether a soup has finished cooking; ``thing`` is the number that encodes it."""
    return clock_of(thing) >= row[TIMES + recipe_of(thing)]


@inline
def ahead(x: int, y: int, direction: int) -> tuple[int, int]:
    """Return the column and row of the next cell in a direction: UP, DOWN, RIGHT or LEFT."""
    return x + (direction == RIGHT) - (direction == LEFT), y + (direction == DOWN) - (direction == UP)


@device_function()
def destination(row: Row, cook: int, action: int) -> tuple[int, int]:
    """Return the column and row in which a cook stands after its action if no other cook blocks it."""
    at = COOK + 4 * cook
    x = row[at]
    y = row[at + 1]
    if action < STAY:
        i, j = ahead(x, y, action)
        if row[terrain_index(row) + i * row[HEIGHT] + j] == FLOOR:
            return i, j
    return x, y


@device_function()
def use_pot(row: Row, at: int, thing_at: int) -> float:
    """Apply a cook's interaction with a pot; return the shaping reward that it earns, or 0.

    Args:
        row: the state.
        at: the index of the cook in the row.
        thing_at: the index of the pot's contents in the row.
    """
    carried = row[at + 3]
    thing = row[thing_at]
    if carried == NOTHING:
        if thing != NOTHING and clock_of(thing) < 0 and row[AUTOMATIC] == 0:
            row[thing_at] = soup(onions_in(thing), tomatoes_in(thing), 0)
    elif carried == DISH:
        if thing != NOTHING and clock_of(thing) >= 0 and is_ready(row, thing):
            row[at + 3] = thing
            row[thing_at] = NOTHING
            return SOUP_TAKEN
    elif kind_of(carried) != SOUP:
        onions = onions_in(thing)
        tomatoes = tomatoes_in(thing)
        clock = clock_of(thing) if thing != NOTHING else -1
        mixes = row[AUTOMATIC] == 1 and (tomatoes > 0 if carried == ONION else onions > 0)
        if clock < 0 and onions + tomatoes < FULL and not mixes:
            onions = onions + (carried == ONION)
            tomatoes = tomatoes + (carried == TOMATO)
            starts = row[AUTOMATIC] == 1 and onions + tomatoes == FULL
            row[thing_at] = soup(onions, tomatoes, 0 if starts else -1)
            row[at + 3] = NOTHING
            return PLACED
    return 0.0


@device_function()
def lacks_dishes(row: Row, active_pots: int) -> bool:
    """Return whether there are more active pots than cooks with a dish, and no dish lies on a counter."""
    cells = row[WIDTH] * row[HEIGHT]
    terrains = terrain_index(row)
    dishes = 0
    on_counters = False
    for other in range(row[COOKS]):
        dishes += row[COOK + 4 * other + 3] == DISH
    for k in range(terrains, terrains + cells):
        on_counters |= row[k] == COUNTER and row[k + cells] == DISH
    return dishes < active_pots and not on_counters


@device_function()
def interact(row: Row, cook: int, active_pots: int, outcomes: NDArray[np.float64]) -> None:
    """Apply a cook's interaction with the cell in front of it.

    Args:
        row: the state.
        cook: the number of the cook.
        active_pots: the number of active pots at the start of the step.
        outcomes: float64[2 * cooks]; what is earned is added to the reward of the cook's deliveries (index ``cook``)
            and to its shaping reward (index ``cooks + cook``).
    """
    cooks = row[COOKS]
    at = COOK + 4 * cook
    cells = row[WIDTH] * row[HEIGHT]
    terrains = terrain_index(row)
    x, y = ahead(row[at], row[at + 1], row[at + 2])
    cell = terrains + x * row[HEIGHT] + y
    terrain = row[cell]
    thing_at = cell + cells
    carried = row[at + 3]
    thing = row[thing_at]
    if terrain == COUNTER:
        if (carried == NOTHING) != (thing == NOTHING):
            row[at + 3] = thing
            row[thing_at] = carried
    elif terrain == HATCH:
        if kind_of(carried) == SOUP:
            outcomes[cook] += row[VALUES + recipe_of(carried)]
            row[at + 3] = NOTHING
    elif terrain == POT:
        outcomes[cooks + cook] += use_pot(row, at, thing_at)
    elif terrain != FLOOR and carried == NOTHING:
        if terrain == DISHES and cooks == 2 and lacks_dishes(row, active_pots):
            outcomes[cooks + cook] += DISH_TAKEN
        row[at + 3] = terrain - ONIONS + ONION


@device_function()
def move_cooks(row: Row, actions: NDArray[np.int64]) -> None:
    """Turn and move all cooks, given one action per cook. If any two would collide, none moves, but all turn."""
    collide = False
    for cook in range(row[COOKS]):
        new = destination(row, cook, actions[cook])
        for other in range(cook):
            other_new = destination(row, other, actions[other])
            at = COOK + 4 * cook
            other_at = COOK + 4 * other
            crossed = new == (row[other_at], row[other_at + 1]) and other_new == (row[at], row[at + 1])
            collide |= new == other_new or crossed
    for cook in range(row[COOKS]):
        at = COOK + 4 * cook
        if not collide:
            row[at], row[at + 1] = destination(row, cook, actions[cook])
        if actions[cook] < STAY:
            row[at + 2] = actions[cook]


@device_function()
def count_active_pots(row: Row) -> int:
    """Return the number of pots that cook, or hold something and have space for more."""
    terrains = terrain_index(row)
    cells = row[WIDTH] * row[HEIGHT]
    active_pots = 0
    for k in range(terrains, terrains + cells):
        if row[k] == POT and row[k + cells] != NOTHING:
            thing = row[k + cells]
            active_pots += clock_of(thing) >= 0 or onions_in(thing) + tomatoes_in(thing) < FULL
    return active_pots


@device_function()
def cook_soups(row: Row) -> None:
    """Advance the clock of every soup that is cooking by one step."""
    terrains = terrain_index(row)
    cells = row[WIDTH] * row[HEIGHT]
    for k in range(terrains, terrains + cells):
        if row[k] == POT and row[k + cells] != NOTHING:
            thing = row[k + cells]
            if clock_of(thing) >= 0 and (row[AUTOMATIC] == 1 or not is_ready(row, thing)):
                row[k + cells] = soup(onions_in(thing), tomatoes_in(thing), clock_of(thing) + 1)


@kernel("(int32[::1], int64[::1], float64[::1], uint8[:, ::1])", hold_gil=True)
def step_kitchen(row: Row, actions: NDArray[np.int64], outcomes: NDArray[np.float64], images: NDArray[np.uint8]) -> int:
    """Make one joint step and observe its result.

    Args:
        row: the state.
        actions: one action per cook.
        outcomes: float64[2 * cooks]; receives the reward of each cook's deliveries, then each cook's shaping reward.
        images: receives each cook's observation, as `observe` writes it.

    Returns:
        The bits `ENDED` and, if `outcomes` are not all 0, `EARNED`; or -1 if no episode is running, and -2 for an
            action that does not exist. In these two cases nothing changes.
    """
    if row[PHASE] != PLAYING:
        return -1
    cooks = row[COOKS]
    for cook in range(cooks):
        if actions[cook] < 0 or actions[cook] > INTERACT:
            return -2
    outcomes[:] = 0.0
    active_pots = count_active_pots(row)
    for cook in range(cooks):
        if actions[cook] == INTERACT:
            interact(row, cook, active_pots, outcomes)
    move_cooks(row, actions)
    cook_soups(row)
    row[STEP] += 1
    if row[STEP] >= row[MAX_STEPS]:
        row[PHASE] = OVER
    observe(row, images)
    status = ENDED if row[PHASE] == OVER else 0
    for k in range(2 * cooks):
        if outcomes[k] != 0:
            status |= EARNED
    return status


@device_function()
def observe_thing(row: Row, thing: int, in_pot: bool, image: NDArray[np.uint8], at: int) -> None:
    """Write an object into the layers of its cell in an observation.

    Args:
        row: the state.
        thing: the number of the object.
        in_pot: whether the object is in a pot.
        image: the observation, uint8[width * height * layers].
        at: the index of the cell's first layer about objects: onions in waiting pots. The others follow in the order of
            `observe`.
    """
    kind = kind_of(thing)
    if kind == SOUP:
        clock = clock_of(thing)
        cooked = 2 if clock >= 0 or not in_pot else 0  # two layers for waiting pots, then two for all other soups
        image[at + cooked] = onions_in(thing)
        image[at + cooked + 1] = tomatoes_in(thing)
        if in_pot and clock >= 0:
            image[at + 4] = max(0, row[TIMES + recipe_of(thing)] - clock)
        if not in_pot or (clock >= 0 and is_ready(row, thing)):
            image[at + 5] = 1  # finished
    elif kind == DISH:
        image[at + 6] = 1
    elif kind == ONION:
        image[at + 7] = 1
    elif kind == TOMATO:
        image[at + 8] = 1


@device_function()
def layer_of_cook(cook: int, viewer: int) -> int:
    """Return the index of the layer that shows where ``cook`` is in the observation of ``viewer``, itself first."""
    return 0 if cook == viewer else cook + (cook < viewer)


@kernel("(int32[::1], uint8[:, ::1])", hold_gil=True)
def observe(row: Row, images: NDArray[np.uint8]) -> None:
    """Write each cook's observation into ``images``, uint8[cooks, width * height * layers].

    Layers show the whole kitchen, in the order of Overcooked-AI's lossless encoding: where each cook is, the observer
    first; each cook's four directions; pots, counters, onions, tomatoes, dishes and hatches; onions and tomatoes in
    waiting pots; onions and tomatoes in cooking or cooked soups; the steps that a soup still cooks; finished soups;
    dishes, onions and tomatoes; and 1 everywhere in the last forty steps.
    """
    cooks = row[COOKS]
    cells = row[WIDTH] * row[HEIGHT]
    terrains = terrain_index(row)
    layers = 5 * cooks + BASE_LAYERS
    urgent = row[MAX_STEPS] - row[STEP] < URGENT
    first = images[0]
    first[:] = 0
    for cell in range(cells):
        base = cell * layers + 5 * cooks
        terrain = row[terrains + cell]
        thing = row[terrains + cells + cell]
        if terrain != FLOOR:
            first[base + terrain - 1] = 1  # a layer for each terrain but the floor
            if thing != NOTHING:
                observe_thing(row, thing, terrain == POT, first, base + 6)
        if urgent:
            first[base + 15] = 1  # the last layer
    for cook in range(cooks):
        at = COOK + 4 * cook
        if row[at + 3] != NOTHING:
            cell = row[at] * row[HEIGHT] + row[at + 1]
            observe_thing(row, row[at + 3], False, first, cell * layers + 5 * cooks + 6)
    for viewer in range(cooks - 1, -1, -1):
        image = images[viewer]
        if viewer > 0:
            for k in range(cells * layers):
                image[k] = first[k]
        for cook in range(cooks):
            at = COOK + 4 * cook
            base = (row[at] * row[HEIGHT] + row[at + 1]) * layers
            place = layer_of_cook(cook, viewer)
            image[base + place] = 1
            image[base + cooks + 4 * place + row[at + 2]] = 1


@kernel("(int32[:, ::1], int32[::1], int64[:, ::1], float64[:, ::1], uint8[:, :, ::1], boolean[::1])", nogil=True)
def step_kitchens(
    rows: Row,
    start: Row,
    actions: NDArray[np.int64],
    outcomes: NDArray[np.float64],
    images: NDArray[np.uint8],
    ends: NDArray[np.bool_],
) -> int:
    """Run `step_kitchen` for each row.

    When an episode ends, the next one begins at once, and ``images`` show its beginning.

    Args:
        rows: the states, one row per kitchen.
        start: the state at the beginning of an episode.
        actions: one action per kitchen and cook.
        outcomes: receives the rewards of each kitchen, float64[kitchens, 2 * cooks], as in `step_kitchen`.
        images: receives the observations of each kitchen.
        ends: receives whether each kitchen's episode ended.

    Returns:
        -1, or the index of the first kitchen with an action that does not exist; then no kitchen was stepped.
    """
    for i in range(len(rows)):
        for cook in range(actions.shape[1]):
            if actions[i, cook] < 0 or actions[i, cook] > INTERACT:
                return i
    for i in range(len(rows)):
        ends[i] = step_kitchen(rows[i], actions[i], outcomes[i], images[i]) & ENDED != 0
        if ends[i]:
            for k in range(len(start)):
                rows[i, k] = start[k]
            observe(rows[i], images[i])
    return -1
