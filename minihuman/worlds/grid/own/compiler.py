"""The compilation of translated rules, in a separate process: ``python -m minihuman.worlds.grid.own.compiler``.

The process reads the translated source from stdin and writes machine code for this machine, an object file, to stdout.
A process that makes worlds therefore never imports Numba.
"""
# mypy: ignore-errors

import math
import re
import sys
from types import ModuleType
from typing import Any

import llvmlite.binding as llvm
import numpy as np
from numba import int64
from numba.core import config, errors
from numba.core.codegen import CPUCodeLibrary
from numba.core.registry import cpu_target

from minihuman.worlds.grid.own import runtime

_ENTRY = """
define i64 @{name}(i64 %table) {{
  %result = alloca i64
  %exception = alloca ptr
  store i64 0, ptr %result
  %status = call i32 @{callee}(ptr %result, ptr %exception, i64 %table)
  %status64 = sext i32 %status to i64
  ret i64 %status64
}}
declare i32 @{callee}(ptr, ptr, i64)
"""


_LIBRARIES: dict[int, Any] = {}  # Numba's libraries of all functions, by id; each is linked once, in the end


def _collect(user: Any, library: Any) -> None:
    """Record the library of a called function, in place of Numba's method that copies its code into the caller's.

    ``user`` is the library of the caller.
    """
    library._ensure_finalized()
    _LIBRARIES[id(library)] = library


def _make_no_executable(library: Any, description: Any, environment: Any) -> Any:
    """Record a library, in place of Numba's method that makes machine code which this process could call.

    Other processes call the functions. The result stands for the compiled function, and is never called.
    """
    _collect(None, library)
    return [].append


def compile_text(text: str) -> bytes:
    """Return the object file of translated source, with the functions ``layouts`` and ``steps``.

    This breaks if Numba renames ``get_executable`` or ``add_linking_library``: nothing is compiled then.
    """
    config.OPT = 0  # all functions are optimised together in the end
    cpu_target.target_context.get_executable = _make_no_executable
    CPUCodeLibrary.add_linking_library = _collect
    CPUCodeLibrary._verify_declare_only_symbols = lambda library: None
    module = ModuleType("translated")
    vars(module).update(rt=runtime, np=np, math=math)
    exec(compile(text, "<translated>", "exec"), vars(module))
    entries = []
    for name in ("layouts", "steps"):
        dispatcher: Any = vars(module).get(name)
        if dispatcher is not None:
            dispatcher.compile((int64,))
            function = dispatcher.overloads[(int64,)].fndesc.llvm_func_name
            entries.append(_ENTRY.format(name=f"minihuman_{name}", callee=f'"{function}"'))
    return _emit([*(str(library._final_module) for library in _LIBRARIES.values()), *entries])


def _emit(codes: list[str]) -> bytes:
    """Link and optimise texts of LLVM code; return an object file in which only the entries can be found by name."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = _describe_machine()
    module = llvm.parse_assembly(_make_globals_internal(codes[0]))
    for code in codes[1:]:
        module.link_in(llvm.parse_assembly(_make_globals_internal(code)))
    for symbol in (*module.functions, *module.global_variables):
        if not symbol.is_declaration and not symbol.name.startswith("minihuman_"):
            symbol.linkage = "internal"
    options = llvm.create_pipeline_tuning_options()
    options.speed_level = 2
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return bytes(machine.emit_object(module))


def _describe_machine() -> Any:
    """Return LLVM's description of this machine, for code that may lie anywhere in memory."""
    # "large": the loader puts code and constants wherever there is memory, and near addresses have 32 bits
    features = llvm.get_host_cpu_features()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=features.flatten(), opt=2, reloc="static", codemodel="large"
    )


def _make_globals_internal(code: str) -> str:
    """Return LLVM code whose common globals are internal, so that linked codes do not share them."""
    return re.sub(r"= common (local_unnamed_addr )?global", "= internal global", code)


def main() -> int:
    """Compile the source on stdin to an object file on stdout; write the line and reason of an error to stderr.

    Return the exit status: 0, or 3 if Numba cannot compile the source.
    """
    try:
        code = compile_text(sys.stdin.read())
    except errors.NumbaError as error:
        lines = re.findall(r'File "<translated>", line (\d+)', str(error))
        reasons = [line.strip() for line in str(error).splitlines() if line.strip()]
        sys.stderr.write(f"LINE {lines[0] if lines else 0}\n" + "\n".join(reasons))
        return 3
    sys.stdout.buffer.write(code)
    return 0


if __name__ == "__main__":
    sys.exit(main())
