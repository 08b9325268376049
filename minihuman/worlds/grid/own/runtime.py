"""What translated rules call, for Numba: checked arithmetic and indices, draws, and what `Layout` and `OwnRules` do.

Only the process that compiles rules imports this module. Each function takes the context of a world, the address of a
block of addresses (see `context`), and the number of a place in the author's source. Where Python would raise an error,
the place and the kind of error are written into the context's fault array, and the function returns with Numba's error
status.
"""
# mypy: ignore-errors

import math
from functools import partial
from types import BuiltinFunctionType, FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import float64, int64, types
from numba.core import cgutils
from numba.extending import intrinsic, overload
from numba.np.arrayobj import populate_array

from minihuman.worlds import rng
from minihuman.worlds.build.compilation import array_at
from minihuman.worlds.grid.core import placement, state
from minihuman.worlds.grid.core.bodies import BLOCK
from minihuman.worlds.grid.own.context import (
    FAULT,
    FLOAT_SETTINGS,
    MISSION,
    OWN,
    RNG,
    ROW,
    ROW_LENGTH_WORD,
    SCRATCH,
    SETTINGS,
)
from minihuman.worlds.grid.own.faults import (
    BAD_RANGE,
    INDEX,
    NEGATIVE_SHIFT,
    NO_AGENT,
    NO_PLACE,
    NOT_FINITE,
    OUTSIDE,
    OVERFLOW,
    TOO_MANY,
    UNPACK,
    WRONG_COLOUR,
    ZERO_DIVISION,
)
from minihuman.worlds.grid.own.fields import MOST_NUMBERS
from minihuman.worlds.kernel_sources import COMPILERS, KernelSource
from minihuman.worlds.kernels import LateKernel

OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True, "_nrt": False}
_NAMES: dict[int, dict[str, Any]] = {}
_FORMS: dict[int, Any] = {}


def numba_form(kernel: Any) -> Any:
    """Return a kernel of ours for Numba, which compiles it when other code calls it and not before."""
    source = _source_of(kernel)
    if id(source.function) not in _FORMS:
        function = source.function
        names = _names_of(function.__globals__)
        copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
        variables = {name: numba.from_dtype(np.dtype(kind)) for name, kind in source.variables.items()}
        _FORMS[id(function)] = _without_literals(numba.njit(locals=variables, **OPTIONS)(copy))
    return _FORMS[id(source.function)]


def _without_literals(dispatcher: Any) -> Any:
    """Compile a function once for all whole numbers, not once for each that is written out in a call.

    Breaks, by compiling more, if Numba renames ``Dispatcher.get_call_template``.
    """
    template = dispatcher.get_call_template

    def template_of_kinds(arguments: Any, named: Any) -> Any:
        return template(tuple(map(types.unliteral, arguments)), named)

    dispatcher.get_call_template = template_of_kinds
    return dispatcher


def _source_of(kernel: Any) -> KernelSource:
    if isinstance(kernel, LateKernel):
        return kernel.source
    if hasattr(kernel, "py_func"):
        return KernelSource(kernel.py_func)
    plain, compile_it = COMPILERS[id(kernel)]
    if isinstance(compile_it, partial) and isinstance(compile_it.args[0], KernelSource):
        return compile_it.args[0]
    return KernelSource(plain)


def _names_of(module_names: dict[str, Any]) -> dict[str, Any]:
    names = _NAMES.get(id(module_names))
    if names is None:
        names = _NAMES[id(module_names)] = dict(module_names)
        for name, value in module_names.items():
            is_kernel = isinstance(value, LateKernel) or hasattr(value, "py_func") or id(value) in COMPILERS
            if is_kernel and isinstance(value, FunctionType | BuiltinFunctionType | LateKernel):
                names[name] = numba_form(value)
    return names


def njit(function: Any) -> Any:
    """Return a function for Numba, to be called from compiled code only."""
    return _without_literals(numba.njit(**OPTIONS)(function))


put_code = numba_form(state.put)
lift_code = numba_form(state.lift)
move_code = numba_form(state.move)
make_code = numba_form(state.make)
cell_code = numba_form(state.cell_at)
clear_row = numba_form(state.clear)
draw_place = numba_form(placement.draw_place)
draw_integer = numba_form(rng.integer)
draw_unit = numba_form(rng.unit)
I64 = array_at(np.int64)
F64 = array_at(np.float64)
U64 = array_at(np.uint64)
I32 = array_at(np.int32)
U8 = array_at(np.uint8)


def _array_of(word: int, kind: type[np.generic]) -> Any:
    """Return an intrinsic that returns one of a context's arrays. Only the row knows its length."""
    dtype = numba.from_dtype(np.dtype(kind))
    array = types.Array(dtype, 1, "C")

    @intrinsic
    def view(typing_context, c):
        def code(context, builder, signature, values):
            block = builder.inttoptr(values[0], ir.IntType(64).as_pointer())
            index = ir.Constant(ir.IntType(64), word)
            struct = context.make_array(array)(context, builder)
            start = builder.inttoptr(builder.load(builder.gep(block, [index])), struct.data.type)
            if word == ROW:
                length = builder.load(builder.gep(block, [ir.Constant(ir.IntType(64), ROW_LENGTH_WORD)]))
            else:
                length = ir.Constant(ir.IntType(64), MOST_NUMBERS)
            item = context.get_constant(types.intp, np.dtype(kind).itemsize)
            populate_array(struct, data=start, shape=[length], strides=[item], itemsize=item, meminfo=None)
            return struct._getvalue()

        return array(int64), code

    return view


row = _array_of(ROW, np.int32)
own = _array_of(OWN, np.int64)
own_floats = _array_of(OWN, np.float64)
settings = _array_of(SETTINGS, np.int64)
float_settings = _array_of(FLOAT_SETTINGS, np.float64)
rng_state = _array_of(RNG, np.uint64)
fault = _array_of(FAULT, np.int64)
mission = _array_of(MISSION, np.int64)
scratch = _array_of(SCRATCH, np.int64)
float_scratch = _array_of(SCRATCH, np.float64)


# --- faults ---


def _store_fault(builder: Any, values: Any, kind: int) -> None:
    word = ir.IntType(64)
    block = builder.inttoptr(values[0], word.as_pointer())
    start = builder.load(builder.gep(block, [ir.Constant(word, FAULT)]))
    words = builder.inttoptr(start, word.as_pointer())
    builder.store(ir.Constant(word, kind), words)
    builder.store(values[1], builder.gep(words, [ir.Constant(word, 1)]))


def _fail_if(context: Any, builder: Any, signature: Any, values: Any, condition: Any, kind: int) -> None:
    with builder.if_then(condition, likely=False):
        _store_fault(builder, values, kind)
        context.call_conv.return_user_exc(builder, ValueError, ("fault",))


@njit
def fail(c, place, kind, a, b):
    """Record a fault with two numbers, and end the call."""
    fault(c)[0] = kind
    fault(c)[1] = place
    fault(c)[2] = a
    fault(c)[3] = b
    raise ValueError("fault")


# --- arithmetic ---


def _is_whole(kind: Any) -> bool:
    return isinstance(kind, types.Integer | types.Boolean)


def _is_number(kind: Any) -> bool:
    return _is_whole(kind) or isinstance(kind, types.Float)


def _checked(name: str, real: str) -> Any:
    """Return an intrinsic of two numbers: whole ones checked for overflow, others as floats."""

    @intrinsic
    def operate(typing_context, c, place, a, b):
        if not (_is_number(a) and _is_number(b)):
            return None
        if _is_whole(a) and _is_whole(b):

            def whole(context, builder, signature, values):
                pair = getattr(builder, name)(values[2], values[3])
                _fail_if(context, builder, signature, values, builder.extract_value(pair, 1), OVERFLOW)
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
    """Divide as Python does."""
    if not (_is_number(a) and _is_number(b)):
        return None

    def code(context, builder, signature, values):
        zero = builder.fcmp_ordered("==", values[3], ir.Constant(ir.DoubleType(), 0.0))
        _fail_if(context, builder, signature, values, zero, ZERO_DIVISION)
        return builder.fdiv(values[2], values[3])

    return float64(c, int64, float64, float64), code


@njit
def _whole_floordiv(c, place, a, b):
    if b == 0:
        fail(c, place, ZERO_DIVISION, a, 0)
    if b == -1:
        return sub(c, place, 0, a)
    return a // b


@njit
def _whole_mod(c, place, a, b):
    if b == 0:
        fail(c, place, ZERO_DIVISION, a, 0)
    if b == -1:
        return np.int64(0)
    return a % b


@njit
def _float_mod(c, place, a, b):
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


def _stub(name: str) -> Any:
    def stub(*arguments):
        raise NotImplementedError(name)

    stub.__name__ = name
    return stub


def _overloaded(typed: Any) -> Any:
    stub = _stub(typed.__name__)
    overload(stub, jit_options=OPTIONS, strict=False)(typed)
    return stub


@_overloaded
def floordiv(c, place, a, b):
    """Divide and round down as Python does."""
    if _is_whole(a) and _is_whole(b):
        return lambda c, place, a, b: _whole_floordiv(c, place, np.int64(a), np.int64(b))
    return lambda c, place, a, b: _float_floordiv(c, place, float(a), float(b))


@_overloaded
def mod(c, place, a, b):
    """Return the remainder as Python does."""
    if _is_whole(a) and _is_whole(b):
        return lambda c, place, a, b: _whole_mod(c, place, np.int64(a), np.int64(b))
    return lambda c, place, a, b: _float_mod(c, place, float(a), float(b))


@_overloaded
def power(c, place, base, exponent):
    """Raise a whole number to a whole power of 0 or more."""
    if not (_is_whole(base) and _is_whole(exponent)):
        raise numba.core.errors.TypingError("a power of floats differs between machines; multiply instead")
    return lambda c, place, base, exponent: _whole_power(c, place, np.int64(base), np.int64(exponent))


@njit
def _whole_power(c, place, base, exponent):
    if exponent < 0:
        fail(c, place, BAD_RANGE, 0, exponent)
    product = np.int64(1)
    for _ in range(exponent):
        product = mul(c, place, product, base)
    return product


@njit
def lshift(c, place, a, b):
    """Shift left as Python does."""
    if b < 0:
        fail(c, place, NEGATIVE_SHIFT, a, b)
    if a == 0:
        return np.int64(0)
    if b > 62 or (a << b) >> b != a:
        fail(c, place, OVERFLOW, a, b)
    return a << b


@njit
def rshift(c, place, a, b):
    """Shift right as Python does."""
    if b < 0:
        fail(c, place, NEGATIVE_SHIFT, a, b)
    return np.int64(a) >> min(b, 63)


@_overloaded
def neg(c, place, a):
    """Negate."""
    if _is_whole(a):
        return lambda c, place, a: sub(c, place, 0, a)
    return lambda c, place, a: -a


@_overloaded
def absolute(c, place, a):
    """Return the absolute value."""
    if _is_whole(a):
        return lambda c, place, a: neg(c, place, a) if a < 0 else np.int64(a)
    return lambda c, place, a: abs(a)


@_overloaded
def whole(c, place, a):
    """Return ``int(a)``."""
    if _is_whole(a):
        return lambda c, place, a: np.int64(a)

    def from_float(c, place, a):
        if not (-9.2e18 < a < 9.2e18):
            fail(c, place, NOT_FINITE, 0, 0)
        return np.int64(a)

    return from_float if isinstance(a, types.Float) else None


@_overloaded
def real(c, place, a):
    """Return ``float(a)``."""
    if isinstance(a, types.Boolean):
        return lambda c, place, a: 1.0 if a else 0.0
    if not _is_number(a):
        raise numba.core.errors.TypingError("a number is wanted here")
    return lambda c, place, a: np.float64(a)


@_overloaded
def declared_whole(c, place, a):
    """Return a number that is assigned to a field of whole numbers, which takes no float."""
    if _is_whole(a):
        return lambda c, place, a: np.int64(a)
    raise numba.core.errors.TypingError("a field of whole numbers cannot be set to a float; use int(...) or Float")


@_overloaded
def is_in(c, place, a, options):
    """Return whether a value is one of a tuple's."""
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
    """Return ``round(a)``."""
    if not (-9.2e18 < a < 9.2e18):
        fail(c, place, NOT_FINITE, 0, 0)
    return np.int64(np.rint(a))


# --- elements ---


@njit
def index_in(c, place, i, n):
    """Return an index from the start; a negative one counts from the end."""
    at = i + n if i < 0 else np.int64(i)
    if at < 0 or at >= n:
        fail(c, place, INDEX, i, n)
    return at


@_overloaded
def at(c, place, values, i):
    """Return an element of a tuple or array, or a row of an array. A pair is the index of an array's element."""
    if isinstance(values, types.Optional):
        return lambda c, place, values, i: at(c, place, unwrapped(c, place, values), i)
    if isinstance(i, types.BaseTuple):
        return lambda c, place, values, i: at_2(c, place, values, i[0], i[1])
    if isinstance(values, types.BaseTuple):
        return lambda c, place, values, i: values[index_in(c, place, i, len(values))]
    if isinstance(values, types.Array) and values.ndim == 2:
        raise numba.core.errors.TypingError("one index of an array with two lengths; give two, or loop over the rows")
    if isinstance(values.dtype, types.Float):
        return lambda c, place, values, i: values[np.uint64(index_in(c, place, i, len(values)))]
    return lambda c, place, values, i: np.int64(values[np.uint64(index_in(c, place, i, len(values)))])


@_overloaded
def at_2(c, place, values, i, j):
    """Return an element of an array of two dimensions."""

    def read(c, place, values, i, j):
        first = index_in(c, place, i, values.shape[0])
        return values[np.uint64(first), np.uint64(index_in(c, place, j, values.shape[1]))]

    def read_whole(c, place, values, i, j):
        return np.int64(read_element(c, place, values, i, j))

    read_element = njit(read)
    return read if isinstance(values.dtype, types.Float) else read_whole


@njit
def _check_code(c, place, code):
    if code < 0 or code >> 9 > np.int64(row(c)[11]):
        fail(c, place, OUTSIDE, -1, code)


@_overloaded
def set_at(c, place, values, i, value):
    """Set an element of an array, or a row of it."""
    if not isinstance(values, types.Array):
        raise numba.core.errors.TypingError("a tuple cannot be changed; assign a new one")
    if isinstance(i, types.BaseTuple):
        return lambda c, place, values, i, value: set_at_2(c, place, values, i[0], i[1], value)
    if values.ndim == 2:

        def write_row(c, place, values, i, value):
            first = index_in(c, place, i, values.shape[0])
            if len(value) != values.shape[1]:
                fail(c, place, UNPACK, len(value), values.shape[1])
            for j in range(len(value)):
                values[first, j] = value[j]

        return write_row
    if isinstance(values.dtype, types.Float):
        return lambda c, place, values, i, value: _write(values, index_in(c, place, i, len(values)), float(value))
    if values.dtype is types.int32:

        def write_code(c, place, values, i, value):
            where = index_in(c, place, i, len(values))
            if where < 2 or 5 < where < 13 or where > 22 or declared_whole(c, place, value) != np.int32(value):
                fail(c, place, OVERFLOW, value, 0)
            if where == 5:
                _check_code(c, place, value)
            values[where] = value

        return write_code
    return lambda c, place, values, i, value: _write(
        values, index_in(c, place, i, len(values)), declared_whole(c, place, value)
    )


@njit
def _write(values, i, value):
    values[np.uint64(i)] = value


@_overloaded
def set_at_2(c, place, values, i, j, value):
    """Set an element of an array of two dimensions."""
    is_code = values.dtype is types.int32
    is_float = isinstance(values.dtype, types.Float)

    def write_float(c, place, values, i, j, value):
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = float(value)

    def write_code(c, place, values, i, j, value):
        _check_code(c, place, value)
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = value

    def write_whole(c, place, values, i, j, value):
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = declared_whole(c, place, value)

    if is_float:
        return write_float
    return write_code if is_code else write_whole


@_overloaded
def fill(c, place, values, value):
    """Set all elements of an array to a number."""
    if values.ndim == 1:

        def fill_1(c, place, values, value):
            for i in range(len(values)):
                values[i] = value

        return fill_1

    def fill_2(c, place, values, value):
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                values[i, j] = value

    return fill_2


@_overloaded
def copy_into(c, place, values, source):
    """Set all elements of a short array to those of a tuple or array, or to a number."""
    if _is_number(source):
        return lambda c, place, values, source: fill(c, place, values, source)

    def copy(c, place, values, source):
        if len(values) != len(source):
            fail(c, place, UNPACK, len(source), len(values))
        for i in range(len(source)):
            set_at(c, place, values, i, source[i])

    return copy


def _view(dimensions: int) -> Any:
    """Return an intrinsic that views part of an array of one dimension as an array of one or two."""

    def typed(values: Any) -> Any:
        return types.Array(values.dtype, dimensions, "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = context.make_array(signature.args[0])(context, builder, arguments[0])
        view = context.make_array(signature.return_type)(context, builder)
        start = builder.gep(source.data, [arguments[1]])
        size = context.get_abi_sizeof(context.get_data_type(signature.args[0].dtype))
        item = context.get_constant(types.intp, size)
        shape = list(arguments[2:])
        strides = [item] if dimensions == 1 else [builder.mul(shape[1], item), item]
        populate_array(view, data=start, shape=shape, strides=strides, itemsize=item, meminfo=None)
        return view._getvalue()

    if dimensions == 1:

        @intrinsic
        def view_1(typing_context, values, offset, n):
            return typed(values)(values, int64, int64), code

        return view_1

    @intrinsic
    def view_2(typing_context, values, offset, n, m):
        return typed(values)(values, int64, int64, int64), code

    return view_2


view_1 = _view(1)
view_2 = _view(2)


@intrinsic
def row_of(typing_context, c, place, values, i):
    """Return a row of an array of two dimensions, as a view."""
    kind = types.Array(values.dtype, 1, "C")

    def code(context, builder, signature, arguments):
        source = context.make_array(signature.args[2])(context, builder, arguments[2])
        rows, columns = cgutils.unpack_tuple(builder, source.shape)
        last = arguments[3]
        zero = ir.Constant(last.type, 0)
        index = builder.select(builder.icmp_signed("<", last, zero), builder.add(last, rows), last)
        outside = builder.icmp_unsigned(">=", index, rows)
        _fail_if(context, builder, signature, arguments, outside, INDEX)
        view = context.make_array(signature.return_type)(context, builder)
        start = builder.gep(source.data, [builder.mul(index, columns)])
        size = context.get_abi_sizeof(context.get_data_type(signature.args[2].dtype))
        item = context.get_constant(types.intp, size)
        populate_array(view, data=start, shape=[columns], strides=[item], itemsize=item, meminfo=None)
        return view._getvalue()

    return kind(c, int64, values, int64), code


@intrinsic
def unwrapped(typing_context, c, place, value):
    """Return what is not None of what may be."""
    if not isinstance(value, types.Optional):
        return value(c, int64, value), lambda context, builder, signature, values: values[2]

    def code(context, builder, signature, values):
        optional = context.make_helper(builder, signature.args[2], value=values[2])
        missing = builder.not_(cgutils.as_bool_bit(builder, optional.valid))
        _fail_if(context, builder, signature, values, missing, UNPACK)
        return optional.data

    return value.type(c, int64, value), code


@_overloaded
def unpack_2(c, place, values):
    """Return two values of a tuple or array."""
    if isinstance(values, types.Array):

        def read(c, place, values):
            if len(values) != 2:
                fail(c, place, UNPACK, len(values), 2)
            return at(c, place, values, 0), at(c, place, values, 1)

        return read
    return lambda c, place, values: unwrapped(c, place, values)


@_overloaded
def unpack_3(c, place, values):
    """Return three values of a tuple or array."""
    if isinstance(values, types.Array):

        def read(c, place, values):
            if len(values) != 3:
                fail(c, place, UNPACK, len(values), 3)
            return at(c, place, values, 0), at(c, place, values, 1), at(c, place, values, 2)

        return read
    return lambda c, place, values: unwrapped(c, place, values)


# --- draws ---


@njit
def draw(c, place, low, high):
    """Draw a whole number in [low, high), as NumPy's generator does."""
    if low >= high or high - low > 4294967295:
        fail(c, place, BAD_RANGE, low, high)
    return draw_integer(rng_state(c), low, high)


@njit
def draw_random(c, place):
    """Draw a number in [0, 1), as NumPy's generator does."""
    return draw_unit(rng_state(c)) * (1.0 / 9007199254740992.0)


@njit
def choice(c, place, options):
    """Draw one of a tuple's values."""
    return options[draw(c, place, 0, len(options))]


# --- the grid ---


@njit
def width(c):
    """Return the number of columns."""
    return np.int64(row(c)[0])


@njit
def height(c):
    """Return the number of rows."""
    return np.int64(row(c)[1])


@njit
def code_at(c, x, y):
    """Return the code in a cell; outside the grid are walls."""
    return np.int64(cell_code(row(c), x, y))


@njit
def is_inside(c, x, y):
    """Return whether a cell is in the grid."""
    return 0 <= x < np.int64(row(c)[0]) and 0 <= y < np.int64(row(c)[1])


@njit
def find(c, place, identity):
    """Return the cell of an object, or None."""
    if identity < 1 or identity > np.int64(row(c)[0]) * np.int64(row(c)[1]):
        fail(c, place, INDEX, identity, np.int64(row(c)[0]) * np.int64(row(c)[1]))
    cell = np.int64(row(c)[24 + np.int64(row(c)[0]) * np.int64(row(c)[1]) + identity - 1])
    if cell == -1:
        return None
    return cell // np.int64(row(c)[1]), cell % np.int64(row(c)[1])


@njit
def body_start(c, bodies, body):
    """Return where a body's column, row, direction and hand are in the row."""
    return np.int64(2) if body == 0 else row(c).shape[0] - BLOCK * (bodies - body)


@njit
def is_body_at(c, bodies, x, y):
    """Return whether a body stands in a cell."""
    for body in range(bodies):
        start = body_start(c, bodies, body)
        if np.int64(row(c)[start]) == x and np.int64(row(c)[start + 1]) == y:
            return True
    return False


@njit
def remove(c, x, y):
    """Empty a cell and return its code."""
    if not is_inside(c, x, y):
        return np.int64(1)
    return np.int64(lift_code(row(c), x, y))


@njit
def move(c, bodies, identity, x, y):
    """Move an object into an empty cell; return whether it was moved."""
    if identity < 1 or identity > np.int64(row(c)[11]) or not is_inside(c, x, y) or is_body_at(c, bodies, x, y):
        return False
    if row(c)[24 + np.int64(row(c)[0]) * np.int64(row(c)[1]) + identity - 1] < 0 or cell_code(row(c), x, y) != 1:
        return False
    move_code(row(c), identity, x * np.int64(row(c)[1]) + y)
    return True


@njit
def make_item(c, place, kind, colour, door_state, has_identity):
    """Return the code of a new object."""
    if has_identity == 0:
        return kind | colour << 4
    if np.int64(row(c)[11]) >= np.int64(row(c)[0]) * np.int64(row(c)[1]) or np.int64(row(c)[11]) >= 4194303:
        fail(c, place, TOO_MANY, np.int64(row(c)[11]), 0)
    return np.int64(make_code(row(c), kind, colour, door_state))


@njit
def put(c, place, item, x, y):
    """Put an item into a cell; return its identity and the cell."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    code = make_item(c, place, item[0], item[1], item[2], item[3])
    if item[4] >= 0:
        inside = make_item(c, place, item[4], item[5], item[6], item[7])
        row(c)[24 + 2 * np.int64(row(c)[0]) * np.int64(row(c)[1]) + (code >> 9) - 1] = inside
    put_code(row(c), x, y, code)
    return code >> 9, np.int64(x), np.int64(y)


@njit
def put_line(c, place, item, x, y, dx, dy, length):
    """Put an item into each cell of a line."""
    for i in range(length):
        put(c, place, item, x + i * dx, y + i * dy)


@njit
def put_code_checked(c, place, x, y, code):
    """Put a code into a cell, as the kernel `put` does."""
    _check_code(c, place, code)
    put_code(row(c), x, y, code)


@njit
def wall_rect(c, place, x, y, w, h):
    """Put the four walls of a room."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    if not is_inside(c, x + w - 1, y + h - 1):
        fail(c, place, OUTSIDE, x + w - 1, y + h - 1)
    for i in range(w):
        put_code(row(c), x + i, y, 82)
        put_code(row(c), x + i, y + h - 1, 82)
    for j in range(h):
        put_code(row(c), x, y + j, 82)
        put_code(row(c), x + w - 1, y + j, 82)


@njit
def clear_cell(c, place, x, y):
    """Make a cell empty."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    put_code(row(c), x, y, 1)


@njit
def is_taken(c, bodies, x, y):
    """Return whether a body other than the first stands in a cell."""
    for body in range(1, bodies):
        start = body_start(c, bodies, body)
        if np.int64(row(c)[start]) == x and np.int64(row(c)[start + 1]) == y:
            return True
    return False


@njit
def draw_cell(c, place, bodies, top, size, tries):
    """Draw a free cell of a rectangle."""
    for _ in range(tries):
        x, y = draw_place(row(c), rng_state(c), top[0], top[1], size[0], size[1], 1 << 30)
        if x < 0:
            row(c)[23] = 0
            fail(c, place, NO_PLACE, size[0], size[1])
        if not is_taken(c, bodies, x, y):
            return np.int64(x), np.int64(y)
    fail(c, place, NO_PLACE, size[0], size[1])
    return np.int64(0), np.int64(0)


@njit
def place_item(c, place, bodies, item, top, size, tries):
    """Put an item into a random free cell of a rectangle."""
    x, y = draw_cell(c, place, bodies, top, size, tries)
    return put(c, place, item, x, y)


@njit
def stand(c, place, bodies, body, x, y, direction):
    """Put a body into a cell."""
    if body < 0 or body >= bodies:
        fail(c, place, INDEX, body, bodies)
    start = body_start(c, bodies, body)
    row(c)[start] = x
    row(c)[start + 1] = y
    row(c)[start + 2] = direction


@njit
def put_agent(c, place, bodies, x, y, direction, body):
    """Put a body into a cell of the grid."""
    if not is_inside(c, x, y):
        fail(c, place, OUTSIDE, x, y)
    stand(c, place, bodies, body, x, y, direction)


@njit
def place_agent(c, place, bodies, top, size, direction, body):
    """Put a body into a random free cell; a direction of -1 is drawn."""
    stand(c, place, bodies, body, -1, -1, -1)
    x, y = draw_cell(c, place, bodies, top, size, 1 if bodies == 1 else 10_000)
    way = draw_integer(rng_state(c), 0, 4) if direction == -1 else direction
    stand(c, place, bodies, body, x, y, way)
    return x, y


@_overloaded
def colour_number(c, place, colour, numbers):
    """Return the number of a colour from the number of its name in the program's table of texts."""

    def look_up(c, place, colour, numbers):
        if numbers[colour[0]] < 0:
            fail(c, place, WRONG_COLOUR, colour[0], 0)
        return numbers[colour[0]]

    return look_up


@_overloaded
def text_part(c, place, nth, value):
    """Record what fills a placeholder of the mission: a text, or a whole number."""
    if isinstance(value, types.UniTuple) and len(value) == 1:

        def record_text(c, place, nth, value):
            mission(c)[1 + 2 * nth] = 1
            mission(c)[2 + 2 * nth] = value[0]

        return record_text
    if isinstance(value, types.Integer):

        def record_number(c, place, nth, value):
            mission(c)[1 + 2 * nth] = 0
            mission(c)[2 + 2 * nth] = value

        return record_number
    raise numba.core.errors.TypingError("a mission's placeholder takes a text or a whole number")


@njit
def set_task(c, nth, number):
    """Set the task's number, or one of what it is about."""
    row(c)[12 + nth] = number


@njit
def ahead(x, y, direction):
    """Return the next cell in a direction."""
    return x + (1 - direction) * (1 - direction % 2), y + (2 - direction) * (direction % 2)


@njit
def move_to_cell(c, place, identity, cell):
    """Move an object to an empty cell, as the kernel `move` does."""
    count = np.int64(row(c)[0]) * np.int64(row(c)[1])
    if identity < 1 or identity > np.int64(row(c)[11]) or cell < 0 or cell >= count:
        fail(c, place, OUTSIDE, identity, cell)
    if np.int64(row(c)[24 + count + identity - 1]) < 0:
        fail(c, place, OUTSIDE, identity, cell)
    move_code(row(c), identity, cell)


@njit
def draw_once(c, place, top, size):
    """Draw a cell in which nothing lies and the first body does not stand."""
    x, y = draw_place(row(c), rng_state(c), top[0], top[1], size[0], size[1], 1 << 30)
    if x < 0:
        row(c)[23] = 0
        fail(c, place, NO_PLACE, size[0], size[1])
    return np.int64(x), np.int64(y)


@njit
def check_bodies(c, place, bodies):
    """Check that every body stands in a cell of its own and looks in a direction."""
    for body in range(bodies):
        start = body_start(c, bodies, body)
        x = np.int64(row(c)[start])
        y = np.int64(row(c)[start + 1])
        if not is_inside(c, x, y) or np.int64(row(c)[start + 2]) < 0 or np.int64(row(c)[start + 2]) > 3:
            fail(c, place, NO_AGENT, x, y)
        for other in range(body):
            at = body_start(c, bodies, other)
            if np.int64(row(c)[at]) == x and np.int64(row(c)[at + 1]) == y:
                fail(c, place, NO_AGENT, x, y)


@njit
def clear_bodies(c, bodies):
    """Remove every body but the first."""
    for body in range(1, bodies):
        start = body_start(c, bodies, body)
        row(c)[start] = -1
        row(c)[start + 1] = -1
        row(c)[start + 2] = -1
        row(c)[start + 3] = 1


@njit
def body(c, place, bodies, nth):
    """Return a body's column, row, direction and the code of what it carries."""
    if nth < 0 or nth >= bodies:
        fail(c, place, INDEX, nth, bodies)
    start = body_start(c, bodies, nth)
    return (
        np.int64(row(c)[start]),
        np.int64(row(c)[start + 1]),
        np.int64(row(c)[start + 2]),
        np.int64(row(c)[start + 3]),
    )
