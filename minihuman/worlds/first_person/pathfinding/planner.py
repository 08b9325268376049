"""The planner: a path to a goal by a world's real motion rules, and a lower bound on the number of steps.

It also plans to pick up several things in turn, and to fetch a thing and put it next to another. Each leg is planned,
and its last steps are tried out in the world.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.pathfinding.search import (
    Body,
    clearance_map,
    distance_map,
    lies_on,
    search,
    shortest_way,
)
from minihuman.worlds.first_person.rooms import FloorPlan
from minihuman.worlds.first_person.state import WorldState

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv

_MOST_CELLS = 20_000_000  # the most cells of a floor, which take some seconds and 200 MB
_MAX_CELL_M = 0.1
_CAUTION = 0.999  # the share of a clearance that is used, so that rounding makes no barrier too long
_OVERLAP_M = 0.01  # of a wall and the barrier that continues it
_MARGIN = 1e-7  # metres added to the distances that the rules keep from walls and things, so that rounding is harmless


def plan(world: "FirstPersonEnv", goal: Entity, *, avoid: Sequence[Entity] = ()) -> tuple[int, ...] | None:
    """Return actions that bring the agent near the goal; None if none were found.

    If the agent carries something, the actions bring that near the goal, where it can be put down. At the goal, the
    plan is one action, since a world checks after a step. The agent is never near the things to ``avoid``. If step
    length and turn vary, the plan uses their defaults: plan again after a few steps.

    Raises:
        WorldError: if the world lacks a turn or the forward step, has heights, or is too large.
    """
    stage = world.stage
    moves = read_moves(world)
    carried = world.stage.agent.carrying
    start = (stage.agent.pos[0], stage.agent.pos[2], stage.agent.dir)
    reach = _reach(stage, goal, carried) - _MARGIN
    x, _, z = stage.agent.pos if carried is None else stage.carrying_position(stage.agent.pos, carried)
    body = Body(
        _default(stage, "forward_step"),
        math.radians(_default(stage, "turn_step")),
        float(stage.agent.radius) + _MARGIN,
        3 if carried is None else len(moves),  # with a thing in hand there may be no turning before a step back
        math.hypot(x - start[0], z - start[1]),
        0.0 if carried is None else float(carried.radius) + _MARGIN,
    )
    if math.hypot(x - goal.pos[0], z - goal.pos[2]) < reach:
        return moves[:1]
    cell = min(body.step / 2, _MAX_CELL_M)
    bounds = np.array(stage.floor.bounds)
    cells = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]) / cell**2
    if cells > _MOST_CELLS:
        raise WorldError(
            f"the floor has {cells:.0f} cells of {cell:g} m; paths can be planned on at most {_MOST_CELLS}; make the "
            "world smaller"
        )
    walls = stage.floor.walls
    discs = _list_obstacles(stage, avoid)
    zones = zones_of(world)
    free = clearance_map(walls, discs, zones, bounds, cell, body.radius)
    column = int((goal.pos[0] - bounds[0]) / cell)
    row = int((goal.pos[2] - bounds[1]) / cell)
    distance = distance_map(free, column, row, (reach + body.ahead) / cell)
    target = (goal.pos[0], goal.pos[2], reach)
    path = search(walls, discs, zones, start, target, body, bounds, distance, cell)
    return tuple(moves[move] for move in path) or None


def least_steps(world: "FirstPersonEnv", goal: Entity) -> int:
    """Return a lower bound on the number of steps to the goal: the steps that cover the distance, and the first turns.

    The bound is 1 at the goal, since a world checks after a step. The distance is that of the shortest path of a point
    around the walls, divided by the world's longest step. Obstacles, most of the body's width, and later turns are
    ignored.

    Raises:
        WorldError: if the world has heights.
    """
    stage = world.stage
    x, _, z = stage.agent.pos
    dx = goal.pos[0] - x
    dz = goal.pos[2] - z
    straight = math.hypot(dx, dz)
    reach = _reach(stage, goal)
    if straight < reach:
        return 1
    drift = max(abs(_get_lowest(stage, "forward_drift")), abs(stage.parameters.largest("forward_drift")))
    longest = math.hypot(stage.reach, drift)
    distance = straight
    if longest < 2 * stage.agent.radius:  # a longer step could jump across a wall
        barriers = _find_barriers(stage, goal, reach, longest)
        ends = np.array(((x, z), (goal.pos[0], goal.pos[2])))
        distance = shortest_way(barriers, np.concatenate((ends, _find_turning_points(stage.floor, barriers))))
    steps = max(math.ceil((distance - reach) / longest - 1e-9), 1)
    if "move_back" in world.action_names:
        return steps
    off_rad = abs((math.atan2(-dz, dx) - stage.agent.dir + math.pi) % (2 * math.pi) - math.pi)
    # the agent need not turn towards the goal's middle, but only towards its reach, and a step can drift aside
    spared_rad = math.asin(reach / straight) + math.atan2(drift, _get_lowest(stage, "forward_step"))
    turn_rad = math.radians(stage.parameters.largest("turn_step"))
    return steps + max(math.ceil((off_rad - spared_rad) / turn_rad - 1e-9), 0)


def read_moves(world: "FirstPersonEnv") -> tuple[int, ...]:
    """Return the numbers of the world's actions for a left turn, a right turn, a step and, if it exists, a step back.

    Raises:
        WorldError: if the world lacks a turn or the forward step.
    """
    try:
        moves = tuple(world.action_names.index(name) for name in ("turn_left", "turn_right", "move_forward"))
    except ValueError:
        raise WorldError(
            f"no path can be planned with the actions {world.action_names}; add both turns and a step forward"
        ) from None
    if "move_back" in world.action_names:
        return (*moves, world.action_names.index("move_back"))
    return moves


def _check_flat(stage: WorldState) -> None:
    """Check that a world is flat, as this planner knows one floor.

    Raises:
        WorldError: if it is a building.
    """
    if stage.has_heights:
        raise WorldError("this planner knows one floor; use the one of minihuman.worlds.first_person.heights.planner")


def _default(stage: WorldState, name: str) -> float:
    """Return the default of a parameter that is one number."""
    return stage.parameters.number(name, None)


def _get_lowest(stage: WorldState, name: str) -> float:
    """Return the lower end of a parameter's range, for a parameter that is one number."""
    value = stage.parameters[name].low
    assert not isinstance(value, tuple)
    return value


def _reach(stage: WorldState, goal: Entity, mover: Entity | None = None) -> float:
    """Return the ground distance between centres, in metres, below which a mover is near the goal.

    ``mover`` is a thing that the agent puts down on the floor; None for the agent.
    """
    _check_flat(stage)
    height = stage.agent.pos[1] if mover is None else 0.0
    threshold = float(goal.radius + (mover or stage.agent).radius + 1.1 * stage.reach)  # as in `WorldState.near`
    rise = goal.pos[1] - height
    return math.sqrt(max(threshold * threshold - rise * rise, 0.0))


def zones_of(world: "FirstPersonEnv") -> NDArray[np.float64]:
    """Return the rooms that planned paths avoid, float64[rooms, edges, 4]: each edge's start and inward normal.

    A room with fewer edges than another repeats its last one.
    """
    rooms = [[(*edge.start, *edge.normal) for edge in room.outline.edges] for room in world.off_limits()]
    n_edges = max(map(len, rooms), default=0)
    padded = [edges + edges[-1:] * (n_edges - len(edges)) for edges in rooms]
    return np.array(padded, dtype=np.float64).reshape(len(rooms), n_edges, 4)


def _list_obstacles(stage: WorldState, avoid: Sequence[Entity]) -> NDArray[np.float64]:
    """Return all entities but the agent and its load, float64[n, 4]: x, z, and the distances that these two keep.

    The agent keeps so far from the things to avoid that it is not near them.
    """
    agent = stage.agent
    carried = stage.agent.carrying
    rows = [
        (
            thing.pos[0],
            thing.pos[2],
            (_reach(stage, thing) if thing in avoid else float(agent.radius + thing.radius)) + _MARGIN,
            (0.0 if carried is None else float(carried.radius + thing.radius)) + _MARGIN,
        )
        for thing in stage.entities
        if thing is not agent and thing is not carried
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _find_barriers(stage: WorldState, goal: Entity, reach: float, longest: float) -> NDArray[np.float64]:
    """Return segments, float64[n, 4], that no path crosses and that lie between no stop near the goal and the goal.

    A stop keeps the body's radius from every wall, and the line between two stops keeps ``clearance``, so walls extend
    by that much beyond their ends. Where the line from a stop near the goal to the goal crosses a segment, that point
    is closer to the goal than ``reach`` minus the stop's distance from the segment. The part of each segment within
    that distance is left out.
    """
    radius = float(stage.agent.radius)
    clearance = _CAUTION * math.sqrt(radius * radius - longest * longest / 4)
    middle = np.array((goal.pos[0], goal.pos[2]))
    segments: list[tuple[NDArray[np.float64], NDArray[np.float64], float]] = []
    for wall in _merge_walls(stage.floor.walls):
        a = wall[:2]
        b = wall[2:]
        ahead = (b - a) / math.hypot(*(b - a))
        segments += [(a, b, radius), (a + _OVERLAP_M * ahead, a - clearance * ahead, radius - clearance)]
        segments += [(b - _OVERLAP_M * ahead, b + clearance * ahead, radius - clearance)]
    rows = [row for a, b, margin in segments for row in _out_of_reach(a, b, middle, reach, margin)]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _out_of_reach(
    a: NDArray[np.float64], b: NDArray[np.float64], middle: NDArray[np.float64], reach: float, margin: float
) -> list[tuple[float, ...]]:
    """Return the parts of the segment from ``a`` to ``b`` (x, z) that are out of reach of the goal.

    A point is out of reach if its distance from the goal's middle is at least ``reach`` minus ``margin``.
    """
    length = math.hypot(*(b - a))
    share = float((middle - a) @ (b - a)) / length**2
    foot = a + (b - a) * min(max(share, 0.0), 1.0)
    if math.hypot(*(foot - middle)) + margin >= reach:
        return [(*a, *b)]
    across = math.hypot(*(a + (b - a) * share - middle))
    half = math.sqrt(reach**2 - across**2) / length
    parts: list[tuple[float, ...]] = []
    if share > half:
        parts.append((*a, *(a + (b - a) * (share - half))))
    if share + half < 1:
        parts.append((*(a + (b - a) * (share + half)), *b))
    return parts


def _find_turning_points(floor: FloorPlan, barriers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the ends of barriers at which a path can bend, (n, 2) x, z: those in a room and not on another barrier."""
    ends = barriers.reshape(-1, 2)
    inside = np.zeros(len(ends), dtype=np.bool_)
    for room in floor.rooms:
        within = np.ones(len(ends), dtype=np.bool_)
        for (x, z), _, _, _, (normal_x, normal_z) in room.outline.edges:
            within &= normal_x * (ends[:, 0] - x) + normal_z * (ends[:, 1] - z) > -1e-6
        inside |= within
    return ends[inside & ~lies_on(barriers, ends)]


def _merge_walls(walls: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return walls (x0, z0, x1, z1), with a wall and those that continue it straight joined to one."""
    rows = [tuple(row) for row in walls.tolist()]
    starts = {row[:2]: row for row in rows}
    joined: dict[tuple[float, ...], None] = {}
    continued = set()
    for row in rows:
        after = starts.get(row[2:])
        if after is not None and after != row and _have_same_direction(row, after):
            continued.add(after[:2])
    for row in rows:
        if row[:2] in continued:
            continue
        end = row
        while (after := starts.get(end[2:])) is not None and _have_same_direction(end, after):
            end = after
        joined[(*row[:2], *end[2:])] = None
    return np.array(list(joined), dtype=np.float64).reshape(-1, 4)


def _have_same_direction(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Return whether two segments (x0, z0, x1, z1) have the same direction, apart from rounding."""
    ax = a[2] - a[0]
    az = a[3] - a[1]
    bx = b[2] - b[0]
    bz = b[3] - b[1]
    return abs(ax * bz - az * bx) <= 1e-9 * math.hypot(ax, az) * math.hypot(bx, bz) and ax * bx + az * bz > 0


BACKWARDS = 8  # steps back from a thing that are tried to take it: beside a wall, it can only be taken from farther off


def plan_take_all(world: "FirstPersonEnv", list_things: Callable[[], list[Entity]]) -> list[int] | None:
    """Return actions that pick up all things of a world, the nearest first; None if none were found.

    The world ends in its original state. Its step limit applies.

    Args:
        world: the world
        list_things: a function that returns the things that are still to be picked up in the world's present state
    """
    saved = world.save()
    actions = []
    try:
        while things := list_things():
            x, _, z = world.agent.pos
            nearest = min(things, key=lambda thing: math.hypot(thing.pos[0] - x, thing.pos[2] - z))
            leg = _approach_and_take(world, nearest, len(things), list_things)
            if leg is None:
                return None
            actions += leg
        return actions
    finally:
        world.restore(saved)


def _approach_and_take(
    world: "FirstPersonEnv", thing: Entity, count: int, list_things: Callable[[], list[Entity]]
) -> list[int] | None:
    """Approach a thing, face it, and pick up that thing or another one in front of it; return the actions.

    The result is None if no thing could be picked up, so that there are still ``count`` of them.
    """
    pickup = world.action_names.index("pickup")
    for approach in _approach(world, thing, ()):
        before = world.save()
        is_over = take_action(world, pickup, [])
        if len(list_things()) < count:
            return [*approach, pickup]
        if is_over:
            return None
        world.restore(before)
    return None


def _approach(world: "FirstPersonEnv", thing: Entity, avoid: Sequence[Entity]) -> Iterator[list[int]]:
    """Bring the agent near a thing, facing it, and yield the actions so far; then again from one step farther away.

    Nothing more is yielded once the episode is over.
    """
    back = world.action_names.index("move_back")
    actions = list[int]()
    if any(take_action(world, action, actions) for action in plan(world, thing, avoid=avoid) or ()):
        return
    for _ in range(BACKWARDS):
        if any(take_action(world, action, actions) for action in turns_to(world, thing)):
            return
        yield actions
        if take_action(world, back, actions):
            return


def take_action(world: "FirstPersonEnv", action: int, actions: list[int]) -> bool:
    """Take an action, add it to ``actions``, and return whether the episode is over."""
    _, terminated, truncated = world.advance(action)
    actions.append(action)
    return terminated or truncated


def turns_to(world: "FirstPersonEnv", thing: Entity) -> list[int]:
    """Return the numbers of the turns after which the agent faces a thing as closely as possible."""
    turn_rad = math.radians(world.stage.parameters.number("turn_step", None))
    x, _, z = world.agent.pos
    bearing_rad = math.atan2(z - thing.pos[2], thing.pos[0] - x)
    off_rad = (bearing_rad - world.agent.dir + math.pi) % (2 * math.pi) - math.pi
    name = "turn_left" if off_rad > 0 else "turn_right"
    return [world.action_names.index(name)] * round(abs(off_rad) / turn_rad)


def plan_put_next(world: "FirstPersonEnv", thing: Entity, target: Entity) -> list[int] | None:
    """Return actions that put a thing next to another and leave nothing carried; None if none were found.

    The world ends in its original state. Its step limit applies.
    """
    saved = world.save()
    actions = list[int]()
    try:
        carried = world.agent.carrying
        if carried is None and world.near(thing, target):
            return [world.action_names.index("turn_left")]  # a world checks for success only after a step
        has_other_load = carried is not None and carried is not thing
        if has_other_load and take_action(world, world.action_names.index("drop"), actions):
            return None
        if carried is thing:
            remaining = _bring(world, target)
        else:
            remaining = _fetch_and_bring(world, thing, target)
        if remaining is None:
            return None
        return actions + remaining
    finally:
        world.restore(saved)


def _fetch_and_bring(world: "FirstPersonEnv", thing: Entity, target: Entity) -> list[int] | None:
    """Fetch a thing and bring it to a target; return the actions, or None if none were found.

    Attempts avoid first none of the other entities, then the nearest one to the thing, then the nearest two, and so on.
    """
    saved = world.save()
    near = [entity for entity in world.entities if entity not in (thing, world.agent)]
    near.sort(key=lambda entity: math.dist(entity.pos, thing.pos))
    for n_avoided in range(len(near) + 1):
        actions = _fetch(world, thing, target, near[:n_avoided])
        if actions is not None:
            return actions
        world.restore(saved)
    return None


def _fetch(world: "FirstPersonEnv", thing: Entity, target: Entity, avoid: list[Entity]) -> list[int] | None:
    """Pick up a thing, from near or from farther away, and bring it to a target; return the actions or None.

    A carried thing floats ahead of the agent, where it might touch a wall if it was picked up from near.
    """
    pickup = world.action_names.index("pickup")
    for approach in _approach(world, thing, avoid):
        before = world.save()
        if not take_action(world, pickup, []) and world.agent.carrying is thing:
            brought = _bring(world, target)
            if brought is not None:
                return [*approach, pickup, *brought]
        world.restore(before)
    return None


def _bring(world: "FirstPersonEnv", target: Entity) -> list[int] | None:
    """Carry the load next to a target and put it down; return the actions, or None if it did not end up there."""
    carried = world.agent.carrying
    actions = list[int]()
    assert carried is not None
    if any(take_action(world, action, actions) for action in plan(world, target) or ()):
        return None
    take_action(world, world.action_names.index("drop"), actions)
    if world.near(carried, target):
        return actions
    return None
