"""The floor plan of a stage as plain segments and things, for plots and replay."""

from minihuman.worlds.first_person.stage import Stage
from minihuman.worlds.pose import Map, Thing


def floor_map(stage: Stage) -> Map:
    """Walls that stop a body, and everything placed but the agent, where it stands now. Metres."""
    return Map(
        unit="m",
        bounds=stage.floor.bounds,
        walls=tuple((x0, z0, x1, z1) for x0, z0, x1, z1 in stage.floor.walls.tolist()),
        things=tuple(
            Thing(entity.name, entity.pos[0], entity.pos[2], float(entity.radius), entity.colour)
            for entity in stage.entities
            if entity is not stage.agent
        ),
    )
