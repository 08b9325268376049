"""How the grid's kernels are compiled: kept on disk, and no more of each than is called for."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])

# Nothing here divides by zero, so nothing is made to raise it. C calls none of it.
_KERNEL: dict[str, Any] = {"cache": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_PART = _KERNEL | {"no_cpython_wrapper": True}


def kernel(signature: str | None = None) -> Callable[[F], F]:
    """Compile what Python calls; with a signature now, and for nothing else than it."""
    return cast(Callable[[F], F], njit(signature, **_KERNEL))


def part(signature: str | None = None, *, into_caller: bool = False) -> Callable[[F], F]:
    """Compile what only kernels call, without a way in from Python, which would have to be compiled too.

    Python must not call a part: there is nothing there, and the process ends. What a layout written in Python may
    call is a kernel. ``into_caller`` copies the machine code to where it is called, in every case.
    """
    return cast(Callable[[F], F], njit(signature, **(_PART | {"forceinline": into_caller})))
