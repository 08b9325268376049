"""Where the library of compiled kernels is, and which of its kernels are of the sources as they are now.

A manifest beside compiled kernels names the digests of their sources. This module imports the standard library alone:
an installation reads it as a file, where neither NumPy nor Gymnasium is there to import the package.
"""

import hashlib
import json
import platform
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PACKAGE = Path(__file__).parents[1]
LIBRARY_FOLDER = Path(__file__).parent / "compiled"
MANIFEST = "manifest.json"
HERE = [sys.platform, platform.machine().lower().replace("amd", "x86_").replace("arm64", "aarch64")]  # as LLVM has it

# What a library calls and compares with, in this order: functions of Python, then kinds of arrays.
API_FUNCTIONS = (
    *("PyLong_AsLongLong", "PyLong_FromLongLong", "PyLong_FromUnsignedLongLong"),
    *("PyFloat_AsDouble", "PyFloat_FromDouble", "PyTuple_New", "PyTuple_SetItem", "PyTuple_GetItem", "PyTuple_Size"),
    *("PyType_GetFlags", "PyErr_Occurred", "PyErr_Clear", "PyObject_Vectorcall", "PyByteArray_FromStringAndSize"),
    *("Py_IncRef", "Py_DecRef", "PyEval_SaveThread", "PyEval_RestoreThread", "PyMem_RawMalloc", "PyMem_RawFree"),
)
KINDS = ("bool", "int8", "uint8", "int16", "int32", "uint32", "int64", "uint64", "float32", "float64")  # of arrays
API = [*API_FUNCTIONS, *KINDS]  # what a library has to agree on


def read_manifest(folder: Path) -> dict[str, Any] | None:
    """Return a folder's manifest; None where there is none, or none that can be read."""
    try:
        manifest = json.loads((folder / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return None
    if isinstance(manifest, dict):
        return manifest
    return None


def number_fitting_kernels(manifest: Mapping[str, Any]) -> dict[str, int]:
    """Return the numbers of the kernels, by name, whose module's sources are all as the manifest has them."""
    if manifest["api"] != API:
        return {}
    changed = {number for number, (path, digest) in enumerate(manifest["sources"]) if source_digest(path) != digest}
    return {
        name: number
        for number, name in enumerate(manifest["kernels"])
        if changed.isdisjoint(manifest["modules"][name.rpartition(".")[0]])
    }


def has_all_kernels(manifest: Mapping[str, Any]) -> bool:
    """Say whether every kernel of a manifest is of the sources as they are."""
    return len(number_fitting_kernels(manifest)) == len(manifest["kernels"]) > 0


def source_digest(path: str) -> str:
    """Return the digest of a source, by its path in the package: 16 hexadecimal digits, "" where there is none."""
    try:
        return hashlib.sha256((PACKAGE / path).read_bytes().replace(b"\r\n", b"\n")).hexdigest()[:16]
    except OSError:
        return ""
