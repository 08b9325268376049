"""Elements of tuples and arrays in translated rules, for Numba: an index out of range is a fault, as in Python.

Each function takes the address of a world's context (see `context`) and the number of a place in the author's source.
"""
# mypy: ignore-errors

from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import int64, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from minihuman.worlds.grid.own.arithmetic import declared_whole
from minihuman.worlds.grid.own.faults import INDEX, OUTSIDE, OVERFLOW, UNPACK
from minihuman.worlds.grid.own.numba_forms import fail, fail_if, is_number, njit, overloaded, row


@njit
def index_in(c, place, i, n):
    """Return the index from the start that ``i`` stands for among ``n`` elements; a negative ``i`` counts from the end.

    An index out of range is a fault.
    """
    at = i + n if i < 0 else np.int64(i)
    if at < 0 or at >= n:
        fail(c, place, INDEX, i, n)
    return at


@overloaded
def at(c, place, values, i):
    """Return an element of a tuple or array; of an array with two dimensions, ``i`` must be a pair of indices.

    An index out of range, or None in place of the values, is a fault.
    """
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


@overloaded
def at_2(c, place, values, i, j):
    """Return the element [i, j] of an array of two dimensions; an index out of range is a fault."""

    def read(c, place, values, i, j):
        first = index_in(c, place, i, values.shape[0])
        return values[np.uint64(first), np.uint64(index_in(c, place, j, values.shape[1]))]

    def read_whole(c, place, values, i, j):
        return np.int64(read_element(c, place, values, i, j))

    read_element = njit(read)
    return read if isinstance(values.dtype, types.Float) else read_whole


@njit
def check_code(c, place, code):
    """Check that a code has no identity or that of an object that exists; otherwise it is a fault."""
    if code < 0 or code >> 9 > np.int64(row(c)[11]):  # the identity in the code, and the number of objects
        fail(c, place, OUTSIDE, -1, code)


@overloaded
def set_at(c, place, values, i, element):
    """Set an element of an array, or a row of it; ``i`` may be a pair of indices.

    Of the row of state, only the numbers of the agent, the target and the mission can be set: others are a fault.
    """
    if not isinstance(values, types.Array):
        raise numba.core.errors.TypingError("a tuple cannot be changed; assign a new one")
    if isinstance(i, types.BaseTuple):
        return lambda c, place, values, i, element: set_at_2(c, place, values, i[0], i[1], element)
    if values.ndim == 2:

        def write_row(c, place, values, i, element):
            first = index_in(c, place, i, values.shape[0])
            if len(element) != values.shape[1]:
                fail(c, place, UNPACK, len(element), values.shape[1])
            for j in range(len(element)):
                values[first, j] = element[j]

        return write_row
    if isinstance(values.dtype, types.Float):
        return lambda c, place, values, i, element: _write(values, index_in(c, place, i, len(values)), float(element))
    if values.dtype is types.int32:

        def write_code(c, place, values, i, element):
            # of a row, rules may write the agent (2 to 5), the task's target (13 to 18) and the mission (19 to 22)
            where = index_in(c, place, i, len(values))
            if where < 2 or 5 < where < 13 or where > 22 or declared_whole(c, place, element) != np.int32(element):
                fail(c, place, OVERFLOW, element, 0)
            if where == 5:
                check_code(c, place, element)
            values[where] = element

        return write_code
    return lambda c, place, values, i, element: _write(
        values, index_in(c, place, i, len(values)), declared_whole(c, place, element)
    )


@njit
def _write(values, i, element):
    values[np.uint64(i)] = element


@overloaded
def set_at_2(c, place, values, i, j, element):
    """Set the element [i, j] of an array of two dimensions; an index out of range is a fault."""
    is_code = values.dtype is types.int32
    is_float = isinstance(values.dtype, types.Float)

    def write_float(c, place, values, i, j, element):
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = float(element)

    def write_code(c, place, values, i, j, element):
        check_code(c, place, element)
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = element

    def write_whole(c, place, values, i, j, element):
        first = index_in(c, place, i, values.shape[0])
        values[first, index_in(c, place, j, values.shape[1])] = declared_whole(c, place, element)

    if is_float:
        return write_float
    return write_code if is_code else write_whole


@overloaded
def fill(c, place, values, element):
    """Set all elements of an array to a number."""
    if values.ndim == 1:

        def fill_1(c, place, values, element):
            for i in range(len(values)):
                values[i] = element

        return fill_1

    def fill_2(c, place, values, element):
        for i in range(values.shape[0]):
            for j in range(values.shape[1]):
                values[i, j] = element

    return fill_2


@overloaded
def copy_into(c, place, values, source):
    """Set all elements of an array to those of a tuple or array, whose length must be the same, or to a number."""
    if is_number(source):
        return lambda c, place, values, source: fill(c, place, values, source)

    def copy(c, place, values, source):
        if len(values) != len(source):
            fail(c, place, UNPACK, len(source), len(values))
        for i in range(len(source)):
            set_at(c, place, values, i, source[i])

    return copy


def _view(dimensions: int) -> Any:
    """Return an intrinsic that views part of an array of one dimension as an array of ``dimensions``, one or two.

    The intrinsic takes the array, the index at which the part begins, and the lengths of the view.
    """

    def typed(values: Any) -> Any:
        return types.Array(values.dtype, dimensions, "C")

    def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        source = context.make_array(signature.args[0])(context, builder, arguments[0])
        view = context.make_array(signature.return_type)(context, builder)
        start = builder.gep(source.data, [arguments[1]])
        size = context.get_abi_sizeof(context.get_data_type(signature.args[0].dtype))
        item_bytes = context.get_constant(types.intp, size)
        shape = list(arguments[2:])
        strides = [item_bytes] if dimensions == 1 else [builder.mul(shape[1], item_bytes), item_bytes]
        populate_array(view, data=start, shape=shape, strides=strides, itemsize=item_bytes, meminfo=None)
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
    """Return row ``i`` of an array of two dimensions, as a view; an index out of range is a fault."""
    kind = types.Array(values.dtype, 1, "C")

    def code(context, builder, signature, arguments):
        source = context.make_array(signature.args[2])(context, builder, arguments[2])
        rows, columns = cgutils.unpack_tuple(builder, source.shape)
        last = arguments[3]
        zero = ir.Constant(last.type, 0)
        index = builder.select(builder.icmp_signed("<", last, zero), builder.add(last, rows), last)
        outside = builder.icmp_unsigned(">=", index, rows)
        fail_if(context, builder, signature, arguments, outside, INDEX)
        view = context.make_array(signature.return_type)(context, builder)
        start = builder.gep(source.data, [builder.mul(index, columns)])
        size = context.get_abi_sizeof(context.get_data_type(signature.args[2].dtype))
        item_bytes = context.get_constant(types.intp, size)
        populate_array(view, data=start, shape=[columns], strides=[item_bytes], itemsize=item_bytes, meminfo=None)
        return view._getvalue()

    return kind(c, int64, values, int64), code


@intrinsic
def unwrapped(typing_context, c, place, element):
    """Return the value of ``element``, which may have an optional type; None is a fault."""
    if not isinstance(element, types.Optional):
        return element(c, int64, element), lambda context, builder, signature, values: values[2]

    def code(context, builder, signature, values):
        optional = context.make_helper(builder, signature.args[2], value=values[2])
        missing = builder.not_(cgutils.as_bool_bit(builder, optional.valid))
        fail_if(context, builder, signature, values, missing, UNPACK)
        return optional.data

    return element.type(c, int64, element), code


@overloaded
def unpack_2(c, place, values):
    """Return the two values of a tuple or array; another length of an array, or None, is a fault."""
    if isinstance(values, types.Array):

        def read(c, place, values):
            if len(values) != 2:
                fail(c, place, UNPACK, len(values), 2)
            return at(c, place, values, 0), at(c, place, values, 1)

        return read
    return lambda c, place, values: unwrapped(c, place, values)


@overloaded
def unpack_3(c, place, values):
    """Return the three values of a tuple or array; another length of an array, or None, is a fault."""
    if isinstance(values, types.Array):

        def read(c, place, values):
            if len(values) != 3:
                fail(c, place, UNPACK, len(values), 3)
            return at(c, place, values, 0), at(c, place, values, 1), at(c, place, values, 2)

        return read
    return lambda c, place, values: unwrapped(c, place, values)
