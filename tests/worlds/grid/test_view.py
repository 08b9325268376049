"""The usual view, made of vectors, is what the general one sees: in worlds that no layout makes, at every border."""

import numpy as np
import pytest

from minihuman.worlds.grid.core import state
from minihuman.worlds.grid.core.cells import pack
from minihuman.worlds.grid.core.view import USUAL_VIEW, see, see_cells
from minihuman.worlds.kernels import int64, kernel

LOOKS = [pack(kind, colour, door, 0) for kind in range(1, 16) for colour in range(6) for door in range(3)]


@kernel()
def see_generally(row, image):
    """The general view at the usual size."""
    see_cells(row, image, int64(USUAL_VIEW))


def draw_row(chance, *, see_through):
    """A world of any size, half empty, with anything anywhere, kinds of its own and the agent too."""
    width, height = (int(size) for size in chance.integers(3, 26, 2))
    row = np.zeros(state.row_length(width, height), np.int32)
    cells = chance.choice(LOOKS, width * height)
    cells[chance.random(width * height) < chance.random()] = pack(1, 0, 0, 0)
    identities = chance.integers(0, width * height, width * height)
    row[state.HEADER : state.HEADER + width * height] = cells + (identities << 9)
    row[[state.WIDTH, state.HEIGHT, state.X, state.Y]] = width, height, chance.integers(width), chance.integers(height)
    row[[state.DIRECTION, state.CARRYING]] = chance.integers(4), chance.choice(LOOKS)
    own = chance.integers(0, 1 << 20) if chance.integers(0, 3) == 0 else 0  # the general view, where one of them hides
    row[state.SEE_THROUGH] = int(see_through) | int(own) << 1
    return row


@pytest.mark.parametrize("see_through", [False, True])
def test_vectors_see_what_the_general_view_sees(see_through):
    chance = np.random.default_rng(5)
    for _ in range(3000):
        row = draw_row(chance, see_through=see_through)
        ours, general = np.full((2, USUAL_VIEW, USUAL_VIEW, 3), 99, np.uint8)
        see(row, ours)
        see_generally(row, general)
        np.testing.assert_array_equal(ours, general)


def test_vectors_write_nothing_beside_the_picture():
    chance = np.random.default_rng(6)
    for _ in range(200):
        room = np.full(USUAL_VIEW * USUAL_VIEW * 3 + 64, 99, np.uint8)
        see(draw_row(chance, see_through=False), room[32:-32].reshape(USUAL_VIEW, USUAL_VIEW, 3))
        assert (room[:32] == 99).all()
        assert (room[-32:] == 99).all()


@pytest.mark.parametrize("x", [32_760, 65_530, 65_538, 66_003])
@pytest.mark.parametrize("direction", range(4))
def test_a_world_longer_than_16_bits_count_is_seen_as_any(x, direction):
    seen = []
    for width, at in ((66_004, x), (21, 20 if x == 66_003 else 10)):
        row = np.zeros(state.row_length(width, 4), np.int32)
        row[state.HEADER : state.HEADER + 4 * width] = pack(1, 0, 0, 0)
        row[[state.WIDTH, state.HEIGHT, state.X, state.Y, state.DIRECTION]] = width, 4, at, 1, direction
        row[state.CARRYING] = pack(1, 0, 0, 0)
        seen.append(np.full((USUAL_VIEW, USUAL_VIEW, 3), 99, np.uint8))
        see(row, seen[-1])
    np.testing.assert_array_equal(*seen)
