"""Kernels as they are written, for what loads them from a library and for what compiles them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple


@dataclass(frozen=True, slots=True, eq=False)
class KernelSource:
    """A function as it is written, and how it is to be compiled.

    Args:
        function: in Python.
        options: for Numba.
        variables: types of variables whose first value says too little.
        signatures: Numba's words for arguments and result, of what Python calls it with.
        only: it is compiled for these signatures alone, for other kernels too.
    """

    function: Callable[..., Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    variables: Mapping[str, Any] = field(default_factory=dict)
    signatures: tuple[str, ...] = ()
    only: bool = False

    @property
    def name(self) -> str:
        """Return the name with its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"


# What stands in modules for a kernel, or for what kernels call, by its `id`; and what Numba makes of it, for others
COMPILERS: dict[int, tuple[Any, Callable[[], Any]]] = {}


class ArrayStart(NamedTuple):
    """An array in a kernel that is being compiled: where it starts, in LLVM's words, and of what it is."""

    start: Any
    kind: str  # NumPy's name
