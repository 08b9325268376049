"""A library is made of the committed bitcode, with llvmlite alone, for the machine that it is for and no other."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kernel_build import bitcode, libraries, library_manifest
from kernel_build.libraries import PLATFORMS, build_every_library, build_library, list_requirements
from kernel_build.library_cache import FOLDER_VARIABLE, LibraryCache
from kernel_build.linking import BuildError
from minihuman.worlds.kernels import load_library
from tests.worlds.build.checkouts import ROOT, copy_checkout, edit_kernel

MACHINES_WITH_A_LIBRARY = {(platform.system, platform.machine) for platform in PLATFORMS}
COMMITTED = library_manifest.read_manifest(bitcode.COMMITTED)
pytestmark = [
    pytest.mark.skipif(
        tuple(library_manifest.HERE) not in MACHINES_WITH_A_LIBRARY, reason="no library is known for this machine"
    ),
    pytest.mark.skipif(
        not bitcode.is_readable_here(COMMITTED),
        reason=f"needs llvmlite>={COMMITTED['llvmlite from']}",
    ),
]
MANIFEST = {"sha256": "of the bitcode", "api": [], "kernels": [], "sources": [], "modules": {}}
OLD = b"of other kernels"
# in a build's environment there is no NumPy, no Numba and no Gymnasium
LLVMLITE_ALONE = """
import runpy, sys
sys.modules |= dict.fromkeys(["numba", "numpy", "gymnasium", "msgspec"])
runpy.run_module("kernel_build", run_name="__main__", alter_sys=True)
"""


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    """A cache of the test's own, empty; and bitcode of these sources, or each build would take Numba minutes."""
    assert bitcode.read_committed_manifest() is not None, "run `python -m kernel_build --bitcode`"
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """A folder with this machine's library and its cache, made by llvmlite alone; and what that printed."""
    folder = tmp_path_factory.mktemp("build")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv(FOLDER_VARIABLE, str(folder / "cache"))
        built = run_build(ROOT, "--stale", str(folder / "compiled"))
    assert built.returncode == 0, built.stderr
    return folder, built.stdout


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """With libraries of other kernels, in a machine on which none for Windows can be linked."""

    def emit(code, target, kernel_count):
        if target.suffix == ".dll":
            raise BuildError("lld-link refused: undefined symbol: fmod\n>>> more")
        return b"new"

    monkeypatch.setattr(bitcode, "read_or_lower", lambda committed: (MANIFEST, b""))
    monkeypatch.setattr(libraries, "emit_library", emit)
    folder = tmp_path / "compiled"
    folder.mkdir()
    for platform in PLATFORMS:
        (folder / platform.file).write_bytes(OLD)
    return folder


def listed(folder):
    return {file["file"] for file in json.loads((folder / library_manifest.MANIFEST).read_bytes())["files"]}


def run_build(checkout: Path, *words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-c", LLVMLITE_ALONE, "--native", *words],
        env=os.environ | {"PYTHONPATH": str(checkout)},
        cwd=checkout,
        capture_output=True,
        text=True,
        check=False,
    )


def test_what_was_made_of_other_kernels_is_not_listed(folder):
    build_library(folder)
    (name,) = listed(folder)
    assert (folder / name).read_bytes() == b"new"


def test_a_library_that_cannot_be_linked_keeps_no_other_from_being_made(folder, capsys):
    build_every_library(folder)
    made = {platform.file for platform in PLATFORMS if platform.system != "win32"}
    assert listed(folder) == made
    assert {path.name for path in folder.iterdir()} == {*made, library_manifest.MANIFEST}
    assert "not made. lld-link refused: undefined symbol: fmod\n" in capsys.readouterr().out


def test_without_this_machines_library_the_build_fails(folder, monkeypatch):
    def refuse(*_):
        raise BuildError("no linker")

    monkeypatch.setattr(libraries, "emit_library", refuse)
    with pytest.raises(BuildError, match="no linker"):
        build_every_library(folder)
    with pytest.raises(BuildError, match="no linker"):
        build_library(folder)


def test_llvmlite_alone_makes_the_whole_library(build):
    folder, printed = build
    library = load_library(folder / "compiled")
    assert library is not None
    assert library.has_all
    (path,) = (folder / "compiled").glob("kernels-*")
    assert printed == f"{path}: {path.stat().st_size / 1000:.0f} kB\n"


def test_what_was_built_once_is_built_nowhere_again(build, tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER_VARIABLE, str(build[0] / "cache"))
    monkeypatch.setattr(libraries, "emit_library", None)
    build_library(tmp_path / "second")
    files = sorted(path.name for path in (tmp_path / "second").iterdir())
    assert len(files) == 2
    for name in files:
        assert (tmp_path / "second" / name).read_bytes() == (build[0] / "compiled" / name).read_bytes()


def test_a_library_is_made_again_only_where_it_is_damaged_or_gone(build, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv(FOLDER_VARIABLE, str(build[0] / "cache"))
    folder = tmp_path / "compiled"
    shutil.copytree(build[0] / "compiled", folder)
    build_library(folder, only_stale=True)
    assert capsys.readouterr().out == "", "it is as new"
    (path,) = folder.glob("kernels-*")
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    build_library(folder, only_stale=True)
    assert path.read_bytes() == whole
    path.unlink()
    build_library(folder, only_stale=True)
    assert path.read_bytes() == whole


def test_a_cached_library_of_other_sources_is_not_believed(build, folder, monkeypatch):
    key = libraries._cache_key(libraries.find_platform(), bitcode.read_committed_manifest())
    cached = LibraryCache(build[0] / "cache").read(key)
    assert cached is not None
    cached.manifest["sources"][0][1] = "of an edited file"
    LibraryCache.of_user().write(key, libraries.CachedLibrary(cached.manifest, OLD))
    build_library(folder)
    (name,) = listed(folder)
    assert (folder / name).read_bytes() == b"new"


def test_an_installation_wants_a_linker_only_where_there_is_none(build, tmp_path, monkeypatch):
    monkeypatch.setattr(libraries, "find_linker", lambda target: ("ld",))
    assert list_requirements(tmp_path) == []
    monkeypatch.setattr(libraries, "find_linker", lambda target: None)
    assert list_requirements(tmp_path) == [libraries.LINKER_REQUIREMENT]
    assert list_requirements(build[0] / "compiled") == [], "the library there is as new"


@pytest.mark.program
@pytest.mark.parametrize("with_new_kernels", [False, True])
def test_an_installation_wants_numba_after_an_edit_and_for_a_new_module_of_kernels(tmp_path, with_new_kernels):
    checkout = copy_checkout(tmp_path / "checkout")
    if with_new_kernels:
        shutil.copy(checkout / "minihuman/worlds/hashing.py", checkout / "minihuman/worlds/more_hashing.py")
        with (checkout / "minihuman/worlds/more_hashing.py").open("a") as source:
            source.write("\n@kernel(\n")
    else:
        edit_kernel(checkout)
    wanted = run_build(checkout, "--requirements")
    assert set(libraries.LOWERING_REQUIREMENTS) <= set(wanted.stdout.split()), wanted.stderr


@pytest.mark.program
def test_without_numba_an_edited_kernel_is_an_error_that_says_what_to_install(tmp_path):
    checkout = copy_checkout(tmp_path / "checkout")
    edit_kernel(checkout)
    failed = run_build(checkout, str(tmp_path / "compiled"))
    assert failed.returncode == 1
    assert failed.stderr.count("\n") == 1, failed.stderr
    assert "not the bitcode of the kernels as they are" in failed.stderr
    assert "pip install numba gymnasium" in failed.stderr


def test_damaged_bitcode_is_an_error_that_names_the_file(tmp_path, monkeypatch):
    shutil.copytree(bitcode.COMMITTED, tmp_path / "bitcode")
    monkeypatch.setattr(bitcode, "COMMITTED", tmp_path / "bitcode")
    (tmp_path / "bitcode" / bitcode.BITCODE).write_bytes(b"no xz")
    with pytest.raises(BuildError, match=r"kernels\.bc\.xz: damaged"):
        build_library(tmp_path / "compiled")
