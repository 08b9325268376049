"""Build what the worlds are compiled to: the page's modules, or with ``--native`` the library that Python calls.

``python -m kernel_build [--native [--all] [--stale]] [FOLDER]``; without a folder, where they are looked for.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import llvmlite.binding as llvm

import minihuman
from kernel_build import compiler_digest
from minihuman.worlds.kernels import HERE, LIBRARY_FOLDER, MANIFEST, load_library

# Numba compiles for the oldest of the processors, and as any process with this seed
_NUMBA = {"NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0", "MINIHUMAN_KERNELS": "jit", "MINIHUMAN_BUILDING": "1"}


def main() -> None:
    """Build, each level of processors in a process of its own: Numba is told the level before it is imported."""
    parser = argparse.ArgumentParser("python -m kernel_build", description="Compile the worlds.")
    parser.add_argument("--native", action="store_true", help="The library that Python calls, for this machine.")
    parser.add_argument("--all", action="store_true", help="With --native: for every machine it can be built for.")
    parser.add_argument("--stale", action="store_true", help="With --native: only if what is there does not fit.")
    parser.add_argument("folder", nargs="?", type=Path, help="The folder to write to.")
    read = parser.parse_args()
    folder = read.folder or (LIBRARY_FOLDER if read.native else Path(minihuman.__file__).parent / "web/page/worlds")
    if read.stale and _is_fresh(folder):
        return
    module = f"kernel_build.{'native_library' if read.native else 'page_modules'}"
    features = llvm.get_host_cpu_features()
    newer = all(features.get(name) for name in ("avx2", "bmi2", "fma", "movbe"))
    levels = ["generic"]
    if read.native and (read.all or HERE[1] == "x86_64"):
        levels = ["x86-64-v3", "x86-64-v2", "generic"] if read.all else ["x86-64-v3" if newer else "x86-64-v2"]
    for level in levels:
        command = [sys.executable, "-m", module, str(folder), *(["--all"] if read.all else [])]
        subprocess.run(command, env=os.environ | _NUMBA | {"NUMBA_CPU_NAME": level}, check=True)


def _is_fresh(folder: Path) -> bool:
    """Whether a library of all kernels as they are is there, by this version of what builds it."""
    there = load_library(folder)
    if there is None or not there.has_all:
        return False
    built_by: object = json.loads((folder / MANIFEST).read_bytes()).get("compiler")
    return built_by == compiler_digest()


if __name__ == "__main__":
    main()
