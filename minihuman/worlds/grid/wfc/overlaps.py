"""Overlaps: the patterns of a picture, how often they come, and which of them fit beside each other.

The overlapping model of Wave Function Collapse (M. Gumin, 2016) as Minigrid 3.2 has it: every window of so many
cells, over the picture's edges too, in so many of its eight orientations. Patterns are numbered by a hash, since
Minigrid's draws go by that order; the hash is an inner product with the first numbers of ``RandomState(0)``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))  # a neighbour's place: along the first axis of a layout, along the second
WORD = 64  # patterns that one number of a set holds


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """The n patterns of a picture.

    Attributes:
        weights: float64[n], in how many orientations of the picture a pattern comes.
        walls: bool[n], whether the pattern's first cell is a wall.
        beside: uint64[4, n, words], for each side the set of patterns that may have this one there.
    """

    weights: NDArray[np.float64]
    walls: NDArray[np.bool_]
    beside: NDArray[np.uint64]


def overlaps(picture: NDArray[np.uint8], width: int, orientations: int = 8) -> Overlaps:
    """What a picture, uint8[height, width, 3], says of layouts; what has no red in it is wall."""
    tiles = _codes(picture.reshape(-1, 3).astype(np.int64)).reshape(picture.shape[:2])
    wall_tiles = np.unique(tiles[picture[:, :, 0] == 0])
    times: dict[int, int] = {}
    cells: dict[int, NDArray[np.int64]] = {}
    for turned in _orientations(tiles, orientations):
        around = np.pad(turned, ((0, width - 1), (0, width - 1)), mode="wrap")
        windows = sliding_window_view(around, (width, width)).reshape(-1, width * width)
        found, first = np.unique(_codes(windows), return_index=True)
        for code, window in zip(found.tolist(), windows[first], strict=True):
            times[code] = times.get(code, 0) + 1
            cells[code] = window.reshape(width, width)
    order = sorted(times)
    patterns = np.stack([cells[code] for code in order])
    weights = np.array([times[code] for code in order], np.float64)
    return Overlaps(weights, np.isin(patterns[:, 0, 0], wall_tiles), _beside(patterns))


def _codes(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """A hash of each row of int64[n, k]."""
    numbers = np.random.RandomState(0).randint(1 - (1 << 63), 1 << 63, values.shape[1], dtype=np.int64)
    return values @ numbers  # modulo 2**64


def _orientations(tiles: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """The picture, and by turns its mirror image and the quarter turn of that."""
    turned = [tiles]
    for i in range(1, count):
        turned.append(np.fliplr(turned[-1]) if i % 2 else np.rot90(turned[-1], axes=(1, 0)))
    return turned


def _beside(patterns: NDArray[np.int64]) -> NDArray[np.uint64]:
    n, width = patterns.shape[:2]
    beside = np.zeros((len(SIDES), n, -(-n // WORD)), np.uint64)
    for side, (across, down) in enumerate(SIDES):  # of the pattern's columns and rows
        mine = patterns[:, max(0, down) : width + min(0, down), max(0, across) : width + min(0, across)]
        theirs = patterns[:, max(0, -down) : width + min(0, -down), max(0, -across) : width + min(0, -across)]
        fits = (mine[:, None] == theirs[None]).all(axis=(2, 3))  # [mine, theirs]
        for k in range(n):
            beside[side, :, k // WORD] |= fits[k].astype(np.uint64) << np.uint64(k % WORD)
    return beside
