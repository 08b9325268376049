"""The cache of libraries gives back what was put in, or nothing."""

import os
import stat
import subprocess
import sys

import pytest

from kernel_build.library_cache import (
    FOLDER_VARIABLE,
    MAX_LIBRARIES,
    CachedLibrary,
    LibraryCache,
    find_cache_folder,
)

KEY = {"sources": "1234", "platform": ["linux", "x86_64", "x86-64-v3"]}
LIBRARY = CachedLibrary({"kernels": ["step"]}, b"\x7fELF\n\n" * 1000)
posix = pytest.mark.skipif(sys.platform == "win32", reason="permissions are POSIX's")


@pytest.fixture
def cache(tmp_path):
    return LibraryCache(tmp_path / "cache")


@pytest.fixture
def path(cache, tmp_path):
    """Of the one library in it."""
    cache.write(KEY, LIBRARY)
    (path,) = (tmp_path / "cache").iterdir()
    return path


def test_what_was_kept_is_given_back_and_nothing_else(cache):
    assert cache.read(KEY) is None
    cache.write(KEY, LIBRARY)
    assert cache.read(KEY) == LIBRARY
    assert cache.read({**KEY, "sources": "another"}) is None


@pytest.mark.parametrize("position", [0, 70, 3000, -1])
def test_a_damaged_library_is_built_again(cache, path, position):
    content = bytearray(path.read_bytes())
    content[position] ^= 1
    path.write_bytes(content)
    assert cache.read(KEY) is None
    cache.write(KEY, LIBRARY)
    assert cache.read(KEY) == LIBRARY


def test_a_library_that_was_cut_off_is_built_again(cache, path):
    for length in (0, 10, 80, path.stat().st_size - 1):
        os.truncate(path, length)
        assert cache.read(KEY) is None
        cache.write(KEY, LIBRARY)


def test_a_library_under_the_name_of_another_is_not_believed(cache, path):
    other = {**KEY, "sources": "another"}
    cache.write(other, LIBRARY)
    (its_path,) = set(path.parent.iterdir()) - {path}
    os.replace(path, its_path)
    assert cache.read(other) is None


@posix
def test_nobody_else_can_read_or_write_what_is_kept(path):
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


@posix
@pytest.mark.parametrize("part", ["library", "folder"])
def test_what_others_could_have_written_is_not_believed(cache, path, part):
    changed = path if part == "library" else path.parent
    changed.chmod(0o777)
    assert cache.read(KEY) is None


@posix
@pytest.mark.parametrize("part", ["library", "folder"])
def test_what_belongs_to_another_user_is_not_believed(cache, path, part, monkeypatch):
    if os.geteuid() == 0:
        os.chown(path if part == "library" else path.parent, 65534, 65534)
    else:
        owner = os.geteuid()
        monkeypatch.setattr(os, "geteuid", lambda: owner + 1)
    assert cache.read(KEY) is None


@posix
def test_a_link_is_not_followed(cache, path, tmp_path):
    os.replace(path, tmp_path / "elsewhere")
    path.symlink_to(tmp_path / "elsewhere")
    assert cache.read(KEY) is None


def test_a_folder_that_cannot_be_written_to_keeps_nothing_and_fails_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    cache = LibraryCache(tmp_path / "file" / "cache")
    cache.write(KEY, LIBRARY)
    assert cache.read(KEY) is None


def test_the_longest_unused_libraries_go(cache, tmp_path):
    keys = [{"sources": str(number)} for number in range(MAX_LIBRARIES + 2)]
    for number, key in enumerate(keys):
        cache.write(key, LIBRARY)
        newest = max((tmp_path / "cache").iterdir(), key=lambda path: path.stat().st_mtime_ns)
        os.utime(newest, (number, number))
        if number == MAX_LIBRARIES - 1:
            assert cache.read(keys[0]) == LIBRARY  # so it was used last
    assert cache.read(keys[0]) == LIBRARY
    assert [cache.read(key) is None for key in keys[1:4]] == [True, True, False]


WRITER = """
import sys
from pathlib import Path
from kernel_build.library_cache import CachedLibrary, LibraryCache
cache = LibraryCache(Path(sys.argv[1]))
for number in range(60):
    library = CachedLibrary({"writer": sys.argv[2], "number": number}, sys.argv[2].encode() * 20_000)
    cache.write({}, library)
    kept = cache.read({})
    assert kept is not None, number
    assert kept.code == kept.manifest["writer"].encode() * 20_000, number
"""


def test_two_builds_at_once_leave_one_whole_library(tmp_path):
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, tmp_path / "cache", name]) for name in ("a", "b")]
    assert [writer.wait(timeout=60) for writer in writers] == [0, 0]
    kept = LibraryCache(tmp_path / "cache").read({})
    assert kept is not None
    assert kept.manifest["number"] == 59
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_the_folder_is_the_users_unless_another_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv(FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_cache_folder() == tmp_path / "minihuman" / "libraries"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # which is to be ignored
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert find_cache_folder() == tmp_path / "home" / ".cache" / "minihuman" / "libraries"
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "named"))
    assert find_cache_folder() == tmp_path / "named"
    monkeypatch.setenv(FOLDER_VARIABLE, "")
    assert find_cache_folder() is None
    LibraryCache(None).write(KEY, LIBRARY)
    assert LibraryCache(None).read(KEY) is None
