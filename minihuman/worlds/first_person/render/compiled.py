"""How the kernels are compiled: nothing fused or reordered, kept on disk, and no more than is called for."""

from collections.abc import Callable
from typing import Any

from numba import njit

Decorator = Callable[[Callable[..., Any]], Any]

# A division by zero is infinite, as in NumPy: nothing is raised in a kernel.
_KERNEL: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
# A part makes no arrays, so it need not count who holds those it is given; and it is put where it is called. Otherwise
# a small one spends most of its time on counting, and on handing over arrays number by number.
_PART = _KERNEL | {"no_cpython_wrapper": True, "_nrt": False, "forceinline": True}


def kernel(**types: Any) -> Decorator:
    """Compile what Python calls; ``types`` names the Numba types of variables whose first value says too little."""
    decorator: Decorator = njit(**(_KERNEL | {"locals": types}))
    return decorator


def part(**types: Any) -> Decorator:
    """Compile what only kernels call and what makes no arrays: without a way in from Python, to compile less."""
    decorator: Decorator = njit(**(_PART | {"locals": types}))
    return decorator
