"""The random number generator inside kernels: NumPy's PCG64, number for number. A layout's seed enters here.

Layouts draw the numbers that `Generator.integers` would draw, from compiled code and for many worlds at once, so the
generator is six uint64 words: state (high, low), increment (high, low), and the buffered half of the last draw (whether
present, value). The algorithms are M. O'Neill's PCG XSL-RR 128/64 and D. Lemire's bounded integers
(https://arxiv.org/abs/1805.10941), as NumPy's documentation names them. No product here overflows 64 bits, so this file
is exact as plain Python too.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.kernels import device_function, inline, kernel

RngState = NDArray[np.uint64]  # (6,)

_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)
_11 = np.uint64(11)
_0 = np.uint64(0)
_1 = np.uint64(1)
_58 = np.uint64(58)
_63 = np.uint64(63)
_64 = np.uint64(64)
# the multiplier 0x2360ED051FC65DA44385DF649FCCF645 in 32-bit limbs, lowest first
_M0 = np.uint64(0x9FCCF645)
_M1 = np.uint64(0x4385DF64)
_M2 = np.uint64(0x1FC65DA4)
_M3 = np.uint64(0x2360ED05)
_MASK64 = (1 << 64) - 1


def read_rng_state(generator: np.random.Generator, rng_state: RngState) -> None:
    """Copy the state of a NumPy generator into ``rng_state``, uint64[6].

    Raises:
        WorldError: if the generator is not a PCG64, which is what Gymnasium's ``np_random`` always is.
    """
    state = generator.bit_generator.state
    if state["bit_generator"] != "PCG64":
        raise WorldError(
            f"np_random is a {state['bit_generator']}; grid worlds need a PCG64, as from numpy.random.default_rng"
        )
    value = state["state"]["state"]
    increment = state["state"]["inc"]
    rng_state[0] = value >> 64
    rng_state[1] = value & _MASK64
    rng_state[2] = increment >> 64
    rng_state[3] = increment & _MASK64
    rng_state[4] = state["has_uint32"]
    rng_state[5] = state["uinteger"]


def write_rng_state(rng_state: RngState, generator: np.random.Generator) -> None:
    """Set a NumPy generator of type PCG64 to the state in ``rng_state``, uint64[6]."""
    high, low, increment_high, increment_low, has_half, half = rng_state.tolist()
    generator.bit_generator.state = {
        "bit_generator": "PCG64",
        "state": {"state": high << 64 | low, "inc": increment_high << 64 | increment_low},
        "has_uint32": has_half,
        "uinteger": half,
    }


@device_function()
def next64(rng_state: RngState) -> np.uint64:
    """Draw the next 64 bits of the random stream."""
    a0 = rng_state[1] & _LOW
    a1 = rng_state[1] >> _32
    a2 = rng_state[0] & _LOW
    a3 = rng_state[0] >> _32
    # state * multiplier + increment, limb by limb; each partial sum stays below 2**64
    t = a0 * _M0
    r0 = (t & _LOW) + (rng_state[3] & _LOW)
    carry = (t >> _32) + (r0 >> _32)
    t = a1 * _M0
    u = a0 * _M1
    r1 = (t & _LOW) + (u & _LOW) + (rng_state[3] >> _32) + carry
    carry = (t >> _32) + (u >> _32) + (r1 >> _32)
    t = a2 * _M0
    u = a1 * _M1
    v = a0 * _M2
    r2 = (t & _LOW) + (u & _LOW) + (v & _LOW) + (rng_state[2] & _LOW) + carry
    carry = (t >> _32) + (u >> _32) + (v >> _32) + (r2 >> _32)
    r3 = (
        (a3 * _M0 & _LOW) + (a2 * _M1 & _LOW) + (a1 * _M2 & _LOW) + (a0 * _M3 & _LOW) + (rng_state[2] >> _32) + carry
    ) & _LOW
    low = r1 << _32 | r0 & _LOW
    high = r3 << _32 | r2 & _LOW
    rng_state[0] = high
    rng_state[1] = low
    mixed = high ^ low
    turn = high >> _58
    return mixed >> turn | mixed << ((_64 - turn) & _63)


@inline
def next32(rng_state: RngState) -> np.uint64:
    """Draw the next 32 bits of the random stream; the other 32 bits of a draw are kept for the next call."""
    if rng_state[4] != _0:
        rng_state[4] = _0
        return rng_state[5]
    bits = next64(rng_state)
    rng_state[4] = _1
    rng_state[5] = bits >> _32
    return bits & _LOW


@kernel("int64(uint64[::1], int64, int64)", only=True)
def integer(rng_state: RngState, low: int, high: int) -> int:
    """Draw a whole number in [low, high), as ``Generator.integers(low, high)`` does.

    The difference of the bounds is at most 2**32 - 1.
    """
    if high - low <= 1:
        return low
    span = np.uint64(high - low)
    while True:
        scaled = next32(rng_state) * span
        left = scaled & _LOW
        if left >= span or left >= (_LOW - span + _1) % span:
            return low + int(scaled >> _32)


@device_function()
def unit(rng_state: RngState) -> int:
    """Draw the number that ``Generator.random`` would return, times 2**53: a whole number from 0 to 2**53 - 1.

    The buffered half of an earlier draw is not used.
    """
    return int(next64(rng_state) >> _11)


@kernel("(uint64[::1], int64[::1])")
def shuffle(rng_state: RngState, values: NDArray[np.int64]) -> None:
    """Shuffle an array in place, as ``Generator.shuffle`` shuffles a list: masked draws, repeated while too large."""
    for i in range(len(values) - 1, 0, -1):
        mask = np.uint64(1)
        while mask < np.uint64(i):
            mask = mask << _1 | _1
        while True:
            j = next32(rng_state) & mask
            if j <= np.uint64(i):
                break
        other = np.int64(j)
        values[i], values[other] = values[other], values[i]
