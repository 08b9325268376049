"""The committed bitcode is what the kernels beside it compile to."""

import copy
import json
import lzma
import re
import tomllib
from pathlib import Path

import llvmlite.binding as llvm
import pytest

from kernel_build import bitcode, library_manifest

ROOT = Path(__file__).parents[3]
REMAKE = "run `python -m kernel_build --bitcode`"


@pytest.fixture(scope="module")
def manifest():
    return json.loads((bitcode.COMMITTED / library_manifest.MANIFEST).read_bytes())


def test_the_committed_bitcode_is_of_the_kernels_beside_it(manifest):
    assert bitcode.is_of_the_sources(manifest), REMAKE
    assert bitcode.read_bitcode(bitcode.COMMITTED, manifest) is not None, "its digest is not the manifest's"
    assert {path.name for path in bitcode.COMMITTED.iterdir()} == {bitcode.BITCODE, library_manifest.MANIFEST}


def test_it_names_no_folder_of_the_machine_that_wrote_it():
    assert b"site-packages" not in lzma.decompress((bitcode.COMMITTED / bitcode.BITCODE).read_bytes())


def test_it_has_no_code_for_one_kind_of_machine(manifest):
    if not bitcode.is_readable_here(manifest):
        pytest.skip(f"needs llvmlite>={manifest['llvmlite from']}, as installing does")
    assert manifest["written by"]["machine"] == "x86_64", "Numba lowers for the machine on which it runs"
    module = str(llvm.parse_bitcode(bitcode.read_bitcode(bitcode.COMMITTED, manifest)))
    assert not re.search(r"target-cpu|target-features|tune-cpu|llvm\.(?:x86|aarch64)\.|\basm\b", module)


def test_installations_ask_for_an_llvmlite_that_reads_it(manifest):
    requires = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["build-system"]["requires"]
    assert f"llvmlite>={manifest['llvmlite from']}" in requires
    assert not [name for name in requires if re.match("num(ba|py)|gymnasium", name)]


@pytest.mark.parametrize("part", ["a source", "the compiler", "a kernel", "the table", "LLVM"])
def test_bitcode_of_anything_else_is_not_used(manifest, part, monkeypatch):
    other = copy.deepcopy(manifest)
    if part == "a source":
        other["sources"][3][1] = "another"
    elif part == "the compiler":
        other["lowering"] = "another"
    elif part == "a kernel":
        monkeypatch.setattr(bitcode, "find_kernel_modules", lambda: ["minihuman.worlds.more"])
    elif part == "the table":
        other["api"] = other["api"][1:]
    else:
        other["llvm"][0] = llvm.llvm_version_info[0] + 1
    monkeypatch.setattr(library_manifest, "read_manifest", lambda folder: other)
    assert bitcode.read_committed_manifest() is None
