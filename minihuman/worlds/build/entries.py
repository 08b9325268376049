"""The functions of a library that Python calls: each reads the arguments of a call, and makes an object of the
result.

They are in LLVM code, and find what they need of Python in a table (`minihuman.worlds.kernels.Library`), so a library
is for every version of Python and NumPy. What they read of an array is what every extension module reads, which NumPy
keeps where it is: the data's address, the number of dimensions, their extents, the kind of item, and flags.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.np.arrayobj import populate_array

from minihuman.worlds.kernels import API_FUNCTIONS, API_OBJECTS, KINDS

_OBJECT, _WORD, _DOUBLE, _INT = cgutils.voidptr_t, ir.IntType(64), ir.DoubleType(), ir.IntType(32)
_FUNCTIONS = {
    "PyLong_AsLongLong": ir.FunctionType(_WORD, [_OBJECT]),
    "PyLong_AsUnsignedLongLong": ir.FunctionType(_WORD, [_OBJECT]),
    "PyLong_FromLongLong": ir.FunctionType(_OBJECT, [_WORD]),
    "PyLong_FromUnsignedLongLong": ir.FunctionType(_OBJECT, [_WORD]),
    "PyNumber_Index": ir.FunctionType(_OBJECT, [_OBJECT]),
    "PyFloat_AsDouble": ir.FunctionType(_DOUBLE, [_OBJECT]),
    "PyFloat_FromDouble": ir.FunctionType(_OBJECT, [_DOUBLE]),
    "PyTuple_New": ir.FunctionType(_OBJECT, [_WORD]),
    "PyTuple_SetItem": ir.FunctionType(_INT, [_OBJECT, _WORD, _OBJECT]),
    "PyType_GetFlags": ir.FunctionType(_WORD, [_OBJECT]),
    "PyTuple_Size": ir.FunctionType(_WORD, [_OBJECT]),
    "PyTuple_GetItem": ir.FunctionType(_OBJECT, [_OBJECT, _WORD]),
    "PyErr_Occurred": ir.FunctionType(_OBJECT, []),
    "PyErr_Clear": ir.FunctionType(ir.VoidType(), []),
    "PyObject_Vectorcall": ir.FunctionType(_OBJECT, [_OBJECT, _OBJECT.as_pointer(), _WORD, _OBJECT]),
    "PyByteArray_FromStringAndSize": ir.FunctionType(_OBJECT, [_OBJECT, _WORD]),
    "Py_IncRef": ir.FunctionType(ir.VoidType(), [_OBJECT]),
    "Py_DecRef": ir.FunctionType(ir.VoidType(), [_OBJECT]),
    "PyEval_SaveThread": ir.FunctionType(_OBJECT, []),
    "PyEval_RestoreThread": ir.FunctionType(ir.VoidType(), [_OBJECT]),
}
_NONE, _TRUE, _FALSE, _WHOLE, _ARRAY, _MAKE_ARRAY, _FIRST_KIND = range(len(API_FUNCTIONS), len(API_FUNCTIONS) + 7)
_TYPE, _TUPLE = 8, 1 << 26  # where an object says its type, in bytes from its start; a type's flag of tuples
_DATA, _DIMENSIONS, _EXTENTS, _STRIDES, _KIND, _FLAGS = 16, 24, 32, 40, 56, 64  # of arrays
_CONTIGUOUS_ALIGNED, _WRITEABLE = 0x101, 0x400


@dataclass(frozen=True, slots=True)
class Overload:
    """A kernel compiled for a signature: what it takes and returns in Numba's words, and where its code is."""

    description: Any
    arguments: tuple[Any, ...]
    result: Any


def write_entries(context: Any, kernels: Sequence[tuple[Sequence[Overload], bool]]) -> str:
    """LLVM code of a function for each kernel: ``kernel_0`` and so on; of each, whether it lets other threads run."""
    module = context.codegen().create_library("entries").create_ir_module("entries")
    table = ir.ArrayType(_OBJECT, len(API_FUNCTIONS) + len(API_OBJECTS))
    for name, kind in (("api", table), ("refusals", ir.ArrayType(_OBJECT, len(kernels)))):
        ir.GlobalVariable(module, kind, name).initializer = ir.Constant(kind, None)
    for number, (overloads, nogil) in enumerate(kernels):
        kind = ir.FunctionType(_OBJECT, [_OBJECT, _OBJECT.as_pointer(), _WORD])
        function = ir.Function(module, kind, f"kernel_{number}")
        _Entry(context, module, function).write(number, overloads, nogil=nogil)
    return str(module)


class _Entry:
    """One function that Python calls."""

    def __init__(self, context: Any, module: Any, function: Any) -> None:
        self._context, self._module, self._function = context, module, function
        self._given, self._count = function.args[1], function.args[2]
        self._builder: Any = ir.IRBuilder(function.append_basic_block("entry"))
        self._mismatch: Any = None  # where to go on when an argument is not what is expected

    def write(self, number: int, overloads: Sequence[Overload], *, nogil: bool) -> None:
        """What fits the first signature is called by it, and so on; what fits none goes to Python."""
        for overload in overloads:
            self._mismatch = self._function.append_basic_block("mismatch")
            self._require(self._is(self._count, len(overload.arguments)))
            values = [
                self._read(kind, self._builder.load(self._builder.gep(self._given, [_WORD(nth)])))
                for nth, kind in enumerate(overload.arguments)
            ]
            self._call(overload, values, nogil=nogil)
            self._builder.position_at_end(self._mismatch)
        refusals = self._builder.gep(self._module.get_global("refusals"), [_WORD(0), _WORD(number)])
        refuse = self._builder.load(refusals)
        self._builder.ret(self._api("PyObject_Vectorcall", refuse, self._given, self._count, _OBJECT(None)))

    def _call(self, overload: Overload, values: Sequence[Any], *, nogil: bool) -> None:
        thread = self._api("PyEval_SaveThread") if nogil else None
        code = self._context.declare_function(self._module, overload.description)
        _, result = self._context.call_conv.call_function(
            self._builder, code, overload.result, overload.arguments, values, attrs=("noinline",)
        )
        if nogil:
            self._api("PyEval_RestoreThread", thread)
        self._builder.ret(self._object(overload.result, result))

    def _require(self, condition: Any) -> None:
        """Go on only if it holds."""
        fits = self._function.append_basic_block()
        self._builder.cbranch(condition, fits, self._mismatch)
        self._builder.position_at_end(fits)

    def _is(self, value: Any, other: Any) -> Any:
        return self._builder.icmp_unsigned("==", value, value.type(other) if isinstance(other, int) else other)

    def _at(self, start: Any, offset: int, kind: Any) -> Any:
        """What lies so many bytes further."""
        place = self._builder.gep(start, [_WORD(offset)])
        return self._builder.load(self._builder.bitcast(place, kind.as_pointer()))

    def _thing(self, number: int) -> Any:
        """What is in Python's table."""
        return self._builder.load(self._builder.gep(self._module.get_global("api"), [_WORD(0), _WORD(number)]))

    def _api(self, name: str, *arguments: Any) -> Any:
        function = self._builder.bitcast(self._thing(API_FUNCTIONS.index(name)), _FUNCTIONS[name].as_pointer())
        return self._builder.call(function, arguments)

    def _read(self, kind: Any, thing: Any) -> Any:
        """An argument's value."""
        if isinstance(kind, types.Array):
            return self._array(kind, thing)
        if isinstance(kind, types.BaseTuple):
            return self._tuple(kind, thing)
        if isinstance(kind, types.Boolean):
            true = self._is(thing, self._thing(_TRUE))
            self._require(self._builder.or_(true, self._is(thing, self._thing(_FALSE))))
            return true
        if isinstance(kind, types.Float):
            return self._checked(self._api("PyFloat_AsDouble", thing), self._builder.fcmp_ordered)
        assert kind.bitwidth == 64, kind
        return self._whole(thing, "PyLong_AsLongLong" if kind.signed else "PyLong_AsUnsignedLongLong")

    def _whole(self, thing: Any, convert: str) -> Any:
        plain, other, after = (self._function.append_basic_block() for _ in range(3))
        is_int = self._is(self._at(thing, _TYPE, _OBJECT), self._thing(_WHOLE))
        self._builder.cbranch(is_int, plain, other)
        self._builder.position_at_end(plain)
        value = self._checked(self._api(convert, thing), self._builder.icmp_signed)
        ends = [(value, self._builder.block)]
        self._builder.branch(after)
        self._builder.position_at_end(other)
        index = self._api("PyNumber_Index", thing)
        self._clear_unless(self._builder.icmp_unsigned("!=", index, _OBJECT(None)))
        value = self._api(convert, index)
        self._api("Py_DecRef", index)
        ends.append((self._checked(value, self._builder.icmp_signed), self._builder.block))
        self._builder.branch(after)
        self._builder.position_at_end(after)
        found = self._builder.phi(_WORD)
        for each in ends:
            found.add_incoming(*each)
        return found

    def _checked(self, value: Any, compare: Callable[..., Any]) -> Any:
        """A number, if it is one: -1 may mean that it is not."""
        suspect, sure = self._function.append_basic_block(), self._function.append_basic_block()
        self._builder.cbranch(compare("==", value, value.type(-1)), suspect, sure)
        self._builder.position_at_end(suspect)
        self._clear_unless(self._is(self._api("PyErr_Occurred"), _OBJECT(None)))
        self._builder.branch(sure)
        self._builder.position_at_end(sure)
        return value

    def _clear_unless(self, condition: Any) -> None:
        """Require it; otherwise an exception is set, which is of no use."""
        failed, fits = self._function.append_basic_block(), self._function.append_basic_block()
        self._builder.cbranch(condition, fits, failed)
        self._builder.position_at_end(failed)
        self._api("PyErr_Clear")
        self._builder.branch(self._mismatch)
        self._builder.position_at_end(fits)

    def _tuple(self, kind: Any, thing: Any) -> Any:
        """Any tuple of the right length; a named one has its items in the same places."""
        flags = self._api("PyType_GetFlags", self._at(thing, _TYPE, _OBJECT))
        self._require(self._is(self._builder.and_(flags, _WORD(_TUPLE)), _TUPLE))
        self._require(self._is(self._api("PyTuple_Size", thing), len(kind)))
        items = [
            self._read(each, self._api("PyTuple_GetItem", thing, _WORD(nth))) for nth, each in enumerate(kind.types)
        ]
        return self._context.make_tuple(self._builder, kind, items)

    def _array(self, kind: Any, thing: Any) -> Any:
        self._require(self._is(self._at(thing, _TYPE, _OBJECT), self._thing(_ARRAY)))
        self._require(self._is(self._at(thing, _DIMENSIONS, _INT), kind.ndim))
        expected = self._thing(_FIRST_KIND + KINDS.index(str(kind.dtype)))
        self._require(self._is(self._at(thing, _KIND, _OBJECT), expected))
        flags = _CONTIGUOUS_ALIGNED | (_WRITEABLE if kind.mutable else 0)
        assert kind.layout == "C", kind
        self._require(self._is(self._builder.and_(self._at(thing, _FLAGS, _INT), _INT(flags)), flags))
        extents, strides = (self._at(thing, offset, _WORD.as_pointer()) for offset in (_EXTENTS, _STRIDES))
        shape, steps = (
            [self._builder.load(self._builder.gep(start, [_WORD(axis)])) for axis in range(kind.ndim)]
            for start in (extents, strides)
        )
        made = self._context.make_array(kind)(self._context, self._builder)
        size = self._context.get_constant(types.intp, np.dtype(str(kind.dtype)).itemsize)
        data = self._at(thing, _DATA, made.data.type)
        populate_array(made, data=data, shape=shape, strides=steps, itemsize=size, meminfo=None)
        return made._getvalue()

    def _object(self, kind: Any, value: Any) -> Any:
        """A result as Python's object."""
        if isinstance(kind, types.Array):
            return self._array_object(kind, value)
        if isinstance(kind, types.BaseTuple):
            made = self._api("PyTuple_New", _WORD(len(kind)))
            for nth, each in enumerate(kind.types):
                item = self._object(each, self._builder.extract_value(value, nth))
                self._api("PyTuple_SetItem", made, _WORD(nth), item)
            return made
        if isinstance(kind, types.Float):
            return self._api("PyFloat_FromDouble", value)
        if isinstance(kind, types.Integer):
            wide = self._context.cast(self._builder, value, kind, types.int64 if kind.signed else types.uint64)
            return self._api("PyLong_FromLongLong" if kind.signed else "PyLong_FromUnsignedLongLong", wide)
        found = self._thing(_NONE)
        if isinstance(kind, types.Boolean):
            found = self._builder.select(value, self._thing(_TRUE), self._thing(_FALSE))
        self._api("Py_IncRef", found)
        return found

    def _array_object(self, kind: Any, value: Any) -> Any:
        """A copy, in memory of Python's."""
        array = self._context.make_array(kind)(self._context, self._builder, value)
        shape = cgutils.unpack_tuple(self._builder, array.shape, kind.ndim)
        size = self._builder.mul(array.nitems, array.itemsize)
        data = self._builder.bitcast(array.data, _OBJECT)
        items = [
            self._api("PyLong_FromLongLong", _WORD(KINDS.index(str(kind.dtype)))),
            self._api("PyByteArray_FromStringAndSize", data, size),
            *(self._api("PyLong_FromLongLong", extent) for extent in shape),
        ]
        given = cgutils.alloca_once(self._builder, _OBJECT, len(items))
        for nth, item in enumerate(items):
            self._builder.store(item, self._builder.gep(given, [_WORD(nth)]))
        made = self._api("PyObject_Vectorcall", self._thing(_MAKE_ARRAY), given, _WORD(len(items)), _OBJECT(None))
        for item in items:
            self._api("Py_DecRef", item)
        decref = cgutils.get_or_insert_function(self._module, ir.FunctionType(ir.VoidType(), [_OBJECT]), "NRT_decref")
        self._builder.call(decref, [self._builder.bitcast(array.meminfo, _OBJECT)])
        return made
