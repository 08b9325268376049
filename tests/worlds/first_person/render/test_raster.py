"""Claiming samples: what a face gets is what nothing nearer owns, and never less than none."""

import numpy as np

from minihuman.worlds.first_person.render.kernel_tables import DrawBuffers
from minihuman.worlds.first_person.render.rasterisation import TILES
from minihuman.worlds.first_person.render.spans import claim
from minihuman.worlds.kernels import kernel

WIDTH = 8


@kernel(nogil=True)
def claims(drawn: DrawBuffers, face: int, first: int, last: int) -> int:
    return claim(drawn, face, first, last, -1)


def blank(rows: list[tuple[int, int]], *, nearness: tuple[tuple[float, float], ...], spans: int = 8) -> DrawBuffers:
    """Nothing drawn yet; faces by how near they are, a step right and at the left, and where in each row one lies."""
    planes = np.zeros((len(nearness), 21))
    planes[:, 0], planes[:, 2] = np.array(nearness).T
    left, right = (np.array(ends, np.int32) for ends in zip(*rows, strict=True))
    return DrawBuffers(
        np.zeros((len(rows), spans, 3), np.int32),
        np.zeros(len(rows), np.int32),
        np.zeros((3 * spans + 8, 3), np.int32),
        planes,
        np.zeros((len(nearness), 2), np.int32),
        np.zeros(len(nearness), np.int32),
        left,
        right,
        np.empty((3, 4, 3)),
        np.empty((4, 2)),
        np.empty((3, 3)),
        np.empty((4, 3)),
        np.empty((TILES, TILES)),
    )


def owners(drawn: DrawBuffers) -> list[list[int]]:
    """Who owns each sample, -1 for nobody; no two spans overlap."""
    rows = []
    for spans, count in zip(drawn.spans, drawn.counts, strict=True):
        row = np.full(WIDTH, -1)
        for begin, end, face in spans[:count]:
            assert (row[begin:end] == -1).all()
            row[begin:end] = face
        rows.append(row.tolist())
    return rows


def test_a_nearer_face_takes_samples_and_one_behind_it_gets_what_is_left() -> None:
    drawn = blank([(0, 8), (2, 6)], nearness=((0.0, 1.0), (0.0, 2.0)))
    assert claims(drawn, 1, 1, 2) == 4
    assert claims(drawn, 0, 0, 2) == 8
    assert owners(drawn) == [[0] * 8, [-1, -1, 1, 1, 1, 1, -1, -1]]


def test_a_face_that_comes_later_and_is_nearer_takes_samples_back() -> None:
    drawn = blank([(0, 8)], nearness=((0.0, 1.0), (0.0, 2.0)))
    assert claims(drawn, 0, 0, 1) == 8
    drawn.left[0], drawn.right[0] = 3, 5
    assert claims(drawn, 1, 0, 1) == 2
    assert owners(drawn) == [[0, 0, 0, 1, 1, 0, 0, 0]]


def test_faces_that_run_through_each_other_change_places_where_they_cross() -> None:
    drawn = blank([(0, 8)], nearness=((0.0, 4.0), (1.0, 0.0)))  # equally near at 4 pixels
    assert claims(drawn, 0, 0, 1) == 8
    assert claims(drawn, 1, 0, 1) == 4
    assert owners(drawn) == [[0, 0, 0, 0, 1, 1, 1, 1]]


def test_a_row_that_ends_before_it_begins_takes_nothing_back() -> None:
    drawn = blank([(1, 4), (5, 2), (3, 3)], nearness=((0.0, 1.0),))
    assert claims(drawn, 0, 0, 3) == 3
    assert sum(row.count(0) for row in owners(drawn)) == 3


def test_a_row_without_room_for_a_span_says_so() -> None:
    drawn = blank([(2, 3)], nearness=((0.0, 1.0), (0.0, 2.0)), spans=1)
    assert claims(drawn, 0, 0, 1) == 1
    drawn.left[0], drawn.right[0] = 5, 6
    assert claims(drawn, 1, 0, 1) == -1
