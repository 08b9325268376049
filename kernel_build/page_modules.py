"""The page's WebAssembly modules: built from the kernels, with a manifest of what is in them and what made them."""

import hashlib
import inspect
import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba

from kernel_build.bitcode import ENVIRONMENT
from kernel_build.entries import compile_for, results_of, retarget, write_table_entry
from kernel_build.linking import BuildError, Target, link_objects, linker_version, machine_for
from minihuman.worlds.build.exports import EXPORTS, NUMBER
from minihuman.worlds.kernels import KERNELS
from minihuman.worlds.source_digest import kernels_digest

_STACK_BYTES = 1 << 18
_COUNTING = """
define void @NRT_incref(ptr %.1) {
  ret void
}
define void @NRT_decref(ptr %.1) {
  ret void
}
"""  # of references: kernels of the page own nothing

_PAGE_OPTIONS = (
    *("--no-entry", "--strip-all", "--stack-first", "-z", f"stack-size={_STACK_BYTES}"),
    *("--export=__heap_base", "--initial-memory=1048576"),
)
_PLAIN = "+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals"
PAGE = Target("wasm32-unknown-unknown", "", _PLAIN, "wasm-ld", _PAGE_OPTIONS, ".wasm")
PAGE_SIMD = Target("wasm32-unknown-unknown", "", f"{_PLAIN},+simd128", "wasm-ld", _PAGE_OPTIONS, ".simd.wasm")


def link(codes: Sequence[str], names: Sequence[str], target: Target) -> bytes:
    """Make one module of LLVM codes, from which these functions can be called.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    return link_objects([_object(code, target) for code in codes], names, target)


def _object(code: str, target: Target) -> bytes:
    machine = machine_for(target)
    return bytes(machine.emit_object(llvm.parse_assembly(retarget(code, target, machine))))


MANIFEST = "manifest.json"
_TARGETS: dict[str, tuple[Target, ...]] = {"grid": (PAGE,), "first_person": (PAGE, PAGE_SIMD)}


def build_page_modules(folder: Path) -> dict[str, Any]:
    """Write the modules and their manifest into a folder, and return the manifest.

    Raises:
        BuildError: if Numba compiles for this machine's own processor, not as in `ENVIRONMENT`, or there is no linker.
    """
    if any(os.environ.get(name) != value for name, value in ENVIRONMENT.items()):
        raise BuildError("build the page modules with `python -m kernel_build`, which sets Numba's target")
    folder.mkdir(parents=True, exist_ok=True)
    modules: dict[str, Any] = {}
    for name, exports in EXPORTS.items():
        lowered = {name: _lower(name, kernel) for name, kernel in exports.items()}
        codes = [code for _, code_pair in lowered.values() for code in code_pair]
        files = []
        for target in _TARGETS[name]:
            code = link([_COUNTING, *codes], list(lowered), target)
            (folder / f"{name}{target.suffix}").write_bytes(code)
            file = {"file": f"{name}{target.suffix}", "simd": target is PAGE_SIMD, "bytes": len(code)}
            files.append(file | {"sha256": hashlib.sha256(code).hexdigest()})
        modules[name] = {"files": files, "functions": {name: description for name, (description, _) in lowered.items()}}
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
    """Return what callers of a kernel must know of its table, and the LLVM codes of the kernel and its entry."""
    source = next(registered_source for registered, registered_source in KERNELS.values() if registered is kernel)
    overload = compile_for(kernel, source, source.signatures[0])
    arguments = list(zip(inspect.signature(source.function).parameters, overload.arguments, strict=True))
    entry = write_table_entry(name, overload, [parameter == NUMBER for parameter, _ in arguments])
    description = {
        "arguments": [
            {"name": name, "kind": _kind(kind), "dimensions": getattr(kind, "ndim", 0)}
            for name, kind in arguments
            if name != NUMBER
        ],
        "results": [_kind(kind) for kind in results_of(overload)],
    }
    return description, (overload.code, entry)


def _kind(numba_type: Any) -> str:
    """Name the type of an array's numbers as NumPy does; of a number, whether it is whole."""
    return str(getattr(numba_type, "dtype", "float64" if str(numba_type) == "float64" else "int64"))


if __name__ == "__main__":
    for _module in build_page_modules(Path(sys.argv[1]))["modules"].values():
        for _file in _module["files"]:
            print(f"{_file['file']}: {_file['bytes'] / 1000:.1f} kB")
