"""How the kernels are compiled: nothing fused or reordered, kept on disk, and no more than is called for."""

from collections.abc import Callable
from typing import Any

from numba import njit

Decorator = Callable[[Callable[..., Any]], Any]

# A division by zero is infinite, as in NumPy: nothing is raised in a kernel. And no kernel makes arrays, so none need
# count who holds those it is given (a small one would spend most of its time on that).
_KERNEL: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
    "_nrt": False,
}
# A part is put where it is called, or handing over arrays number by number would take longer than what it does.
_PART = _KERNEL | {"no_cpython_wrapper": True, "forceinline": True}


def kernel(**types: Any) -> Decorator:
    """Compile what Python calls, and what makes no arrays.

    ``types`` names the Numba types of variables whose first value says too little.
    """
    decorator: Decorator = njit(**(_KERNEL | {"locals": types}))
    return decorator


def part(**types: Any) -> Decorator:
    """Compile what only kernels call: without a way in from Python, to compile less."""
    decorator: Decorator = njit(**(_PART | {"locals": types}))
    return decorator
