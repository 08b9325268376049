"""The ways into compiled kernels, in LLVM code: functions that Python calls, and functions of a table for others.

What Python calls reads the arguments of a call and makes an object of the result. It finds what it needs of Python in a
table (`minihuman.worlds.kernels.KernelLibrary`), so a library is for every version of Python and NumPy. What it reads
of an array is what every extension module reads, which NumPy keeps where it is: the data's address, the number of
dimensions, their extents, the kind of item, and flags.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import callconv, cgutils, sigutils, types
from numba.core.registry import cpu_target
from numba.np.arrayobj import populate_array

from kernel_build.linking import Target
from minihuman.worlds.kernels import API_OBJECTS, KernelSource
from minihuman.worlds.library_manifest import API_FUNCTIONS, KINDS

_OBJECT = cgutils.voidptr_t
_WORD = ir.IntType(64)
_INT = ir.IntType(32)
_DOUBLE = ir.DoubleType()
_NOTHING = ir.VoidType()
_MANY = _OBJECT.as_pointer()
_SIGNATURES: dict[str, tuple[Any, ...]] = {  # result and arguments
    "PyLong_AsLongLong": (_WORD, _OBJECT),
    "PyLong_FromLongLong": (_OBJECT, _WORD),
    "PyLong_FromUnsignedLongLong": (_OBJECT, _WORD),
    "PyFloat_AsDouble": (_DOUBLE, _OBJECT),
    "PyFloat_FromDouble": (_OBJECT, _DOUBLE),
    "PyTuple_New": (_OBJECT, _WORD),
    "PyTuple_SetItem": (_INT, _OBJECT, _WORD, _OBJECT),
    "PyTuple_GetItem": (_OBJECT, _OBJECT, _WORD),
    "PyTuple_Size": (_WORD, _OBJECT),
    "PyType_GetFlags": (_WORD, _OBJECT),
    "PyErr_Occurred": (_OBJECT,),
    "PyErr_Clear": (_NOTHING,),
    "PyObject_Vectorcall": (_OBJECT, _OBJECT, _MANY, _WORD, _OBJECT),
    "PyByteArray_FromStringAndSize": (_OBJECT, _OBJECT, _WORD),
    "Py_IncRef": (_NOTHING, _OBJECT),
    "Py_DecRef": (_NOTHING, _OBJECT),
    "PyEval_SaveThread": (_OBJECT,),
    "PyEval_RestoreThread": (_NOTHING, _OBJECT),
}
_NONE, _TRUE, _FALSE, _ARRAY, _MAKE_ARRAY, _FIRST_KIND = range(len(API_FUNCTIONS), len(API_FUNCTIONS) + 6)
# where an object says its type, in bytes from its start; a type's flag of tuples
_TYPE = 8
_TUPLE = 1 << 26
# of arrays
_DATA = 16
_DIMENSIONS = 24
_EXTENTS = 32
_KIND = 56
_FLAGS = 64
_USABLE = 0x501  # contiguous, aligned and writeable
_RESHAPE = """
define internal i32 @numba_attempt_nocopy_reshape(
    i64, ptr, ptr, i64 %count, ptr %extents, ptr %strides, i64 %size, i32) {
entry:
  br label %test
test:
  %left = phi i64 [ %count, %entry ], [ %axis, %next ]
  %stride = phi i64 [ %size, %entry ], [ %wider, %next ]
  %more = icmp sgt i64 %left, 0
  br i1 %more, label %next, label %end
next:
  %axis = sub i64 %left, 1
  %to = getelementptr i64, ptr %strides, i64 %axis
  store i64 %stride, ptr %to
  %from = getelementptr i64, ptr %extents, i64 %axis
  %extent = load i64, ptr %from
  %wider = mul i64 %stride, %extent
  br label %test
end:
  ret i32 1
}
"""  # of a contiguous array, as all in kernels are


def _omit_places() -> None:
    """Let errors in compiled code name no line of Numba's sources.

    None of our kernels raises. With the lines, what is committed would hold the path of whoever built it, and would
    differ from environment to environment. Breaks if Numba renames `CPUCallConv.build_excinfo_struct`.
    """
    call_convention: Any = callconv.CPUCallConv
    build = call_convention.build_excinfo_struct

    def build_without_place(self: Any, exception: Any, arguments: Any, place: Any, function_name: str) -> Any:
        return build(self, exception, arguments, None, function_name)

    call_convention.build_excinfo_struct = build_without_place


_omit_places()


@dataclass(frozen=True, slots=True)
class Overload:
    """A kernel that Numba compiled for a signature.

    Args:
        description: Numba's, of the function in ``code``.
        code: in LLVM's words, with all that it calls.
        arguments: Numba's types.
        result: likewise.
    """

    description: Any
    code: str
    arguments: tuple[Any, ...]
    result: Any


def compile_for(dispatcher: Any, source: KernelSource, text: str) -> Overload:
    """Compile a kernel for a signature, in Numba's words, which may name classes of the kernel's module."""
    arguments = sigutils.normalize_signature(eval(text, {**source.function.__globals__, **vars(types)}))[0]
    if arguments not in dispatcher.overloads:
        dispatcher.compile(arguments)
    compiled = dispatcher.overloads[arguments]
    # environments of Numba's are nobody's; references are counted by the library's own, for any processor
    code = re.sub(r"= common (local_unnamed_addr )?global", "= internal global", compiled.library.get_llvm_str())
    counting = r"^define linkonce_odr void @(NRT_(?:inc|dec)ref)\([^)]*\)[^{]*\{.*?\n\}$"
    code = re.sub(counting, r"declare void @\1(ptr)", code, flags=re.M | re.S)
    return Overload(compiled.fndesc, code, arguments, compiled.signature.return_type)


def retarget(code: str, target: Target, machine: Any) -> str:
    """Return LLVM code of the machine that compiled it, for a target."""
    code = re.sub(r'target datalayout = ".*"', f'target datalayout = "{machine.target_data}"', code)
    code = re.sub(r'target triple = ".*"', f'target triple = "{target.triple}"', code)
    code = re.sub(r'"(target-cpu|target-features|tune-cpu)"="[^"]*"', "", code)
    return re.sub(r"^declare [^@]*@numba_attempt_nocopy_reshape\(.*$", lambda _: _RESHAPE, code, flags=re.M)


class _Function:
    """A function that calls a kernel, as it is being written."""

    def __init__(self, module: Any, name: str, result: Any, *arguments: Any) -> None:
        self.context = cpu_target.target_context
        self.module = module
        self.function = ir.Function(module, ir.FunctionType(result, arguments), name)
        self.builder: Any = ir.IRBuilder(self.function.append_basic_block("entry"))

    def place(self, start: Any, offset: int, kind: Any) -> Any:
        """Return the place so many bytes further."""
        return self.builder.bitcast(
            self.builder.gep(self.builder.bitcast(start, _OBJECT), [_WORD(offset)]), kind.as_pointer()
        )

    def load(self, start: Any, offset: int, kind: Any) -> Any:
        """Load what is stored there."""
        return self.builder.load(self.place(start, offset, kind))

    def array(self, kind: Any, data: Any, shape: Sequence[Any]) -> Any:
        """Make a contiguous array."""
        struct = self.context.make_array(kind)(self.context, self.builder)
        strides = [self.context.get_constant(types.intp, np.dtype(str(kind.dtype)).itemsize)]
        for extent in shape[:0:-1]:
            strides.insert(0, self.builder.mul(strides[0], extent))
        data = self.builder.bitcast(data, struct.data.type)
        populate_array(struct, data=data, shape=shape, strides=strides, itemsize=strides[-1], meminfo=None)
        return struct._getvalue()

    def call(self, overload: Overload, values: Sequence[Any]) -> Any:
        """Call a kernel, none of which raises, and return its result."""
        code = self.context.declare_function(self.module, overload.description)
        kinds = overload.result, overload.arguments
        return self.context.call_conv.call_function(self.builder, code, *kinds, values, attrs=("noinline",))[1]


def write_table_entry(name: str, overload: Overload, takes_number: Sequence[bool]) -> str:
    """Write the LLVM code of ``int32 name(table, number)``, which `minihuman.worlds.build.exports` describes.

    Args:
        name: of the function.
        overload: what it calls.
        takes_number: for each argument, whether it is the number beside the table.
    """
    module = _new_module()
    table_entry = _Function(module, name, _INT, _OBJECT, _INT)
    builder = table_entry.builder
    table, number = table_entry.function.args
    values = []
    at = 0
    for kind, apart in zip(overload.arguments, takes_number, strict=True):
        if apart:
            values.append(builder.sext(number, _WORD))
            continue
        values.append(_load_argument(table_entry, table, at, kind))
        at += 8 * (1 + (kind.ndim if isinstance(kind, types.Array) else 0))
    returned = table_entry.call(overload, values)
    first = _INT(0)
    for nth, kind in enumerate(results_of(overload)):
        if isinstance(overload.result, types.BaseTuple):
            value = builder.extract_value(returned, nth)
        else:
            value = returned
        if not isinstance(kind, types.Float):
            value = (builder.sext if kind in types.signed_domain else builder.zext)(value, _WORD)
            first = builder.trunc(value, _INT) if nth == 0 else first
        builder.store(value, table_entry.place(table, at + 8 * nth, value.type))
    builder.ret(first)
    return str(module)


def _load_argument(table_entry: _Function, table: Any, at: int, kind: Any) -> Any:
    """Load an argument, of a kind of Numba's, from so many bytes into the table: an array, or a number."""
    if isinstance(kind, types.Array) and kind.ndim:
        shape = [table_entry.load(table, at + 8 * nth, _WORD) for nth in range(1, 1 + kind.ndim)]
        start = table_entry.builder.inttoptr(table_entry.load(table, at, _WORD), _OBJECT)
        return table_entry.array(kind, start, shape)
    if isinstance(kind, types.Float):
        return table_entry.load(table, at, _DOUBLE)
    word = table_entry.load(table, at, _WORD)
    if isinstance(kind, types.Boolean):
        return table_entry.builder.icmp_signed("!=", word, _WORD(0))
    return word


def results_of(overload: Overload) -> tuple[Any, ...]:
    """Return Numba's types of what a kernel returns; none where it returns nothing."""
    is_tuple = isinstance(overload.result, types.BaseTuple)
    results = tuple(overload.result) if is_tuple else (overload.result,)
    return tuple(kind for kind in results if not isinstance(kind, types.NoneType))


def write_python_entries(kernels: Sequence[tuple[Sequence[Overload], bool]]) -> str:
    """Write the LLVM code of a function for each kernel, ``kernel_0`` and so on; each may let other threads run."""
    module = _new_module()
    table = ir.ArrayType(_OBJECT, len(API_FUNCTIONS) + len(API_OBJECTS))
    for name, kind in (("api", table), ("refusals", ir.ArrayType(_OBJECT, len(kernels)))):
        ir.GlobalVariable(module, kind, name).initializer = ir.Constant(kind, None)
    for number, (overloads, nogil) in enumerate(kernels):
        _PythonEntry(module, f"kernel_{number}", _OBJECT, _OBJECT, _MANY, _WORD).write(number, overloads, nogil=nogil)
    return str(module)


def _items(kind: Any) -> tuple[Any, ...]:
    return tuple(kind)


def _new_module() -> Any:
    return cpu_target.target_context.codegen().create_library("entries").create_ir_module("entries")


class _PythonEntry(_Function):
    """A function that Python calls."""

    def write(self, number: int, overloads: Sequence[Overload], *, nogil: bool) -> None:
        """Call the first signature that fits the arguments; arguments that fit none go to Python."""
        _, argument_array, count = self.function.args
        for overload in overloads:
            self._mismatch = self.function.append_basic_block("mismatch")
            self._require(self._is(count, len(overload.arguments)))
            things = (self.load(argument_array, 8 * nth, _OBJECT) for nth in range(len(overload.arguments)))
            values = [self._read(kind, thing) for kind, thing in zip(overload.arguments, things, strict=True)]
            thread = self._api("PyEval_SaveThread") if nogil else None
            result = self.call(overload, values)
            if nogil:
                self._api("PyEval_RestoreThread", thread)
            self.builder.ret(self._object(overload.result, result))
            self.builder.position_at_end(self._mismatch)
        refuse = self.load(self.module.get_global("refusals"), 8 * number, _OBJECT)
        self.builder.ret(self._api("PyObject_Vectorcall", refuse, argument_array, count, _OBJECT(None)))

    def _require(self, condition: Any) -> None:
        """Go on only if it holds."""
        fits = self.function.append_basic_block()
        self.builder.cbranch(condition, fits, self._mismatch)
        self.builder.position_at_end(fits)

    def _is(self, value: Any, other: Any) -> Any:
        return self.builder.icmp_unsigned("==", value, value.type(other) if isinstance(other, int) else other)

    def _thing(self, number: int) -> Any:
        """Return what is in Python's table."""
        return self.load(self.module.get_global("api"), 8 * number, _OBJECT)

    def _api(self, name: str, *arguments: Any) -> Any:
        result, *kinds = _SIGNATURES[name]
        function = self._thing(API_FUNCTIONS.index(name))
        return self.builder.call(self.builder.bitcast(function, ir.FunctionType(result, kinds).as_pointer()), arguments)

    def _read(self, kind: Any, thing: Any) -> Any:
        """Read an argument's value."""
        if isinstance(kind, types.Array):
            return self._array(kind, thing)
        if isinstance(kind, types.BaseTuple):  # a named one has its items in the same places
            flags = self._api("PyType_GetFlags", self.load(thing, _TYPE, _OBJECT))
            self._require(self._is(self.builder.and_(flags, _WORD(_TUPLE)), _TUPLE))
            self._require(self._is(self._api("PyTuple_Size", thing), len(kind)))
            things = (self._api("PyTuple_GetItem", thing, _WORD(nth)) for nth in range(len(kind)))
            items = [self._read(*pair) for pair in zip(_items(kind), things, strict=True)]
            return self.context.make_tuple(self.builder, kind, items)
        if isinstance(kind, types.Boolean):
            true = self._is(thing, self._thing(_TRUE))
            self._require(self.builder.or_(true, self._is(thing, self._thing(_FALSE))))
            return true
        is_float = isinstance(kind, types.Float)
        value = self._api("PyFloat_AsDouble" if is_float else "PyLong_AsLongLong", thing)
        suspect, failed, sure = (self.function.append_basic_block() for _ in range(3))
        if is_float:
            compare = self.builder.fcmp_ordered
        else:
            compare = self.builder.icmp_signed
        self.builder.cbranch(compare("==", value, value.type(-1)), suspect, sure)
        self.builder.position_at_end(suspect)  # it may be a -1, or no number
        self.builder.cbranch(self._is(self._api("PyErr_Occurred"), _OBJECT(None)), sure, failed)
        self.builder.position_at_end(failed)
        self._api("PyErr_Clear")
        self.builder.branch(self._mismatch)
        self.builder.position_at_end(sure)
        return value

    def _array(self, kind: Any, thing: Any) -> Any:
        self._require(self._is(self.load(thing, _TYPE, _OBJECT), self._thing(_ARRAY)))
        self._require(self._is(self.load(thing, _DIMENSIONS, _INT), kind.ndim))
        expected = self._thing(_FIRST_KIND + KINDS.index(str(kind.dtype)))
        self._require(self._is(self.load(thing, _KIND, _OBJECT), expected))
        flags = self.builder.and_(self.load(thing, _FLAGS, _INT), _INT(_USABLE))
        self._require(self._is(flags, _USABLE))
        extents = self.load(thing, _EXTENTS, _OBJECT)
        shape = [self.load(extents, 8 * axis, _WORD) for axis in range(kind.ndim)]
        return self.array(kind, self.load(thing, _DATA, _OBJECT), shape)

    def _object(self, kind: Any, value: Any) -> Any:
        """Convert a result to a Python object."""
        if isinstance(kind, types.Array):
            return self._array_object(kind, value)
        if isinstance(kind, types.BaseTuple):
            tuple_object = self._api("PyTuple_New", _WORD(len(kind)))
            for nth, inner_kind in enumerate(_items(kind)):
                self._api(
                    "PyTuple_SetItem",
                    tuple_object,
                    _WORD(nth),
                    self._object(inner_kind, self.builder.extract_value(value, nth)),
                )
            return tuple_object
        if isinstance(kind, types.Float):
            return self._api("PyFloat_FromDouble", value)
        if isinstance(kind, types.Integer):
            signed = kind in types.signed_domain
            wide = self.context.cast(self.builder, value, kind, types.int64 if signed else types.uint64)
            return self._api("PyLong_FromLongLong" if signed else "PyLong_FromUnsignedLongLong", wide)
        singleton = self._thing(_NONE)
        if isinstance(kind, types.Boolean):
            singleton = self.builder.select(value, self._thing(_TRUE), self._thing(_FALSE))
        self._api("Py_IncRef", singleton)
        return singleton

    def _array_object(self, kind: Any, value: Any) -> Any:
        """Copy an array into memory of Python's."""
        array = self.context.make_array(kind)(self.context, self.builder, value)
        size = self.builder.mul(array.nitems, array.itemsize)
        shape = cgutils.unpack_tuple(self.builder, array.shape, kind.ndim)
        numbers = [self._api("PyLong_FromLongLong", number) for number in (_WORD(KINDS.index(str(kind.dtype))), *shape)]
        items = [self._api("PyByteArray_FromStringAndSize", self.builder.bitcast(array.data, _OBJECT), size), *numbers]
        argument_array = cgutils.alloca_once(self.builder, _OBJECT, len(items))
        for nth, item in enumerate(items):
            self.builder.store(item, self.place(argument_array, 8 * nth, _OBJECT))
        array_object = self._api(
            "PyObject_Vectorcall", self._thing(_MAKE_ARRAY), argument_array, _WORD(len(items)), _OBJECT(None)
        )
        for item in items:
            self._api("Py_DecRef", item)
        release = cgutils.get_or_insert_function(self.module, ir.FunctionType(_NOTHING, [_OBJECT]), "NRT_decref")
        self.builder.call(release, [self.builder.bitcast(array.meminfo, _OBJECT)])
        return array_object
