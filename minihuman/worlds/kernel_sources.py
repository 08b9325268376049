"""The Python sources of kernels, for the code that loads kernels from a library and the code that compiles them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple


@dataclass(frozen=True, slots=True, eq=False)
class KernelSource:
    """A kernel's Python function, and how to compile it.

    Args:
        function: the function in Python.
        options: the options for Numba's compiler.
        variables: the types of variables whose first value does not determine them.
        signatures: the argument and return types with which Python calls the function, in Numba's notation.
        only: whether the function is compiled for these signatures alone, even where other kernels call it.
    """

    function: Callable[..., Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    variables: Mapping[str, Any] = field(default_factory=dict)
    signatures: tuple[str, ...] = ()
    only: bool = False

    @property
    def name(self) -> str:
        """Return the function's qualified name, including its module."""
        return f"{self.function.__module__}.{self.function.__qualname__}"


# By the `id` of the object that stands in modules for a kernel, or for a function that kernels call: this object, and
# the function that compiles it with Numba for the kernels that call it.
COMPILERS: dict[int, tuple[Any, Callable[[], Any]]] = {}


class ArrayStart(NamedTuple):
    """An array in a kernel that is being compiled: LLVM's pointer to its start, and the type of its elements."""

    start: Any
    kind: str  # NumPy's name
