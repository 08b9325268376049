"""Checked arithmetic of translated rules, for Numba: overflow and division by zero are faults, as Python's errors are.

Each function takes the address of a world's context (see `context`) and the number of a place in the author's source.
"""
# mypy: ignore-errors

import math
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import float64, int64, types
from numba.extending import intrinsic

from minihuman.worlds.grid.own.faults import BAD_RANGE, NEGATIVE_SHIFT, NOT_FINITE, OVERFLOW, ZERO_DIVISION
from minihuman.worlds.grid.own.numba_forms import fail, fail_if, is_number, is_whole, njit, overloaded


def _checked(name: str, real: str) -> Any:
    """Return an intrinsic for an operation on two numbers, with an overflow check if both are whole numbers.

    Args:
        name: the method of LLVM's builder for whole numbers, which also returns whether the result overflowed.
        real: the method of LLVM's builder for floats.
    """

    @intrinsic
    def operate(typing_context, c, place, a, b):
        if not (is_number(a) and is_number(b)):
            return None
        if is_whole(a) and is_whole(b):

            def whole(context, builder, signature, values):
                pair = getattr(builder, name)(values[2], values[3])
                fail_if(context, builder, signature, values, builder.extract_value(pair, 1), OVERFLOW)
                return builder.extract_value(pair, 0)

            return int64(c, int64, int64, int64), whole

        def floating(context, builder, signature, values):
            return getattr(builder, real)(values[2], values[3])

        return float64(c, int64, float64, float64), floating

    return operate


add = _checked("sadd_with_overflow", "fadd")
sub = _checked("ssub_with_overflow", "fsub")
mul = _checked("smul_with_overflow", "fmul")


@intrinsic
def truediv(typing_context, c, place, a, b):
    """Return the quotient of two numbers as a float; division by zero is a fault, as in Python."""
    if not (is_number(a) and is_number(b)):
        return None

    def code(context, builder, signature, values):
        zero = builder.fcmp_ordered("==", values[3], ir.Constant(ir.DoubleType(), 0.0))
        fail_if(context, builder, signature, values, zero, ZERO_DIVISION)
        return builder.fdiv(values[2], values[3])

    return float64(c, int64, float64, float64), code


@njit
def _whole_floordiv(c, place, a, b):
    """Return the quotient of whole numbers, rounded down; division by -1 is a negation with its overflow check."""
    if b == 0:
        fail(c, place, ZERO_DIVISION, a, 0)
    if b == -1:
        return sub(c, place, 0, a)
    return a // b


@njit
def _whole_mod(c, place, a, b):
    """Return the remainder of whole numbers; 0 for the divisor -1, by which a processor may refuse to divide."""
    if b == 0:
        fail(c, place, ZERO_DIVISION, a, 0)
    if b == -1:
        return np.int64(0)
    return a % b


@njit
def _float_mod(c, place, a, b):
    """Return the remainder of floats with the sign of the divisor, as CPython computes it."""
    if b == 0.0:
        fail(c, place, ZERO_DIVISION, 0, 0)
    remainder = math.fmod(a, b)
    if remainder == 0.0:
        return math.copysign(0.0, b)
    if (b < 0.0) != (remainder < 0.0):
        remainder += b
    return remainder


@njit
def _float_floordiv(c, place, a, b):
    """Return the quotient of floats, rounded down, as CPython computes it."""
    if b == 0.0:
        fail(c, place, ZERO_DIVISION, 0, 0)
    remainder = math.fmod(a, b)
    quotient = (a - remainder) / b
    if remainder != 0.0 and (b < 0.0) != (remainder < 0.0):
        quotient -= 1.0
    if quotient == 0.0:
        return math.copysign(0.0, a / b)
    floor = np.floor(quotient)
    if quotient - floor > 0.5:
        floor += 1.0
    return floor


@overloaded
def floordiv(c, place, a, b):
    """Return the quotient of two numbers, rounded down as in Python; division by zero is a fault."""
    if is_whole(a) and is_whole(b):
        return lambda c, place, a, b: _whole_floordiv(c, place, np.int64(a), np.int64(b))
    return lambda c, place, a, b: _float_floordiv(c, place, float(a), float(b))


@overloaded
def mod(c, place, a, b):
    """Return the remainder of a division, with the sign of the divisor as in Python; division by zero is a fault."""
    if is_whole(a) and is_whole(b):
        return lambda c, place, a, b: _whole_mod(c, place, np.int64(a), np.int64(b))
    return lambda c, place, a, b: _float_mod(c, place, float(a), float(b))


@overloaded
def power(c, place, base, exponent):
    """Return a whole number raised to a whole power; a power below 0 is a fault."""
    if not (is_whole(base) and is_whole(exponent)):
        raise numba.core.errors.TypingError("a power of floats differs between machines; multiply instead")
    return lambda c, place, base, exponent: _whole_power(c, place, np.int64(base), np.int64(exponent))


@njit
def _whole_power(c, place, base, exponent):
    """Return a whole number raised to a whole power, by repeated multiplication with an overflow check."""
    if exponent < 0:
        fail(c, place, BAD_RANGE, 0, exponent)
    product = np.int64(1)
    for _ in range(exponent):
        product = mul(c, place, product, base)
    return product


@njit
def lshift(c, place, a, b):
    """Return a whole number shifted left as in Python; overflow and a negative shift are faults."""
    if b < 0:
        fail(c, place, NEGATIVE_SHIFT, a, b)
    if a == 0:
        return np.int64(0)
    if b > 62 or (a << b) >> b != a:
        fail(c, place, OVERFLOW, a, b)
    return a << b


@njit
def rshift(c, place, a, b):
    """Return a whole number shifted right as in Python; a negative shift is a fault."""
    if b < 0:
        fail(c, place, NEGATIVE_SHIFT, a, b)
    return np.int64(a) >> min(b, 63)


@overloaded
def neg(c, place, a):
    """Return the negative of a number; overflow is a fault."""
    if is_whole(a):
        return lambda c, place, a: sub(c, place, 0, a)
    return lambda c, place, a: -a


@overloaded
def absolute(c, place, a):
    """Return the absolute value of a number; overflow is a fault."""
    if is_whole(a):
        return lambda c, place, a: neg(c, place, a) if a < 0 else np.int64(a)
    return lambda c, place, a: abs(a)


@overloaded
def whole(c, place, a):
    """Return ``int(a)``; a float that does not fit 64 bits is a fault."""
    if is_whole(a):
        return lambda c, place, a: np.int64(a)

    def from_float(c, place, a):
        if not (-9.2e18 < a < 9.2e18):
            fail(c, place, NOT_FINITE, 0, 0)
        return np.int64(a)

    return from_float if isinstance(a, types.Float) else None


@overloaded
def real(c, place, a):
    """Return ``float(a)``; what is no number does not compile."""
    if isinstance(a, types.Boolean):
        return lambda c, place, a: 1.0 if a else 0.0
    if not is_number(a):
        raise numba.core.errors.TypingError("a number is wanted here")
    return lambda c, place, a: np.float64(a)


@overloaded
def declared_whole(c, place, a):
    """Return ``a`` as int64, to be assigned to a field of whole numbers; a float does not compile."""
    if is_whole(a):
        return lambda c, place, a: np.int64(a)
    raise numba.core.errors.TypingError("a field of whole numbers cannot be set to a float; use int(...) or Float")


@overloaded
def is_in(c, place, a, options):
    """Return whether the tuple or array ``options`` contains the number ``a``."""
    if isinstance(options, types.BaseTuple) and len(options) == 0:
        return lambda c, place, a, options: False

    def search(c, place, a, options):
        for option in options:
            if option == a:
                return True
        return False

    return search


@njit
def rounded(c, place, a):
    """Return ``round(a)``; a float that does not fit 64 bits is a fault."""
    if not (-9.2e18 < a < 9.2e18):
        fail(c, place, NOT_FINITE, 0, 0)
    return np.int64(np.rint(a))
