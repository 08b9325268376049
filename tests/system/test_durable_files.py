"""Files are replaced whole, and what a killed process left beside them goes."""

import os
import time
from pathlib import Path

import pytest

from minihuman.storage.durable_files import replace_durably


def write(path: Path, content: bytes) -> None:
    with replace_durably(path) as file:
        file.write(content)


def test_what_a_killed_writer_left_is_removed_once_nobody_can_still_be_writing_it(tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    abandoned, recent, other, own = (
        tmp_path / name
        for name in (".study.toml.7.unfinished", ".study.toml.8.unfinished", ".s.toml.7.unfinished", ".study.toml.7")
    )
    for file in (abandoned, recent, other, own):
        file.write_bytes(b"half")
    two_hours_ago = time.time() - 7200
    for file in (abandoned, other, own):
        os.utime(file, (two_hours_ago, two_hours_ago))
    write(path, b"whole")
    assert path.read_bytes() == b"whole"
    assert sorted(tmp_path.iterdir()) == sorted([path, recent, other, own])


def test_a_folder_that_cannot_be_listed_is_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(folder: Path) -> None:
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(Path, "iterdir", refuse)
    write(tmp_path / "study.toml", b"whole")
    assert (tmp_path / "study.toml").read_bytes() == b"whole"
