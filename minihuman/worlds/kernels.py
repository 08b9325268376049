"""Kernels: functions that run as machine code from a library that was compiled when minihuman was built.

In a checkout, ``python -m kernel_build --native`` builds the library in the folder ``compiled`` beside this module;
installing the package builds it too. A kernel is loaded from the library only if all sources that its module depends
on are unchanged since the build; otherwise Numba compiles it on its first call in each process. Operations are neither
fused nor reordered, so a kernel gives the same results on every machine and either way. With NUMBA_DISABLE_JIT=1
kernels run as the plain Python in which they are written; with MINIHUMAN_KERNELS=jit Numba compiles them even where
there is a library.

In the package, only ``minihuman.worlds.build`` imports Numba and llvmlite, and this module imports
``minihuman.worlds.build`` only to compile.
"""

import ctypes
import logging
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import MinihumanError
from minihuman.worlds.kernel_sources import COMPILERS, KernelSource as KernelSource
from minihuman.worlds.library_manifest import (
    API_FUNCTIONS,
    HERE,
    KINDS,
    LIBRARY_FOLDER,
    number_fitting_kernels,
    read_manifest,
)

LOG = logging.getLogger("minihuman")
COMPILE_NOTICE = (
    "the worlds are not compiled as they are now; each process compiles them anew until "
    "`python -m kernel_build --native`"
)
NO_COMPILER = (
    "kernels of {} are in no library that fits them, and Numba, which would compile them, is not installed: after an "
    "update run `pip install -e .` again in minihuman's folder; for kernels that you write, `pip install numba`"
)

int64: Any = np.int64  # for variables whose first values say too little, and constants that are to be as any number

F = TypeVar("F", bound=Callable[..., Any])

_HOLD_GIL: dict[str, Any] = {"_nrt": False}  # Numba counts no references to arrays
_NOGIL: dict[str, Any] = _HOLD_GIL | {"nogil": True}


KERNELS: dict[str, tuple[Any, KernelSource]] = {}  # what Python calls, by name


def kernel(
    *signatures: str, only: bool = False, nogil: bool = False, hold_gil: bool = False, **variables: Any
) -> Callable[[F], F]:
    """Return a decorator that compiles a function for calls from Python.

    Args:
        signatures: the return and argument types with which Python calls it, in Numba's notation. A function without
            signatures is in no library: Numba compiles it for the arguments of each call.
        only: whether kernels that call the function convert their arguments to one of the signatures, too.
        nogil: whether to release the interpreter lock while the function runs. It must make no arrays; references to
            its arguments are not counted.
        hold_gil: like ``nogil``, but for a call so short that releasing the lock would take longer than the call.
        variables: NumPy types of variables whose first value does not determine their type.
    """
    if nogil:
        options = _NOGIL
    elif hold_gil:
        options = _HOLD_GIL
    else:
        options = {}

    def register(function: F) -> F:
        source = KernelSource(function, options, variables, signatures, only)
        library = _library()
        implementation: Any
        if library is None:
            implementation = function
        else:
            implementation = library.entry(source) or LateKernel(source)
        compiled = _compile_or_keep(implementation, partial(_compiled, source))
        KERNELS[source.name] = compiled, source
        return cast(F, compiled)

    return register


def device_function(
    signature: str | None = None, *, nogil: bool = False, force_inline: bool = False, **variables: Any
) -> Callable[[F], F]:
    """Return a decorator that compiles a function for calls from kernels only, without an entry point for Python.

    An entry point would have to be compiled too. Python must not call the function: the process would crash. A function
    that a layout written in Python may call is a kernel.

    Args:
        signature: the return and argument types in Numba's notation; None compiles it for the arguments of each call.
        nogil: as in `kernel`.
        force_inline: whether the machine code is always copied into the caller.
        variables: as in `kernel`.
    """
    options = {"no_cpython_wrapper": True, "forceinline": force_inline} | (_NOGIL if nogil else {})
    signatures = (signature,) if signature else ()
    return lambda function: _compile_or_keep(
        function, partial(_compiled, KernelSource(function, options, variables, signatures, only=bool(signature)))
    )


def inline(function: F) -> F:
    """Decorate a function of a line or two, whose code is inserted into each kernel that calls it."""
    return cast(F, _compile_or_keep(function, partial(_compiled, KernelSource(function, {"inline": "always"}))))


def llvm_function(write: Callable[..., Any], plain: F, *, counts: bool) -> F:
    """Make a function for kernels whose LLVM instructions ``write`` emits. Without compilation, ``plain`` runs instead.

    Args:
        write: a function that takes LLVM's builder and, for each argument, its kind and value: "array" and an
            `ArrayStart`, or "int64" or "float64" and LLVM's value. If ``counts`` is true, it returns LLVM's value of
            an int64.
        plain: the Python function that does the same without compilation.
        counts: whether the function returns a whole number; otherwise it returns nothing.
    """
    return cast(F, _compile_or_keep(plain, lambda: _import_compiler(plain).llvm_function(write, plain, counts=counts)))


def array_at(kind: type[np.generic]) -> Callable[[int, int], NDArray[Any]]:
    """Make a function for kernels that returns the array of a given length that begins at a memory address.

    With it, one table of whole numbers can hold the addresses of any number of arrays. The writer of the table must
    keep the arrays alive.
    """

    def plain(address: int, count: int) -> NDArray[Any]:
        size = np.dtype(kind).itemsize * int(count)
        return np.ndarray((count,), kind, memoryview((ctypes.c_byte * size).from_address(int(address))))

    return cast(
        Callable[[int, int], NDArray[Any]], _compile_or_keep(plain, lambda: _import_compiler(plain).array_at(kind))
    )


def _compile_or_keep(plain: Any, compile_function: Callable[[], Any]) -> Any:
    """Return the plain function if there is a library or compilation is off, else what ``compile_function`` returns.

    With a library, ``compile_function`` is recorded for kernels that are compiled later.
    """
    if _library() is None:
        if _is_compiling():
            return compile_function()
        return plain
    COMPILERS[id(plain)] = plain, compile_function
    return plain


@cache
def _compiled(source: KernelSource) -> Any:
    return _import_compiler(source.function).compiled(source)


def _is_compiling() -> bool:
    return os.environ.get("NUMBA_DISABLE_JIT", "0") == "0"


def _import_compiler(function: Any) -> Any:
    """Return the module that compiles kernels; raise MinihumanError if Numba is not installed."""
    try:
        from minihuman.worlds.build import compilation
    except ImportError as error:
        raise MinihumanError(NO_COMPILER.format(getattr(function, "__module__", "the worlds"))) from error
    if str(getattr(function, "__module__", "")).startswith("minihuman.") and "MINIHUMAN_KERNELS" not in os.environ:
        _announce()
    return compilation


_announce = cache(lambda: LOG.warning(COMPILE_NOTICE))  # once; Python shows it on stderr without any logging set up


class LateKernel:
    """A kernel that is not in the library, such as a user's: Numba compiles it on its first call."""

    def __init__(self, source: KernelSource) -> None:
        self.source = source

    def __call__(self, *arguments: Any) -> Any:
        """Compile the kernel if necessary, and call it from Python."""
        return _compiled(self.source)(*arguments)


def _make_array(data: bytearray, kind: int, *shape: int) -> NDArray[Any]:
    return np.ndarray(shape, KINDS[kind], data)


API_OBJECTS: tuple[Any, ...] = (
    *(None, True, False, np.ndarray, _make_array),
    *(np.dtype(kind) for kind in KINDS),
)


class _Method(ctypes.Structure):
    _fields_ = (("name", ctypes.c_char_p), ("call", ctypes.c_void_p), ("flags", ctypes.c_int), ("doc", ctypes.c_char_p))


class KernelLibrary:
    """A shared library of kernels, built by ``kernel_build``.

    Each kernel is a C function that Python calls like a built-in function. The library does not link to Python or
    NumPy; it finds their functions in a table of addresses.
    """

    def __init__(self, path: Path, numbers: Mapping[str, int], count: int) -> None:
        """Load the library.

        Args:
            path: the library's file.
            numbers: the number of each kernel to be used, by its name.
            count: the number of kernels in the library.

        Raises:
            OSError: if the library was built for another machine, or cannot be read.
        """
        self._code = ctypes.PyDLL(str(path))
        if not self._code.runs_here():
            raise OSError(f"{path.name} is for newer processors")
        self.numbers = numbers
        self.has_all = len(numbers) == count
        self._references: list[Any] = []
        table: Any = [ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value for name in API_FUNCTIONS]
        table += map(id, API_OBJECTS)
        (ctypes.c_void_p * len(table)).in_dll(self._code, "api")[:] = table
        self._refusals = (ctypes.c_void_p * count).in_dll(self._code, "refusals")
        self._new = ctypes.pythonapi.PyCFunction_NewEx
        self._new.argtypes = ctypes.c_void_p, ctypes.c_void_p, ctypes.py_object
        self._new.restype = ctypes.py_object

    def entry(self, source: KernelSource) -> Callable[..., Any] | None:
        """Return the function that Python calls for a kernel, or None if the library does not have the kernel."""
        number = self.numbers.get(source.name)
        if number is None:
            return None
        function = source.function
        address = ctypes.cast(getattr(self._code, f"kernel_{number}"), ctypes.c_void_p).value
        method = _Method(function.__name__.encode(), address, 0x80, (function.__doc__ or "").encode())  # METH_FASTCALL
        entry_point: Callable[..., Any] = self._new(ctypes.addressof(method), None, function.__module__)
        retry = partial(_retry_converted, source, entry_point)  # called if an argument is of a wrong type
        self._refusals[number] = id(retry)
        self._references += method, retry
        return entry_point


def _retry_converted(source: KernelSource, entry: Callable[..., Any], *arguments: Any) -> Any:
    """Call a kernel again with arguments converted to the types it takes, such as NumPy's numbers to Python's.

    Raises:
        TypeError: if no argument needed a conversion, so that the call cannot succeed.
    """
    converted = [_convert_argument(argument) for argument in arguments]
    if all(before is after for before, after in zip(arguments, converted, strict=True)):
        kinds = ", ".join(
            f"{argument.dtype}{argument.shape}" if isinstance(argument, np.ndarray) else repr(argument)
            for argument in arguments
        )
        raise TypeError(f"{source.name} takes {' or '.join(source.signatures)}, not ({kinds})")
    return entry(*converted)


def _convert_argument(value: Any) -> Any:
    """Return an argument in a form that kernels take: a plain number, or a plain array of the usual byte order."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        usual = np.dtype(value.dtype.name)
        if value.dtype is usual and type(value) is np.ndarray:
            return value
        return np.asarray(value).view(usual)
    return value


@cache
def _library() -> KernelLibrary | None:
    """Load the library beside this module.

    Return None if none fits the sources and this machine, or if the environment turns the library off.
    """
    if not _is_compiling() or os.environ.get("MINIHUMAN_KERNELS") == "jit":
        return None
    return load_library(LIBRARY_FOLDER)


def load_library(folder: Path) -> KernelLibrary | None:
    """Return a folder's library with the kernels whose sources are unchanged; None if none fits this machine."""
    manifest = read_manifest(folder)
    if manifest is None:
        return None
    numbers = number_fitting_kernels(manifest)
    if not numbers:
        return None
    for file in manifest["files"]:
        if file["runs on"] == HERE:
            with suppress(OSError):
                return KernelLibrary(folder / file["file"], numbers, len(manifest["kernels"]))
    return None
