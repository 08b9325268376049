"""Compiled rules on disk and in memory: object files in the user's cache, loaded through llvmlite and without Numba.

A file is named by the digest of everything from which it was made. A file that does not match the digest in it, or that
does not belong to the user, is treated as missing.
"""

import ctypes
import hashlib
import os
import stat
import subprocess
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from minihuman.operating_system import is_owned_by_user, replace_file
from minihuman.worlds.grid.own.source_names import TranslationError
from minihuman.worlds.library_manifest import source_digest
from minihuman.worlds.source_digest import import_closure

CACHE_VARIABLE = "MINIHUMAN_WORLDS_CACHE"  # names the cache's folder; an empty text switches the cache off
NO_COMPILER = "Numba, which compiles them, is not installed: pip install 'minihuman-lab[own]'"
MOST_FILES = 256  # in the cache
_MAX_MESSAGE_CHARS = 4000  # of a compiler's error
_SOURCES = ("compiler", "runtime")
_COMPILER = "minihuman.worlds.grid.own.compiler"
_WRITABLE_BY_OTHERS = stat.S_IWGRP | stat.S_IWOTH

CompiledFunction = Callable[[int], int]


class RulesLibrary:
    """The compiled functions of a program.

    Args:
        code: the contents of an object file.
        has_steps: whether it has `reward_and_done`, in addition to the layout.

    Attributes:
        layouts: lays out episodes of the worlds in a table (see `entries`), whose address it takes; a result that is
            not 0 means that the table has a fault.
        steps: runs `reward_and_done` likewise; None if there is none.
        layout_of_one: does the same as ``layouts``, without releasing the interpreter lock.
        step_of_one: does the same as ``steps``, without releasing the interpreter lock.
        step_address: the address of ``steps``, for kernels to call; 0 if there is none.
    """

    def __init__(self, code: bytes, *, has_steps: bool) -> None:
        self._engine = _load_engine(code)
        self.layouts = self._function("minihuman_layouts", ctypes.CFUNCTYPE)
        self.steps = self._function("minihuman_steps", ctypes.CFUNCTYPE) if has_steps else None
        # one world's rules run for less time than releasing the interpreter lock takes
        self.layout_of_one = self._function("minihuman_layouts", ctypes.PYFUNCTYPE)
        self.step_of_one = self._function("minihuman_steps", ctypes.PYFUNCTYPE) if has_steps else None
        self.step_address: int = self._engine.get_function_address("minihuman_steps") if has_steps else 0

    def _function(self, name: str, kind: Any) -> CompiledFunction:
        """Return a compiled function by its name, as the ctypes ``kind``; raise OSError if there is none."""
        address = self._engine.get_function_address(name)
        if address == 0:
            raise OSError(f"the compiled rules have no {name}")
        function: CompiledFunction = kind(ctypes.c_int64, ctypes.c_int64)(address)
        return function


def _load_engine(code: bytes) -> Any:
    """Return an LLVM engine that has loaded the contents of an object file; it must live as long as its functions."""
    llvm = _llvm()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    return engine


@cache
def _llvm() -> Any:
    """Import and return LLVM's binding."""
    from minihuman.worlds.build.loading import llvm_binding  # it comes with Numba, and loads in a twentieth of a second

    return llvm_binding()


def can_load() -> bool:
    """Return whether llvmlite, which loads compiled rules, is installed, and kernels are not switched off."""
    return os.environ.get("NUMBA_DISABLE_JIT", "0") == "0" and find_spec("llvmlite") is not None


_LIBRARIES: dict[str, RulesLibrary] = {}


def find_library(text: str, *, has_steps: bool) -> RulesLibrary | None:
    """Return the compiled form of translated source from memory or the user's cache; None if it is in neither.

    ``has_steps`` says whether the source has `reward_and_done`.
    """
    if not can_load():
        return None
    key = _name_entry(text)
    if key not in _LIBRARIES:
        code = _read_cached(key)
        if code is None:
            return None
        _LIBRARIES[key] = RulesLibrary(code, has_steps=has_steps)
    return _LIBRARIES[key]


def compile_library(text: str, *, has_steps: bool) -> RulesLibrary:
    """Return the compiled form of translated source, compiling it if it is not in the cache.

    ``has_steps`` says whether the source has `reward_and_done`.

    Raises:
        TranslationError: if Numba is missing, or the source does not compile; in the second case, the message begins
            with ``LINE`` and the line of the translated source.
    """
    library = find_library(text, has_steps=has_steps)
    if library is not None:
        return library
    if not can_load() or find_spec("numba") is None:
        raise TranslationError(NO_COMPILER)
    # LLVM code is optimised once, in the end
    environment = {**os.environ, "MINIHUMAN_BUILDING": "1", "NUMBA_OPT": "0"}
    environment["PYTHONPATH"] = os.pathsep.join([str(Path(__file__).parents[4]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", _COMPILER]
    completed = subprocess.run(command, input=text.encode(), capture_output=True, env=environment, check=False)
    if completed.returncode:
        raise TranslationError(completed.stderr.decode(errors="replace").strip()[-_MAX_MESSAGE_CHARS:])
    key = _name_entry(text)
    _write_cached(key, completed.stdout)
    _LIBRARIES[key] = RulesLibrary(completed.stdout, has_steps=has_steps)
    return _LIBRARIES[key]


def _name_entry(text: str) -> str:
    """Return the cache key of translated source, which depends on the machine and our own sources, too."""
    llvm = _llvm()
    machine = f"{llvm.get_process_triple()} {llvm.get_host_cpu_name()} {llvm.get_host_cpu_features().flatten()}"
    return hashlib.sha256("\n".join([text, machine, _sources_digest()]).encode()).hexdigest()[:40]


@cache
def _sources_digest() -> str:
    """Return the digests of all modules that the compiler and the runtime import."""
    paths = import_closure(*(f"minihuman.worlds.grid.own.{name}" for name in _SOURCES))
    return " ".join(source_digest(path) for path in paths)


def cache_folder() -> Path | None:
    """Return the folder of the user's compiled rules; None if the cache is switched off or there is no home folder."""
    override = os.environ.get(CACHE_VARIABLE)
    if override is not None:
        return Path(override).absolute() if override else None
    try:
        if sys.platform == "win32":
            return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local") / "minihuman" / "worlds"
        if sys.platform == "darwin":
            return Path.home() / "Library" / "Caches" / "minihuman" / "worlds"
        xdg_cache = Path(os.environ.get("XDG_CACHE_HOME", ""))
        return (xdg_cache if xdg_cache.is_absolute() else Path.home() / ".cache") / "minihuman" / "worlds"
    except RuntimeError:  # no home
        return None


def _read_cached(key: str) -> bytes | None:
    """Return the contents of an object file in the user's cache; None if it is absent, damaged or not private."""
    folder = cache_folder()
    if folder is None or not _is_private(folder):
        return None
    path = folder / f"{key}.o"
    try:
        if not _is_private(path):
            return None
        digest, _, code = path.read_bytes().partition(b"\n")
    except OSError:
        return None
    if hashlib.sha256(code).hexdigest().encode() != digest:
        return None
    with suppress(OSError):
        os.utime(path)  # marks it as used: the files that are unused for longest are removed first
    return code


def _write_cached(key: str, code: bytes) -> None:
    """Write an object file into the user's cache, if that is on and private, and remove files unused for longest.

    ``key`` is the cache key and ``code`` the file's contents.
    """
    folder = cache_folder()
    if folder is None:
        return
    with suppress(OSError):
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not _is_private(folder):
            return
        with tempfile.TemporaryDirectory(dir=folder, prefix=".") as scratch:
            new = Path(scratch, "new")
            new.touch(mode=0o600)
            new.write_bytes(hashlib.sha256(code).hexdigest().encode() + b"\n" + code)
            replace_file(new, folder / f"{key}.o")
        files = sorted(folder.glob("*.o"), key=lambda path: path.stat().st_mtime)
        for path in files[:-MOST_FILES]:
            path.unlink(missing_ok=True)


def _is_private(path: Path) -> bool:
    """Return whether a file or folder is safe to run code from: the user's own, not a link, writable by no one else."""
    try:
        status = path.lstat()
    except OSError:
        return False
    if stat.S_ISLNK(status.st_mode):
        return False
    is_writable_by_others = sys.platform != "win32" and bool(status.st_mode & _WRITABLE_BY_OTHERS)
    return is_owned_by_user(status) and not is_writable_by_others
