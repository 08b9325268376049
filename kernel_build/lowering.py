"""Lowers all kernels that Python calls to one LLVM module, as bitcode for any machine: Numba's part of a build.

``python -m kernel_build.lowering FOLDER``, with `ENVIRONMENT` set, writes it and its manifest. No machine code was made
from the module before it is written: LLVM's back ends leave instructions of one machine in what they compile.
"""

import hashlib
import json
import lzma
import os
import platform
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba
import numpy as np
from numba.core.registry import cpu_target

from kernel_build import entries
from kernel_build.bitcode import BITCODE, ENVIRONMENT, find_kernel_modules, lowering_digest
from kernel_build.linking import BuildError, Target, machine_for
from minihuman.worlds.build import compilation
from minihuman.worlds.kernels import KERNELS, KernelSource
from minihuman.worlds.library_manifest import API, API_FUNCTIONS, MANIFEST, source_digest
from minihuman.worlds.source_digest import import_closure

# The first release of llvmlite with each LLVM
_FIRST_LLVMLITE = {22: "0.48"}
# Memory for kernels that make arrays: Python's, behind a header that Numba's code reads
_RUNTIME = """
@api = external global [64 x ptr]
@_fltused = global i32 0
define ptr @NRT_Allocate(i64 %size) {
  %place = getelementptr [64 x ptr], ptr @api, i64 0, i64 MALLOC
  %allocate = load ptr, ptr %place
  %start = call ptr %allocate(i64 %size)
  ret ptr %start
}
define void @NRT_Free(ptr %start) {
  %place = getelementptr [64 x ptr], ptr @api, i64 0, i64 FREE
  %free = load ptr, ptr %place
  call void %free(ptr %start)
  ret void
}
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {
  %step = zext i32 %align to i64
  %aligned = add i64 %size, %step
  %all = add i64 %aligned, 48
  %start = call ptr @NRT_Allocate(i64 %all)
  %address = ptrtoint ptr %start to i64
  %after = add i64 %address, 48
  %odd = urem i64 %after, %step
  %more = sub i64 %step, %odd
  %at = add i64 %after, %more
  %data = inttoptr i64 %at to ptr
  store i64 1, ptr %start
  %data_place = getelementptr i8, ptr %start, i64 24
  store ptr %data, ptr %data_place
  %size_place = getelementptr i8, ptr %start, i64 32
  store i64 %size, ptr %size_place
  ret ptr %start
}
define void @NRT_incref(ptr %start) noinline {
  %none = icmp eq ptr %start, null
  br i1 %none, label %end, label %count
count:
  %before = atomicrmw add ptr %start, i64 1 monotonic
  br label %end
end:
  ret void
}
define void @NRT_decref(ptr %start) noinline {
  %none = icmp eq ptr %start, null
  br i1 %none, label %end, label %count
count:
  %before = atomicrmw sub ptr %start, i64 1 acq_rel
  %last = icmp eq i64 %before, 1
  br i1 %last, label %free, label %end
free:
  call void @NRT_Free(ptr %start)
  br label %end
end:
  ret void
}
"""


def import_kernels() -> dict[str, tuple[Any, KernelSource]]:
    """Return every kernel of minihuman that Python calls, by name."""
    for module in find_kernel_modules():
        import_module(module)
    return {name: KERNELS[name] for name in sorted(KERNELS) if KERNELS[name][1].signatures}


def _link_only(library: Any, description: Any, environment: Any) -> Any:
    """Do without machine code for this process: link and optimise, and let something new stand for what is called."""
    library._ensure_finalized()
    return list[Any]().append


def lower_kernels() -> tuple[list[str], list[str]]:
    """Return the names of the kernels, and LLVM codes of all that is in a library."""
    cpu_target.target_context.get_executable = _link_only
    kernels = import_kernels()
    compiled = [
        (
            [entries.compile_for(dispatcher, source, text) for text in source.signatures],
            bool(source.options.get("nogil")),
        )
        for dispatcher, source in kernels.values()
    ]
    codes = [overload.code for overloads, _ in compiled for overload in overloads]
    return list(kernels), [entries.write_python_entries(compiled), *codes]


def link_codes(codes: Sequence[str], kernel_count: int) -> bytes:
    """Return one module of LLVM codes as bitcode, in which only what a library exports has a name."""
    target = Target(llvm.get_process_triple(), "", "", "", (), "")
    machine = machine_for(target)
    runtime = _RUNTIME
    for name, function in (("MALLOC", "PyMem_RawMalloc"), ("FREE", "PyMem_RawFree")):
        runtime = runtime.replace(name, str(API_FUNCTIONS.index(function)))
    first, *other_codes = (entries.retarget(code, target, machine) for code in codes)
    module = llvm.parse_assembly(first)
    for code in (*other_codes, runtime):
        module.link_in(llvm.parse_assembly(code))
    exported = {"api", "refusals", *(f"kernel_{number}" for number in range(kernel_count))}
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and symbol.name not in exported:
            symbol.linkage = "internal"
    pipeline = llvm.create_new_module_pass_manager()
    pipeline.add_global_dead_code_eliminate_pass()
    pipeline.add_strip_symbols_pass()
    pipeline.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    module.verify()
    return bytes(module.as_bitcode())


def write_bitcode(folder: Path) -> dict[str, Any]:
    """Write the module and its manifest into a folder, and return the manifest.

    Raises:
        BuildError: if Numba compiles otherwise than for any machine, or its LLVM's first llvmlite is not known.
    """
    if any(os.environ.get(name) != value for name, value in ENVIRONMENT.items()):
        raise BuildError("lower the kernels with `python -m kernel_build --bitcode`, which sets Numba's target")
    if llvm.llvm_version_info[0] not in _FIRST_LLVMLITE:
        raise BuildError(f"{__file__}: say in which llvmlite LLVM {llvm.llvm_version_info[0]} came first")
    names, codes = lower_kernels()
    code = link_codes(codes, len(names))
    modules = sorted({name.rpartition(".")[0] for name in names})
    needed = {module: import_closure(module, compilation.__name__) for module in modules}
    paths = sorted({path for closure in needed.values() for path in closure})
    manifest = {
        "sha256": hashlib.sha256(code).hexdigest(),
        "llvm": list(llvm.llvm_version_info),
        "llvmlite from": _FIRST_LLVMLITE[llvm.llvm_version_info[0]],
        "written by": {
            "machine": platform.machine(),
            "python": ".".join(platform.python_version_tuple()[:2]),
            "llvmlite": llvmlite.__version__,
            "numba": numba.__version__,
            "numpy": np.__version__,
        },
        "lowering": lowering_digest(),
        "api": API,
        "kernels": names,
        "sources": [[path, source_digest(path)] for path in paths],
        "modules": {module: [paths.index(path) for path in closure] for module, closure in needed.items()},
    }
    folder.mkdir(parents=True, exist_ok=True)
    (folder / BITCODE).write_bytes(lzma.compress(code, preset=9 | lzma.PRESET_EXTREME))
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(part)}" for name, part in manifest.items())
    (folder / MANIFEST).write_text(f"{{\n{lines}\n}}\n", encoding="utf-8", newline="\n")
    return manifest


if __name__ == "__main__":
    write_bitcode(Path(sys.argv[1]))
