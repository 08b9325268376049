"""The one way to Numba: decorators that compile kernels, and the cache of compiled machine code.

Cached code is found by a digest of everything it was made of, so it is never stale; a platform wheel ships code for
x86-64-v3 (nearly every processor since 2013) under the same keys. Nothing is fused or reordered, so a kernel computes
the same on every machine; with NUMBA_DISABLE_JIT=1 it runs as the plain Python in which it is written.

No other module imports Numba or llvmlite's binding. What is used of Numba beyond its documented interface, and what
breaks when it changes:

- `core.caching._Cache` (base of `KernelCache`), `CompileResult._rebuild`, ``data._reduce()``, `core.serialize.dumps`,
  ``dispatcher._cache``, `library.has_dynamic_globals`, ``codegen.magic_tuple()``, ``target_context.refresh()``,
  `core.sigutils.normalize_signature`: the cache on disk. Without them kernels still compile, in each process anew.
- `core.config`, `misc.appdirs.AppDirs`: the cache's key and folder.
- `core.event` ("numba:compile" and its ``data["dispatcher"]``): the notice that kernels are being compiled.
- the options ``_nrt``, ``no_cfunc_wrapper``, ``no_cpython_wrapper``: compile time and the cost of a call alone.
- `np.arrayobj.populate_array`, ``context.make_array``, ``array._getvalue()``: `array_at` and `llvm_function`, so all
  of the first-person renderer.
"""

import ctypes
import hashlib
import inspect
import logging
import os
import pickle
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import llvmlite.binding
import numba
import numpy as np
from numba import float64
from numba.core import config, event
from numba.core.caching import _Cache
from numba.core.compiler import CompileResult
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.extending import intrinsic
from numba.misc.appdirs import AppDirs
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from minihuman.worlds.source_digest import module_digest

SHIPPED_CPU = "x86-64-v3"  # LLVM's name of it
SHIPPED_FOLDER = Path(__file__).parent / "compiled"
_INSTRUCTIONS = (
    *("cx16", "popcnt", "sse3", "ssse3", "sse4.1", "sse4.2", "avx", "avx2"),
    *("bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"),
)


def shipped_target(triple: str, features: Mapping[str, bool]) -> tuple[str, str, str] | None:
    """What shipped code for a machine was compiled for, in Numba's words; None where the processor lacks something.

    Args:
        triple: the machine, its system and its ABI.
        features: LLVM's names of instructions, and whether this processor has them.
    """
    if not triple.startswith("x86_64") or not all(features.get(name) for name in _INSTRUCTIONS):
        return None
    return triple, SHIPPED_CPU, ""


int64: Any = numba.int64  # for variables whose first values say too little, and constants that are to be as any number
LOG = logging.getLogger("minihuman")
COMPILE_NOTICE = "compiling the worlds for this machine; this takes some seconds, and only the first time"
CACHE_LIMIT_BYTES = 512 * 1024**2  # when there is more, what was not used for longest is deleted, down to half of it

F = TypeVar("F", bound=Callable[..., Any])

# A division by zero is infinite, as in NumPy: nothing is made to raise it. C calls no kernel.
_KERNEL_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
_HOLD_GIL: dict[str, Any] = {"_nrt": False}
_NOGIL: dict[str, Any] = _HOLD_GIL | {"nogil": True}


def kernel(
    signature: str | None = None, *, nogil: bool = False, hold_gil: bool = False, **variables: Any
) -> Callable[[F], F]:
    """Compile what Python calls; with a signature now, and for nothing else than it.

    Args:
        signature: Numba's words for arguments and result; without one, what it is first called with.
        nogil: It makes no arrays, so it counts no references to those it is given; other threads run meanwhile.
        hold_gil: The same for a call so short that releasing the lock would take longer.
        variables: Numba's types of variables whose first value says too little.
    """
    return _compiled(signature, _NOGIL if nogil else _HOLD_GIL if hold_gil else {}, variables)


def device_function(
    signature: str | None = None, *, nogil: bool = False, force_inline: bool = False, **variables: Any
) -> Callable[[F], F]:
    """Compile what only kernels call, without a way in from Python, which would have to be compiled too.

    Python must not call it: it has no entry, and the process ends. What a layout written in Python may call is a
    kernel. ``force_inline`` always copies the machine code into the caller.
    """
    options = {"no_cpython_wrapper": True, "forceinline": force_inline} | (_NOGIL if nogil else {})
    return _compiled(signature, options, variables)


def inline(function: F) -> F:
    """Compile what is a line or two, as if it were written out in each kernel that calls it."""
    return _compiled(None, {"inline": "always"}, {})(function)


def _compiled(signature: str | None, options: dict[str, Any], variables: dict[str, Any]) -> Callable[[F], F]:
    options = _KERNEL_OPTIONS | options

    def compiled(function: F) -> F:
        dispatcher = numba.njit(locals=variables, **options)(function)
        if not hasattr(dispatcher, "py_func"):
            return function  # NUMBA_DISABLE_JIT
        _announce()
        dispatcher._cache = KernelCache(function, repr((sorted(options.items()), sorted(variables.items(), key=str))))
        if signature is not None:
            dispatcher.compile(signature)
            dispatcher.disable_compile()
        return cast(F, dispatcher)

    return compiled


class ArrayStart(NamedTuple):
    """An array in a kernel that is being compiled: where it starts, in LLVM's words, and of what it is."""

    start: Any
    kind: str  # NumPy's name


def llvm_function(write: Callable[..., Any], plain: F, *, counts: bool) -> F:
    """A function for kernels to call whose LLVM instructions ``write`` adds; it is ``plain`` where nothing is compiled.

    Args:
        write: takes LLVM's builder and, for each argument, its kind and value: "array" and an `ArrayStart`, or "int64"
            or "float64" and LLVM's value. It returns LLVM's value of an int64 if it ``counts``.
        plain: does the same, uncompiled.
        counts: whether a whole number is returned; otherwise it is nothing.
    """
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return plain

    def typed(context: Any, *arguments: Any) -> Any:
        kinds = [
            each if isinstance(each, numba.types.Array) else int64 if isinstance(each, numba.types.Integer) else float64
            for each in arguments
        ]

        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            given = []
            for kind, value in zip(kinds, values, strict=True):
                if isinstance(kind, numba.types.Array):
                    start = context.make_array(kind)(context, builder, value).data
                    given.append(("array", ArrayStart(start, str(kind.dtype))))
                else:
                    given.append((str(kind), value))
            found = write(builder, given)
            return found if counts else context.get_dummy_value()

        return (int64 if counts else numba.void)(*kinds), code

    # Numba asks for names of arguments, one by one
    names = ["context", *list(inspect.signature(plain).parameters)]
    parameters = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in names]
    vars(typed)["__signature__"] = inspect.Signature(parameters)
    return cast(F, intrinsic(typed))


def array_at(kind: type[np.generic]) -> Callable[[int, int], NDArray[Any]]:
    """A function for kernels: from an address and a count to the array of so many numbers that begins there.

    So one table of whole numbers can say where any number of arrays are; its writer keeps them alive.
    """
    size = np.dtype(kind).itemsize

    def plain(address: int, count: int) -> NDArray[Any]:
        return np.ndarray((count,), kind, memoryview((ctypes.c_byte * (size * int(count))).from_address(int(address))))

    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return plain
    array = numba.types.Array(numba.from_dtype(np.dtype(kind)), 1, "C")

    def typed(context: Any, address: Any, count: Any) -> Any:
        def code(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            made = context.make_array(array)(context, builder)
            start = builder.inttoptr(values[0], made.data.type)
            step = context.get_constant(numba.types.intp, size)
            populate_array(made, data=start, shape=values[1:], strides=[step], itemsize=step, meminfo=None)
            return made._getvalue()

        return array(int64, int64), code

    return cast(Callable[[int, int], NDArray[Any]], intrinsic(typed))


class KernelCache(_Cache):
    """One function's machine code on disk, a file for each signature, found by all that the code is made of.

    That is: the sources of the function's module and of every module it imports, here and further on; how it is
    compiled, for which types; Python, Numba, LLVM and NumPy; the processor. So neither an edit nor an upgrade nor
    another machine on the same disk ever finds what is not its own, and nothing needs to be deleted by hand. Numba's
    own cache looks at the function's file alone, and so goes on with what is compiled into it from others.

    Code that came with the package is looked for first; it is found by the same, but for the processor's name.
    """

    def __init__(self, function: Callable[..., Any], options: str) -> None:
        if function.__closure__:
            raise TypeError(f"{function.__qualname__} is nested in a function; define kernels at module level")
        self._name = f"{function.__module__}.{function.__qualname__}"
        self._digest = module_digest(function.__module__)
        self._made_of = f"{self._name} {function.__code__.co_firstlineno} {self._digest} {options}"

    @property
    def cache_path(self) -> str:
        """The folder new code goes to; "" where there is none that can be written to."""
        return str(cache_folder() or "")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for a signature; None where none is kept, or the file is damaged."""
        if self._digest is None:
            return None
        target_context.refresh()  # or what the code refers to may not be there yet
        machine = target_context.codegen().magic_tuple()
        code, where = None, cache_folder()
        if (shipped := _shipped(machine[0])) is not None:
            code = _read(SHIPPED_FOLDER / self._file(sig, shipped))
        if code is None and where is not None:
            path = where / self._file(sig, machine)
            code = _read(path)
            with suppress(OSError):  # perhaps another user's file
                os.utime(path)
        return None if code is None else CompileResult._rebuild(target_context, *pickle.loads(code))

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep new code, unless it holds addresses of this process or the disk does not take it."""
        where = cache_folder()
        if where is None or self._digest is None or data.library.has_dynamic_globals:
            return
        code = dumps(data._reduce())
        try:
            _make_room(where)
            with tempfile.NamedTemporaryFile(dir=where, suffix=".new", delete=False) as file:
                file.write(hashlib.sha256(code).digest() + code)
            os.replace(file.name, where / self._file(sig, data.codegen.magic_tuple()))
        except OSError as error:
            LOG.debug("compiled code of %s is not kept: %s", self._name, error)

    def enable(self) -> None:
        """It always is."""

    def disable(self) -> None:
        """It never is."""

    def flush(self) -> None:
        """Nothing kept is ever stale."""

    def _file(self, sig: Any, machine: tuple[str, ...]) -> str:
        arguments, result = normalize_signature(sig)
        signature = [_spelt(each) for each in (*arguments, result)]
        made_of = f"{self._made_of} {signature} {machine} {_versions()}"
        return f"{self._name.rpartition('.')[2]}-{hashlib.sha256(made_of.encode()).hexdigest()[:24]}.code"


def _read(path: Path) -> bytes | None:
    try:
        data = path.read_bytes()
    except OSError:
        return None
    return data[32:] if hashlib.sha256(data[32:]).digest() == data[:32] else None


@cache
def _shipped(triple: str) -> tuple[str, str, str] | None:
    """What code that came with the package was compiled for; None where there is none that runs here.

    Who tells Numba for which processor to compile gets just that.
    """
    if not SHIPPED_FOLDER.is_dir() or {"NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES"} & os.environ.keys():
        return None
    return shipped_target(triple, llvmlite.binding.get_host_cpu_features())


def _spelt(numba_type: Any) -> str:
    """A type by name; of a named tuple its fields too, which Numba leaves out."""
    inner = [_spelt(each) for each in getattr(numba_type, "types", ())]
    return f"{numba_type} {getattr(numba_type, 'fields', '')} {inner}" if inner else str(numba_type)


@cache
def _versions() -> str:
    """The versions that compiled code depends on, and the options that Numba compiles with."""
    numpy = ".".join(np.__version__.split(".")[:2])
    options = [str(getattr(config, name)) for name in ("OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE", "BOUNDSCHECK")]
    return f"{sys.implementation.cache_tag} {numba.__version__} {llvmlite.__version__} {numpy} {options}"


@cache
def cache_folder() -> Path | None:
    """Where compiled code is kept: NUMBA_CACHE_DIR where that is set, or the user's cache, or beside the worlds.

    None where none of them can be written to; then every process compiles anew.
    """
    users = Path(AppDirs("minihuman", appauthor=False).user_cache_dir)
    chosen, beside = os.environ.get("NUMBA_CACHE_DIR"), Path(__file__).parent / "__pycache__"
    for place in [Path(chosen) / "minihuman"] if chosen else [users, beside]:
        where = place / "kernels"
        try:
            where.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=where).close()
        except OSError:
            continue
        return where
    return None


@cache
def _make_room(where: Path) -> None:
    """Delete what was not used for longest, if there is much; once a process, before it adds to it."""
    found = []
    for path in where.iterdir():
        with suppress(OSError):  # another process may be doing the same
            found.append((path.stat().st_mtime, path.stat().st_size, path))
    left = sum(size for _, size, _ in found)
    if left <= CACHE_LIMIT_BYTES:
        return
    for _, size, path in sorted(found):
        with suppress(OSError):
            path.unlink()
        left -= size
        if left <= CACHE_LIMIT_BYTES / 2:
            return


class _FirstCompile(event.Listener):
    """Calls ``act`` when the first function is compiled, or the first kernel of ``ours``; cached code calls nothing."""

    def __init__(self, act: Callable[[], None], *, ours: bool = False) -> None:
        self._act: Callable[[], None] | None = act
        self._ours = ours

    def on_start(self, event: event.Event) -> None:
        if not self._ours or isinstance(getattr(event.data["dispatcher"], "_cache", None), KernelCache):
            act, self._act = self._act, None
            if act is not None:
                act()

    def on_end(self, event: event.Event) -> None:
        pass


@cache
def _announce() -> None:
    """Log `COMPILE_NOTICE` once, as a warning: Python shows that on stderr without any logging set up."""
    event.register("numba:compile", _FirstCompile(lambda: LOG.warning(COMPILE_NOTICE), ours=True))


@contextmanager
def at_first_compile(act: Callable[[], None]) -> Iterator[None]:
    """Call ``act`` when the first function is compiled meanwhile, before that; cached code calls nothing."""
    with event.install_listener("numba:compile", _FirstCompile(act)):
        yield
