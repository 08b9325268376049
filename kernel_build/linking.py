"""From machine code to libraries and the page's modules: targets, LLVM's back ends for them, and linkers.

The back ends come with llvmlite, the linkers with lld, the system or ziglang. Neither Numba nor NumPy is imported here.
"""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

_INSTEAD = {  # the system's own linkers
    "ld.lld": ("ld", "-shared", "-z", "noexecstack", "--strip-all"),
    "ld64.lld": ("cc", "-dynamiclib", "-Wl,-undefined,dynamic_lookup"),
}
_EXPORT = {"wasm-ld": "--export=", "lld-link": "/export:"}  # other linkers export whatever is not internal


class BuildError(RuntimeError):
    """A tool that builds is missing, or refused."""


@dataclass(frozen=True, slots=True)
class Target:
    """What code is made for.

    Args:
        triple: LLVM's name of the machine.
        cpu: LLVM's name of the oldest processor it runs on; "" for the machine's first.
        features: LLVM's names of instructions beside those, each with a plus.
        linker: the name of lld that makes its modules.
        options: what the linker is told, beside the names of functions and files.
        suffix: of the file.
    """

    triple: str
    cpu: str
    features: str
    linker: str
    options: tuple[str, ...]
    suffix: str


def linker_version(target: Target) -> str | None:
    """Return what the linker calls itself; None where there is none."""
    command = find_linker(target)
    if command is None:
        return None
    return subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout.strip()


def link_objects(objects: Sequence[bytes], names: Sequence[str], target: Target) -> bytes:
    """Make one library or module of machine code, from which these functions can be called.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    command = find_linker(target)
    if command is None:
        raise BuildError(f"{target.linker} was not found on the PATH; install lld, or ziglang from PyPI")
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{number}.o") for number in range(len(objects))]
        for path, code in zip(paths, objects, strict=True):
            path.write_bytes(code)
        out = Path(folder, "out")
        exported = [f"{_EXPORT[target.linker]}{name}" for name in names if target.linker in _EXPORT]
        if target.linker == "lld-link":
            output = [f"/out:{out}"]
        else:
            output = ["-o", str(out)]
        completed = subprocess.run([*command, *exported, *output, *map(str, paths)], capture_output=True, text=True)
        if completed.returncode:
            raise BuildError(f"{target.linker} refused: {(completed.stderr or completed.stdout).strip()[:2000]}")
        return out.read_bytes()


def machine_for(target: Target) -> Any:
    """Return LLVM's back end for a target."""
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    llvm.initialize_native_asmparser()
    return llvm.Target.from_triple(target.triple).create_target_machine(
        cpu=target.cpu,
        features=target.features,
        opt=3,
        reloc="static" if "wasm" in target.triple else "pic",
        codemodel="default",
    )


@cache
def find_linker(target: Target) -> tuple[str, ...] | None:
    """Return the command that links for a target, but for names and files; None where there is none."""
    if path := shutil.which(target.linker):
        return path, *target.options
    if find_spec("ziglang") is not None and target.linker != "ld64.lld":
        return sys.executable, "-m", "ziglang", target.linker, *target.options
    first, *options = _INSTEAD.get(target.linker, ("",))
    if path := shutil.which(first):
        return (path, *options)
    return None
