"""The library of compiled worlds of the sources that are tested, built where there is none: once, before all tests."""

import fcntl
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from minihuman.worlds.kernels import LIBRARY_FOLDER, load_library

ENOUGH = 80  # kernels that fit


def build_worlds() -> None:
    """Build it, unless nothing is to be compiled ahead or another process does so just now."""
    if {"NUMBA_DISABLE_JIT", "MINIHUMAN_KERNELS"} & os.environ.keys():
        return
    library = load_library(LIBRARY_FOLDER)
    if library is not None and len(library.numbers) >= ENOUGH:  # compiling a few is quicker
        return
    with Path(tempfile.gettempdir(), f"minihuman-build-{os.getuid()}").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run([sys.executable, "-m", "kernel_build", "--native", "--stale"], check=True)
