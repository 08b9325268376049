"""The manifest of compiled worlds names libraries of the kernels as they are, and no others."""

import json

import pytest

from kernel_build import native_library
from kernel_build.page_modules import BuildError
from minihuman.worlds.kernels import HERE

MINE = "kernels-linux-x86-64-v3.so"
OTHERS = ("kernels-linux-generic.so", "kernels-linux-x86-64-v2.so", "kernels-win32-x86-64-v3.dll")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """With libraries of other kernels; here none for Windows can be linked."""

    def link(target, codes, count):
        if target.suffix == ".dll":
            raise BuildError("lld-link refused: undefined symbol: fmod\n>>> more")
        return b"new"

    monkeypatch.setattr(native_library, "lower_kernels", lambda: ([], []))
    monkeypatch.setattr(native_library, "link_library", link)
    monkeypatch.setenv("NUMBA_CPU_NAME", "x86-64-v3")
    for name in OTHERS:
        (tmp_path / name).write_bytes(b"old")
    return tmp_path


def listed(folder):
    return {one["file"] for one in json.loads((folder / native_library.MANIFEST).read_bytes())["files"]}


@pytest.mark.skipif(HERE != ["linux", "x86_64"], reason="the names are this machine's")
def test_what_was_made_of_other_kernels_is_not_listed(folder):
    native_library.build_library(folder)
    assert listed(folder) == {MINE}


@pytest.mark.skipif(HERE != ["linux", "x86_64"], reason="the names are this machine's")
def test_a_library_that_cannot_be_linked_keeps_no_other_from_being_made(folder, capsys):
    native_library.build_library(folder, everywhere=True)
    assert listed(folder) == {MINE, *OTHERS[:2]}, "the next two levels make those anew"
    assert not (folder / OTHERS[2]).exists()
    assert "not made. lld-link refused: undefined symbol: fmod\n" in capsys.readouterr().out


@pytest.mark.skipif(HERE != ["linux", "x86_64"], reason="the names are this machine's")
def test_without_this_machines_library_the_build_fails(folder, monkeypatch):
    def refuse(*_):
        raise BuildError("no linker")

    monkeypatch.setattr(native_library, "link_library", refuse)
    with pytest.raises(BuildError, match="no linker"):
        native_library.build_library(folder, everywhere=True)
