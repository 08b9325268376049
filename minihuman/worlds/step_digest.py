"""The digest of a step: 64 bits by which a page and the server detect whether they computed the same state.

It depends on flat arrays alone, so both sides run the same compiled function. The log's `state_hash` is a different
hash. No product here overflows 64 bits, so this file is exact as plain Python too.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import inline, kernel

_LOW = np.uint64(0xFFFFFFFF)
_8 = np.uint64(8)
_13 = np.uint64(13)
_15 = np.uint64(15)
_16 = np.uint64(16)
_32 = np.uint64(32)
# odd, so that multiplication by them modulo 2**32 is one-to-one
_A = np.uint64(0x9E3779B1)
_B = np.uint64(0x85EBCA77)


@inline
def stir(half: np.uint64, value: np.uint64, factor: np.uint64, shift: np.uint64) -> np.uint64:
    """Mix 32 bits into one half of the digest, and return the new half."""
    mixed = (half ^ value) * factor & _LOW
    return mixed ^ mixed >> shift


@kernel("uint64(int32[::1], uint8[:, :, ::1], uint64[::1])", only=True, hold_gil=True)
def digest_step(row: NDArray[np.int32], image: NDArray[np.uint8], outcome: NDArray[np.uint64]) -> np.uint64:
    """Return the digest of the state, observation and outcome after a step.

    Args:
        row: the state after the step.
        image: what the agent sees after the step, uint8[size, size, 3].
        outcome: the bits of the reward as a float64, and how the episode ended: 0 not at all, 1 terminated,
            2 truncated.
    """
    high_half = _A
    low_half = _B
    for k in range(len(row)):
        value = np.uint64(row[k]) & _LOW
        high_half = stir(high_half, value, _A, _15)
        low_half = stir(low_half, value, _B, _13)
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            value = np.uint64(image[i, j, 0]) | np.uint64(image[i, j, 1]) << _8 | np.uint64(image[i, j, 2]) << _16
            high_half = stir(high_half, value, _A, _15)
            low_half = stir(low_half, value, _B, _13)
    for k in range(len(outcome)):
        for value in (outcome[k] & _LOW, outcome[k] >> _32):
            high_half = stir(high_half, value, _A, _15)
            low_half = stir(low_half, value, _B, _13)
    return high_half << _32 | low_half
