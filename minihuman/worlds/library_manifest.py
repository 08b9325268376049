"""The place of the library of compiled kernels, and which of its kernels match the present sources.

A manifest beside the library has the digests of the sources. This module imports only the standard library, because an
installer reads it as a file, before NumPy and Gymnasium are there to import the package.
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
    """Return a folder's manifest, or None if there is none that can be read."""
    try:
        manifest = json.loads((folder / MANIFEST).read_bytes())
    except (OSError, ValueError):
        return None
    if isinstance(manifest, dict):
        return manifest
    return None


def number_fitting_kernels(manifest: Mapping[str, Any]) -> dict[str, int]:
    """Return, by name, the numbers of the kernels whose module's sources all match the manifest."""
    if manifest["api"] != API:
        return {}
    changed = {number for number, (path, digest) in enumerate(manifest["sources"]) if source_digest(path) != digest}
    return {
        name: number
        for number, name in enumerate(manifest["kernels"])
        if changed.isdisjoint(manifest["modules"][name.rpartition(".")[0]])
    }


def has_all_kernels(manifest: Mapping[str, Any]) -> bool:
    """Return whether every kernel of a manifest matches the present sources."""
    return len(number_fitting_kernels(manifest)) == len(manifest["kernels"]) > 0


def source_digest(path: str) -> str:
    """Return a source file's digest, 16 hexadecimal digits, or "" if there is no such file.

    Args:
        path: the file's path in the package.
    """
    try:
        return hashlib.sha256((PACKAGE / path).read_bytes().replace(b"\r\n", b"\n")).hexdigest()[:16]
    except OSError:
        return ""
