"""Vector code: what is done to several pixels at once, written once with operators.

In a compiled kernel such a function becomes LLVM's vector instructions, of whatever width the processor has; where
nothing is compiled it runs on NumPy's arrays. Both compute the same to the last bit: each operation is one of IEEE 754
or of whole numbers that wrap around, in the order it is written in.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.kernels import instructions
from minihuman.worlds.lanes_compiled import arguments, operations

Array = NDArray[Any]


def vector(*, counts: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Make vector code of a function, for kernels to call; its first argument is what it finds the operations in.

    Its other arguments are arrays, whole numbers and floating-point ones. With ``counts`` it returns a whole number,
    otherwise nothing.
    """

    def made(function: Callable[..., Any]) -> Callable[..., Any]:
        def write(builder: Any, given: Sequence[tuple[str, Any]]) -> Any:
            found = function(operations(builder), *arguments(builder, given))
            return found.value if counts else None

        return instructions(write, partial(function, Plain()), counts=counts)

    return made


class Plain:
    """The operations on NumPy's arrays."""

    def load(self, array: Array, at: int, count: int) -> Any:
        """``count`` neighbours in an array."""
        values = array[at : at + count].copy()
        return values.view(np.uint32) if values.dtype == np.int32 else values

    def store(self, array: Array, at: int, values: Any) -> None:
        """Put neighbours into an array."""
        array[at : at + len(values)] = values

    def pairs(self, array: Array, at: Any) -> tuple[Any, Any]:
        """What is at some places of an array of uint32, and what is one further."""
        return array[at], array[at + np.uint32(1)]

    def pairs_at(self, array: Array, places: Array, first: int, count: int) -> tuple[Any, Any]:
        """The same, for places that stand in another array."""
        return self.pairs(array, places[first : first + count])

    def fetch(self, array: Array, at: Any, by: int) -> None:
        """Ask memory for what is so much further than every fourth of some places; it may lie outside the array."""

    def count_from(self, first: int, count: int, by: int) -> Any:
        """first, first + by, first + 2 * by and so on, as float64."""
        return first + by * np.arange(count, dtype=np.float64)

    def these(self, values: Sequence[float]) -> Any:
        """Constants, as float64."""
        return np.array(values, np.float64)

    def all_of(self, value: float, count: int) -> Any:
        """One float64 in every lane."""
        return np.full(count, value, np.float64)

    def steps(self, count: int) -> Any:
        """0, 1, 2 and so on, as float32."""
        return np.arange(count, dtype=np.float32)

    def single(self, value: float, count: int) -> Any:
        """A float64 as the nearest float32 in every lane."""
        return np.full(count, value, np.float32)

    def fixed(self, value: int, count: int) -> Any:
        """One uint32 in every lane."""
        return np.full(count, value, np.uint32)

    def floor(self, values: Any) -> Any:
        """The whole number below."""
        return np.floor(values)

    def ceil(self, values: Any) -> Any:
        """The whole number above."""
        return np.ceil(values)

    def size(self, values: Any) -> Any:
        """Without the sign."""
        return np.abs(values)

    def larger(self, a: Any, b: Any) -> Any:
        """The larger of two, lane by lane."""
        return np.where(a > b, a, b)

    def smaller(self, a: Any, b: Any) -> Any:
        """The smaller of two, lane by lane."""
        return np.where(a < b, a, b)

    def where(self, chosen: Any, a: Any, b: Any) -> Any:
        """``a`` where something is true, ``b`` elsewhere."""
        return np.where(chosen, a, b)

    def cut(self, values: Any) -> Any:
        """A floating-point number without its fraction, as uint32; it is 0 or more, and below 2 ** 31."""
        return values.astype(np.int32).view(np.uint32)

    def real(self, values: Any) -> Any:
        """A uint32 below 2 ** 31 as float64."""
        return values.view(np.int32).astype(np.float64)

    def short(self, values: Any) -> Any:
        """A uint32 below 2 ** 31 as float32."""
        return values.view(np.int32).astype(np.float32)

    def bits(self, values: Any) -> Any:
        """A float32's bits, as uint32."""
        return values.view(np.uint32)

    def halves(self, values: Any) -> Any:
        """Each uint32 as two uint16."""
        return values.view(np.uint16)

    def wholes(self, values: Any) -> Any:
        """Two uint16 as one uint32."""
        return values.view(np.uint32)

    def upper(self, a: Any, b: Any) -> Any:
        """The upper half of each product of two uint16."""
        return (a.astype(np.uint32) * b >> 16).astype(np.uint16)

    def octets(self, values: Any) -> Any:
        """Each uint32 as four uint8, the lowest first."""
        return values.view(np.uint8)

    def three_of_four(self, values: Any) -> Any:
        """Every lane but each fourth."""
        return values.reshape(-1, 4)[:, :3].ravel()

    def part(self, values: Any, first: int, count: int) -> Any:
        """Some neighbouring lanes."""
        return values[first : first + count].copy()
