"""The page's WebAssembly modules: built from the kernels, with a manifest of what is in them and what made them."""

import hashlib
import json
import os
from pathlib import Path
from typing import Any

import llvmlite
import numba

from minihuman.errors import MinihumanError
from minihuman.worlds.build.exports import EXPORTS
from minihuman.worlds.build.lowering import lower
from minihuman.worlds.build.targets import PAGE, PAGE_SIMD, Target, link, linker_version
from minihuman.worlds.source_digest import kernels_digest

MANIFEST = "manifest.json"
# code for the machine's first processor: what is built is the same wherever it is
PORTABLE = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": "", "PYTHONHASHSEED": "0"}
_TARGETS: dict[str, tuple[Target, ...]] = {"grid": (PAGE,), "first_person": (PAGE, PAGE_SIMD)}


def build_page_modules(folder: Path) -> dict[str, Any]:
    """Write the modules and their manifest into a folder, and return the manifest.

    Raises:
        MinihumanError: if Numba compiles for this machine's own processor, not as in `PORTABLE`.
        BuildError: if there is no linker.
    """
    if any(os.environ.get(name) != value for name, value in PORTABLE.items()):
        raise MinihumanError(
            "build the page modules with `python -m minihuman.worlds.build`, which sets Numba's target"
        )
    folder.mkdir(parents=True, exist_ok=True)
    modules: dict[str, Any] = {}
    for name, exports in EXPORTS.items():
        functions = [lower(export) for export in exports]
        files = []
        for target in _TARGETS[name]:
            code = link([each.code for each in functions], [each.name for each in functions], target)
            (folder / f"{name}{target.suffix}").write_bytes(code)
            files.append(
                {
                    "file": f"{name}{target.suffix}",
                    "simd": target is PAGE_SIMD,
                    "bytes": len(code),
                    "sha256": hashlib.sha256(code).hexdigest(),
                }
            )
        modules[name] = {
            "files": files,
            "functions": {
                each.name: {
                    "arguments": [
                        {"name": one.name, "kind": one.kind, "dimensions": one.dimensions} for one in each.arguments
                    ],
                    "results": list(each.results),
                }
                for each in functions
            },
        }
    manifest = {
        "sources": kernels_digest(),
        "numba": numba.__version__,
        "llvmlite": llvmlite.__version__,
        "linker": linker_version(PAGE),
        "modules": modules,
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8", newline="\n")
    return manifest
