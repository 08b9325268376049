"""The least of many, again and again: a binary heap in arrays that the caller gives, so that nothing is allocated.

Entries are a key and a number; of equal keys the smaller number comes first. What is in use are the first ``size``
places, and both calls say how many that is afterwards.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import part

Keys = NDArray[np.float64]
Numbers = NDArray[np.int64]


@part(lean=True)
def push(keys: Keys, numbers: Numbers, size: int, key: float, number: int) -> int:
    """Add an entry; the caller has made sure that there is room."""
    place = size
    while place > 0:
        above = (place - 1) >> 1
        if not _before(key, number, keys[above], numbers[above]):
            break
        keys[place], numbers[place] = keys[above], numbers[above]
        place = above
    keys[place], numbers[place] = key, number
    return size + 1


@part(lean=True)
def drop_first(keys: Keys, numbers: Numbers, size: int) -> int:
    """Take the first entry, which stands at 0, away; the next comes to stand there."""
    size -= 1
    key, number = keys[size], numbers[size]
    place = 0
    while 2 * place + 1 < size:
        below = 2 * place + 1
        if below + 1 < size and _before(keys[below + 1], numbers[below + 1], keys[below], numbers[below]):
            below += 1
        if not _before(keys[below], numbers[below], key, number):
            break
        keys[place], numbers[place] = keys[below], numbers[below]
        place = below
    keys[place], numbers[place] = key, number
    return size


@part(lean=True)
def _before(key: float, number: int, other_key: float, other_number: int) -> bool:
    return key < other_key or (key == other_key and number < other_number)
