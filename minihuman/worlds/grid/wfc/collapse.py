"""Wave Function Collapse: cells settle one by one on a pattern of a picture, each restricting the others.

The overlapping model of Wave Function Collapse (M. Gumin, 2016) as in Minigrid 3.2: patterns are windows of a given
number of cells, which wrap around the picture's edges, in up to eight orientations. They are numbered by a hash, since
Minigrid's draws depend on that order; the hash is an inner product with the first numbers of `RandomState(0)`.

The largest connected part of the result is used. Minigrid keeps it in a networkx graph and draws two of its nodes.
Their order is the layout's own unless the part is smaller than half of the free cells: then networkx iterates over a
Python set, whose order depends on the order in which it was filled. The same sets are filled in the same order here.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from minihuman.worlds.kernels import kernel
from minihuman.worlds.rng import RngState, unit

SIDES = ((0, -1), (1, 0), (0, 1), (-1, 0))  # the offset of a neighbour along the first and the second axis of a layout
WORD = 64  # patterns that one number of a set holds: its bits


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """The n patterns of a picture, and which of them may be adjacent.

    Attributes:
        weights: the number of orientations of the picture in which each pattern occurs, float64[n].
        walls: whether each pattern's first cell is a wall, bool[n].
        adjacency: for each side and pattern, the set of patterns that may have it on that side, uint64[4, n, words].
    """

    weights: NDArray[np.float64]
    walls: NDArray[np.bool_]
    adjacency: NDArray[np.uint64]


def find_overlaps(picture: NDArray[np.uint8], width: int, orientations: int = 8) -> Overlaps:
    """Return the patterns of a picture and which of them may be adjacent.

    Args:
        picture: uint8[height, width, 3]; a pixel without red is a wall.
        width: the number of pixels on a side of a pattern.
        orientations: the number of orientations in which the picture is read, 1 to 8.
    """
    tiles = _hash_rows(picture.reshape(-1, 3).astype(np.int64)).reshape(picture.shape[:2])
    wall_tiles = np.unique(tiles[picture[:, :, 0] == 0])
    counts: dict[int, int] = {}
    tiles_by_hash: dict[int, NDArray[np.int64]] = {}
    for oriented_tiles in _orientations(tiles, orientations):
        for pattern_hash, pattern in _distinct_patterns(oriented_tiles, width).items():
            counts[pattern_hash] = counts.get(pattern_hash, 0) + 1
            tiles_by_hash[pattern_hash] = pattern
    order = sorted(counts)
    patterns = np.stack([tiles_by_hash[pattern_hash] for pattern_hash in order])
    weights = np.array([counts[pattern_hash] for pattern_hash in order], np.float64)
    has_wall_first = np.isin(patterns[:, 0, 0], wall_tiles)
    return Overlaps(weights, has_wall_first, _find_adjacency(patterns))


def _distinct_patterns(tiles: NDArray[np.int64], width: int) -> dict[int, NDArray[np.int64]]:
    """Return the distinct patterns of a picture, ``width`` tiles on a side, by their hash.

    Patterns wrap around the picture's edges. The picture is given as a number per tile.
    """
    wrapped_tiles = np.pad(tiles, ((0, width - 1), (0, width - 1)), mode="wrap")
    windows = sliding_window_view(wrapped_tiles, (width, width)).reshape(-1, width * width)
    hashes, first_indices = np.unique(_hash_rows(windows), return_index=True)
    patterns = windows[first_indices].reshape(-1, width, width)
    return dict(zip(hashes.tolist(), patterns, strict=True))


def _hash_rows(values: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return a hash of each row of int64[n, k]."""
    numbers = np.random.RandomState(0).randint(1 - (1 << 63), 1 << 63, values.shape[1], dtype=np.int64)
    return values @ numbers  # modulo 2**64


def _orientations(tiles: NDArray[np.int64], count: int) -> list[NDArray[np.int64]]:
    """Return ``count`` orientations of a picture, each a mirror image or a quarter turn of the previous one."""
    oriented = [tiles]
    for i in range(1, count):
        oriented.append(np.fliplr(oriented[-1]) if i % 2 else np.rot90(oriented[-1], axes=(1, 0)))
    return oriented


def _find_adjacency(patterns: NDArray[np.int64]) -> NDArray[np.uint64]:
    """Return which patterns, int64[n, width, width], agree in the cells in which they overlap on each side.

    The result has the form of `Overlaps.adjacency`.
    """
    count, width = patterns.shape[:2]
    word_count = -(-count // WORD)
    adjacency = np.zeros((len(SIDES), count, word_count), np.uint64)
    for side, (columns, rows) in enumerate(SIDES):
        own_overlap = _shifted_part(patterns, width, columns, rows)
        neighbour_overlap = _shifted_part(patterns, width, -columns, -rows)
        agrees = (own_overlap[:, None] == neighbour_overlap[None]).all(axis=(2, 3))  # [pattern, neighbour]
        for number in range(count):
            word, bit = divmod(number, WORD)
            adjacency[side, :, word] |= agrees[number].astype(np.uint64) << np.uint64(bit)
    return adjacency


def _shifted_part(patterns: NDArray[np.int64], width: int, columns: int, rows: int) -> NDArray[np.int64]:
    """Return the part of each pattern that another, shifted by ``columns`` and ``rows``, also covers.

    ``width`` is the number of cells on a side of a pattern.
    """
    row_range = slice(max(0, rows), width + min(0, rows))
    column_range = slice(max(0, columns), width + min(0, columns))
    return patterns[:, row_range, column_range]


Sets = NDArray[np.uint64]  # of patterns, (cells, words): one bit per pattern

_0 = np.uint64(0)
_1 = np.uint64(1)


@kernel("(uint64[::1], float64[::1], uint64[:, :, ::1], int64, boolean, int64)")
def collapse(
    rng_state: RngState, weights: NDArray[np.float64], adjacency: Sets, size: int, periodic: bool, attempts: int
) -> NDArray[np.int64]:
    """Return one pattern per cell, int64[size * size]; empty if all ``attempts`` ended in contradiction.

    The function draws the same numbers as Minigrid's solver: one per cell at the beginning, to break ties between cells
    with equally few patterns left, then one per cell that settles.

    Args:
        rng_state: the random stream.
        weights: the weight of each of n patterns.
        adjacency: for each side and pattern, the set of patterns that may have it on that side, uint64[4, n, words].
        size: the number of cells on a side.
        periodic: whether the layout wraps around its edges.
        attempts: the maximum number of collapses.
    """
    cells = size * size
    n = len(weights)
    untied = np.empty(cells)
    for cell in range(cells):
        untied[cell] = unit(rng_state) * 2.0**-53 * 0.1
    initial_sets = np.zeros((cells, adjacency.shape[2]), np.uint64)
    for p in range(n):
        initial_sets[:, p // 64] |= _1 << np.uint64(p % 64)
    initial_counts = np.full(cells, n, np.int64)
    queue = np.empty(cells, np.int64)
    is_queued = np.zeros(cells, np.bool_)
    possible = _borders(initial_sets, initial_counts, adjacency)
    if possible:
        for cell in range(cells):
            queue[cell] = cell
            is_queued[cell] = True
        possible = _spread(initial_sets, initial_counts, adjacency, size, periodic, queue, is_queued, cells)
    sets = np.empty_like(initial_sets)
    counts = np.empty_like(initial_counts)
    for _ in range(attempts):
        if not possible:
            break
        sets[:] = initial_sets
        counts[:] = initial_counts
        settled = n == 1
        fits = True
        while fits and not settled:
            cell = _fewest(counts, untied)
            _settle(sets, counts, cell, _draw(rng_state, weights, sets[cell]))
            queue[0] = cell
            is_queued[cell] = True
            fits = _spread(sets, counts, adjacency, size, periodic, queue, is_queued, 1)
            settled = counts.max() == 1
        if fits:
            return _patterns(sets)
    return np.empty(0, np.int64)


@kernel("(uint64[:, ::1], int64[::1], uint64[:, :, ::1])")
def _borders(sets: Sets, counts: NDArray[np.int64], adjacency: Sets) -> bool:
    """Remove from each cell's set the patterns that can have no neighbour on some side.

    Update ``counts``, the number of patterns left in each cell, and return whether every cell has a pattern left.
    Beyond an edge at which the layout ends, any pattern is possible.
    """
    n = adjacency.shape[1]
    for side in range(4):
        some = np.zeros(adjacency.shape[2], np.uint64)
        for p in range(n):
            some |= adjacency[side, p]
        for cell in range(len(sets)):
            counts[cell] = _narrow(sets[cell], some)
            if counts[cell] == 0:
                return False
    return True


@kernel("(uint64[::1], uint64[::1])")
def _narrow(patterns: NDArray[np.uint64], allowed: NDArray[np.uint64]) -> int:
    """Remove from a set the patterns that are not in the set ``allowed``; return how many are left."""
    count = 0
    for w in range(len(patterns)):
        patterns[w] &= allowed[w]
        bits = patterns[w]
        while bits != _0:
            bits &= bits - _1  # clears the lowest bit that is set
            count += 1
    return count


@kernel("(uint64[:, ::1], int64[::1], uint64[:, :, ::1], int64, boolean, int64[::1], boolean[::1], int64)")
def _spread(
    sets: Sets,
    counts: NDArray[np.int64],
    adjacency: Sets,
    size: int,
    periodic: bool,
    queue: NDArray[np.int64],
    is_queued: NDArray[np.bool_],
    queue_length: int,
) -> bool:
    """Propagate the queued cells' restrictions to their neighbours; return whether every cell has a pattern left."""
    cells = len(sets)
    allowed = np.empty(adjacency.shape[2], np.uint64)
    head = 0
    fits = True
    while queue_length > 0:
        cell = queue[head]
        head = (head + 1) % cells
        queue_length = queue_length - 1
        is_queued[cell] = False
        if not fits:
            continue  # only to empty the queue
        x = cell // size
        y = cell % size
        for side in range(4):
            # SIDES say where a cell has its neighbour: here the cell is the neighbour, and its own lie opposite
            other_x = x - (0, 1, 0, -1)[side]
            other_y = y - (-1, 0, 1, 0)[side]
            if periodic:
                other_x = (other_x + size) % size
                other_y = (other_y + size) % size
            elif other_x < 0 or other_y < 0 or other_x >= size or other_y >= size:
                continue
            other = other_x * size + other_y
            allowed[:] = _0
            for p in range(adjacency.shape[1]):
                if sets[cell, p // 64] >> np.uint64(p % 64) & _1 != _0:
                    for w in range(len(allowed)):
                        allowed[w] |= adjacency[side, p, w]
            before = counts[other]
            counts[other] = _narrow(sets[other], allowed)
            if counts[other] == 0:
                fits = False
            elif counts[other] < before and not is_queued[other]:
                queue[(head + queue_length) % cells] = other
                is_queued[other] = True
                queue_length += 1
    return fits


@kernel("(int64[::1], float64[::1])")
def _fewest(counts: NDArray[np.int64], untied: NDArray[np.float64]) -> int:
    """Return the cell with the fewest patterns left of the cells with several, or the first cell if none has several.

    ``untied`` has a number below 1 for each cell, which is added to its count to break ties.
    """
    best = np.inf
    cell = 0
    for k in range(len(counts)):
        if counts[k] > 1 and untied[k] + counts[k] < best:
            best = untied[k] + counts[k]
            cell = k
    return cell


@kernel("(uint64[::1], float64[::1], uint64[::1])")
def _draw(rng_state: RngState, weights: NDArray[np.float64], patterns: NDArray[np.uint64]) -> int:
    """Return a pattern drawn from a set by weight, as ``Generator.choice`` draws it."""
    n = len(weights)
    shares = np.zeros(n)
    for p in range(n):
        if patterns[p // 64] >> np.uint64(p % 64) & _1 != _0:
            shares[p] = weights[p]
    total = shares.sum()
    so_far = 0.0
    for p in range(n):
        so_far += shares[p] / total
        shares[p] = so_far
    threshold = unit(rng_state) * 2.0**-53
    for p in range(n):
        if shares[p] / so_far > threshold:
            return p
    return n - 1


@kernel("(uint64[:, ::1], int64[::1], int64, int64)")
def _settle(sets: Sets, counts: NDArray[np.int64], cell: int, pattern: int) -> None:
    """Leave only the pattern ``pattern`` in the set of a cell."""
    sets[cell] = _0
    sets[cell, pattern // 64] = _1 << np.uint64(pattern % 64)
    counts[cell] = 1


@kernel("(uint64[:, ::1],)")
def _patterns(sets: Sets) -> NDArray[np.int64]:
    """Return the pattern of each cell, given sets of one pattern each."""
    patterns = np.empty(len(sets), np.int64)
    for cell in range(len(sets)):
        for p in range(64 * sets.shape[1]):
            if sets[cell, p // 64] >> np.uint64(p % 64) & _1 != _0:
                patterns[cell] = p
    return patterns


Cell = tuple[int, int]


def largest_part(free: list[Cell]) -> list[Cell]:
    """Return the largest connected part of two cells or more, or the first of several; empty if there is none.

    The order of its cells is Minigrid's; see the module's description.

    Args:
        free: the free cells in the layout's order.
    """
    unseen = dict.fromkeys(free)
    largest: set[Cell] = set()
    visited_count = 0
    for cell in free:
        if cell in unseen:
            part = _find_connected(cell, unseen, len(free) - visited_count)
            visited_count += len(part)
            for member in part:
                del unseen[member]
            if len(part) > max(1, len(largest)):
                largest = part
    # twice, as Minigrid takes the subgraph of the part, and then the subgraph of the cells of that subgraph
    return _order_as_networkx(_order_as_networkx(largest, free), free)


def _find_connected(source: Cell, unseen: dict[Cell, None], at_most: int) -> set[Cell]:
    """Return the unseen cells connected with a cell, itself included, found breadth first, at most ``at_most``."""
    reached = {source}
    next_level = [source]
    while next_level:
        level = next_level
        next_level = []
        for x, y in level:
            for cell in ((x - 1, y), (x, y - 1), (x + 1, y), (x, y + 1)):
                if cell in unseen and cell not in reached:
                    reached.add(cell)
                    next_level.append(cell)
            if len(reached) == at_most:
                return reached
    return reached


def _order_as_networkx(cells: Iterable[Cell], free: list[Cell]) -> list[Cell]:
    """Return cells in the order in which networkx iterates over a part of a graph of the free cells."""
    chosen = set(iter(cells))  # added one by one: a copy of a set can have another order
    if 2 * len(chosen) < len(free):
        return list(chosen)
    return [cell for cell in free if cell in chosen]
