"""The LLVM module of all kernels that Python calls, as bitcode: read, and compared with the sources.

It lies in a folder with a manifest. The committed one is made by ``python -m kernel_build --bitcode`` alone, and is
used only where all that it was made of is as it was then; any machine's library is made of it.
"""

import hashlib
import lzma
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm

from kernel_build import compiler_digest, library_manifest
from kernel_build.linking import BuildError

COMMITTED = Path(__file__).parent / "bitcode"
BITCODE = "kernels.bc.xz"
# Numba compiles for any machine, and as any process with this seed; it calls nothing that it compiles
ENVIRONMENT = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "PYTHONHASHSEED": "0",
    "MINIHUMAN_KERNELS": "jit",
    "MINIHUMAN_BUILDING": "1",
}
_LOWERING = "entries", "lowering"  # of this package's modules, those that decide what is in the bitcode


def read_committed_manifest() -> dict[str, Any] | None:
    """Return the manifest of the committed bitcode; None where that is of other sources, or not for this LLVM."""
    manifest = library_manifest.read_manifest(COMMITTED)
    if manifest is None or not is_readable_here(manifest) or not is_of_the_sources(manifest):
        return None
    return manifest


def is_of_the_sources(manifest: Mapping[str, Any]) -> bool:
    """Say whether bitcode has every kernel as it is written now, lowered as it would be lowered now."""
    return manifest["lowering"] == lowering_digest() and has_every_kernel(manifest)


def has_every_kernel(manifest: Mapping[str, Any]) -> bool:
    """Say whether bitcode or a library has all kernels as they are written now, those of new modules too."""
    modules = {name.rpartition(".")[0] for name in manifest["kernels"]}
    return library_manifest.has_all_kernels(manifest) and modules == set(find_kernel_modules())


def lowering_digest() -> str:
    """Return the digest of what makes bitcode of kernels."""
    return compiler_digest(_LOWERING)


def find_kernel_modules() -> list[str]:
    """Return the names of the modules with kernels that Python calls."""
    package = library_manifest.PACKAGE
    return [
        ".".join(path.relative_to(package.parent).with_suffix("").parts)
        for path in sorted((package / "worlds").rglob("*.py"))
        if "\n@kernel(" in path.read_text(encoding="utf-8") and path.parent.name != "build"
    ]


def read_bitcode(folder: Path, manifest: Mapping[str, Any]) -> bytes | None:
    """Return a folder's bitcode; None where it is not the manifest's."""
    try:
        code = lzma.decompress((folder / BITCODE).read_bytes())
    except (OSError, lzma.LZMAError):
        return None
    if hashlib.sha256(code).hexdigest() == manifest["sha256"]:
        return code
    return None


def is_readable_here(manifest: Mapping[str, Any]) -> bool:
    """Say whether the installed LLVM, llvmlite's, reads the bitcode: one reads what it or an older one wrote."""
    return bool(llvm.llvm_version_info[0] >= manifest["llvm"][0])


def read_or_lower(committed: Mapping[str, Any] | None) -> tuple[Mapping[str, Any], bytes]:
    """Return the manifest and bitcode of the kernels as they are: the committed, or what Numba makes of them now.

    Args:
        committed: the manifest of the committed bitcode, where it is of the sources as they are.

    Raises:
        BuildError: if Numba is needed and missing.
    """
    if committed is not None:
        code = read_bitcode(COMMITTED, committed)
        if code is None:
            raise BuildError(f"{COMMITTED / BITCODE}: damaged; its manifest has another digest. Check it out again")
        return committed, code
    if find_spec("numba") is None:
        raise BuildError(
            f"{COMMITTED}: not the bitcode of the kernels as they are, or of a newer LLVM than llvmlite has, "
            f"{'.'.join(map(str, llvm.llvm_version_info))}; to compile them anew, pip install numba gymnasium"
        )
    with tempfile.TemporaryDirectory() as folder:
        run_numba("kernel_build.lowering", folder)
        manifest = library_manifest.read_manifest(Path(folder))
        assert manifest is not None
        lowered = read_bitcode(Path(folder), manifest)
        assert lowered is not None
        return manifest, lowered


def run_numba(module: str, folder: str) -> None:
    """Run a module that compiles kernels, in a process of its own: Numba reads the environment when it is imported."""
    inherited = {name: text for name, text in os.environ.items() if not name.startswith("NUMBA_")}
    subprocess.run([sys.executable, "-m", module, folder], env=inherited | ENVIRONMENT, check=True)
