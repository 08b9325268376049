"""SIMD vectors for kernels: operations on several pixels at once, written once with operators.

In a compiled kernel they become LLVM vector instructions of the processor's width; without compilation they run on
NumPy arrays. Both give the same bits: each operation is an IEEE 754 operation or a whole-number operation that wraps
around, in the order in which it is written.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import llvm_function

Array = NDArray[Any]


def simd_function(*, counts: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that turns a function into vector code for kernels to call.

    The function's first argument is the object that has the vector operations. Its other arguments are arrays, whole
    numbers and floating-point numbers. With ``counts`` it returns a whole number, otherwise nothing.
    """

    def vectorise(function: Callable[..., Any]) -> Callable[..., Any]:
        def write(builder: Any, typed_values: Sequence[tuple[str, Any]]) -> Any:
            from minihuman.worlds.build.compilation import llvm_arguments, llvm_operations

            returned = function(llvm_operations(builder), *llvm_arguments(builder, typed_values))
            return returned.value if counts else None

        return llvm_function(write, partial(function, NumpyOperations()), counts=counts)

    return vectorise


class NumpyOperations:
    """The vector operations on NumPy arrays."""

    def load(self, array: Array, at: int, count: int) -> Any:
        """Load ``count`` consecutive elements of the flattened array.

        Elements of type int32 must be 0 or more, and become uint32.
        """
        values = array.reshape(-1)[at : at + count].copy()
        if values.dtype == np.int32:
            return values.view(np.uint32)
        return values

    def load_16(self, array: Array, at: int, count: int) -> Any:
        """Load the lowest 16 bits of consecutive elements in an array of int16 or int32, as uint16."""
        return self.load(array, at, count).astype(np.uint16)

    def store(self, array: Array, at: int, values: Any) -> None:
        """Store values in consecutive elements of the flattened array."""
        array.reshape(-1)[at : at + len(values)] = values

    def pairs(self, array: Array, at: Any) -> tuple[Any, Any]:
        """Load the elements at the given indices of an array of uint32, and the elements that follow them."""
        return array[at], array[at + np.uint32(1)]

    def pairs_at(self, array: Array, places: Array, first: int, count: int) -> tuple[Any, Any]:
        """Load pairs of elements as `pairs` does, at indices that are read from another array."""
        return self.pairs(array, places[first : first + count])

    def fetch(self, array: Array, at: Any, by: int) -> None:
        """Prefetch the element ``by`` after every fourth of the given indices; it may lie outside the array."""

    def prefetch(self, array: Array, at: int) -> None:
        """Prefetch the element at an index into the nearest cache; the index may lie outside the array."""

    def count_from(self, first: int, count: int, by: int) -> Any:
        """Return ``count`` numbers from ``first`` in steps of ``by``, as float64."""
        return first + by * np.arange(count, dtype=np.float64)

    def these(self, values: Sequence[float]) -> Any:
        """Return a vector of constants, as float64."""
        return np.array(values, np.float64)

    def all_of(self, value: float, count: int) -> Any:
        """Return a vector with the same float64 in every lane."""
        return np.full(count, value, np.float64)

    def steps(self, count: int) -> Any:
        """Return the numbers from 0 to ``count`` - 1, as float32."""
        return np.arange(count, dtype=np.float32)

    def single(self, value: float, count: int) -> Any:
        """Return a vector with a float64, rounded to the nearest float32, in every lane."""
        return np.full(count, value, np.float32)

    def fixed(self, value: int, count: int) -> Any:
        """Return a vector with the same uint32 in every lane."""
        return np.full(count, value, np.uint32)

    def floor(self, values: Any) -> Any:
        """Return the values rounded down."""
        return np.floor(values)

    def ceil(self, values: Any) -> Any:
        """Return the values rounded up."""
        return np.ceil(values)

    def size(self, values: Any) -> Any:
        """Return the absolute values."""
        return np.abs(values)

    def larger(self, a: Any, b: Any) -> Any:
        """Return the larger of two values, lane by lane."""
        return np.where(a > b, a, b)

    def smaller(self, a: Any, b: Any) -> Any:
        """Return the smaller of two values, lane by lane."""
        return np.where(a < b, a, b)

    def where(self, chosen: Any, a: Any, b: Any) -> Any:
        """Return, lane by lane, ``a`` where the mask is true and ``b`` elsewhere."""
        return np.where(chosen, a, b)

    def cut(self, values: Any) -> Any:
        """Truncate floating-point numbers from 0 to below 2 ** 31 to uint32."""
        return values.astype(np.int32).view(np.uint32)

    def real(self, values: Any) -> Any:
        """Convert uint32 numbers below 2 ** 31 to float64."""
        return values.view(np.int32).astype(np.float64)

    def short(self, values: Any) -> Any:
        """Convert uint32 numbers below 2 ** 31 to float32."""
        return values.view(np.int32).astype(np.float32)

    def view(self, values: Any, kind: str) -> Any:
        """View the same bits as "uint8", "uint16" or "uint32" numbers, in little-endian order."""
        return values.view(kind)

    def upper(self, a: Any, b: Any) -> Any:
        """Return the upper 16 bits of the products of uint16 numbers, lane by lane."""
        return (a.astype(np.uint32) * b >> 16).astype(np.uint16)

    def number(self, array: Array, at: int) -> int:
        """Load one whole number from an array."""
        return int(array[at])

    def these_16(self, values: Sequence[int]) -> Any:
        """Return a vector of constants, as uint16."""
        return np.array(values, np.uint16)

    def fixed_16(self, value: int, count: int) -> Any:
        """Return a vector with the lowest 16 bits of a whole number in every lane, as uint16."""
        return np.full(count, value & 0xFFFF, np.uint16)

    def shuffled(self, first: Any, lanes: Sequence[int], second: Any = None) -> Any:
        """Return chosen lanes of one vector or of two; lanes of the second are numbered after the first's."""
        return np.concatenate((first, first if second is None else second))[list(lanes)]

    def lane_bits(self, chosen: Any) -> int:
        """Return a whole number with one bit per lane, set where the lane is true. The first lane is the lowest bit."""
        return int.from_bytes(np.packbits(chosen, bitorder="little").tobytes(), "little")

    def spread_bytes(self, number: int) -> Any:
        """Return a vector with one byte of a 64-bit whole number per lane, as uint16; the eight bytes appear twice."""
        return np.tile(np.array([number], np.uint64).view(np.uint8), 2).astype(np.uint16)
