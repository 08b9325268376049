"""The planner of buildings: a path to a goal over floors, stairs and ramps, and a lower bound on the number of steps.

A route names the sectors. It is cut into legs whose sectors do not lie above each other, so that each leg is searched
for in the plan by the kernels of flat worlds, with the real moves and the walls of these sectors alone.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.heights.actions import bring_load, step
from minihuman.worlds.first_person.heights.footing import Walker, can_pass, room_below
from minihuman.worlds.first_person.heights.plan import SectorPlan
from minihuman.worlds.first_person.heights.planes import LEAST_AREA_M2, area_of, common_area
from minihuman.worlds.first_person.heights.routes import Route, find_route, least_length
from minihuman.worlds.first_person.heights.sliding import turn_body
from minihuman.worlds.first_person.heights.state import BuildingState
from minihuman.worlds.first_person.pathfinding.planner import read_moves
from minihuman.worlds.first_person.pathfinding.search import (
    BACK,
    FORWARD,
    TURN_LEFT,
    Body,
    clearance_map,
    distance_map,
    search,
)

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv

_MARGIN_M = 1e-7  # added to the distances that the rules keep from walls and things, so that rounding decides no move
_LOOK_AHEAD_M = 1.2  # how far a leg ends before the end of its sectors, whose last opening is a wall to the search
_AT_ENTRY_M = 0.35  # how near to the middle of an opening a leg ends
_BEHIND_M = 1.5  # how much of the route so far belongs to a leg: the body still overlaps it
_MOST_LEGS = 200
_MAX_CELL_M = 0.1  # of the grid by which a leg is searched for

_NO_ZONES = np.zeros((0, 0, 4))


def plan(world: "FirstPersonEnv", goal: Entity) -> tuple[int, ...] | None:
    """Return the numbers of actions that bring the agent, or what it carries, near the goal; None if none were found.

    At the goal, the plan is one action, since a world checks after a step. If step length and turn vary, the plan uses
    their defaults.

    Raises:
        WorldError: if the world lacks a turn or the forward step.
    """
    stage = _stage_of(world)
    moves = read_moves(world)
    agent = stage.agent
    load = agent.carrying
    placed = [(thing, thing.pos, thing.dir) for thing in (agent, load) if thing is not None]
    path: list[int] = []
    avoid = frozenset(room.number for room in world.off_limits())
    try:
        for _ in range(_MOST_LEGS):
            if _is_at(stage, goal):
                return tuple(moves[move] for move in path) or moves[:1]
            leg = _find_leg(stage, goal, len(moves), avoid)
            walked = [] if leg is None else _walk(stage, leg)
            if not walked:
                return None
            path += walked
        return None
    finally:
        for thing, pos, heading in placed:
            thing.pos = pos
            thing.dir = heading


def least_steps(world: "FirstPersonEnv", goal: Entity) -> int:
    """Return a lower bound on the number of steps to the goal; 1 at the goal, since a world checks after a step.

    Raises:
        WorldError: if no path leads to the goal.
    """
    stage = _stage_of(world)
    agent = stage.agent
    walker = stage.body_of(agent)
    start = (stage.agent_room, agent.pos[0], agent.pos[2])
    length = least_length(stage.floor, start, _goal_place(stage, goal), walker)
    if math.isinf(length):
        raise WorldError(f"no path leads from the agent to {goal!r}; connect their rooms")
    drift = max(abs(float(stage.parameters["forward_drift"].low)), abs(stage.parameters.largest("forward_drift")))  # type: ignore[arg-type]  # one number
    longest = math.hypot(stage.reach, drift)
    return max(math.ceil((length - _reach(stage, goal)) / longest - 1e-9), 1)


def _stage_of(world: "FirstPersonEnv") -> BuildingState:
    """Return the state of a building.

    Raises:
        WorldError: if the world is flat.
    """
    stage = world.stage
    if not isinstance(stage, BuildingState):
        raise WorldError("this planner is for buildings; use minihuman.worlds.first_person.pathfinding.planner")
    return stage


def _is_at(stage: BuildingState, goal: Entity) -> bool:
    """Return whether the agent, or what it carries once it is put down, is near the goal."""
    load = stage.agent.carrying
    if load is None:
        return stage.near(stage.agent, goal)
    x, _, z = load.pos
    return math.hypot(x - goal.pos[0], z - goal.pos[2]) < _reach(stage, goal) - _MARGIN_M and (
        abs((stage.floor_below(load.pos) or 0.0) - goal.pos[1]) < stage.step_height
    )


def _goal_place(stage: BuildingState, goal: Entity) -> tuple[int, float, float]:
    """Return the number of the sector in which a goal is, and its x and z.

    Raises:
        WorldError: if there is no floor below it.
    """
    x, y, z = goal.pos
    room = room_below(stage.floor, x, z, y)
    if room is None:
        raise WorldError(f"there is no floor below {goal!r}; place it in a room")
    return room, x, z


def _reach(stage: BuildingState, goal: Entity) -> float:
    """Return the distance in the plan, in metres, below which the agent, or what it puts down, is near the goal."""
    mover = stage.agent.carrying or stage.agent
    threshold = float(goal.radius + mover.radius + 1.1 * stage.reach)  # as in `WorldState.near`
    room, x, z = _goal_place(stage, goal)
    rise = goal.pos[1] - stage.floor.rooms[room].floor_plane.at(x, z)
    return math.sqrt(max(threshold * threshold - rise * rise, 0.0))


def _find_leg(stage: BuildingState, goal: Entity, n_moves: int, avoid: frozenset[int]) -> list[int] | None:
    """Return the moves of the next leg, as `search` numbers them; None if there is none."""
    agent = stage.agent
    floor = stage.floor
    walker = stage.body_of(agent)
    room, goal_x, goal_z = _goal_place(stage, goal)
    route = find_route(floor, (stage.agent_room, agent.pos[0], agent.pos[2]), (room, goal_x, goal_z), walker, avoid)
    if route is None:
        return None
    region, n_route = _choose_region(floor, route, walker, avoid)
    if n_route == len(route.sectors):
        target = goal_x, goal_z, _reach(stage, goal) - _MARGIN_M
    else:
        target = (*_choose_entry(route, n_route), _AT_ENTRY_M)
    load = agent.carrying
    body = Body(  # which may step back only with a load: there may be no room to turn before
        stage.parameters.number("forward_step", None),
        math.radians(stage.parameters.number("turn_step", None)),
        float(agent.radius) + _MARGIN_M,
        3 if load is None else n_moves,
        0.0 if load is None else math.hypot(load.pos[0] - agent.pos[0], load.pos[2] - agent.pos[2]),
        0.0 if load is None else float(load.radius) + _MARGIN_M,
    )
    return _search_region(stage, region, target, body)


def _choose_region(floor: SectorPlan, route: Route, walker: Walker, avoid: frozenset[int]) -> tuple[list[int], int]:
    """Return the sectors of the next leg, none above another, and how many of the route's they begin with.

    The sectors around the route come after it, so that a leg may make a detour around things.
    """
    region: list[int] = []
    n_route = 0
    for number in route.sectors:
        if any(_share_area(floor, number, chosen) for chosen in region):
            break
        region.append(number)
        n_route += 1
    for number in region:  # the loop appends to it
        sector = floor.rooms[number]
        for opening in sector.openings:
            middle = (opening.start + opening.end) / 2
            into = opening.into
            if into in region or into in avoid or not can_pass(sector, opening, floor.rooms[into], middle, walker):
                continue
            if not any(_share_area(floor, into, chosen) for chosen in region):
                region.append(into)
    return region, n_route


def _share_area(floor: SectorPlan, a: int, b: int) -> bool:
    """Return whether two sectors share a part of the plan."""
    first = floor.rooms[a].outline
    second = floor.rooms[b].outline
    if (
        first.max_x <= second.min_x
        or second.max_x <= first.min_x
        or first.max_z <= second.min_z
        or second.max_z <= first.min_z
    ):
        return False
    return a != b and area_of(common_area(first.corners, second.corners)) > LEAST_AREA_M2


def _choose_entry(route: Route, n_route: int) -> tuple[float, float]:
    """Return the point (x, z) at which a leg ends: the last entry that is far enough from the end of its sectors.

    If none is, it is the route's first entry.
    """
    end_x, end_z = route.entries[n_route - 1]
    for x, z in reversed(route.entries[: n_route - 1]):
        if math.hypot(x - end_x, z - end_z) >= _LOOK_AHEAD_M:
            return x, z
    return route.entries[0]


def _search_region(
    stage: BuildingState, region: Sequence[int], target: tuple[float, float, float], body: Body
) -> list[int]:
    """Return the moves that bring the body within reach of a target (x, z, reach), without leaving some sectors.

    They are numbered as in `search`; the list is empty if there are none.
    """
    floor = stage.floor
    agent = stage.agent
    walls = region_walls(floor, region, stage.body_of(agent))
    shapes = [floor.rooms[number].outline for number in region]
    bounds = np.array(
        (
            min(shape.min_x for shape in shapes),
            min(shape.min_z for shape in shapes),
            max(shape.max_x for shape in shapes),
            max(shape.max_z for shape in shapes),
        )
    )
    cell = min(body.step / 2, _MAX_CELL_M)
    discs = _list_obstacles(stage, region)
    free = clearance_map(walls, discs, _NO_ZONES, bounds, cell, body.radius)
    column = int((target[0] - bounds[0]) / cell)
    row = int((target[1] - bounds[1]) / cell)
    distance = distance_map(free, column, row, (target[2] + body.ahead) / cell)
    start = (agent.pos[0], agent.pos[2], agent.dir)
    return search(walls, discs, _NO_ZONES, start, target, body, bounds, distance, cell)


def region_walls(floor: SectorPlan, region: Sequence[int], walker: Walker) -> NDArray[np.float64]:
    """Return the segments that stop a body within some sectors, float64[n, 4] with x0, z0, x1, z1.

    They are walls, openings that lead out of the sectors or that the body cannot pass, and edges of holes.
    """
    inside = set(region)
    rows: list[tuple[float, ...]] = []
    for number in region:
        sector = floor.rooms[number]
        for edge_number, edge in enumerate(sector.outline.edges):
            free = sorted(
                (opening.start, opening.end)
                for opening in sector.openings
                if opening.edge == edge_number
                and opening.into in inside
                and can_pass(sector, opening, floor.rooms[opening.into], (opening.start + opening.end) / 2, walker)
            )
            reached = 0.0
            for start, end in [*free, (edge.length, edge.length)]:
                if start - reached > 1e-9:
                    rows.append((*edge.at(reached), *edge.at(start)))
                reached = max(reached, end)
        for hole in sector.floor_holes:
            corners = (
                (hole.min_x, hole.min_z),
                (hole.max_x, hole.min_z),
                (hole.max_x, hole.max_z),
                (hole.min_x, hole.max_z),
            )
            rows += [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    return np.array(rows, np.float64).reshape(-1, 4)


def _list_obstacles(stage: BuildingState, region: Sequence[int]) -> NDArray[np.float64]:
    """Return a row for each entity in some sectors: x, z, and the distances (m) that the agent and its load keep."""
    agent = stage.agent
    load = agent.carrying
    rows = []
    for thing in stage.entities:
        if (
            thing is agent
            or thing is load
            or room_below(stage.floor, thing.pos[0], thing.pos[2], thing.pos[1]) not in region
        ):
            continue
        beside_load = 0.0 if load is None else float(load.radius + thing.radius)
        rows.append(
            (thing.pos[0], thing.pos[2], float(agent.radius + thing.radius) + _MARGIN_M, beside_load + _MARGIN_M)
        )
    return np.array(rows, np.float64).reshape(-1, 4)


def _walk(stage: BuildingState, moves: Sequence[int]) -> list[int]:
    """Move the agent by the real rules until a move fails; return the moves that succeeded."""
    ahead_m = stage.parameters.number("forward_step", None)
    turn_rad = math.radians(stage.parameters.number("turn_step", None))
    done = []
    for move in moves:
        if move in (FORWARD, BACK):
            succeeded = step(stage, ahead_m if move == FORWARD else -ahead_m, 0.0)
        else:
            succeeded = turn_body(stage, turn_rad if move == TURN_LEFT else -turn_rad)
        if not succeeded:
            break
        bring_load(stage)
        done.append(move)
    return done
