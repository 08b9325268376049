"""The tables that the render kernels read and write, as flat arrays.

Kernels compute with +, -, x, /, square roots, rounding, comparisons and bits only: without sines, fused multiply-add or
reordering. A picture is therefore the same on every machine, compiled or not.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]


# In place of a texture: the face covers only the first of each pixel's four samples; -3: only the second, and so on.
SHADE = -2


class FaceTable(NamedTuple):
    """Flat convex faces; the corners of face f are the rows start[f] to start[f + 1] of the corner arrays."""

    start: I32  # (faces + 1,)
    position: F64  # (corners, 3) metres, or the mesh's own units
    texture_place: F64  # (corners, 2) repeats of the texture, right and up
    normal: F64  # (corners, 3) for the light
    colour: F64  # (faces, 3)
    texture: I32  # (faces,) row of Textures; -1 for none; `SHADE` and below for a shade on what is behind
    plane: F64  # (faces, 4) a, b, c, d: a*x + b*y + c*z + d is above 0 on the side it is seen from


OCCLUDER_SIZE = 8
NO_FACES = np.zeros(1, np.int32)
NO_OCCLUDERS = np.zeros((0, OCCLUDER_SIZE))


class RoomTable(NamedTuple):
    """The faces, place and openings of each room."""

    first_face: I32  # (rooms + 1,)
    bounds: F64  # (rooms, 4) x0, z0, x1, z1
    first_edge: I32  # (rooms + 1,)
    edge: F64  # (edges, 3) a, b, c: a*x + b*z + c is above 0 inside
    first_opening: I32  # (rooms + 1,)
    opening: F64  # (openings, 4, 3)
    opening_into: I32  # (openings,)
    roofed: NDArray[np.bool_] | I32  # (rooms,)
    # What darkens each face where it meets others, in the look of a display: segments in the plane of its texture,
    # x, y, direction x, y, length, and how much the texture covers right and up, metres; 1.0 for a floor.
    first_occluder: I32 = NO_FACES  # (faces + 1,) or (1,) where there are none
    occluder: F64 = NO_OCCLUDERS  # (n, OCCLUDER_SIZE)


# The columns of a thing's array, (things, THING_SIZE): its first face in the library and one past its last; its scale
# along x, y and z; the factor of its normals' length (OpenGL lights scaled meshes with it); the factors of its faces'
# colours (3); its largest distances from the vertical axis and from its place, metres; and its bounding box: half its
# width, its lowest and highest y, and half its depth, metres.
FIRST = 0
LAST = 1
THING_SCALE = 2
THING_NORMAL_SCALE = 5
THING_TINT = 6
AROUND = 9
REACH = 10
THING_BOX = 11
THING_SIZE = 15


class TextureTable(NamedTuple):
    """Every texture in decreasing sizes, with one texel per integer 0x00BBGGRR, bottom row first.

    Each size is surrounded by a ring of texels from its opposite sides, so that a texel's neighbours are always
    adjacent: a row is width + 2 texels. In the table, each texture has `texture.MOST_SIZES` pairs, one per size: the
    start of its ring; its width without the ring, with its height in the upper half. The very last number is that of
    the smallest size.
    """

    texels: NDArray[np.uint32]
    table: NDArray[np.uint32]


# the columns of a span: its first pixel and one past its last, and its face's row of planes
BEGIN = 0
END = 1
FACE = 2


class DrawBuffers(NamedTuple):
    """The state of a drawing: the face that covers each sample, and how each face varies over the picture.

    A row of pixels has four rows of samples, each a list of spans from left to right, with sky between them. A face's
    row in ``planes`` contains seven planes a*x + b*y + c over pixel coordinates: nearness (1/distance), then the
    texture coordinates right and up and red, green and blue, each divided by distance.
    """

    spans: I32  # (4 * height, the maximum per row, 3)
    counts: I32  # (4 * height,) how many spans each row has
    merged: I32  # (3 * the maximum per row + 8, 3) spans that are about to replace others
    planes: F64  # (capacity, 21)
    kind: I32  # (capacity, 2) texture; and 1 if the face has one colour, plus 2 * (1 + its number) if it is a room's
    run: I32  # (capacity,) the latest run of lookups of each face
    left: I32  # (4 * height + 8,) where a face begins in each sample row
    right: I32  # (4 * height + 8,) and where it ends
    corners: F64  # (3, most corners, 3) a polygon, and its forms before and after a cut
    screen: F64  # (most corners, 2) its corners in 1/256 of a pixel
    lit: F64  # (3, 3) how bright each channel is at three corners
    inverse: F64  # (4, 3) the inverse matrix of three corners' positions, and the factors of its rows
    tiles: F64  # (TILES, TILES) the least nearness of the picture so far
