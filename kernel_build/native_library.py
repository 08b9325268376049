"""The library of all kernels that Python calls: machine code for several processors, and a manifest of its sources."""

import json
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba.core.registry import cpu_target

from kernel_build import compiler_digest, entries
from kernel_build.page_modules import BuildError, Target, link_objects, machine_for, retarget
from minihuman.worlds.build import compilation
from minihuman.worlds.kernels import (
    API,
    API_FUNCTIONS,
    HERE,
    KERNELS,
    MANIFEST,
    PACKAGE,
    KernelSource,
    source_digest,
)
from minihuman.worlds.source_digest import import_closure

# Memory for kernels that make arrays: Python's, behind a header that Numba's code reads; and how a processor is asked
# what it can
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
# Whether a library is for this processor: which bits cpuid sets says what instructions there are, and xgetbv that the
# system keeps the wide registers. v2 is of 2009 (SSE3, SSSE3, CX16, SSE4.1, SSE4.2, POPCNT), v3 of 2013 (those, FMA,
# MOVBE, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT).
_CPUID = 'call { i32, i32, i32, i32 } asm "cpuid", "={ax},={bx},={cx},={dx},{ax},{cx},~{dirflag},~{fpsr},~{flags}"'
_RUNS_HERE = {
    "generic": """
define i32 @runs_here() {
  ret i32 1
}
""",
    "x86-64-v2": """
define i32 @runs_here() #0 {
  %basic = CPUID(i32 1, i32 0)
  %basic_said = extractvalue { i32, i32, i32, i32 } %basic, 2
  %basic_set = and i32 %basic_said, 9970177
  %basic_fits = icmp eq i32 %basic_set, 9970177
  br i1 %basic_fits, label %yes, label %no
yes:
  ret i32 1
no:
  ret i32 0
}
attributes #0 = { "target-cpu"="x86-64" "target-features"="" }
""",
    "x86-64-v3": """
define i32 @runs_here() #0 {
  %basic = CPUID(i32 1, i32 0)
  %basic_said = extractvalue { i32, i32, i32, i32 } %basic, 2
  %basic_set = and i32 %basic_said, 953692673
  %basic_fits = icmp eq i32 %basic_set, 953692673
  br i1 %basic_fits, label %newer, label %no
newer:
  %newer_set = CPUID(i32 7, i32 0)
  %newer_set_said = extractvalue { i32, i32, i32, i32 } %newer_set, 1
  %newer_set_set = and i32 %newer_set_said, 296
  %newer_set_fits = icmp eq i32 %newer_set_set, 296
  br i1 %newer_set_fits, label %more, label %no
more:
  %more_set = CPUID(i32 -2147483647, i32 0)
  %more_set_said = extractvalue { i32, i32, i32, i32 } %more_set, 2
  %more_set_set = and i32 %more_set_said, 32
  %more_set_fits = icmp eq i32 %more_set_set, 32
  br i1 %more_set_fits, label %kept, label %no
kept:
  %kept_set = call { i32, i32 } asm "xgetbv", "={ax},={dx},{cx},~{dirflag},~{fpsr},~{flags}"(i32 0)
  %kept_said = extractvalue { i32, i32 } %kept_set, 0
  %kept_wide = and i32 %kept_said, 6
  %kept_fits = icmp eq i32 %kept_wide, 6
  br i1 %kept_fits, label %yes, label %no
yes:
  ret i32 1
no:
  ret i32 0
}
attributes #0 = { "target-cpu"="x86-64" "target-features"="" }
""",
}


_ELF = "ld.lld", ("-shared", "-z", "noexecstack", "--strip-all", "--hash-style=gnu"), ".so"
_DLL = "lld-link", ("/dll", "/noentry", "/nodefaultlib", "/opt:ref"), ".dll"
_MACOS = "-dylib", "-arch", "arm64", "-platform_version", "macos", "11.0", "11.0", "-undefined", "dynamic_lookup"
_MACHO = "ld64.lld", _MACOS, ".dylib"
# for Python's name of the system and LLVM's of the machine; the newest processors first
LIBRARIES: tuple[tuple[str, str, Target], ...] = (
    ("linux", "x86_64", Target("x86_64-unknown-linux-gnu", "x86-64-v3", "", *_ELF)),
    ("linux", "x86_64", Target("x86_64-unknown-linux-gnu", "x86-64-v2", "", *_ELF)),
    ("linux", "aarch64", Target("aarch64-unknown-linux-gnu", "generic", "", *_ELF)),
    ("win32", "x86_64", Target("x86_64-pc-windows-msvc", "x86-64-v3", "", *_DLL)),
    ("win32", "x86_64", Target("x86_64-pc-windows-msvc", "x86-64-v2", "", *_DLL)),
    ("darwin", "aarch64", Target("arm64-apple-macosx", "generic", "", *_MACHO)),
)


def import_kernels() -> dict[str, tuple[Any, KernelSource]]:
    """Every kernel of minihuman that Python calls, by name."""
    for path in sorted((PACKAGE / "worlds").rglob("*.py")):
        if "\n@kernel(" in path.read_text(encoding="utf-8") and path.parent.name != "build":
            import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
    return {name: KERNELS[name] for name in sorted(KERNELS) if KERNELS[name][1].signatures}


def _link_only(library: Any, description: Any, environment: Any) -> Any:
    """Do without machine code for this process: link and optimise, and let something new stand for what is called."""
    library._ensure_finalized()
    return list[Any]().append


def lower_kernels() -> tuple[list[str], list[str]]:
    """The names of the kernels, and LLVM codes of all that is in a library."""
    cpu_target.target_context.get_executable = _link_only
    kernels = import_kernels()
    compiled = [
        ([entries.compile_for(found, written, text) for text in written.signatures], bool(written.options.get("nogil")))
        for found, written in kernels.values()
    ]
    codes = [overload.code for overloads, _ in compiled for overload in overloads]
    return list(kernels), [entries.write_python_entries(compiled), *codes]


def link_library(target: Target, codes: Sequence[str], count: int) -> bytes:
    """A library of so many lowered kernels.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    machine = machine_for(target)
    exported = ["api", "refusals", "runs_here", *(f"kernel_{number}" for number in range(count))]
    runtime = _RUNTIME + _RUNS_HERE[target.cpu].replace("CPUID", _CPUID)
    for name, function in (("MALLOC", "PyMem_RawMalloc"), ("FREE", "PyMem_RawFree")):
        runtime = runtime.replace(name, str(API_FUNCTIONS.index(function)))
    first, *others = (retarget(code, target, machine) for code in codes)
    whole = llvm.parse_assembly(first)
    for code in (*others, runtime):
        whole.link_in(llvm.parse_assembly(code))
    for thing in (*whole.functions, *whole.global_variables):
        if not thing.is_declaration and thing.name not in exported:
            thing.linkage = "internal"
    pipeline = llvm.create_new_module_pass_manager()
    pipeline.add_global_dead_code_eliminate_pass()
    pipeline.run(whole, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    whole.verify()
    return link_objects([machine.emit_object(whole)], exported, target)


def build_library(folder: Path, *, everywhere: bool = False) -> None:
    """Write libraries for this machine, or everywhere, of the level Numba compiles for; and the manifest.

    What was made of other kernels is not in the manifest: it would be loaded as if it were of these.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    names, codes = lower_kernels()
    files = []
    for system, machine, target in LIBRARIES:
        path = folder / f"kernels-{system}-{target.cpu}{target.suffix}"
        wanted = target.cpu == os.environ["NUMBA_CPU_NAME"] and (everywhere or [system, machine] == HERE)
        if wanted:
            try:
                path.write_bytes(link_library(target, codes, len(names)))
            except BuildError as error:
                if [system, machine] == HERE:
                    raise
                path.unlink(missing_ok=True)  # one of other kernels
                print(f"{path}: not made. {str(error).splitlines()[0]}")
            else:
                print(f"{path}: {path.stat().st_size / 1000:.0f} kB")
        if path.exists() and (wanted or everywhere):  # the other levels' are as new, or about to be made
            files.append({"file": path.name, "runs on": [system, machine]})
    modules = sorted({name.rpartition(".")[0] for name in names})
    needed = {module: import_closure(module, compilation.__name__) for module in modules}
    paths = sorted({path for each in needed.values() for path in each})
    manifest = {
        "api": API,
        "compiler": compiler_digest(),
        "files": files,
        "kernels": names,
        "sources": [[path, source_digest(path)] for path in paths],
        "modules": {module: [paths.index(path) for path in each] for module, each in needed.items()},
    }
    (folder / MANIFEST).write_text(json.dumps(manifest) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    build_library(Path(sys.argv[1]), everywhere="--all" in sys.argv)
