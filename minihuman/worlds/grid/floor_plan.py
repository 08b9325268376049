"""The floor plan: a grid's walls as outlines and its things by name, enough to draw paths without the world."""

from collections.abc import Sequence

import numpy as np

from minihuman.worlds.grid.art.palettes import GridPalette, hex_colour
from minihuman.worlds.grid.core.cells import COLOURS, EMPTY, LAVA, WALL, colour_of, kind_of
from minihuman.worlds.grid.core.state import State
from minihuman.worlds.grid.kinds import Kind, kind_name
from minihuman.worlds.outlines import wall_outlines
from minihuman.worlds.pose import Map, Thing


def floor_plan(state: State, palette: GridPalette = "classic", kinds: Sequence[Kind] = ()) -> Map:
    """The map of a state: wall outlines, and every thing that lies in a cell now."""
    lying = state.kinds
    walls = wall_outlines(lying == WALL)
    things = []
    for x, y in np.argwhere((lying != WALL) & (lying != EMPTY)).tolist():
        code = int(state.cells[x, y])
        kind, colour = kind_name(kind_of(code), kinds), COLOURS[colour_of(code)]
        name = kind if kind_of(code) == LAVA else f"{colour} {kind}"
        things.append(Thing(name, float(x), float(y), 0.5, hex_colour(code, palette)))
    bounds = (-0.5, -0.5, state.width - 0.5, state.height - 0.5)
    return Map("cell", bounds, walls, tuple(things))
