"""LLVM's library, for loading machine code that was compiled before. Numba is not imported."""

from typing import Any

import llvmlite.binding as llvm


def llvm_binding() -> Any:
    """Return llvmlite's binding, ready for this machine."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm
