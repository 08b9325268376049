"""Pictures against a slow, exact renderer: the same faces, looked up pixel by pixel in double precision."""

import math

import numpy as np
import pytest

from minihuman.worlds.first_person.render import drawing
from minihuman.worlds.first_person.render.draw_buffers import drawn_in
from minihuman.worlds.first_person.render.scene import Camera, Scene
from minihuman.worlds.first_person.render.texture import MOST_SIZES
from tests.worlds.first_person.render.stages import two_rooms

WIDTH, HEIGHT = 160, 120
WITHIN = 3.0  # of 255


def exact(scene: Scene, plane: np.ndarray, texture: int, x: int, y: int) -> list[np.ndarray]:
    """The colours a face has at a pixel by each size of its texture, smallest number first, and the size that fits."""
    at = np.array([x + 0.5, y + 0.5, 1.0])
    inverse, u, v = (float(plane[3 * k : 3 * k + 3] @ at) for k in (1, 2, 3))
    light = np.array([plane[12], plane[15], plane[18]])
    if texture < 0:
        return [255.0 * light] * 2
    u, v = u / inverse, v / inverse
    table = scene.layout.textures.table.reshape(-1, MOST_SIZES, 2)[texture].astype(np.int64)
    wide, high = table[0, 1] & 0xFFFF, table[0, 1] >> 16
    ways = [abs(plane[6 + k] - u * plane[3 + k]) * wide for k in (0, 1)]
    ways += [abs(plane[9 + k] - v * plane[3 + k]) * high for k in (0, 1)]
    fitting = 4.0 * math.log2(max(max(ways) / inverse, 1e-9))
    last = int(table[-1, 1])
    colours = []
    for size in range(math.floor(fitting) - 1, math.floor(fitting) + 3):  # on the edge of two sizes, either
        offset, both = table[min(max(size, 0), last)]
        colours.append(between(scene.layout.textures.texels, int(offset), both & 0xFFFF, both >> 16, u, v) * light)
    return colours


def between(texels: np.ndarray, offset: int, width: int, height: int, u: float, v: float) -> np.ndarray:
    x, y = (u - math.floor(u)) * width + 0.5, (v - math.floor(v)) * height + 0.5
    column, row = math.floor(x), math.floor(y)
    found = np.zeros(3)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        share = (x - column if dx else 1 - x + column) * (y - row if dy else 1 - y + row)
        texel = int(texels[offset + column + dx + (row + dy) * (width + 2)])
        found += share * np.array([texel & 255, texel >> 8 & 255, texel >> 16])
    return found


@pytest.mark.parametrize(("yaw", "pitch"), [(0.1, 0.0), (2.0, -20.0), (-1.0, 8.0)])
def test_a_pixel_that_one_face_covers_has_the_colour_that_face_has_there(yaw: float, pitch: float) -> None:
    scene, camera = two_rooms(), Camera((-1.5, 1.5, 0.3), yaw, math.radians(pitch))
    picture = drawing.render(scene, camera, WIDTH, HEIGHT).astype(float)
    view = drawing._perspective(camera, WIDTH, HEIGHT)
    drawing._complete(scene, view, WIDTH, HEIGHT)
    drawn, _, _ = getattr(drawn_in, "py_func", drawn_in)(
        view, *drawing._cover(scene.layout, view, drawing._turned(scene.places))
    )
    owner = np.full((4 * HEIGHT, WIDTH), -1)
    for row in range(4 * HEIGHT):
        for begin, end, face in drawn.spans[row][: drawn.counts[row]]:
            owner[row, begin:end] = face
    compared = 0
    for y in range(0, HEIGHT, 8):
        for x in range(WIDTH):
            faces = set(owner[4 * y : 4 * y + 4, x].tolist())
            face = faces.pop()
            if faces or face < 0 or not drawn.kind[face, 1] & 1:  # in other bits: which surface its shade is of
                continue
            colours = exact(scene, drawn.planes[face], int(drawn.kind[face, 0]), x, y)
            away = min(float(np.abs(picture[y, x] - colour).max()) for colour in colours)
            assert away <= WITHIN, (x, y, picture[y, x], colours)
            compared += 1
    assert compared > 1500
