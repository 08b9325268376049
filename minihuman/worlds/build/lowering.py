"""From a kernel to LLVM code of a C function that reads its arguments from a table."""

import re
from dataclasses import dataclass
from functools import cache
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from minihuman.worlds.build.exports import NUMBER, Export

WORD_BYTES = 8  # one entry of a table
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}


@dataclass(frozen=True, slots=True)
class KernelArgument:
    """One parameter of an exported function, as its callers in other languages have to know it."""

    name: str
    kind: str  # NumPy's name of what an array is made of; "int64" or "float64" for a number
    dimensions: int  # 0 for a number


@dataclass(frozen=True, slots=True)
class Lowered:
    """An exported function in LLVM code for the machine that compiled it, and what its table holds."""

    name: str
    code: str
    arguments: tuple[KernelArgument, ...]
    results: tuple[str, ...]  # NumPy's names


def lower(export: Export) -> Lowered:
    """Compile a kernel anew, without a cache, behind a C function of a table and a number.

    Raises:
        ValueError: if the kernel makes arrays, or calls what a library of its own has not got.
    """
    kinds = tuple(numba.core.sigutils.normalize_signature(f"void({', '.join(export.arguments)})")[0])
    kernel = numba.njit(**_OPTIONS, locals=getattr(export.kernel, "locals", {}))(export.kernel.py_func)  # type: ignore[attr-defined]
    kernel.compile(kinds)
    returned: Any = kernel.overloads[kinds].signature.return_type
    several = isinstance(returned, types.BaseTuple)
    results = tuple(returned) if several else (returned,)
    results = tuple(each for each in results if not isinstance(each, types.NoneType))
    beside = [name == NUMBER for name in export.parameters]
    read = _reader(kinds, tuple(beside))
    write = _writer(results, _words(kinds, beside))

    def entry(table: Any, number: Any) -> Any:
        return write(table, kernel(*read(table, number)))

    def entry_of_one(table: Any, number: Any) -> Any:
        return write(table, (kernel(*read(table, number)),))

    def entry_of_none(table: Any, number: Any) -> Any:
        kernel(*read(table, number))
        return write(table, ())

    outer = numba.njit(**_OPTIONS)(entry if several else entry_of_one if results else entry_of_none)
    signature = types.voidptr, types.int32
    outer.compile(signature)
    compiled = outer.overloads[signature]
    return Lowered(
        export.name,
        _as_c(compiled.library.get_llvm_str(), compiled.fndesc.llvm_func_name, export.name),
        tuple(
            _argument(name, kind)
            for name, kind, apart in zip(export.parameters, kinds, beside, strict=True)
            if not apart
        ),
        tuple(_number_kind(kind) for kind in results),
    )


def _argument(name: str, kind: Any) -> KernelArgument:
    if isinstance(kind, types.Array):
        return KernelArgument(name, str(kind.dtype), kind.ndim)
    return KernelArgument(name, _number_kind(kind), 0)


def _number_kind(kind: Any) -> str:
    return "float64" if isinstance(kind, types.Float) else "int64"


def _words(kinds: tuple[Any, ...], beside: list[bool]) -> int:
    """How long the table is up to the results."""
    sizes = [1 + kind.ndim if isinstance(kind, types.Array) else 1 for kind in kinds]
    return sum(size for size, apart in zip(sizes, beside, strict=True) if not apart)


@cache
def _reader(kinds: tuple[Any, ...], beside: tuple[bool, ...]) -> Any:
    """A function for kernels that reads what is called from the table."""

    def typed(context: Any, table: Any, number: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            words = builder.bitcast(values[0], cgutils.intp_t.as_pointer())
            at, read = 0, []
            for kind, apart in zip(kinds, beside, strict=True):
                if apart:
                    read.append(context.cast(builder, values[1], types.int32, kind))
                    continue
                value, at = _value(context, builder, words, at, kind)
                read.append(value)
            return context.make_tuple(builder, signature.return_type, read)

        return types.Tuple(kinds)(types.voidptr, types.int32), code

    return intrinsic(typed)


def _value(context: Any, builder: Any, words: Any, at: int, kind: Any) -> tuple[Any, int]:
    """An argument, and where the next one is."""

    def word(index: int) -> Any:
        return builder.load(builder.gep(words, [context.get_constant(types.intp, index)]), align=WORD_BYTES)

    if not isinstance(kind, types.Array):
        if isinstance(kind, types.Float):
            return builder.bitcast(word(at), context.get_value_type(kind)), at + 1
        return context.cast(builder, word(at), types.int64, kind), at + 1
    made = context.make_array(kind)(context, builder)
    shape = [word(at + 1 + axis) for axis in range(kind.ndim)]
    size = np.dtype(str(kind.dtype)).itemsize
    strides = [context.get_constant(types.intp, size)]
    for extent in shape[:0:-1]:
        strides.insert(0, builder.mul(strides[0], extent))
    start = builder.inttoptr(word(at), made.data.type)
    populate_array(
        made, data=start, shape=shape, strides=strides, itemsize=context.get_constant(types.intp, size), meminfo=None
    )
    return made._getvalue(), at + 1 + kind.ndim


@cache
def _writer(results: tuple[Any, ...], at: int) -> Any:
    """A function for kernels that writes results behind the arguments, and returns the first as an int32."""
    whole = bool(results) and not isinstance(results[0], types.Float)

    def typed(context: Any, table: Any, values: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            words = builder.bitcast(arguments[0], cgutils.intp_t.as_pointer())
            first = context.get_constant(types.int32, 0)
            for number, kind in enumerate(results):
                value = builder.extract_value(arguments[1], number)
                wide = types.float64 if isinstance(kind, types.Float) else types.int64
                value = context.cast(builder, value, kind, wide)
                place = builder.gep(words, [context.get_constant(types.intp, at + number)])
                if wide is types.float64:
                    place = builder.bitcast(place, value.type.as_pointer())
                elif number == 0:
                    first = context.cast(builder, value, types.int64, types.int32)
                builder.store(value, place, align=WORD_BYTES)
            return first

        return types.int32(types.voidptr, values), code

    typed.__doc__ = f"Writes {len(results)} results, the first {'returned' if whole else 'not returned'}."
    return intrinsic(typed)


def _as_c(code: str, mangled: str, name: str) -> str:
    """The code with a function of that name that is called as C calls, and nothing else to be seen from outside."""
    quoted = f'@"{mangled}"' if f'@"{mangled}"' in code else f"@{mangled}"
    if f"{quoted}(" not in code:
        raise ValueError(f"{name}: the compiled code has no function {mangled}")
    # Numba's environments, counted references: nothing here has either
    code = re.sub(r"= common (local_unnamed_addr )?global", "= internal global", code)
    code = re.sub(
        r"define linkonce_odr void @NRT_(inc|dec)ref\([^)]*\)[^{]*\{.*?\n\}",
        r"define internal void @NRT_\1ref(ptr %.1) {\n ret void\n}",
        code,
        flags=re.S,
    )
    return (
        code
        + f"""
define i32 @{name}(ptr %table, i32 %number) {{
  %result = alloca i32
  %failure = alloca ptr
  %status = call i32 {quoted}(ptr %result, ptr %failure, ptr %table, i32 %number)
  %value = load i32, ptr %result
  ret i32 %value
}}
"""
    )
