"""What the kernels read and write, as flat arrays. A kernel knows these tables and nothing else.

Everything a kernel computes uses +, -, x, /, square roots, rounding, comparisons and bits only: no sine, no fused
multiply-add, no reordering. That is why a picture is the same on every machine, compiled or not.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


class Faces(NamedTuple):
    """Flat convex faces; the corners of face f are rows start[f] to start[f + 1] of the corner arrays."""

    start: I32  # (faces + 1,)
    position: F64  # (corners, 3) metres, or the mesh's own units
    texture_place: F64  # (corners, 2) repeats of the texture, right and up
    normal: F64  # (corners, 3) for the light
    colour: F64  # (faces, 3)
    texture: I32  # (faces,) row of Textures, -1 for none
    plane: F64  # (faces, 4) a, b, c, d: a*x + b*y + c*z + d is above 0 on the side it is seen from


class Rooms(NamedTuple):
    """Which faces make a room, where it is, and what it opens into."""

    first_face: I32  # (rooms + 1,)
    bounds: F64  # (rooms, 4) x0, z0, x1, z1
    first_edge: I32  # (rooms + 1,)
    edge: F64  # (edges, 3) a, b, c: a*x + b*z + c is above 0 inside
    first_opening: I32  # (rooms + 1,)
    opening: F64  # (openings, 4, 3)
    opening_into: I32  # (openings,)
    roofed: NDArray[np.bool_]  # (rooms,)


class Things(NamedTuple):
    """What the things look like: faces of the library, scaled."""

    faces: I32  # (things, 2) first face and one past the last
    scale: F64  # (things, 3)
    normal_scale: F64  # (things,) how long a normal becomes: OpenGL lights scaled meshes with it
    tint: F64  # (things, 3) times the faces' colours
    reach: F64  # (things, 2) radius around the vertical axis, and around the place, metres


class Textures(NamedTuple):
    """Every texture with its ever smaller versions, one texel an integer 0x00BBGGRR, bottom row first.

    Around each goes a ring of texels from its other side, so that a texel's neighbours are always beside it: a row is
    width + 2 texels. Offset is where the ring begins; width and height are without it.
    """

    texels: NDArray[np.uint32]
    levels: I64  # (textures, 12, 3) offset, width, height
    level_count: I64  # (textures,)


class Drawn(NamedTuple):
    """What has been drawn so far: which face covers each sample, and how each face varies over the picture.

    A picture row has four sample rows, so ``owner`` is (4 * height, width). A face's row in ``planes`` holds seven
    planes of a*x + b*y + c over pixel coordinates: nearness, 1/distance, then texture right and up and red, green and
    blue, each over distance.
    """

    owner: I32  # (4 * height, width) row of planes, -1 for the sky
    planes: F64  # (capacity, 21)
    kind: I32  # (capacity, 2) texture, and 1 where the colour is the same all over
    left: I32  # (4 * height,)
    right: I32  # (4 * height,)
    corners: F64  # (3, most, 3) a polygon, and before and after a cut
    screen: F64  # (most, 2) its corners in 1/256 of a pixel
    lit: F64  # (3, 3) how bright each channel is at three corners
