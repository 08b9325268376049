"""The page's WebAssembly modules: built from the kernels, with a manifest of what is in them and what made them.

From LLVM code to modules and libraries: LLVM's back ends come with llvmlite, the linkers with lld or ziglang.
"""

import hashlib
import inspect
import json
import os
import re
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

import llvmlite
import llvmlite.binding as llvm
import numba

from kernel_build.entries import compile_for, results_of, write_table_entry
from minihuman.errors import MinihumanError
from minihuman.worlds.build.exports import EXPORTS, NUMBER
from minihuman.worlds.kernels import KERNELS
from minihuman.worlds.source_digest import kernels_digest

_STACK_BYTES = 1 << 18
_INSTEAD = {  # the system's own linkers
    "ld.lld": ("ld", "-shared", "-z", "noexecstack", "--strip-all"),
    "ld64.lld": ("cc", "-dynamiclib", "-Wl,-undefined,dynamic_lookup"),
}
_EXPORT = {"wasm-ld": "--export=", "lld-link": "/export:"}  # other linkers export whatever is not internal
_RESHAPE = """
define internal i32 @numba_attempt_nocopy_reshape(
    i64, ptr, ptr, i64 %count, ptr %extents, ptr %strides, i64 %size, i32) {
entry:
  br label %test
test:
  %left = phi i64 [ %count, %entry ], [ %axis, %next ]
  %stride = phi i64 [ %size, %entry ], [ %wider, %next ]
  %more = icmp sgt i64 %left, 0
  br i1 %more, label %next, label %end
next:
  %axis = sub i64 %left, 1
  %to = getelementptr i64, ptr %strides, i64 %axis
  store i64 %stride, ptr %to
  %from = getelementptr i64, ptr %extents, i64 %axis
  %extent = load i64, ptr %from
  %wider = mul i64 %stride, %extent
  br label %test
end:
  ret i32 1
}
"""  # of a contiguous array, as all in kernels are


_COUNTING = """
define void @NRT_incref(ptr %.1) {
  ret void
}
define void @NRT_decref(ptr %.1) {
  ret void
}
"""  # of references: kernels of the page own nothing


class BuildError(MinihumanError, RuntimeError):
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


_PAGE_OPTIONS = (
    *("--no-entry", "--strip-all", "--stack-first", "-z", f"stack-size={_STACK_BYTES}"),
    *("--export=__heap_base", "--initial-memory=1048576"),
)
_PLAIN = "+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals"
PAGE = Target("wasm32-unknown-unknown", "", _PLAIN, "wasm-ld", _PAGE_OPTIONS, ".wasm")
PAGE_SIMD = Target("wasm32-unknown-unknown", "", f"{_PLAIN},+simd128", "wasm-ld", _PAGE_OPTIONS, ".simd.wasm")


def linker_version(target: Target) -> str | None:
    """What the linker calls itself; None where there is none."""
    command = _linker(target)
    if command is None:
        return None
    return subprocess.run([*command, "--version"], capture_output=True, text=True, check=True).stdout.strip()


def link(codes: Sequence[str], names: Sequence[str], target: Target) -> bytes:
    """Make one module of LLVM codes, from which these functions can be called.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    return link_objects([_object(code, target) for code in codes], names, target)


def link_objects(objects: Sequence[bytes], names: Sequence[str], target: Target) -> bytes:
    """The same, of machine code.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    command = _linker(target)
    if command is None:
        raise BuildError(f"{target.linker} was not found on the PATH; install lld, or ziglang from PyPI")
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder, f"{number}.o") for number in range(len(objects))]
        for path, code in zip(paths, objects, strict=True):
            path.write_bytes(code)
        out = Path(folder, "out")
        exported = [f"{_EXPORT[target.linker]}{name}" for name in names if target.linker in _EXPORT]
        output = [f"/out:{out}"] if target.linker == "lld-link" else ["-o", str(out)]
        done = subprocess.run([*command, *exported, *output, *map(str, paths)], capture_output=True, text=True)
        if done.returncode:
            raise BuildError(f"{target.linker} refused: {(done.stderr or done.stdout).strip()[:2000]}")
        return out.read_bytes()


def machine_for(target: Target) -> Any:
    """LLVM's back end for a target."""
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


def retarget(code: str, target: Target, machine: Any) -> str:
    """LLVM code of the machine that compiled it, for a target."""
    code = re.sub(r'target datalayout = ".*"', f'target datalayout = "{machine.target_data}"', code)
    code = re.sub(r'target triple = ".*"', f'target triple = "{target.triple}"', code)
    code = re.sub(r'"(target-cpu|target-features|tune-cpu)"="[^"]*"', "", code)
    return re.sub(r"^declare [^@]*@numba_attempt_nocopy_reshape\(.*$", lambda _: _RESHAPE, code, flags=re.M)


def _object(code: str, target: Target) -> bytes:
    machine = machine_for(target)
    return bytes(machine.emit_object(llvm.parse_assembly(retarget(code, target, machine))))


@cache
def _linker(target: Target) -> tuple[str, ...] | None:
    """The command that links for a target, but for names and files."""
    if path := shutil.which(target.linker):
        return path, *target.options
    if find_spec("ziglang") is not None and target.linker != "ld64.lld":
        return sys.executable, "-m", "ziglang", target.linker, *target.options
    first, *options = _INSTEAD.get(target.linker, ("",))
    return (path, *options) if (path := shutil.which(first)) else None


MANIFEST = "manifest.json"
# code for the machine's first processor: what is built is the same wherever it is
PORTABLE = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
_TARGETS: dict[str, tuple[Target, ...]] = {"grid": (PAGE,), "first_person": (PAGE, PAGE_SIMD)}


def build_page_modules(folder: Path) -> dict[str, Any]:
    """Write the modules and their manifest into a folder, and return the manifest.

    Raises:
        BuildError: if Numba compiles for this machine's own processor, not as in `PORTABLE`, or there is no linker.
    """
    if any(os.environ.get(name) != value for name, value in PORTABLE.items()):
        raise BuildError("build the page modules with `python -m kernel_build`, which sets Numba's target")
    folder.mkdir(parents=True, exist_ok=True)
    modules: dict[str, Any] = {}
    for name, exports in EXPORTS.items():
        lowered = {name: _lower(name, kernel) for name, kernel in exports.items()}
        codes = [code for _, both in lowered.values() for code in both]
        files = []
        for target in _TARGETS[name]:
            code = link([_COUNTING, *codes], list(lowered), target)
            (folder / f"{name}{target.suffix}").write_bytes(code)
            file = {"file": f"{name}{target.suffix}", "simd": target is PAGE_SIMD, "bytes": len(code)}
            files.append(file | {"sha256": hashlib.sha256(code).hexdigest()})
        modules[name] = {"files": files, "functions": {name: about for name, (about, _) in lowered.items()}}
    manifest = {
        "sources": kernels_digest(),
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "linker": linker_version(PAGE),
        "modules": modules,
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8", newline="\n")
    return manifest


def _lower(name: str, kernel: Any) -> tuple[dict[str, Any], tuple[str, str]]:
    """What callers of a kernel have to know of its table; and LLVM codes, of the kernel and of the way into it."""
    written = next(each for found, each in KERNELS.values() if found is kernel)
    overload = compile_for(kernel, written, written.signatures[0])
    arguments = list(zip(inspect.signature(written.function).parameters, overload.arguments, strict=True))
    entry = write_table_entry(name, overload, [parameter == NUMBER for parameter, _ in arguments])
    about = {
        "arguments": [
            {"name": name, "kind": _kind(kind), "dimensions": getattr(kind, "ndim", 0)}
            for name, kind in arguments
            if name != NUMBER
        ],
        "results": [_kind(kind) for kind in results_of(overload)],
    }
    return about, (overload.code, entry)


def _kind(numba_type: Any) -> str:
    """NumPy's name of what an array is made of; of a number whether it is whole."""
    return str(getattr(numba_type, "dtype", "float64" if str(numba_type) == "float64" else "int64"))


if __name__ == "__main__":
    for _module in build_page_modules(Path(sys.argv[1]))["modules"].values():
        for _file in _module["files"]:
            print(f"{_file['file']}: {_file['bytes'] / 1000:.1f} kB")
