"""Claiming samples: what a face gets is what nothing nearer owns, and never less than none."""

import numpy as np

from minihuman.worlds.first_person.render.raster import claim
from minihuman.worlds.first_person.render.tables import Drawn


def blank(rows: list[tuple[int, int]], width: int = 8) -> Drawn:
    """Nothing drawn yet; two faces, the second nearer, whose outline begins and ends here in each sample row."""
    planes = np.zeros((2, 21))
    planes[:, 2] = 1.0, 2.0
    left, right = (np.array(ends, np.int32) for ends in zip(*rows, strict=True))
    return Drawn(
        np.full((len(rows), width), -1, np.int32),
        planes,
        np.zeros((2, 2), np.int32),
        left,
        right,
        np.empty((3, 4, 3)),
        np.empty((4, 2)),
        np.empty((3, 3)),
    )


def test_a_nearer_face_takes_samples_and_one_behind_it_gets_what_is_left() -> None:
    drawn = blank([(0, 8), (2, 6)])
    assert claim.py_func(drawn, 1, 1, 2) == 4
    assert claim.py_func(drawn, 0, 0, 2) == 8
    assert drawn.owner.tolist() == [[0] * 8, [-1, -1, 1, 1, 1, 1, -1, -1]]


def test_a_row_that_ends_before_it_begins_takes_nothing_back() -> None:
    drawn = blank([(1, 4), (5, 2), (3, 3)])
    assert claim.py_func(drawn, 0, 0, 3) == 3
    assert (drawn.owner == 0).sum() == 3
