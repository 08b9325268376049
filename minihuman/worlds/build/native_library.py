"""The library of all kernels that Python calls: machine code for several processors, and a manifest of its sources."""

import json
import platform
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba.core import config, types
from numba.core.registry import cpu_target

from minihuman.worlds.build import compilation, entries
from minihuman.worlds.build.page_modules import Target, link_objects, machine_for, retarget
from minihuman.worlds.kernels import API, API_FUNCTIONS, KERNELS, MACHINES, MANIFEST, PACKAGE, Written, sources_digest
from minihuman.worlds.source_digest import import_closure

# Memory for kernels that make arrays: Python's, behind a header that Numba's code reads; and how a processor is asked
# what it can
_RUNTIME = """
@api = external global [64 x ptr]
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
_CPUID = (
    '{ i32, i32, i32, i32 } asm "cpuid", "={ax},={bx},={cx},={dx},{ax},{cx},~{dirflag},~{fpsr},~{flags}"(i32 %s, i32 0)'
)
# Of a processor from 2009 on, of one from 2013 on: which bits are set of what cpuid says of 1 in ecx, of 7 in ebx, and
# of 0x80000001 in ecx
_V2_BITS, _V3_BITS = (0x982201, 0, 0), (0x38D83201 | 1 << 27, 0x128, 0x20)


@dataclass(frozen=True, slots=True)
class Processor:
    """What a library is for.

    Args:
        system: Python's name of the operating system, as in ``sys.platform``.
        machine: LLVM's name of the kind of processor.
        level: Numba's name of the oldest processor of that kind.
        target: LLVM's, and the linker.
        bits: what an x86-64 processor must say of itself.
    """

    system: str
    machine: str
    level: str
    target: Target
    bits: tuple[int, int, int] | None = None

    @property
    def file(self) -> str:
        """The library's name."""
        return f"kernels-{self.system}-{self.level}{self.target.suffix}"


_ELF = ("-shared", "--no-undefined-version", "-z", "noexecstack", "--strip-all", "--hash-style=gnu")
_DLL = ("/dll", "/noentry", "/nodefaultlib", "/opt:ref")
_MACHO = ("-dylib", "-arch", "arm64", "-platform_version", "macos", "11.0", "11.0", "-undefined", "dynamic_lookup")


def _x86(system: str, triple: str, linker: str, options: tuple[str, ...], suffix: str) -> tuple[Processor, ...]:
    return tuple(
        Processor(system, "x86_64", level, Target(triple, level, "", linker, options, suffix), bits)
        for level, bits in (("x86-64-v3", _V3_BITS), ("x86-64-v2", _V2_BITS))
    )


PROCESSORS = (  # of one kind the newest first
    *_x86("linux", "x86_64-unknown-linux-gnu", "ld.lld", _ELF, ".so"),
    *_x86("win32", "x86_64-pc-windows-msvc", "lld-link", _DLL, ".dll"),
    Processor(
        *("linux", "aarch64", "generic"), Target("aarch64-unknown-linux-gnu", "generic", "", "ld.lld", _ELF, ".so")
    ),
    Processor(*("darwin", "aarch64", "generic"), Target("arm64-apple-macosx", "", "", "ld64.lld", _MACHO, ".dylib")),
)


def import_kernels() -> dict[str, tuple[Any, Written]]:
    """Every kernel of minihuman that Python calls, by name."""
    for path in sorted((PACKAGE / "worlds").rglob("*.py")):
        if "\n@kernel(" in path.read_text(encoding="utf-8") and path.parent.name != "build":
            import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
    return {name: KERNELS[name] for name in sorted(KERNELS) if KERNELS[name][1].signatures}


def lower_kernels() -> tuple[list[str], list[str]]:
    """The names of the kernels, and LLVM codes of all that is in a library."""
    # What is called by its address here would have to be compiled for this process too; a new one stands for each
    cpu_target.target_context.get_executable = lambda library, description, environment: list[Any]().append
    kernels = import_kernels()
    codes, called = [], []
    for dispatcher, written in kernels.values():
        overloads = []
        for text in written.signatures:
            arguments = _arguments(text, written)
            if arguments not in dispatcher.overloads:
                dispatcher.compile(arguments)
            compiled = dispatcher.overloads[arguments]
            codes.append(_without_counting(compiled.library.get_llvm_str()))
            overloads.append(entries.Overload(compiled.fndesc, arguments, compiled.signature.return_type))
        called.append((overloads, bool(written.options.get("nogil"))))
    return list(kernels), [entries.write_entries(cpu_target.target_context, called), *codes]


def _arguments(text: str, written: Written) -> tuple[Any, ...]:
    """Numba's types of a signature's arguments; it may name classes of the kernel's module."""
    found = eval(text, {**written.function.__globals__, **vars(types)})
    return found if isinstance(found, tuple) else found.args


def _without_counting(code: str) -> str:
    """Without Numba's own counting of references, which is for the processor that compiled it."""
    code = re.sub(r"= common (local_unnamed_addr )?global", "= internal global", code)
    counting = r"^define linkonce_odr void @(NRT_(?:inc|dec)ref)\([^)]*\)[^{]*\{.*?\n\}$"
    return re.sub(
        counting,
        r"declare void @\1(ptr)",
        re.sub(counting, r"declare void @\1(ptr)", code, flags=re.M | re.S),
        flags=re.M | re.S,
    )


def build(processor: Processor, names: Sequence[str], codes: Sequence[str]) -> bytes:
    """A library of lowered kernels for a processor."""
    machine = machine_for(processor.target)
    exported = ["api", "refusals", "runs_here", *(f"kernel_{number}" for number in range(len(names)))]
    runtime = _RUNTIME.replace("MALLOC", str(API_FUNCTIONS.index("PyMem_RawMalloc")))
    runtime = runtime.replace("FREE", str(API_FUNCTIONS.index("PyMem_RawFree"))) + _runs_here(processor.bits)
    first, *others = (retarget(code, processor.target, machine) for code in codes)
    whole = llvm.parse_assembly(first)
    for code in (*others, runtime):
        whole.link_in(llvm.parse_assembly(code))
    for thing in (*whole.functions, *whole.global_variables):
        if not thing.is_declaration and thing.name not in exported:
            thing.linkage = "internal"
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(whole, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))
    whole.verify()
    return link_objects([machine.emit_object(whole)], exported, processor.target)


def _runs_here(bits: tuple[int, int, int] | None) -> str:
    """LLVM code of a function that says whether the library is for this processor."""
    if bits is None:
        return "define i32 @runs_here() {\n  ret i32 1\n}\n"
    lines = ["define i32 @runs_here() #0 {"]
    for name, leaf, part, wanted in zip("abc", (1, 7, -0x7FFFFFFF), (2, 1, 2), bits, strict=True):
        if wanted:
            lines += [
                f"  %{name} = call {_CPUID % leaf}",
                f"  %{name}_bits = extractvalue {{ i32, i32, i32, i32 }} %{name}, {part}",
                f"  %{name}_set = and i32 %{name}_bits, {wanted}",
                f"  %{name}_fits = icmp eq i32 %{name}_set, {wanted}",
                f"  br i1 %{name}_fits, label %after_{name}, label %no",
                f"after_{name}:",
            ]
    if bits[1]:  # the system keeps the wide registers
        lines += [
            '  %kept = call { i32, i32 } asm "xgetbv", "={ax},={dx},{cx},~{dirflag},~{fpsr},~{flags}"(i32 0)',
            "  %kept_bits = extractvalue { i32, i32 } %kept, 0",
            "  %kept_set = and i32 %kept_bits, 6",
            "  %kept_fits = icmp eq i32 %kept_set, 6",
            "  br i1 %kept_fits, label %yes, label %no",
            "yes:",
        ]
    lines += [
        "  ret i32 1",
        "no:",
        "  ret i32 0",
        "}",
        'attributes #0 = { "target-cpu"="x86-64" "target-features"="" }',
    ]
    return "\n".join(lines)


def build_library(folder: Path, *, everywhere: bool = False) -> None:
    """Write libraries for this machine, or everywhere, of the level Numba compiles for; and the manifest of all there.

    Raises:
        BuildError: if there is no linker, or it refuses.
    """
    folder.mkdir(parents=True, exist_ok=True)
    machine = platform.machine().lower()
    here = sys.platform, MACHINES.get(machine, machine)
    names, codes = lower_kernels()
    for each in PROCESSORS:
        if each.level == config.CPU_NAME and (everywhere or here == (each.system, each.machine)):
            (folder / each.file).write_bytes(build(each, names, codes))
            print(f"{folder / each.file}: {(folder / each.file).stat().st_size / 1000:.0f} kB")
    modules = {written.function.__module__ for _, written in KERNELS.values()}
    paths = import_closure(*modules, compilation.__name__, entries.__name__)
    there = [each for each in PROCESSORS if (folder / each.file).exists()]
    manifest = {
        "digest": sources_digest(paths),
        "sources": paths,
        "api": API,
        "files": [{"file": each.file, "runs on": [each.system, each.machine]} for each in there],
        "kernels": {name: number for number, name in enumerate(names)},
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    build_library(Path(sys.argv[1]), everywhere="--all" in sys.argv)
