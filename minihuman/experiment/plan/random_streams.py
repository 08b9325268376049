"""Random streams of a study: every random choice derives from the study seed, with one stream per purpose.

An additional draw for one purpose changes nothing elsewhere. Only `SeedSequence` is used, because NumPy guarantees
that its output never changes, so a protocol gives the same plan on every machine and in ten years.
"""

import hashlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


def draw_words(count: int, *, seed: int, purpose: str, index: int = 0) -> NDArray[np.uint64]:
    """Draw ``count`` random uint64 values from the stream (seed, purpose, index)."""
    name = int.from_bytes(hashlib.blake2b(purpose.encode(), digest_size=4).digest(), "little")
    return np.random.SeedSequence(seed, spawn_key=(name, index)).generate_state(count, np.uint64).astype(np.uint64)


def make_draw(seed: int, purpose: str, index: int) -> Callable[[int], tuple[float, ...]]:
    """Return a function that returns the first random numbers in [0, 1) of the stream (seed, purpose, index).

    Its argument is how many numbers it returns; each call begins at the first number of the stream.
    """

    def draw(count: int) -> tuple[float, ...]:
        words = draw_words(count, seed=seed, purpose=purpose, index=index)
        return tuple((int(word) >> 11) / 2**53 for word in words)  # the upper 53 bits, as many as a float holds

    return draw


def draw_seeds(count: int, *, seed: int, purpose: str, index: int = 0) -> tuple[int, ...]:
    """Draw ``count`` reset seeds of worlds, in [0, 2**31), from the stream (seed, purpose, index)."""
    # the upper 31 bits of each word
    return tuple(int(word) >> 33 for word in draw_words(count, seed=seed, purpose=purpose, index=index))


def draw_permutation(count: int, *, seed: int, purpose: str, index: int = 0) -> tuple[int, ...]:
    """Draw a random permutation of 0 to count - 1 from the stream (seed, purpose, index)."""
    words = draw_words(count, seed=seed, purpose=purpose, index=index)
    return tuple(np.argsort(words, kind="stable").tolist())
