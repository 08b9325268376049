"""The page's WebAssembly modules: built from the kernels, with a manifest of what is in them and what made them."""

import hashlib
import inspect
import json
import os
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import llvmlite
import llvmlite.binding as llvm
import numba

from kernel_build.bitcode import ENVIRONMENT
from kernel_build.entries import compile_for, results_of, retarget, write_table_entry
from kernel_build.linking import BuildError, Target, link_objects, linker_version, machine_for
from minihuman.worlds.build.exports import EXPORTS, NUMBER
from minihuman.worlds.build.layout_exports import LAYOUT_EXPORTS
from minihuman.worlds.kernels import KERNELS
from minihuman.worlds.source_digest import kernels_digest, layouts_digest

_STACK_BYTES = 1 << 18
_COUNTING = """
define void @NRT_incref(ptr %.1) {
  ret void
}
define void @NRT_decref(ptr %.1) {
  ret void
}
"""  # of references: kernels that step and draw own nothing
# Memory for layouts, which make arrays: blocks of 128 bytes and of each power of two above, and a list of the
# released ones of each size, in memory that is no part of the file. A level may reject thousands of layouts before it
# accepts one, so memory that is never released would not do. A header of 64 bytes lies before the data. Kernels look
# in it where it is on the machine that compiled them: references at 0, the data's address at 24, the size at 32. In
# what they do not look at, we keep the next released block, at 8, and the logarithm of the block's size, at 16.
_LAYOUT_BYTES = 1 << 20
_ALLOCATION = f"""
declare i64 @llvm.ctlz.i64(i64, i1)
declare void @llvm.trap()
@memory_of_layouts = internal global [{_LAYOUT_BYTES} x i8] zeroinitializer, align 64
@unused = internal global i64 0
@released = internal global [64 x ptr] zeroinitializer
define ptr @NRT_MemInfo_alloc_aligned(i64 %size, i32 %align) {{
  %last = add i64 %size, 63
  %filled = or i64 %last, 127
  %zeros = call i64 @llvm.ctlz.i64(i64 %filled, i1 false)
  %power = sub i64 64, %zeros
  %block_size = shl i64 1, %power
  %index = trunc i64 %power to i32
  %list = getelementptr [64 x ptr], ptr @released, i32 0, i32 %index
  %first = load ptr, ptr %list
  %is_empty = icmp eq ptr %first, null
  br i1 %is_empty, label %extend, label %reuse
reuse:
  %next_place = getelementptr i8, ptr %first, i32 8
  %next = load ptr, ptr %next_place
  store ptr %next, ptr %list
  br label %fill
extend:
  %start = load i64, ptr @unused
  %end = add i64 %start, %block_size
  %fits = icmp ule i64 %end, {_LAYOUT_BYTES}
  br i1 %fits, label %take, label %full
full:
  call void @llvm.trap()
  unreachable
take:
  store i64 %end, ptr @unused
  %offset = trunc i64 %start to i32
  %new = getelementptr i8, ptr @memory_of_layouts, i32 %offset
  br label %fill
fill:
  %block = phi ptr [ %first, %reuse ], [ %new, %take ]
  %data = getelementptr i8, ptr %block, i32 64
  %data_address = ptrtoint ptr %data to i64
  %power_place = getelementptr i8, ptr %block, i32 16
  %data_place = getelementptr i8, ptr %block, i32 24
  %size_place = getelementptr i8, ptr %block, i32 32
  store i64 1, ptr %block
  store i64 %power, ptr %power_place
  store i64 %data_address, ptr %data_place
  store i64 %size, ptr %size_place
  ret ptr %block
}}
define void @NRT_incref(ptr %block) noinline {{
  %is_null = icmp eq ptr %block, null
  br i1 %is_null, label %end, label %count
count:
  %before = load i64, ptr %block
  %after = add i64 %before, 1
  store i64 %after, ptr %block
  br label %end
end:
  ret void
}}
define void @NRT_decref(ptr %block) noinline {{
  %is_null = icmp eq ptr %block, null
  br i1 %is_null, label %end, label %count
count:
  %before = load i64, ptr %block
  %after = sub i64 %before, 1
  store i64 %after, ptr %block
  %is_last = icmp eq i64 %after, 0
  br i1 %is_last, label %release, label %end
release:
  %power_place = getelementptr i8, ptr %block, i32 16
  %power = load i64, ptr %power_place
  %index = trunc i64 %power to i32
  %list = getelementptr [64 x ptr], ptr @released, i32 0, i32 %index
  %next = load ptr, ptr %list
  %next_place = getelementptr i8, ptr %block, i32 8
  store ptr %next, ptr %next_place
  store ptr %block, ptr %list
  br label %end
end:
  ret void
}}
"""
# The product of two numbers of 128 bits, which LLVM calls to see whether one of 64 bits overflows
_MULTIPLICATION = """
define void @__multi3(ptr %result, i64 %a_low, i64 %a_high, i64 %b_low, i64 %b_high) {
  %a0 = and i64 %a_low, 4294967295
  %a1 = lshr i64 %a_low, 32
  %b0 = and i64 %b_low, 4294967295
  %b1 = lshr i64 %b_low, 32
  %p00 = mul i64 %a0, %b0
  %p01 = mul i64 %a0, %b1
  %p10 = mul i64 %a1, %b0
  %p11 = mul i64 %a1, %b1
  %p00_high = lshr i64 %p00, 32
  %p01_low = and i64 %p01, 4294967295
  %p10_low = and i64 %p10, 4294967295
  %middle_part = add i64 %p00_high, %p01_low
  %middle = add i64 %middle_part, %p10_low
  %low = mul i64 %a_low, %b_low
  %carry = lshr i64 %middle, 32
  %p01_high = lshr i64 %p01, 32
  %p10_high = lshr i64 %p10, 32
  %high_1 = add i64 %p11, %carry
  %high_2 = add i64 %high_1, %p01_high
  %high_3 = add i64 %high_2, %p10_high
  %cross_1 = mul i64 %a_low, %b_high
  %cross_2 = mul i64 %a_high, %b_low
  %high_4 = add i64 %high_3, %cross_1
  %high = add i64 %high_4, %cross_2
  store i64 %low, ptr %result
  %high_place = getelementptr i8, ptr %result, i32 8
  store i64 %high, ptr %high_place
  ret void
}
"""

_OPTIONS = (
    *("--no-entry", "--strip-all", "--stack-first", "-z", f"stack-size={_STACK_BYTES}"),
    "--export=__heap_base",
)
_PAGE_OPTIONS = (*_OPTIONS, "--initial-memory=1048576")
_LAYOUT_OPTIONS = (*_OPTIONS, f"--initial-memory={1048576 + _LAYOUT_BYTES}")
_PLAIN = "+bulk-memory,+sign-ext,+nontrapping-fptoint,+mutable-globals"
PAGE = Target("wasm32-unknown-unknown", "", _PLAIN, "wasm-ld", _PAGE_OPTIONS, ".wasm")
PAGE_LAYOUTS = Target("wasm32-unknown-unknown", "", _PLAIN, "wasm-ld", _LAYOUT_OPTIONS, ".wasm")
PAGE_SIMD = Target("wasm32-unknown-unknown", "", f"{_PLAIN},+simd128", "wasm-ld", _PAGE_OPTIONS, ".simd.wasm")


def link(codes: Sequence[str], names: Sequence[str], target: Target) -> bytes:
    """Make one module of LLVM codes, from which these functions can be called.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    return link_objects([_object(code, target) for code in codes], names, target)


def _object(code: str, target: Target) -> bytes:
    machine = machine_for(target)
    return bytes(machine.emit_object(llvm.parse_assembly(keep_structure_sizes(retarget(code, target, machine)))))


def keep_structure_sizes(code: str) -> str:
    """Return LLVM code in which each structure on the stack has the size that it has where Numba compiled it.

    There a pointer takes eight bytes, and LLVM has already replaced a structure's fields by their distances from its
    start. In the page a pointer takes four, so that the structure would end before its last field, which would be
    written over whatever follows on the stack.
    """
    return re.sub(r"^ +%\S+ = alloca [{[].*$", lambda line: re.sub(r"\bptr\b", "i64", line[0]), code, flags=re.M)


MANIFEST = "manifest.json"
LAYOUTS_MANIFEST = "layouts.json"  # of its own: only pages that draw layouts read it
_TARGETS: dict[str, tuple[Target, ...]] = {"grid": (PAGE,), "first_person": (PAGE, PAGE_SIMD)}


def build_page_modules(folder: Path) -> dict[str, Any]:
    """Write the modules and their manifests into a folder, and return the modules of both.

    Raises:
        BuildError: if Numba compiles for this machine's own processor, not as in `ENVIRONMENT`, or there is no linker.
    """
    if any(os.environ.get(name) != value for name, value in ENVIRONMENT.items()):
        raise BuildError("build the page modules with `python -m kernel_build`, which sets Numba's target")
    folder.mkdir(parents=True, exist_ok=True)
    modules = {
        name: _build_module(folder, name, exports, (_COUNTING,), _TARGETS[name]) for name, exports in EXPORTS.items()
    }
    runtime = _ALLOCATION, _MULTIPLICATION
    layouts = {
        name: _build_module(folder, name, exports, runtime, (PAGE_LAYOUTS,)) for name, exports in LAYOUT_EXPORTS.items()
    }
    _write_manifest(folder / MANIFEST, kernels_digest(), modules)
    _write_manifest(folder / LAYOUTS_MANIFEST, layouts_digest(), layouts)
    return modules | layouts


def _build_module(
    folder: Path, name: str, exports: Mapping[str, Any], runtime: Sequence[str], targets: Sequence[Target]
) -> dict[str, Any]:
    """Write a module's file for each target; return what the manifest says of the module."""
    lowered = {name: _lower(name, kernel) for name, kernel in exports.items()}
    codes = [code for _, code_pair in lowered.values() for code in code_pair]
    files = []
    for target in targets:
        code = link([*runtime, *codes], list(lowered), target)
        (folder / f"{name}{target.suffix}").write_bytes(code)
        file = {"file": f"{name}{target.suffix}", "simd": target is PAGE_SIMD, "bytes": len(code)}
        files.append(file | {"sha256": hashlib.sha256(code).hexdigest()})
    return {"files": files, "functions": {name: description for name, (description, _) in lowered.items()}}


def _write_manifest(path: Path, sources: str, modules: Mapping[str, Any]) -> None:
    manifest = {
        "sources": sources,
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "linker": linker_version(PAGE),
        "modules": modules,
    }
    path.write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8", newline="\n")


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
    for _module in build_page_modules(Path(sys.argv[1])).values():
        for _file in _module["files"]:
            print(f"{_file['file']}: {_file['bytes'] / 1000:.1f} kB")
