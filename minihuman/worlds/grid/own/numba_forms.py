"""The forms in which Numba compiles functions for rules: our kernels, contexts, and the record of a fault.

Only the process that compiles rules imports this module.
"""
# mypy: ignore-errors

from functools import partial
from types import BuiltinFunctionType, FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import int64, types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import populate_array

from minihuman.worlds.build.compilation import array_at
from minihuman.worlds.grid.own.context import (
    FAULT,
    FLOAT_SETTINGS,
    INT_SETTINGS,
    MISSION,
    OWN_NUMBERS,
    RNG,
    ROW,
    ROW_LENGTH_WORD,
    SCRATCH,
)
from minihuman.worlds.grid.own.fields import MOST_NUMBERS
from minihuman.worlds.kernel_sources import COMPILERS, KernelSource
from minihuman.worlds.kernels import LateKernel

OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True, "no_cpython_wrapper": True, "_nrt": False}
_NAMES: dict[int, dict[str, Any]] = {}
_FORMS: dict[int, Any] = {}


def numba_form(kernel: Any) -> Any:
    """Return one of our kernels as a Numba function, which is compiled when other compiled code first calls it."""
    source = _find_source(kernel)
    if id(source.function) not in _FORMS:
        function = source.function
        names = _list_module_names(function.__globals__)
        copy = FunctionType(function.__code__, names, function.__name__, function.__defaults__)
        variables = {name: numba.from_dtype(np.dtype(kind)) for name, kind in source.variables.items()}
        _FORMS[id(function)] = _without_literals(numba.njit(locals=variables, **OPTIONS)(copy))
    return _FORMS[id(source.function)]


def _without_literals(dispatcher: Any) -> Any:
    """Return a dispatcher, changed to compile once for all whole numbers, not once for each constant in a call.

    This breaks, by compiling more, if Numba renames ``Dispatcher.get_call_template``.
    """
    template = dispatcher.get_call_template

    def template_of_kinds(arguments: Any, named: Any) -> Any:
        return template(tuple(map(types.unliteral, arguments)), named)

    dispatcher.get_call_template = template_of_kinds
    return dispatcher


def _find_source(kernel: Any) -> KernelSource:
    """Return the source of a kernel, however it was declared."""
    if isinstance(kernel, LateKernel):
        return kernel.source
    if hasattr(kernel, "py_func"):
        return KernelSource(kernel.py_func)
    plain, compile_it = COMPILERS[id(kernel)]
    if isinstance(compile_it, partial) and isinstance(compile_it.args[0], KernelSource):
        return compile_it.args[0]
    return KernelSource(plain)


def _list_module_names(module_names: dict[str, Any]) -> dict[str, Any]:
    """Return a module's names, with kernels replaced by their forms for Numba; the result is cached."""
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


I64 = array_at(np.int64)
F64 = array_at(np.float64)
U64 = array_at(np.uint64)
I32 = array_at(np.int32)
U8 = array_at(np.uint8)


def _array_of(word: int, kind: type[np.generic]) -> Any:
    """Return an intrinsic that returns one of a context's arrays.

    ``word`` is the index in the context of the array's address, and ``kind`` the type of its elements. The row has its
    own length; all others have the length `MOST_NUMBERS`, whatever memory they have.
    """
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
            item_bytes = context.get_constant(types.intp, np.dtype(kind).itemsize)
            populate_array(struct, data=start, shape=[length], strides=[item_bytes], itemsize=item_bytes, meminfo=None)
            return struct._getvalue()

        return array(int64), code

    return view


row = _array_of(ROW, np.int32)
own = _array_of(OWN_NUMBERS, np.int64)
own_floats = _array_of(OWN_NUMBERS, np.float64)
settings = _array_of(INT_SETTINGS, np.int64)
float_settings = _array_of(FLOAT_SETTINGS, np.float64)
rng_state = _array_of(RNG, np.uint64)
fault = _array_of(FAULT, np.int64)
mission = _array_of(MISSION, np.int64)
scratch = _array_of(SCRATCH, np.int64)
float_scratch = _array_of(SCRATCH, np.float64)


def _store_fault(builder: Any, values: Any, kind: int) -> None:
    """Emit code that records a fault's kind and place; ``values`` begins with the context's address and the place."""
    word = ir.IntType(64)
    block = builder.inttoptr(values[0], word.as_pointer())
    start = builder.load(builder.gep(block, [ir.Constant(word, FAULT)]))
    words = builder.inttoptr(start, word.as_pointer())
    builder.store(ir.Constant(word, kind), words)
    builder.store(values[1], builder.gep(words, [ir.Constant(word, 1)]))


def fail_if(context: Any, builder: Any, signature: Any, values: Any, condition: Any, kind: int) -> None:
    """Emit code that records a fault and ends the call if a condition holds when the rules run.

    Args:
        context: Numba's target context.
        builder: LLVM's builder, at the place of the code.
        signature: the signature of the intrinsic.
        values: the intrinsic's arguments: a world's context, the number of a place, and others.
        condition: LLVM's value of the condition.
        kind: the kind of fault.
    """
    with builder.if_then(condition, likely=False):
        _store_fault(builder, values, kind)
        context.call_conv.return_user_exc(builder, ValueError, ("fault",))


@njit
def fail(c, place, kind, a, b):
    """Record a fault of a kind with two numbers for its message, and end the call."""
    fault(c)[0] = kind
    fault(c)[1] = place
    fault(c)[2] = a
    fault(c)[3] = b
    raise ValueError("fault")


def is_whole(kind: Any) -> bool:
    """Return whether one of Numba's types holds whole numbers or truth values."""
    return isinstance(kind, types.Integer | types.Boolean)


def is_number(kind: Any) -> bool:
    """Return whether one of Numba's types holds numbers."""
    return is_whole(kind) or isinstance(kind, types.Float)


def _make_stub(name: str) -> Any:
    """Return a function that stands for a name in compiled code, and cannot be called from Python."""

    def stub(*arguments):
        raise NotImplementedError(name)

    stub.__name__ = name
    return stub


def overloaded(typed: Any) -> Any:
    """Return a function in whose place Numba compiles what the decorated one returns for the arguments' types."""
    stub = _make_stub(typed.__name__)
    overload(stub, jit_options=OPTIONS, strict=False)(typed)
    return stub
