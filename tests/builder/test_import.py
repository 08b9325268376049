"""A colleague's folder that is imported: what of it is written, and that its code runs only once it was seen."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.builder.study_api import BuilderApi
from minihuman.trust import Trust

NAVIGATION = Path(__file__).parents[2] / "protocols" / "navigation"
KEY = {"key": "maze/water-maze.toml"}


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder of a user who trusts nothing yet."""
    monkeypatch.setenv("MINIHUMAN_CONFIG", str(tmp_path / "config"))
    monkeypatch.delenv("MINIHUMAN_TRUST", raising=False)
    folder = tmp_path / "lab"
    folder.mkdir()
    return folder


@pytest.fixture
def client(lab: Path) -> Iterator[TestClient]:
    with TestClient(Starlette(routes=BuilderApi(lab, lab / "sessions").routes())) as client:
        yield client


def send(client: TestClient, folder: str, path: str, content: bytes) -> Any:
    headers = {"content-type": "application/octet-stream"}
    return client.post("/api/import", params={"folder": folder, "path": path}, content=content, headers=headers)


def test_a_folder_is_imported_and_its_code_is_trusted_once_it_was_seen(lab: Path, client: TestClient) -> None:
    for name in ("water-maze.toml", "water_maze.py"):
        assert send(client, "maze", name, (NAVIGATION / name).read_bytes()).status_code == 201
    assert [card["key"] for card in client.get("/api/studies").json()["studies"]] == [KEY["key"]]
    assert client.get("/api/study", params=KEY).json()["trusted"] is False
    question = client.get("/api/trust", params=KEY).json()
    assert question["untrusted"] == str(lab / "maze")
    assert [file["name"] for file in question["files"]] == ["water_maze.py"]
    (lab / "maze" / "water_maze.py").write_text("print('something else')\n")
    refused = client.post("/api/trust", params=KEY, json={"sha256": question["sha256"]})
    assert (refused.status_code, "changed" in refused.json()["message"]) == (409, True)
    assert not Trust.read().holds(lab / "maze")
    seen = client.get("/api/trust", params=KEY).json()["sha256"]
    assert client.post("/api/trust", params=KEY, json={"sha256": seen}).json()["trusted"] is True
    assert Trust.read().holds(lab / "maze")
    assert client.get("/api/trust", params=KEY).json()["untrusted"] == ""  # it was asked once


@pytest.mark.parametrize(
    ("folder", "path", "reason"),
    [
        ("..", "a.toml", "letters, digits"),
        ("new", "../a.toml", "letters, digits"),
        ("new", "/etc/a.toml", "letters, digits"),
        ("new", "a/.ssh/b.txt", "letters, digits"),
        ("new", "run.sh", "not a file of a study"),
        ("new", "a/b/c/d.csv", "not a file of a study"),
        ("there", "a.toml", "there is a folder there already"),
    ],
)
def test_nothing_is_written_outside_a_new_folder(
    lab: Path, client: TestClient, folder: str, path: str, reason: str
) -> None:
    (lab / "there").mkdir()
    answer = send(client, folder, path, b"x = 1")
    assert answer.status_code in (400, 409)
    assert reason in answer.json()["message"]
    assert [file for file in lab.parent.rglob("*") if file.is_file()] == []


def test_a_file_is_imported_once_and_other_pages_import_nothing(lab: Path, client: TestClient) -> None:
    assert send(client, "new", "a.toml", b"x = 1").status_code == 201
    assert "nothing is replaced" in send(client, "new", "a.toml", b"x = 2").json()["message"]
    assert (lab / "new" / "a.toml").read_bytes() == b"x = 1"
    headers = {"content-type": "application/octet-stream", "sec-fetch-site": "cross-site"}
    answer = client.post("/api/import", params={"folder": "b", "path": "a.toml"}, content=b"", headers=headers)
    assert answer.json()["error"] == "not_trusted"
