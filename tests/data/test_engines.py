"""Many logs worked on in processes of this machine, or in a Ray cluster: the same lines and bytes."""

import os
import shutil
from pathlib import Path

import pytest

from minihuman.api import verify
from minihuman.dataset.selection import Selection
from minihuman.errors import LogError
from minihuman.exporters.exporter import export_study
from tests.copied import as_another
from tests.machine import needs

GOLDEN = Path(__file__).parents[1] / "golden/v1/plain"


@pytest.fixture
def study(tmp_path, monkeypatch) -> Path:
    """A study of several sessions, one of them damaged, seen from the folder above it."""
    folder = shutil.copytree(GOLDEN, tmp_path / "plain")
    logs = sorted(folder.rglob("*.mcap"))
    for number in range(10, 26):
        as_another(logs[0], f"sub-{number}", folder)
    damaged = folder / "sub-12/ses-01/sub-12_ses-01.mcap"
    content = bytearray(damaged.read_bytes())
    content[len(content) // 3] ^= 1
    damaged.write_bytes(content)
    monkeypatch.chdir(tmp_path)
    return Path("plain")


def read_files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def list_findings(study: Path, **how: object) -> list[tuple[Path, str, bool, str]]:
    return [(line.log, line.text, line.ok, repr(line.error)) for line in verify(study, **how)]


def test_several_processes_verify_as_one_does(study, monkeypatch):
    monkeypatch.setattr("minihuman.dataset.log_files.count_processes", lambda: 2)
    several = list_findings(study)
    monkeypatch.setattr("minihuman.dataset.log_files.count_processes", lambda: 1)
    assert several == list_findings(study)
    assert sum("LogError" in error for *_, error in several) == 1
    logs = [path for path, *_ in several if path.suffix == ".mcap"]
    assert logs == sorted(logs)


@needs("ray")
def test_ray_exports_and_verifies_as_processes_do(study, tmp_path):
    local, remote = (list_findings(study, engine=engine) for engine in ("local", "ray"))
    assert remote == local
    for engine in ("local", "ray"):  # another selection than the cache's, so that both read the logs
        export_study("parquet", study, tmp_path / engine, Selection(with_=("unfinished",)), engine=engine)
    assert read_files(tmp_path / "ray") == read_files(tmp_path / "local")
    assert os.getcwd() == str(tmp_path)


def test_an_unknown_engine_is_named(study, tmp_path):
    with pytest.raises(LogError, match="no engine is called 'spark'; there are local and ray"):
        export_study("parquet", study, tmp_path / "out", Selection(), engine="spark")
