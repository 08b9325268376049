"""The render pool: the pictures of many targets, drawn together by several threads without the GIL.

A row of numbers holds the addresses of each target's tables.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.drawing import RenderTarget, memory_for
from minihuman.worlds.first_person.render.kernel_tables import F64, I32, I64, THING_SIZE
from minihuman.worlds.first_person.render.shading import colour
from minihuman.worlds.first_person.render.visibility import SAMPLES, cover
from minihuman.worlds.kernels import array_at, int64, kernel
from minihuman.worlds.shared_work import DONE, TAKEN, add_to_counter, count, share_work

# The columns of a row: address and length of each of a target's arrays; how many float64 and int32 drawing needs.
TEXELS, TABLE, ROOM_FLOATS, ROOM_WHOLES, LIBRARY_FLOATS, LIBRARY_WHOLES, THINGS, PLACES, VIEW = range(0, 18, 2)
MEMORY = 18
ROW_SIZE = 20

_floats_at = array_at(np.float64)
_wholes_at = array_at(np.int32)
_texels_at = array_at(np.uint32)


@kernel(
    "(int64[:, ::1], int64[::1], float64[::1], int32[::1], uint8[:, :, :, ::1])",
    nogil=True,
    nth=int64,
)
def draw_targets(rows: I64, counters: I64, floats: F64, wholes: I32, out: NDArray[np.uint8]) -> int:
    """Take pictures in turn with other threads and draw them until none is left; then return -1.

    If a picture needs more memory, the function ends early and returns that picture's number. ``floats`` and ``wholes``
    are this thread's memory, and ``out`` has a picture for each row.
    """
    while True:
        nth = add_to_counter(counters, TAKEN, 1)
        if nth >= out.shape[0]:
            return -1
        row = rows[nth]
        if row[MEMORY] > floats.shape[0] or row[MEMORY + 1] > wholes.shape[0]:
            return nth
        view = _floats_at(row[VIEW], row[VIEW + 1])
        rooms = _floats_at(row[ROOM_FLOATS], row[ROOM_FLOATS + 1]), _wholes_at(row[ROOM_WHOLES], row[ROOM_WHOLES + 1])
        things = _floats_at(row[THINGS], row[THINGS + 1]).reshape(row[THINGS + 1] // THING_SIZE, THING_SIZE)
        places = _floats_at(row[PLACES], row[PLACES + 1]).reshape(row[PLACES + 1] // (SAMPLES + 1), SAMPLES + 1)
        if not cover(
            rooms[0],
            rooms[1],
            _floats_at(row[LIBRARY_FLOATS], row[LIBRARY_FLOATS + 1]),
            _wholes_at(row[LIBRARY_WHOLES], row[LIBRARY_WHOLES + 1]),
            things,
            places,
            view,
            floats,
            wholes,
        ):
            return nth
        texels = _texels_at(row[TEXELS], row[TEXELS + 1])
        table = _texels_at(row[TABLE], row[TABLE + 1])
        colour(texels, table, rooms[0], rooms[1], things, places, view, floats, wholes, out[nth])
        add_to_counter(counters, DONE, 1)


class RenderPool:
    """Draws the pictures of a number of targets with several threads.

    Args:
        pictures: the number of targets.
        threads: the maximum number of threads.
    """

    def __init__(self, pictures: int, threads: int) -> None:
        self._rows = np.zeros((pictures, ROW_SIZE), np.int64)
        self._targets: list[Any] = [None] * pictures  # kept alive, as the rows contain the addresses of their arrays
        self._helpers = min(threads, pictures) - 1

    def __reduce__(self) -> tuple[Any, ...]:
        return RenderPool, (len(self._targets), self._helpers + 1)

    def paint(self, targets: Iterable[RenderTarget], out: NDArray[np.uint8]) -> None:
        """Draw the picture of each target into ``out``, which is contiguous and has one picture per target."""
        for nth, target in enumerate(targets):
            self._set_target(nth, target)
        share_work(self._draw_share, (out,), len(out), self._helpers)

    def _draw_share(self, counters: I64, out: NDArray[np.uint8], _nth: int) -> None:
        """Draw pictures in one thread until none is left; one that needs more memory is drawn by its target."""
        while (unfinished := draw_targets(self._rows, counters, *memory_for(0, 0), out)) >= 0:
            self._targets[unfinished].draw(out[unfinished])
            count(counters, DONE, 1)

    def _set_target(self, nth: int, target: RenderTarget) -> None:
        """Write the addresses of a target's arrays, and the memory that it needs, into a row."""
        if self._targets[nth] is target:
            return
        layout = target.layout
        arrays = (*layout.textures, *layout.packed_rooms, *layout.packed_library, layout.things, target.places)
        self._rows[nth] = *addresses(*arrays, target.view), *target.room()
        self._targets[nth] = target


def addresses(*arrays: NDArray[Any]) -> list[int]:
    """Return the address and length of each array in turn; the caller keeps the arrays alive."""
    assert all(array.flags.c_contiguous for array in arrays)
    return [number for array in arrays for number in (array.__array_interface__["data"][0], array.size)]
