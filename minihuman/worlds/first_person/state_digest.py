"""The digest of a first-person world's state after a step, by which Python and a page compare what they computed."""

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.rules import (
    ACCELERATION,
    CARRIED,
    COUNT,
    DIR,
    DRAWS,
    SCORE,
    VELOCITY,
    Numbers,
    Things,
)
from minihuman.worlds.kernels import device_function, kernel
from minihuman.worlds.rng import RngState
from minihuman.worlds.step_digest import stir

_LOW = np.uint64(0xFFFFFFFF)
_13 = np.uint64(13)
_15 = np.uint64(15)
_32 = np.uint64(32)
_A = np.uint64(0x9E3779B1)
_B = np.uint64(0x85EBCA77)


@device_function()
def _stir_value(high_half: np.uint64, low_half: np.uint64, word: np.uint64) -> tuple[np.uint64, np.uint64]:
    """Mix 64 bits into the halves of a digest, and return the new halves."""
    for half in (word & _LOW, word >> _32):
        high_half = stir(high_half, half, _A, _15)
        low_half = stir(low_half, half, _B, _13)
    return high_half, low_half


@kernel("(float64[:, ::1], float64[::1], uint64[::1], uint64[::1])", hold_gil=True)
def digest_state(things: Things, numbers: Numbers, rng_state: RngState, outcome: NDArray[np.uint64]) -> np.uint64:
    """Return the digest of the state after a step.

    ``outcome`` is uint64[2]: the bits of the reward as a float64, and how the episode ended: 0 not at all, 1
    terminated, 2 truncated.
    """
    high_half = _A
    low_half = _B
    rows = max(int(numbers[COUNT]), int(numbers[CARRIED]) + 1)
    places = things.view(np.uint64)
    state = numbers.view(np.uint64)
    for row in range(rows):
        for column in range(DIR + 1):
            value = places[row, column]
            high_half, low_half = _stir_value(high_half, low_half, value)
    for k in range(SCORE + 1):
        high_half, low_half = _stir_value(high_half, low_half, state[k])
    if numbers[ACCELERATION] > 0.0:
        for k in range(VELOCITY, ACCELERATION):
            high_half, low_half = _stir_value(high_half, low_half, state[k])
    if numbers[DRAWS] != 0.0:
        for k in range(len(rng_state)):
            high_half, low_half = _stir_value(high_half, low_half, rng_state[k])
    for k in range(len(outcome)):
        high_half, low_half = _stir_value(high_half, low_half, outcome[k])
    return high_half << _32 | low_half
