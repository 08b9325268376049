"""Disks that are small, full, or may not be written: mounted by root, or the tests that want one are skipped."""

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_PIECE = b"x" * 65536


@contextmanager
def small_disk(at: Path, size_bytes: int) -> Iterator[Path]:
    """A disk of so many bytes, mounted at a folder that is there."""
    with _mounted("-t", "tmpfs", "-o", f"size={size_bytes}", "tmpfs", str(at)):
        yield at


@contextmanager
def read_only(folder: Path) -> Iterator[Path]:
    """A folder on a disk that may be read only, whoever asks."""
    with _mounted("--bind", str(folder), str(folder)):
        subprocess.run(["mount", "-o", "remount,ro,bind", folder], check=True)
        yield folder


def fill(disk: Path, *, but: int) -> Path:
    """Leave so many bytes free, or what their pages come to; gives the file that takes the rest."""
    ballast = disk / "ballast"
    with ballast.open("wb", buffering=0) as file:
        try:
            while file.write(_PIECE) == len(_PIECE):
                pass
        except OSError:
            pass
        file.truncate(max(0, file.tell() - but))
    return ballast


@contextmanager
def _mounted(*words: str) -> Iterator[None]:
    if os.geteuid() != 0:
        pytest.skip("a disk is mounted by root alone: run pytest as root")
    made = subprocess.run(["mount", *words], capture_output=True, text=True)
    if made.returncode != 0:
        pytest.skip(
            f"no disk can be mounted ({made.stderr.strip()}): run pytest as root, in a container with --privileged"
        )
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", words[-1]], check=True)  # a test that failed may still hold a file open
