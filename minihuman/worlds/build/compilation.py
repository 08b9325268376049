"""The compilation of kernels with Numba, and of their SIMD vectors to LLVM's vector instructions.

`minihuman.worlds.simd` describes each vector operation.

These undocumented parts of Numba are used, with what breaks if they change:

- the options ``_nrt``, ``no_cfunc_wrapper``, ``no_cpython_wrapper``: only compile time and the cost of a call.
- `np.arrayobj.populate_array`, ``context.make_array``, ``array._getvalue()``: `array_at` and `llvm_function`, and thus
  the whole first-person renderer.
"""

import inspect
import os
from collections.abc import Callable, Sequence
from types import FunctionType
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import float64, int64, types
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from minihuman.worlds.kernel_sources import COMPILERS, ArrayStart, KernelSource

# A division by zero is infinite, as in NumPy: nothing is made to raise it. C calls no kernel.
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_FOR_NUMBA: dict[int, dict[str, Any]] = {}  # by the id of a module's globals: these globals, with kernels compiled
BUILDING = "MINIHUMAN_BUILDING"  # an environment variable, set if Python calls no kernel in this process


def compiled(source: KernelSource) -> Any:
    """Compile a kernel with Numba, for any arguments or only for its declared signatures; return the dispatcher."""
    options = _OPTIONS | dict(source.options) | ({"no_cpython_wrapper": True} if BUILDING in os.environ else {})
    variables = {name: numba.from_dtype(np.dtype(kind)) for name, kind in source.variables.items()}
    function = source.function
    assert isinstance(function, FunctionType)
    if COMPILERS:
        names = function.__code__, _for_numba(function.__globals__), function.__name__, function.__defaults__
        function = FunctionType(*names)
        function.__module__ = source.function.__module__
        function.__qualname__ = source.function.__qualname__
    dispatcher = numba.njit(locals=variables, **options)(function)
    if source.only:
        for signature in source.signatures:
            dispatcher.compile(signature)
        dispatcher.disable_compile()
    return dispatcher


def _for_numba(names: dict[str, Any]) -> dict[str, Any]:
    """Return the names of a module with each kernel replaced by its compiled form."""
    replaced = _FOR_NUMBA.get(id(names))
    if replaced is None:
        replaced = _FOR_NUMBA[id(names)] = dict(names)
        for name, value in names.items():
            if id(value) in COMPILERS:
                replaced[name] = COMPILERS[id(value)][1]()
    return replaced


def _argument_type(kind: Any) -> Any:
    """Return Numba's type for an argument of vector code: arrays keep their type, numbers have 64 bits."""
    if isinstance(kind, types.Array):
        return kind
    if isinstance(kind, types.Integer):
        return int64
    return float64


def llvm_function(write: Callable[..., Any], plain: Callable[..., Any], *, counts: bool) -> Any:
    """Return the Numba implementation of `minihuman.worlds.kernels.llvm_function`."""

    def typed(context: Any, *arguments: Any) -> Any:
        kinds = [_argument_type(argument) for argument in arguments]

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            typed_values = []
            for kind, value in zip(kinds, values, strict=True):
                if isinstance(kind, types.Array):
                    start = context.make_array(kind)(context, builder, value).data
                    typed_values.append(("array", ArrayStart(start, str(kind.dtype))))
                else:
                    typed_values.append((str(kind), value))
            returned = write(builder, typed_values)
            if counts:
                return returned
            return context.get_dummy_value()

        return (int64 if counts else numba.void)(*kinds), code

    # Numba asks for names of arguments, one by one
    names = ["context", *list(inspect.signature(plain).parameters)]
    parameters = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    vars(typed)["__signature__"] = inspect.Signature(parameters)
    return intrinsic(typed)


def call_function(builder: Any, address: Any, argument: Any) -> Any:
    """Return LLVM's value of the int64 that the compiled function at an address returns for an int64."""
    kind = ir.FunctionType(_WHOLE, [_WHOLE])
    return builder.call(builder.inttoptr(address, kind.as_pointer()), [argument])


def array_at(kind: type[np.generic]) -> Any:
    """Return the Numba implementation of `minihuman.worlds.kernels.array_at`."""
    size = np.dtype(kind).itemsize
    array = types.Array(numba.from_dtype(np.dtype(kind)), 1, "C")

    def typed(context: Any, address: Any, count: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            struct = context.make_array(array)(context, builder)
            start = builder.inttoptr(values[0], struct.data.type)
            step = context.get_constant(types.intp, size)
            populate_array(struct, data=start, shape=values[1:], strides=[step], itemsize=step, meminfo=None)
            return struct._getvalue()

        return array(int64, int64), code

    return intrinsic(typed)


F64 = "float64"
F32 = "float32"
I64 = "int64"
U32 = "uint32"
U16 = "uint16"
U8 = "uint8"
BOOL = "bool"
_BITS = {F64: 64, F32: 32, I64: 64, U32: 32, U16: 16, U8: 8, BOOL: 1}
_REAL = F64, F32
_WHOLE = ir.IntType(64)


def llvm_operations(builder: Any) -> "_Operations":
    """Return the operations that vector code can use."""
    return _Operations(builder)


def llvm_arguments(builder: Any, typed_values: Sequence[tuple[str, Any]]) -> list[Any]:
    """Convert the arguments of vector code: numbers become a `SimdVector` of their kind, arrays are unchanged."""
    return [SimdVector(builder, value, kind) if kind in (F64, I64) else value for kind, value in typed_values]


def _operator(integer_instruction: str, real_instruction: str, *, is_swapped: bool = False) -> Any:
    """Return a method that emits the integer or real instruction; if ``is_swapped``, with its operands swapped."""

    def emit(self: "SimdVector", other: Any) -> "SimdVector":
        a, b = (self._operand(other), self.value) if is_swapped else (self.value, self._operand(other))
        instruction = real_instruction if self.kind in _REAL else integer_instruction
        return self._with(getattr(self.builder, instruction)(a, b))

    return emit


class SimdVector:
    """A vector of numbers in a kernel that is being compiled; its operators emit instructions."""

    def __init__(self, builder: Any, value: Any, kind: str) -> None:
        self.builder = builder
        self.value = value
        self.kind = kind

    @property
    def count(self) -> int:
        """The number of lanes."""
        return int(self.value.type.count)

    def _with(self, value: Any, kind: str | None = None) -> "SimdVector":
        """Return a vector with another LLVM value and, if ``kind`` is given, another kind."""
        return SimdVector(self.builder, value, kind or self.kind)

    def _operand(self, other: Any) -> Any:
        """Return LLVM's value of a vector, or of a Python number as a constant of this vector's type."""
        if isinstance(other, SimdVector):
            return other.value
        if self.kind in _REAL:
            number = float(other)
        else:
            number = int(other)
        is_scalar = not isinstance(self.value.type, ir.VectorType)
        return ir.Constant(self.value.type, number if is_scalar else [number] * self.count)

    __add__ = _operator("add", "fadd")
    __mul__ = _operator("mul", "fmul")
    __sub__ = _operator("sub", "fsub")
    __rsub__ = _operator("sub", "fsub", is_swapped=True)
    __truediv__ = _operator("", "fdiv")
    __rtruediv__ = _operator("", "fdiv", is_swapped=True)
    __and__ = _operator("and_", "")
    __or__ = _operator("or_", "")
    __xor__ = _operator("xor", "")
    __lshift__ = _operator("shl", "")
    __rshift__ = _operator("lshr", "")

    def _compare(self, sign: str, other: Any) -> "SimdVector":
        """Emit a comparison, lane by lane; numbers that are not floating-point are compared as unsigned."""
        if self.kind in _REAL:
            compare = self.builder.fcmp_ordered
        else:
            compare = self.builder.icmp_unsigned
        return self._with(compare(sign, self.value, self._operand(other)), BOOL)

    def __lt__(self, other: Any) -> "SimdVector":
        return self._compare("<", other)

    def __gt__(self, other: Any) -> "SimdVector":
        return self._compare(">", other)

    def __eq__(self, other: object) -> "SimdVector":  # type: ignore[override]
        return self._compare("==", other)

    __hash__ = None  # type: ignore[assignment]


def _vector_type(kind: str, count: int) -> ir.VectorType:
    """Return LLVM's type of a vector of ``count`` numbers of a kind."""
    real = {F64: ir.DoubleType(), F32: ir.FloatType()}
    return ir.VectorType(real.get(kind) or ir.IntType(_BITS[kind]), count)


class _Operations:
    """The vector operations of `minihuman.worlds.simd.NumpyOperations`, as instructions that LLVM's builder emits."""

    def __init__(self, builder: Any) -> None:
        self._builder = builder

    def _llvm_int64(self, value: Any) -> Any:
        """Return LLVM's value of a whole number, which is a Python number or a `SimdVector` without lanes."""
        if isinstance(value, int):
            return ir.Constant(_WHOLE, value)
        return value.value

    def _vector_pointer(self, array: Any, at: Any, kind: str, count: int) -> Any:
        """Return a pointer to the vector of ``count`` elements that begins at an index of an array."""
        pointer = self._builder.gep(array.start, [self._llvm_int64(at)])
        return self._builder.bitcast(pointer, _vector_type(kind, count).as_pointer())

    def _call_intrinsic(self, name: str, result: Any, *arguments: Any) -> Any:
        kind = ir.FunctionType(result, [argument.type for argument in arguments])
        return self._builder.call(self._builder.module.declare_intrinsic(name, (), kind), arguments)

    def load(self, array: Any, at: Any, count: int) -> SimdVector:
        kind = {"int32": U32, "int16": U16}.get(array.kind, array.kind)
        values = self._builder.load(self._vector_pointer(array, at, kind, count), align=_BITS[kind] // 8)
        return SimdVector(self._builder, values, kind)

    def load_16(self, array: Any, at: Any, count: int) -> SimdVector:
        values = self.load(array, at, count).value
        return SimdVector(self._builder, self._builder.trunc(values, _vector_type(U16, count)), U16)

    def store(self, array: Any, at: Any, values: SimdVector) -> None:
        pointer = self._vector_pointer(array, at, values.kind, values.count)
        self._builder.store(values.value, pointer, align=_BITS[values.kind] // 8)

    def pairs(self, array: Any, at: SimdVector) -> tuple[SimdVector, SimdVector]:
        build = self._builder
        short = ir.IntType(32)
        return self._pairs(
            array, [build.extract_element(at.value, ir.Constant(short, lane)) for lane in range(at.count)]
        )

    def pairs_at(self, array: Any, places: Any, first: Any, count: int) -> tuple[SimdVector, SimdVector]:
        build = self._builder
        start = build.gep(places.start, [self._llvm_int64(first)])
        lanes = [build.load(build.gep(start, [ir.Constant(_WHOLE, lane)])) for lane in range(count)]
        return self._pairs(array, lanes)

    def _pairs(self, array: Any, numbers: Sequence[Any]) -> tuple[SimdVector, SimdVector]:
        """Load the elements at some indices, LLVM's values, and the elements that follow them, for `pairs`."""
        build = self._builder
        count = len(numbers)
        # Lanes 0, 1, 4, 5, ... are loaded into the first part, lanes 2, 3, 6, 7, ... into the second, so that each
        # result is one shuffle within every sixteen bytes. A pair is loaded as one float64, which one instruction loads
        # into the upper half of sixteen bytes.
        parts = []
        for odd in (0, 2):
            lanes = [lane for lane in range(count) if lane & 2 == odd]
            vector = ir.Constant(_vector_type(F64, count // 2), ir.Undefined)
            for at, lane in enumerate(lanes):
                place = build.gep(array.start, [build.zext(numbers[lane], _WHOLE)])
                pixel_pair = build.load(build.bitcast(place, ir.DoubleType().as_pointer()), align=4)
                vector = build.insert_element(vector, pixel_pair, ir.Constant(ir.IntType(32), at))
            parts.append(build.bitcast(vector, _vector_type(U32, count)))
        # by lane: the index of its first element in the two parts, one after the other
        order = [(lane & 2) // 2 * count + lane // 4 * 4 + lane % 2 * 2 for lane in range(count)]
        first_pixels, second_pixels = (
            _shuffle(build, parts[0], parts[1], [at + odd for at in order]) for odd in (0, 1)
        )
        return SimdVector(build, first_pixels, U32), SimdVector(build, second_pixels, U32)

    def fetch(self, array: Any, at: SimdVector, by: Any) -> None:
        build = self._builder
        short = ir.IntType(32)
        start = build.gep(array.start, [self._llvm_int64(by)])
        for lane in range(0, at.count, 4):  # neighbours are mostly in the same cache line
            number = build.extract_element(at.value, ir.Constant(short, lane))
            self._prefetch(build.gep(start, [build.zext(number, _WHOLE)]), 2)

    def prefetch(self, array: Any, at: Any) -> None:
        self._prefetch(self._builder.gep(array.start, [self._llvm_int64(at)]), 3)

    def _prefetch(self, pointer: Any, locality: int) -> None:
        """Emit LLVM's prefetch instruction; ``locality`` is 3 for the nearest cache, and less for farther ones."""
        build = self._builder
        short = ir.IntType(32)
        hints = [ir.Constant(short, hint) for hint in (0, locality, 1)]  # for reading; the cache; of data
        byte_pointer = build.bitcast(pointer, ir.IntType(8).as_pointer())
        self._call_intrinsic("llvm.prefetch.p0", ir.VoidType(), byte_pointer, *hints)

    def count_from(self, first: Any, count: int, by: int) -> SimdVector:
        build = self._builder
        start = _splat(build, build.sitofp(self._llvm_int64(first), ir.DoubleType()), count)
        steps = ir.Constant(_vector_type(F64, count), [float(by * lane) for lane in range(count)])
        return SimdVector(build, build.fadd(start, steps), F64)

    def these(self, values: Sequence[float]) -> SimdVector:
        return SimdVector(self._builder, ir.Constant(_vector_type(F64, len(values)), list(values)), F64)

    def all_of(self, value: Any, count: int) -> SimdVector:
        return SimdVector(self._builder, _splat(self._builder, value.value, count), F64)

    def steps(self, count: int) -> SimdVector:
        return SimdVector(
            self._builder, ir.Constant(_vector_type(F32, count), [float(lane) for lane in range(count)]), F32
        )

    def single(self, value: Any, count: int) -> SimdVector:
        short = self._builder.fptrunc(value.value, ir.FloatType())
        return SimdVector(self._builder, _splat(self._builder, short, count), F32)

    def fixed(self, value: Any, count: int) -> SimdVector:
        short = self._builder.trunc(self._llvm_int64(value), ir.IntType(32))
        return SimdVector(self._builder, _splat(self._builder, short, count), U32)

    def _map(self, name: str, values: SimdVector) -> SimdVector:
        """Call an LLVM intrinsic function that maps each lane of a floating-point vector to one of the same type."""
        vector_type = values.value.type
        full_name = f"llvm.{name}.v{values.count}f{_BITS[values.kind]}"
        return SimdVector(self._builder, self._call_intrinsic(full_name, vector_type, values.value), values.kind)

    def floor(self, values: SimdVector) -> SimdVector:
        return self._map("floor", values)

    def ceil(self, values: SimdVector) -> SimdVector:
        return self._map("ceil", values)

    def size(self, values: SimdVector) -> SimdVector:
        return self._map("fabs", values)

    def larger(self, a: SimdVector, b: Any) -> SimdVector:
        return self.where(a > b, a, b)

    def smaller(self, a: SimdVector, b: Any) -> SimdVector:
        return self.where(a < b, a, b)

    def where(self, chosen: SimdVector, a: Any, b: Any) -> SimdVector:
        vector = a if isinstance(a, SimdVector) else b
        selected = self._builder.select(chosen.value, vector._operand(a), vector._operand(b))
        return SimdVector(self._builder, selected, vector.kind)

    def cut(self, values: SimdVector) -> SimdVector:
        return SimdVector(self._builder, self._builder.fptosi(values.value, _vector_type(U32, values.count)), U32)

    def real(self, values: SimdVector) -> SimdVector:
        return SimdVector(self._builder, self._builder.sitofp(values.value, _vector_type(F64, values.count)), F64)

    def short(self, values: SimdVector) -> SimdVector:
        return SimdVector(self._builder, self._builder.sitofp(values.value, _vector_type(F32, values.count)), F32)

    def view(self, values: SimdVector, kind: str) -> SimdVector:
        kinds = _vector_type(kind, _BITS[values.kind] * values.count // _BITS[kind])
        return SimdVector(self._builder, self._builder.bitcast(values.value, kinds), kind)

    def upper(self, a: SimdVector, b: SimdVector) -> SimdVector:
        build = self._builder
        wide = _vector_type(U32, a.count)
        product = build.mul(build.zext(a.value, wide), build.zext(b.value, wide))
        half = build.lshr(product, ir.Constant(wide, [16] * a.count))
        return SimdVector(build, build.trunc(half, a.value.type), U16)

    def number(self, array: Any, at: int) -> SimdVector:
        pointer = self._builder.gep(array.start, [self._llvm_int64(at)])
        return SimdVector(self._builder, self._builder.sext(self._builder.load(pointer), _WHOLE), I64)

    def these_16(self, values: Sequence[int]) -> SimdVector:
        return SimdVector(self._builder, ir.Constant(_vector_type(U16, len(values)), list(values)), U16)

    def fixed_16(self, value: Any, count: int) -> SimdVector:
        short = self._builder.trunc(self._llvm_int64(value), ir.IntType(16))
        return SimdVector(self._builder, _splat(self._builder, short, count), U16)

    def shuffled(self, first: SimdVector, lanes: Sequence[int], second: SimdVector | None = None) -> SimdVector:
        shuffled = _shuffle(self._builder, first.value, (second or first).value, lanes)
        return SimdVector(self._builder, shuffled, first.kind)

    def lane_bits(self, chosen: SimdVector) -> SimdVector:
        bits = self._builder.bitcast(chosen.value, ir.IntType(chosen.count))
        return SimdVector(self._builder, self._builder.zext(bits, _WHOLE), I64)

    def spread_bytes(self, number: SimdVector) -> SimdVector:
        short = self._builder.bitcast(number.value, _vector_type(U8, 8))
        twice = _shuffle(self._builder, short, short, range(16))
        return SimdVector(self._builder, self._builder.zext(twice, _vector_type(U16, 16)), U16)


def _splat(builder: Any, value: Any, count: int) -> Any:
    """Emit a vector with the same LLVM value in every lane."""
    kind = ir.VectorType(value.type, count)
    single = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(single, single, ir.Constant(ir.VectorType(ir.IntType(32), count), [0] * count))


def _shuffle(builder: Any, a: Any, b: Any, lanes: Sequence[int]) -> Any:
    """Emit a vector of chosen lanes of two vectors; lanes of ``b`` are numbered after those of ``a``."""
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes)))
