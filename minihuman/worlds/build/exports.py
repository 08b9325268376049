"""Which kernels are built ahead of time, and how each is called: the table of its arguments.

Every exported function has one C signature, ``int32 name(const void *table, int32 number)``. The table is int64
numbers: for each argument in turn where an array starts, followed by its extents, or a number itself. The whole number
whose name is `NUMBER` is not in the table; it is the second argument. Results come after the arguments, eight bytes
each, whole numbers as int64 and others as float64; the first is returned too if it is whole.
"""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.shading import colour
from minihuman.worlds.first_person.render.texture import fill_sizes
from minihuman.worlds.first_person.render.visibility import cover, size_of
from minihuman.worlds.first_person.rules import digest_state, look, step
from minihuman.worlds.grid.babyai.verifier import step_instructed
from minihuman.worlds.grid.core.view import see
from minihuman.worlds.grid.pictures.drawing import draw_cells
from minihuman.worlds.kernels import int64, kernel
from minihuman.worlds.step_digest import digest_step

NUMBER = "action"  # the parameter that is passed beside the table

_ROW, _WORDS, _VIEW = "int32[::1]", "uint64[::1]", "uint8[:,:,::1]"
_F64, _I32, _U32 = "float64[::1]", "int32[::1]", "uint32[::1]"
_MATRIX = "float64[:,::1]"


@kernel("(uint8[::1], uint8[::1])", hold_gil=True)
def write_rgba(picture: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """Write bytes of red, green and blue as a canvas takes them: with a fourth that says opaque."""
    for pixel in range(len(out) // 4):
        out[4 * pixel] = picture[3 * pixel]
        out[4 * pixel + 1] = picture[3 * pixel + 1]
        out[4 * pixel + 2] = picture[3 * pixel + 2]
        out[4 * pixel + 3] = int64(255)


@dataclass(frozen=True, slots=True)
class Export:
    """A kernel that is built ahead of time.

    Args:
        name: of the function in the library.
        kernel: what Numba compiles.
        arguments: Numba's types of the kernel's parameters, in order; arrays are contiguous.
    """

    name: str
    kernel: Callable[..., Any]
    arguments: tuple[str, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of the kernel's parameters."""
        return tuple(inspect.signature(self.kernel.py_func).parameters)  # type: ignore[attr-defined] # Numba's


_RGBA = Export("write_rgba", write_rgba, ("uint8[::1]", "uint8[::1]"))

# by module: a page loads the modules that its worlds need
EXPORTS: Mapping[str, tuple[Export, ...]] = {
    "grid": (
        Export("step", step_instructed, (_ROW, "int64", _WORDS, _VIEW)),  # which steps the others too
        Export("see", see, (_ROW, _VIEW)),
        Export("digest_step", digest_step, (_ROW, _VIEW, _WORDS)),
        Export(
            "draw_cells",
            draw_cells,
            (
                *(_ROW, _VIEW, "boolean", "boolean", "int64[:,::1]", "int64[::1]", "int64[:,::1]"),
                *("uint8[:,:,:,::1]", "uint8[:,:,:,::1]", "uint8[:,:,:,::1]", "uint8[:,::1]", "uint8[:,::1]"),
            ),
        ),
        _RGBA,
    ),
    "first_person": (
        Export("step", step, (_MATRIX, _F64, _MATRIX, _WORDS, _MATRIX, _MATRIX, "int64")),
        Export("look", look, (_MATRIX, _F64, _MATRIX, _F64, "int64", "int64")),
        Export("digest_state", digest_state, (_MATRIX, _F64, _WORDS, _WORDS)),
        Export("fill_sizes", fill_sizes, (_VIEW, _U32, _U32)),
        Export("size_of", size_of, ("int64",) * 5),
        Export("cover", cover, (_F64, _I32, _F64, _I32, _MATRIX, _MATRIX, _F64, _F64, _I32)),
        Export("colour", colour, (_U32, _U32, _F64, _I32, _MATRIX, _MATRIX, _F64, _F64, _I32, _VIEW)),
        _RGBA,
    ),
}
