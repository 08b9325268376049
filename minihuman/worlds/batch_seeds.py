"""Seeds of a batch of worlds, as Gymnasium's vectors take them."""

from collections.abc import Sequence
from operator import index

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

Seeds = int | Sequence[int | None] | NDArray[np.integer] | None  # one for all to count from, or one a world


def seeds_of(seed: Seeds, count: int) -> list[int | None]:
    """One seed a world: ``seed`` + i for a number, or those given; None goes on drawing.

    Raises:
        WorldError: if there are more or fewer than worlds, or one is no whole number.
    """
    try:
        if seed is None:
            return [None] * count
        if not isinstance(seed, Sequence | np.ndarray):
            return [index(seed) + i for i in range(count)]
        seeds = [None if one is None else index(one) for one in seed]
    except TypeError as error:
        raise WorldError(f"seed is {seed!r}; a batch takes a whole number, or one for each world") from error
    if len(seeds) != count:
        raise WorldError(f"{len(seeds)} seeds for {count} worlds; give one for each, or a single number")
    return seeds
