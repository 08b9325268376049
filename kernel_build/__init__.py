"""Builds what the worlds are compiled to: a library for Python and modules for the page. No part of the package.

An installation builds the library with llvmlite and a linker alone, so this module and those that it needs (`bitcode`,
`libraries`, `library_cache`, `linking`) import neither Numba nor NumPy, and of the package one file.
"""

import hashlib
from collections.abc import Iterable
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import TYPE_CHECKING, Any


def compiler_digest(names: Iterable[str] = ("*",)) -> str:
    """Return the digest of modules of this package, 16 hexadecimal digits: another version builds anew.

    Args:
        names: of the modules; "*" for all.
    """
    sources = sorted(path for name in names for path in Path(__file__).parent.glob(f"{name}.py"))
    texts = (path.read_bytes().replace(b"\r\n", b"\n") for path in sources)
    return hashlib.sha256(b"\n".join(texts)).hexdigest()[:16]


def _load_library_manifest() -> Any:
    """Load the one module of minihuman that a build needs, as a file: importing minihuman takes NumPy and Gymnasium."""
    package = find_spec("minihuman")
    assert package is not None, "minihuman lies beside kernel_build, or is installed"
    assert package.origin is not None
    path = Path(package.origin).parent / "worlds" / "library_manifest.py"
    spec = spec_from_file_location("kernel_build.library_manifest", path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if TYPE_CHECKING:
    from minihuman.worlds import library_manifest as library_manifest
else:
    library_manifest = _load_library_manifest()
