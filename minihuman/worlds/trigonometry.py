"""Sine and cosine for kernels, correctly rounded: the same bits on every machine, in the page, and without compilation.

The C library of a machine differs from the correct result, and from those of other machines, in about one call of a
thousand. Here an angle is reduced by multiples of a quarter turn, and the Taylor series is summed in double-double
numbers (T. J. Dekker, Numerische Mathematik 18, 1971): some 100 bits, of which the first 53 are returned. A result
would be wrong only if it lay within 2**-100 of the middle between two doubles.
"""

from fractions import Fraction
from math import factorial

from minihuman.worlds.kernels import device_function, kernel

LARGEST_RAD = 500_000.0  # of an angle; beyond, products of whole quarter turns are not exact
_SPLITTER = 134217729.0  # 2**27 + 1
_TERMS = 14  # of a series; up to an eighth of a turn, the next term is below 2**-100
# pi / 2, rounded to 256 bits
_HALF_PI = Fraction(0xC90FDAA22168C234C4C6628B80DC1CD129024E088A67CC74020BBEA63B139B22, 1 << 255)


def _split(number: Fraction, bits: int, count: int) -> tuple[float, ...]:
    """Split a number between 1 and 2 into ``count`` doubles of ``bits`` bits each, and one more for the remainder."""
    parts = []
    for nth in range(1, count + 1):
        unit = Fraction(1, 1 << bits * nth - 1)
        parts.append(float(number // unit * unit))
        number -= Fraction(parts[-1])
    return *parts, float(number)


# the product of each of the first three parts with a whole number below 2**20 is exact
_PI_1, _PI_2, _PI_3, _PI_4 = _split(_HALF_PI, 32, 3)
_QUARTERS_PER_RAD = float(1 / _HALF_PI)


def _taylor_series(first: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return Taylor coefficients in powers of the squared angle, highest first, and their rounding errors.

    Args:
        first: the exponent of the first term: 1 for the sine, 0 for the cosine.
    """
    exact = [Fraction((-1) ** k, factorial(2 * k + first)) for k in range(_TERMS)][::-1]
    return tuple(map(float, exact)), tuple(float(number - Fraction(float(number))) for number in exact)


_SINE, _SINE_REST = _taylor_series(1)
_COSINE, _COSINE_REST = _taylor_series(0)


@device_function()
def add_exactly(a: float, b: float) -> tuple[float, float]:
    """Return the sum of two doubles and its rounding error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@device_function()
def multiply_exactly(a: float, b: float) -> tuple[float, float]:
    """Return the product of two doubles and its rounding error."""
    product = a * b
    wide = _SPLITTER * a
    a_high = wide - (wide - a)
    a_low = a - a_high
    wide = _SPLITTER * b
    b_high = wide - (wide - b)
    b_low = b - b_high
    return product, ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low


@device_function()
def multiply(a: float, a_rest: float, b: float, b_rest: float) -> tuple[float, float]:
    """Return the product of two double-double numbers, each the sum of a double and its ``rest``, as a third."""
    product, error = multiply_exactly(a, b)
    return add_exactly(product, error + (a * b_rest + a_rest * b))


@device_function()
def add(a: float, a_rest: float, b: float, b_rest: float) -> tuple[float, float]:
    """Return the sum of two double-double numbers, each the sum of a double and its ``rest``, as a third."""
    total, error = add_exactly(a, b)
    low_sum, low_error = add_exactly(a_rest, b_rest)
    total, error = add_exactly(total, error + low_sum)
    return add_exactly(total, error + low_error)


@device_function()
def wave(angle_rad: float, quarters: int) -> float:
    """Return the sine of an angle plus ``quarters`` quarter turns; NaN for an angle beyond `LARGEST_RAD`."""
    if not -LARGEST_RAD <= angle_rad <= LARGEST_RAD:
        return angle_rad * 0.0 + float("nan")
    if angle_rad == 0.0 and quarters == 0:
        return angle_rad  # with its sign
    scaled = angle_rad * _QUARTERS_PER_RAD
    turns = float(int(scaled + 0.5) if scaled >= 0.0 else -int(0.5 - scaled))
    high, low = add_exactly(angle_rad - turns * _PI_1, -turns * _PI_2)
    high, low = add(high, low, -turns * _PI_3, 0.0)
    product, error = multiply_exactly(-turns, _PI_4)
    high, low = add(high, low, product, error)
    square, square_rest = multiply(high, low, high, low)
    quarter = (int(turns) + quarters) & 3
    if quarter & 1:
        total = _COSINE[0]
        total_rest = _COSINE_REST[0]
        for k in range(1, _TERMS):
            total, total_rest = multiply(total, total_rest, square, square_rest)
            total, total_rest = add(total, total_rest, _COSINE[k], _COSINE_REST[k])
    else:
        total = _SINE[0]
        total_rest = _SINE_REST[0]
        for k in range(1, _TERMS):
            total, total_rest = multiply(total, total_rest, square, square_rest)
            total, total_rest = add(total, total_rest, _SINE[k], _SINE_REST[k])
        total, total_rest = multiply(total, total_rest, high, low)
    return -total if quarter & 2 else total


@kernel("float64(float64)", only=True, hold_gil=True)
def sine(angle_rad: float) -> float:
    """Return the correctly rounded sine, or NaN for an angle beyond `LARGEST_RAD`."""
    return wave(angle_rad, 0)


@kernel("float64(float64)", only=True, hold_gil=True)
def cosine(angle_rad: float) -> float:
    """Return the correctly rounded cosine, or NaN for an angle beyond `LARGEST_RAD`."""
    return wave(angle_rad, 1)
