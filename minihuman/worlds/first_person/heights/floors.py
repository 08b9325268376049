"""The floors of a building: their map, their plans from above, and whether the agent can reach all rooms."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette
from minihuman.worlds.first_person.heights.footing import Walker, can_pass
from minihuman.worlds.first_person.heights.plan import SectorPlan
from minihuman.worlds.first_person.heights.state import BuildingState
from minihuman.worlds.first_person.heights.surfaces import floor_tables
from minihuman.worlds.first_person.pictures import WorldRenderer
from minihuman.worlds.pose import Map, Thing


def building_map(stage: BuildingState) -> Map:
    """Return the plans of all floors in metres: the walls of each, and the places of all entities but the agent."""
    plan = stage.floor
    walls: list[tuple[float, float, float, float]] = []
    floors: list[int] = []
    for room, (x0, z0, x1, z1) in zip(plan.wall_rooms.tolist(), plan.walls.tolist(), strict=True):
        for floor in plan.floors_of(room):
            walls.append((x0, z0, x1, z1))
            floors.append(floor)
    return Map(
        unit="m",
        bounds=plan.bounds,
        walls=tuple(walls),
        things=tuple(
            Thing(
                *(entity.name, entity.pos[0], entity.pos[2], float(entity.radius), entity.colour),
                floor=plan.floor_at(entity.pos[1]),
            )
            for entity in stage.entities
            if entity is not stage.agent
        ),
        levels=plan.levels,
        wall_floors=tuple(floors),
    )


def draw_floor(
    renderer: WorldRenderer, stage: BuildingState, floor: int, size_px: tuple[int, int], palette: Palette
) -> NDArray[np.uint8]:
    """Return a picture of one floor from above, with what stands there and the agent if it is there.

    The picture is uint8[H, W, 3] of exactly ``size_px`` (width, height).

    Raises:
        WorldError: if there is no such floor.
    """
    plan = stage.floor
    if not 0 <= floor < len(plan.levels):
        raise WorldError(f"floor is {floor}; the floors of this building are 0 to {len(plan.levels) - 1}")
    rooms = [number for number in range(len(plan.rooms)) if floor in plan.floors_of(number)]
    things = [thing for thing in stage.entities if thing is not stage.agent and plan.floor_at(thing.pos[1]) == floor]
    is_here = plan.floor_at(stage.agent.pos[1]) == floor
    return renderer.draw_part(
        stage, lambda library: floor_tables(plan, library, rooms), things, size_px, palette, shows_agent=is_here
    )


def check_reach(stage: BuildingState) -> None:
    """Check that the agent can walk to every room that must be reached.

    Raises:
        WorldError: if it cannot; the message names the first such room and what keeps it apart.
    """
    plan = stage.floor
    body = stage.body_of(stage.agent)
    reached = _find_reached(plan, stage.agent_room, body)
    for number, room in enumerate(plan.rooms):
        if number in reached or not room.must_be_reached:
            continue
        floor = plan.floors_of(number)[0]
        no_opening = "no opening leads there; connect it, or build it with must_be_reached=False"
        obstacle = next(_describe_obstacles(plan, number, reached, body), no_opening)
        raise WorldError(f"floor {floor}: {plan.describe(number)} cannot be reached from the agent's room: {obstacle}")


def _find_reached(plan: SectorPlan, start: int, body: Walker) -> set[int]:
    """Return the numbers of the sectors that a body can reach from the sector ``start``, itself included."""
    reached = {start}
    waiting = [start]
    for number in waiting:  # the loop appends to it
        sector = plan.rooms[number]
        following = [
            opening.into
            for opening in sector.openings
            if can_pass(sector, opening, plan.rooms[opening.into], (opening.start + opening.end) / 2, body)
        ]
        following += [hole.into for hole in sector.floor_holes if body.fall > body.step]
        for into in following:
            if into not in reached:
                reached.add(into)
                waiting.append(into)
    return reached


def _describe_obstacles(plan: SectorPlan, number: int, reached: set[int], body: Walker) -> Iterator[str]:
    """Yield a text for each opening into a sector from reached ones, with the reason why a body cannot pass it."""
    for start in sorted(reached):
        sector = plan.rooms[start]
        for opening in sector.openings:
            if opening.into != number:
                continue
            middle = (opening.start + opening.end) / 2
            x, z = sector.outline.edges[opening.edge].at(middle)
            bottom, top = opening.heights_at(middle)
            rise = bottom - sector.floor_plane.at(x, z)
            location = f"at (x {x:g}, z {z:g})"
            if top - bottom < body.height:
                yield f"the opening {location} is {top - bottom:.3g} m high, lower than the body's {body.height:g} m"
            elif rise > body.step:
                yield (
                    f"the step up {location} is {rise:.3g} m, higher than step_height = {body.step:g} m; add stairs or "
                    "a ramp"
                )
            else:
                drop = bottom - plan.rooms[number].floor_plane.at(x, z)
                yield (
                    f"the edge {location} is {drop:.3g} m deep; add stairs or a ramp, or let bodies fall by fall_height"
                )
