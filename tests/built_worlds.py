"""The library of compiled worlds of the sources that are tested, built where there is none: once, before all tests."""

import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from minihuman.worlds.kernels import load_library
from minihuman.worlds.library_manifest import LIBRARY_FOLDER

ENOUGH = 80  # kernels that fit


def build_worlds() -> None:
    """Build it, unless nothing is to be compiled ahead or another process does so just now."""
    if {"NUMBA_DISABLE_JIT", "MINIHUMAN_KERNELS"} & os.environ.keys():
        return
    library = load_library(LIBRARY_FOLDER)
    if library is not None and (library.has_all or (len(library.numbers) >= ENOUGH and _takes_minutes())):
        return
    with Path(tempfile.gettempdir(), f"minihuman-build-{os.getuid()}").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run([sys.executable, "-m", "kernel_build", "--native", "--stale"], check=True)


def _takes_minutes() -> bool:
    """Say whether Numba would compile all kernels anew, as after an edit: compiling a few as needed is quicker."""
    from kernel_build.bitcode import read_committed_manifest  # llvmlite is needed where something is built

    return read_committed_manifest() is None
