"""Vector code as LLVM's instructions, where a kernel is compiled; what each operation does stands in `lanes.Plain`."""

from collections.abc import Sequence
from typing import Any

from llvmlite import ir

F64, F32, I64, U32, U16, U8, BOOL = "float64", "float32", "int64", "uint32", "uint16", "uint8", "bool"
_BITS = {F64: 64, F32: 32, I64: 64, U32: 32, U16: 16, U8: 8, BOOL: 1}
_REAL = F64, F32
_WHOLE = ir.IntType(64)


def operations(builder: Any) -> "_Operations":
    """What vector code finds its operations in."""
    return _Operations(builder)


def arguments(builder: Any, given: Sequence[tuple[str, Any]]) -> list[Any]:
    """What vector code is given, as it takes it: numbers by kind and LLVM's value, arrays as they are."""
    return [Lanes(builder, value, kind) if kind in (F64, I64) else value for kind, value in given]


class Lanes:
    """Numbers side by side in a kernel that is being compiled; operators add instructions."""

    def __init__(self, builder: Any, value: Any, kind: str) -> None:
        self.builder, self.value, self.kind = builder, value, kind

    @property
    def count(self) -> int:
        """How many lanes."""
        return int(self.value.type.count)

    def _with(self, value: Any, kind: str | None = None) -> "Lanes":
        return Lanes(self.builder, value, kind or self.kind)

    def _like(self, other: Any) -> Any:
        if isinstance(other, Lanes):
            return other.value
        number = float(other) if self.kind in _REAL else int(other)
        one = not isinstance(self.value.type, ir.VectorType)
        return ir.Constant(self.value.type, number if one else [number] * self.count)

    def _do(self, whole: str, real: str, other: Any, turned: bool = False) -> "Lanes":
        a, b = (self._like(other), self.value) if turned else (self.value, self._like(other))
        return self._with(getattr(self.builder, real if self.kind in _REAL else whole)(a, b))

    def __add__(self, other: Any) -> "Lanes":
        return self._do("add", "fadd", other)

    def __sub__(self, other: Any) -> "Lanes":
        return self._do("sub", "fsub", other)

    def __rsub__(self, other: Any) -> "Lanes":
        return self._do("sub", "fsub", other, turned=True)

    def __mul__(self, other: Any) -> "Lanes":
        return self._do("mul", "fmul", other)

    def __truediv__(self, other: Any) -> "Lanes":
        return self._do("", "fdiv", other)

    def __rtruediv__(self, other: Any) -> "Lanes":
        return self._do("", "fdiv", other, turned=True)

    def __and__(self, other: Any) -> "Lanes":
        return self._do("and_", "", other)

    def __or__(self, other: Any) -> "Lanes":
        return self._do("or_", "", other)

    def __lshift__(self, other: Any) -> "Lanes":
        return self._do("shl", "", other)

    def __rshift__(self, other: Any) -> "Lanes":
        return self._do("lshr", "", other)

    def _compare(self, sign: str, other: Any) -> "Lanes":
        compare = self.builder.fcmp_ordered if self.kind in _REAL else self.builder.icmp_unsigned
        return self._with(compare(sign, self.value, self._like(other)), BOOL)

    def __lt__(self, other: Any) -> "Lanes":
        return self._compare("<", other)

    def __gt__(self, other: Any) -> "Lanes":
        return self._compare(">", other)

    def __eq__(self, other: object) -> "Lanes":  # type: ignore[override]
        return self._compare("==", other)

    __hash__ = None  # type: ignore[assignment]


def _vector(kind: str, count: int) -> ir.VectorType:
    real = {F64: ir.DoubleType(), F32: ir.FloatType()}
    return ir.VectorType(real.get(kind) or ir.IntType(_BITS[kind]), count)


class _Operations:
    def __init__(self, builder: Any) -> None:
        self._builder = builder

    def _whole(self, value: Any) -> Any:
        return ir.Constant(_WHOLE, value) if isinstance(value, int) else value.value

    def _place(self, array: Any, at: Any, kind: str, count: int) -> Any:
        place = self._builder.gep(array.start, [self._whole(at)])
        return self._builder.bitcast(place, _vector(kind, count).as_pointer())

    def _call(self, name: str, result: Any, *arguments: Any) -> Any:
        kind = ir.FunctionType(result, [argument.type for argument in arguments])
        return self._builder.call(self._builder.module.declare_intrinsic(name, (), kind), arguments)

    def load(self, array: Any, at: Any, count: int) -> Lanes:
        kind = U32 if array.kind == "int32" else array.kind
        place = self._place(array, at, kind, count)
        return Lanes(self._builder, self._builder.load(place, align=_BITS[kind] // 8), kind)

    def store(self, array: Any, at: Any, values: Lanes) -> None:
        place = self._place(array, at, values.kind, values.count)
        self._builder.store(values.value, place, align=_BITS[values.kind] // 8)

    def pairs(self, array: Any, at: Lanes) -> tuple[Lanes, Lanes]:
        build, short = self._builder, ir.IntType(32)
        return self._pairs(
            array, [build.extract_element(at.value, ir.Constant(short, lane)) for lane in range(at.count)]
        )

    def pairs_at(self, array: Any, places: Any, first: Any, count: int) -> tuple[Lanes, Lanes]:
        build = self._builder
        start = build.gep(places.start, [self._whole(first)])
        each = [build.load(build.gep(start, [ir.Constant(_WHOLE, lane)])) for lane in range(count)]
        return self._pairs(array, each)

    def _pairs(self, array: Any, numbers: Sequence[Any]) -> tuple[Lanes, Lanes]:
        build, count = self._builder, len(numbers)
        # two pixels in turn, so that what belongs together is one shuffle within each sixteen bytes; as float64, which
        # one instruction loads into the upper half
        parts = []
        for odd in (0, 2):
            lanes = [lane for lane in range(count) if lane & 2 == odd]
            both = ir.Constant(_vector(F64, count // 2), ir.Undefined)
            for at, lane in enumerate(lanes):
                place = build.gep(array.start, [build.zext(numbers[lane], _WHOLE)])
                found = build.load(build.bitcast(place, ir.DoubleType().as_pointer()), align=4)
                both = build.insert_element(both, found, ir.Constant(ir.IntType(32), at))
            parts.append(build.bitcast(both, _vector(U32, count)))
        order = [(lane & 2) // 2 * count + lane // 4 * 4 + lane % 2 * 2 for lane in range(count)]
        here, beside = (_shuffle(build, parts[0], parts[1], [at + odd for at in order]) for odd in (0, 1))
        return Lanes(build, here, U32), Lanes(build, beside, U32)

    def fetch(self, array: Any, at: Lanes, by: Any) -> None:
        build, short = self._builder, ir.IntType(32)
        start = build.gep(array.start, [self._whole(by)])
        how = [ir.Constant(short, each) for each in (0, 2, 1)]  # to be read, into the second cache, and it is data
        for lane in range(0, at.count, 4):
            number = build.extract_element(at.value, ir.Constant(short, lane))
            place = build.bitcast(build.gep(start, [build.zext(number, _WHOLE)]), ir.IntType(8).as_pointer())
            self._call("llvm.prefetch.p0", ir.VoidType(), place, *how)

    def count_from(self, first: Any, count: int, by: int) -> Lanes:
        build = self._builder
        start = _splat(build, build.sitofp(self._whole(first), ir.DoubleType()), count)
        steps = ir.Constant(_vector(F64, count), [float(by * lane) for lane in range(count)])
        return Lanes(build, build.fadd(start, steps), F64)

    def these(self, values: Sequence[float]) -> Lanes:
        return Lanes(self._builder, ir.Constant(_vector(F64, len(values)), list(values)), F64)

    def all_of(self, value: Any, count: int) -> Lanes:
        return Lanes(self._builder, _splat(self._builder, value.value, count), F64)

    def steps(self, count: int) -> Lanes:
        return Lanes(self._builder, ir.Constant(_vector(F32, count), [float(lane) for lane in range(count)]), F32)

    def single(self, value: Any, count: int) -> Lanes:
        short = self._builder.fptrunc(value.value, ir.FloatType())
        return Lanes(self._builder, _splat(self._builder, short, count), F32)

    def fixed(self, value: Any, count: int) -> Lanes:
        short = self._builder.trunc(self._whole(value), ir.IntType(32))
        return Lanes(self._builder, _splat(self._builder, short, count), U32)

    def _rounded(self, name: str, values: Lanes) -> Lanes:
        kind = values.value.type
        named = f"llvm.{name}.v{values.count}f{_BITS[values.kind]}"
        return Lanes(self._builder, self._call(named, kind, values.value), values.kind)

    def floor(self, values: Lanes) -> Lanes:
        return self._rounded("floor", values)

    def ceil(self, values: Lanes) -> Lanes:
        return self._rounded("ceil", values)

    def size(self, values: Lanes) -> Lanes:
        return self._rounded("fabs", values)

    def larger(self, a: Lanes, b: Any) -> Lanes:
        return self.where(a > b, a, b)

    def smaller(self, a: Lanes, b: Any) -> Lanes:
        return self.where(a < b, a, b)

    def where(self, chosen: Lanes, a: Any, b: Any) -> Lanes:
        like = a if isinstance(a, Lanes) else b
        return Lanes(self._builder, self._builder.select(chosen.value, like._like(a), like._like(b)), like.kind)

    def cut(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.fptosi(values.value, _vector(U32, values.count)), U32)

    def real(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.sitofp(values.value, _vector(F64, values.count)), F64)

    def short(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.sitofp(values.value, _vector(F32, values.count)), F32)

    def bits(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.bitcast(values.value, _vector(U32, values.count)), U32)

    def halves(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.bitcast(values.value, _vector(U16, 2 * values.count)), U16)

    def wholes(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.bitcast(values.value, _vector(U32, values.count // 2)), U32)

    def upper(self, a: Lanes, b: Lanes) -> Lanes:
        build, wide = self._builder, _vector(U32, a.count)
        product = build.mul(build.zext(a.value, wide), build.zext(b.value, wide))
        half = build.lshr(product, ir.Constant(wide, [16] * a.count))
        return Lanes(build, build.trunc(half, a.value.type), U16)

    def octets(self, values: Lanes) -> Lanes:
        return Lanes(self._builder, self._builder.bitcast(values.value, _vector(U8, 4 * values.count)), U8)

    def three_of_four(self, values: Lanes) -> Lanes:
        return self._shuffled(values, values, [lane for lane in range(values.count) if lane % 4 < 3])

    def part(self, values: Lanes, first: int, count: int) -> Lanes:
        return self._shuffled(values, values, list(range(first, first + count)))

    def _shuffled(self, a: Lanes, b: Lanes, lanes: Sequence[int]) -> Lanes:
        return Lanes(self._builder, _shuffle(self._builder, a.value, b.value, lanes), a.kind)


def _splat(builder: Any, value: Any, count: int) -> Any:
    kind = ir.VectorType(value.type, count)
    one = builder.insert_element(ir.Constant(kind, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), count), [0] * count))


def _shuffle(builder: Any, a: Any, b: Any, lanes: Sequence[int]) -> Any:
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), list(lanes)))
