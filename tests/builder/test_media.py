"""Files beside a protocol: listed with their uses, dropped, read, and tables that are pasted from a spreadsheet."""

from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.builder.study_api import BuilderApi

BYTES = {"content-type": "application/octet-stream"}
KEY = "colours/colours.toml"


@pytest.fixture
def client(tmp_path: Path) -> TestClient:
    client = TestClient(Starlette(routes=BuilderApi(tmp_path, tmp_path / "sessions").routes()))
    assert client.post("/api/new", json={"name": "Colours", "template": "trials/stroop"}).status_code == 201
    return client


def drop(client: TestClient, name: str, content: bytes, **query: Any) -> Any:
    return client.post("/api/media/file", params={"key": KEY, "name": name, **query}, content=content, headers=BYTES)


def test_a_template_comes_with_its_files_in_a_folder_of_its_own(client: TestClient, tmp_path: Path) -> None:
    assert client.get("/api/study", params={"key": KEY}).json()["mistakes"] == []
    (file,) = client.get("/api/media", params={"key": KEY}).json()["files"]
    assert (file["name"], file["media_type"], file["used_at"]) == (
        "stroop.csv",
        "text/csv",
        [["blocks", 0, "stimuli", "file"]],
    )
    again = client.post("/api/new", json={"name": "colours", "template": "trials/stroop"})
    assert (again.status_code, again.json()["error"]) == (409, "exists")


def test_a_file_is_dropped_and_another_of_its_name_is_not_overwritten(client: TestClient, tmp_path: Path) -> None:
    assert drop(client, "face.png", b"one").status_code == 201
    assert drop(client, "face.png", b"one").status_code == 201
    refused = drop(client, "face.png", b"two")
    assert (refused.status_code, refused.json()["error"]) == (409, "exists")
    assert (tmp_path / "colours" / "face.png").read_bytes() == b"one"
    assert drop(client, "face.png", b"two", replace=1).status_code == 201
    picture = client.get("/api/media/file", params={"key": KEY, "name": "face.png"})
    assert (picture.content, picture.headers["content-type"]) == (b"two", "image/png")


@pytest.mark.parametrize(
    "name", ["../face.png", "/tmp/face.png", "a.py", "colours.toml", ".hidden.png", "a/b.png", "x.svg", "con.png", ""]
)
def test_a_name_that_is_a_path_or_of_another_kind_is_refused(client: TestClient, tmp_path: Path, name: str) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert drop(client, name, b"1").status_code == 400
    assert client.get("/api/media/file", params={"key": KEY, "name": name}).status_code == 404
    assert sorted(tmp_path.rglob("*")) == before


def test_a_table_is_read_edited_and_read_again(client: TestClient, tmp_path: Path) -> None:
    table = client.get("/api/table", params={"key": KEY, "name": "stroop.csv"}).json()
    file = tmp_path / "colours" / "stroop.csv"
    content = file.read_bytes()
    assert table["columns"] == ["text", "colour", "correct", "congruent", "times"]
    same = {name: table[name] for name in ("name", "version", "columns", "rows")}
    assert client.post("/api/table", params={"key": KEY}, json=same).json() == table
    assert file.read_bytes() == content
    table["rows"][0][4] = "5"
    edited = client.post("/api/table", params={"key": KEY}, json=table).json()
    assert edited["rows"][0] == ["RED", "#e8503c", "red", "yes", "5"]
    late = client.post("/api/table", params={"key": KEY}, json=table)
    assert (late.status_code, late.json()["error"]) == (409, "conflict")


def test_cells_are_pasted_from_a_spreadsheet_into_a_new_table(client: TestClient, tmp_path: Path) -> None:
    pasted = 'text\tcorrect\nRED\tred\n"a ""quoted""\nword"\tblue\n\n'
    table = client.post("/api/table", params={"key": KEY}, json={"name": "words.csv", "pasted": pasted}).json()
    assert table["rows"] == [["RED", "red"], ['a "quoted"\nword', "blue"]]
    for body, problem in [
        ({"columns": ["a", "a"], "rows": []}, "give each a name"),
        ({"columns": ["a"], "rows": [["1", "2"]]}, "row 1 of more.csv has 2 cells for 1 columns"),
        ({"pasted": "\n"}, "nothing was pasted"),
    ]:
        refused = client.post("/api/table", params={"key": KEY}, json={"name": "more.csv", **body})
        assert refused.status_code == 400
        assert problem in refused.json()["message"]


def test_a_new_table_has_the_separator_of_its_name_in_capitals_too(client: TestClient, tmp_path: Path) -> None:
    for name, content in (("A.TSV", "a\tb\n1\t2\n"), ("b.tsv", "a\tb\n1\t2\n"), ("C.CSV", "a,b\n1,2\n")):
        table = {"name": name, "columns": ["a", "b"], "rows": [["1", "2"]]}
        assert client.post("/api/table", params={"key": KEY}, json=table).status_code == 200
        (file,) = tmp_path.rglob(name)
        assert file.read_text() == content


@pytest.mark.parametrize("headers", [{"origin": "http://stranger"}, {"sec-fetch-site": "cross-site"}])
def test_another_page_changes_nothing(client: TestClient, tmp_path: Path, headers: dict[str, str]) -> None:
    before = sorted(tmp_path.rglob("*"))
    assert client.post("/api/new", json={"name": "mine"}, headers=headers).status_code == 403
    assert client.post("/api/media/file?name=a.png", content=b"1", headers={**BYTES, **headers}).status_code == 403
    assert client.post("/api/new", content=b'{"name": "mine"}').status_code == 403
    assert client.post("/api/edit", json={"version": 1}).status_code == 400
    assert client.get("/api/study").status_code == 400
    assert sorted(tmp_path.rglob("*")) == before
