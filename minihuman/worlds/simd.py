"""SIMD vectors for kernels: operations on several pixels at once, written once with operators.

In a compiled kernel they become LLVM vector instructions of the width that the processor has; without compilation they
run on NumPy arrays. Both give the same bits: each operation is one of IEEE 754 or of whole numbers that wrap around, in
the order in which it is written.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import llvm_function

Array = NDArray[Any]


def simd_function(*, counts: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make vector code of a function, for kernels to call; its first argument is what it finds the operations in.

    Its other arguments are arrays, whole numbers and floating-point ones. With ``counts`` it returns a whole number,
    otherwise nothing.
    """

    def vectorise(function: Callable[..., Any]) -> Callable[..., Any]:
        def write(builder: Any, typed_values: Sequence[tuple[str, Any]]) -> Any:
            from minihuman.worlds.build.compilation import llvm_arguments, llvm_operations

            returned = function(llvm_operations(builder), *llvm_arguments(builder, typed_values))
            return returned.value if counts else None

        return llvm_function(write, partial(function, NumpyOperations()), counts=counts)

    return vectorise


class NumpyOperations:
    """The operations on NumPy's arrays."""

    def load(self, array: Array, at: int, count: int) -> Any:
        """Load ``count`` neighbours of an array, whatever its shape; int32, which are 0 or more, as uint32."""
        values = array.reshape(-1)[at : at + count].copy()
        if values.dtype == np.int32:
            return values.view(np.uint32)
        return values

    def load_16(self, array: Array, at: int, count: int) -> Any:
        """Load the lowest bits of neighbours in an array of int16 or int32, as uint16."""
        return self.load(array, at, count).astype(np.uint16)

    def store(self, array: Array, at: int, values: Any) -> None:
        """Put neighbours into an array, whatever its shape."""
        array.reshape(-1)[at : at + len(values)] = values

    def pairs(self, array: Array, at: Any) -> tuple[Any, Any]:
        """Load what is at some places of an array of uint32, and what is one further."""
        return array[at], array[at + np.uint32(1)]

    def pairs_at(self, array: Array, places: Array, first: int, count: int) -> tuple[Any, Any]:
        """Load the same, for places that stand in another array."""
        return self.pairs(array, places[first : first + count])

    def fetch(self, array: Array, at: Any, by: int) -> None:
        """Prefetch what lies ``by`` further than every fourth of some places; it may lie outside the array."""

    def prefetch(self, array: Array, at: int) -> None:
        """Prefetch what lies at a place, into the nearest cache; it may lie outside the array."""

    def count_from(self, first: int, count: int, by: int) -> Any:
        """Return first, first + by, first + 2 * by and so on, as float64."""
        return first + by * np.arange(count, dtype=np.float64)

    def these(self, values: Sequence[float]) -> Any:
        """Return constants, as float64."""
        return np.array(values, np.float64)

    def all_of(self, value: float, count: int) -> Any:
        """Return one float64 in every lane."""
        return np.full(count, value, np.float64)

    def steps(self, count: int) -> Any:
        """Return 0, 1, 2 and so on, as float32."""
        return np.arange(count, dtype=np.float32)

    def single(self, value: float, count: int) -> Any:
        """Return a float64 as the nearest float32 in every lane."""
        return np.full(count, value, np.float32)

    def fixed(self, value: int, count: int) -> Any:
        """Return one uint32 in every lane."""
        return np.full(count, value, np.uint32)

    def floor(self, values: Any) -> Any:
        """Round down."""
        return np.floor(values)

    def ceil(self, values: Any) -> Any:
        """Round up."""
        return np.ceil(values)

    def size(self, values: Any) -> Any:
        """Return the size, without the sign."""
        return np.abs(values)

    def larger(self, a: Any, b: Any) -> Any:
        """Return the larger of two, lane by lane."""
        return np.where(a > b, a, b)

    def smaller(self, a: Any, b: Any) -> Any:
        """Return the smaller of two, lane by lane."""
        return np.where(a < b, a, b)

    def where(self, chosen: Any, a: Any, b: Any) -> Any:
        """Return ``a`` where a mask is true, ``b`` elsewhere."""
        return np.where(chosen, a, b)

    def cut(self, values: Any) -> Any:
        """Cut off the fraction of a floating-point number from 0 to below 2 ** 31; return uint32."""
        return values.astype(np.int32).view(np.uint32)

    def real(self, values: Any) -> Any:
        """Convert a uint32 below 2 ** 31 to float64."""
        return values.view(np.int32).astype(np.float64)

    def short(self, values: Any) -> Any:
        """Convert a uint32 below 2 ** 31 to float32."""
        return values.view(np.int32).astype(np.float32)

    def view(self, values: Any, kind: str) -> Any:
        """View the same bits as numbers of another kind, "uint8", "uint16" or "uint32", the lowest first."""
        return values.view(kind)

    def upper(self, a: Any, b: Any) -> Any:
        """Return the upper half of each product of two uint16."""
        return (a.astype(np.uint32) * b >> 16).astype(np.uint16)

    def number(self, array: Array, at: int) -> int:
        """Load one whole number of an array."""
        return int(array[at])

    def these_16(self, values: Sequence[int]) -> Any:
        """Return constants, as uint16."""
        return np.array(values, np.uint16)

    def fixed_16(self, value: int, count: int) -> Any:
        """Return a whole number's lowest bits in every lane, as uint16."""
        return np.full(count, value & 0xFFFF, np.uint16)

    def shuffled(self, first: Any, lanes: Sequence[int], second: Any = None) -> Any:
        """Shuffle lanes of a vector, or of two; those of the second are counted on."""
        return np.concatenate((first, first if second is None else second))[list(lanes)]

    def lane_bits(self, chosen: Any) -> int:
        """Return which lanes are true: a bit each, the first the lowest."""
        return int.from_bytes(np.packbits(chosen, bitorder="little").tobytes(), "little")

    def spread_bytes(self, number: int) -> Any:
        """Spread the eight bytes of a whole number, a lane each, twice, as uint16."""
        return np.tile(np.array([number], np.uint64).view(np.uint8), 2).astype(np.uint16)
