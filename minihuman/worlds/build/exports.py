"""The kernels that are built ahead of time, and the table of arguments with which each is called.

Every exported function has the C signature ``int32 name(const void *table, int32 number)``. The table consists of int64
numbers: for each argument in turn, a number itself, or the start of an array followed by its extents. The whole number
whose name is `NUMBER` is not in the table, since it is the second argument. Results follow the arguments, eight bytes
each, whole numbers as int64 and others as float64; the first result is also returned if it is whole.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.motion_kernels import step_freely
from minihuman.worlds.first_person.render.draw_buffers import size_of
from minihuman.worlds.first_person.render.shading import colour
from minihuman.worlds.first_person.render.texture import fill_sizes
from minihuman.worlds.first_person.render.visibility import cover
from minihuman.worlds.first_person.rules import look, step
from minihuman.worlds.first_person.state_digest import digest_state
from minihuman.worlds.grid.babyai.verifier import step_instructed
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.pictures.drawing import draw_cells
from minihuman.worlds.kernels import int64, kernel
from minihuman.worlds.step_digest import digest_step

NUMBER = "action"  # the parameter that is passed beside the table


@kernel("(uint8[::1], uint8[::1])", hold_gil=True)
def write_rgba(picture: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """Convert RGB bytes to RGBA bytes for a canvas, with full opacity."""
    for pixel in range(len(out) // 4):
        out[4 * pixel] = picture[3 * pixel]
        out[4 * pixel + 1] = picture[3 * pixel + 1]
        out[4 * pixel + 2] = picture[3 * pixel + 2]
        out[4 * pixel + 3] = int64(255)


# by module, for a page loads the modules that its worlds need: kernels by the names that they have there
EXPORTS: Mapping[str, Mapping[str, Callable[..., Any]]] = {
    "grid": {
        "step": step_instructed,  # which steps the others too
        "see": see,
        "digest_step": digest_step,
        "draw_cells": draw_cells,
        "write_rgba": write_rgba,
    },
    "first_person": {
        "step": step,
        "step_freely": step_freely,
        "look": look,
        "digest_state": digest_state,
        "fill_sizes": fill_sizes,
        "size_of": size_of,
        "cover": cover,
        "colour": colour,
        "write_rgba": write_rgba,
    },
}
