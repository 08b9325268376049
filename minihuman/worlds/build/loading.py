"""LLVM's library, for loading machine code that was compiled before. Numba is not imported."""

from typing import Any

import llvmlite.binding as llvm


def llvm_binding() -> Any:
    """Initialize LLVM for this machine's processor, and return llvmlite's module of bindings."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm
