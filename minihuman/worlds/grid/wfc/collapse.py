"""The collapse: cells settle one by one on a pattern, each leaving the others what still fits."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.grid.core.chance import Words, unit
from minihuman.worlds.kernels import kernel

Sets = NDArray[np.uint64]  # of patterns, (cells, words): one bit a pattern

_0 = np.uint64(0)
_1 = np.uint64(1)


@kernel()
def collapse(
    words: Words, weights: NDArray[np.float64], beside: Sets, size: int, periodic: bool, attempts: int
) -> NDArray[np.int64]:
    """A pattern a cell, int64[size * size]; empty where ``attempts`` collapses all ended in contradiction.

    Draws what Minigrid's solver draws: one number a cell, once, which breaks ties between cells with as few patterns
    left, then one a cell that settles.

    Args:
        words: The random stream.
        weights: How often each of n patterns comes.
        beside: uint64[4, n, w], for each side the set of patterns that may have this one there.
        size: Cells on a side.
        periodic: The layout goes on over its edges.
        attempts: Collapses that are begun.
    """
    cells, n = size * size, len(weights)
    untied = np.empty(cells)
    for cell in range(cells):
        untied[cell] = unit(words) * 2.0**-53 * 0.1
    begun = np.zeros((cells, beside.shape[2]), np.uint64)
    for p in range(n):
        begun[:, p // 64] |= _1 << np.uint64(p % 64)
    left = np.full(cells, n, np.int64)
    waiting, waits = np.empty(cells, np.int64), np.zeros(cells, np.bool_)
    possible = _borders(begun, left, beside)
    if possible:
        for cell in range(cells):
            waiting[cell], waits[cell] = cell, True
        possible = _spread(begun, left, beside, size, periodic, waiting, waits, cells)
    sets, counts = np.empty_like(begun), np.empty_like(left)
    for _ in range(attempts):
        if not possible:
            break
        sets[:], counts[:] = begun, left
        settled = n == 1
        fits = True
        while fits and not settled:
            cell = _fewest(counts, untied)
            _settle(sets, counts, cell, _draw(words, weights, sets[cell]))
            waiting[0], waits[cell] = cell, True
            fits = _spread(sets, counts, beside, size, periodic, waiting, waits, 1)
            settled = counts.max() == 1
        if fits:
            return _patterns(sets)
    return np.empty(0, np.int64)


@kernel()
def _borders(sets: Sets, counts: NDArray[np.int64], beside: Sets) -> bool:
    """Take away what nothing at all fits beside; at an edge that ends the layout anything may be beyond."""
    n = beside.shape[1]
    for side in range(4):
        some = np.zeros(beside.shape[2], np.uint64)
        for p in range(n):
            some |= beside[side, p]
        for cell in range(len(sets)):
            counts[cell] = _narrow(sets[cell], some)
            if counts[cell] == 0:
                return False
    return True


@kernel()
def _narrow(patterns: NDArray[np.uint64], allowed: NDArray[np.uint64]) -> int:
    """Take away what is not allowed; how many are left."""
    count = 0
    for w in range(len(patterns)):
        patterns[w] &= allowed[w]
        rest = patterns[w]
        while rest != _0:
            rest &= rest - _1
            count += 1
    return count


@kernel()
def _spread(
    sets: Sets,
    counts: NDArray[np.int64],
    beside: Sets,
    size: int,
    periodic: bool,
    waiting: NDArray[np.int64],
    waits: NDArray[np.bool_],
    many: int,
) -> bool:
    """Let the cells that wait tell their neighbours, and those theirs. Whether every cell has a pattern left."""
    cells = len(sets)
    allowed = np.empty(beside.shape[2], np.uint64)
    head, fits = 0, True
    while many > 0:
        cell = waiting[head]
        head, many = (head + 1) % cells, many - 1
        waits[cell] = False
        if not fits:
            continue  # only to empty the list
        x, y = cell // size, cell % size
        for side in range(4):
            # SIDES say where a cell has its neighbour: here the cell is the neighbour, and its own lie opposite
            other_x = x - (0, 1, 0, -1)[side]
            other_y = y - (-1, 0, 1, 0)[side]
            if periodic:
                other_x, other_y = (other_x + size) % size, (other_y + size) % size
            elif other_x < 0 or other_y < 0 or other_x >= size or other_y >= size:
                continue
            other = other_x * size + other_y
            allowed[:] = _0
            for p in range(beside.shape[1]):
                if sets[cell, p // 64] >> np.uint64(p % 64) & _1 != _0:
                    for w in range(len(allowed)):
                        allowed[w] |= beside[side, p, w]
            before = counts[other]
            counts[other] = _narrow(sets[other], allowed)
            if counts[other] == 0:
                fits = False
            elif counts[other] < before and not waits[other]:
                waiting[(head + many) % cells] = other
                waits[other] = True
                many += 1
    return fits


@kernel()
def _fewest(counts: NDArray[np.int64], untied: NDArray[np.float64]) -> int:
    """The unsettled cell with the fewest patterns left; the first cell if all have settled."""
    best, cell = np.inf, 0
    for k in range(len(counts)):
        if counts[k] > 1 and untied[k] + counts[k] < best:
            best, cell = untied[k] + counts[k], k
    return cell


@kernel()
def _draw(words: Words, weights: NDArray[np.float64], patterns: NDArray[np.uint64]) -> int:
    """One of the patterns by weight, as ``Generator.choice`` draws it."""
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
    drawn = unit(words) * 2.0**-53
    for p in range(n):
        if shares[p] / so_far > drawn:
            return p
    return n - 1


@kernel()
def _settle(sets: Sets, counts: NDArray[np.int64], cell: int, pattern: int) -> None:
    sets[cell] = _0
    sets[cell, pattern // 64] = _1 << np.uint64(pattern % 64)
    counts[cell] = 1


@kernel()
def _patterns(sets: Sets) -> NDArray[np.int64]:
    patterns = np.empty(len(sets), np.int64)
    for cell in range(len(sets)):
        for p in range(64 * sets.shape[1]):
            if sets[cell, p // 64] >> np.uint64(p % 64) & _1 != _0:
                patterns[cell] = p
    return patterns
