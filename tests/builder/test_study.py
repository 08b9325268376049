"""A study that is edited through the builder's interface: the file, its history, conflicts, what enrolment fixes."""

import hashlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.admin.enrolment_log import take_slot
from minihuman.builder.study_api import BuilderApi
from minihuman.experiment.protocol.protocol import decode_protocol
from tests.builder.test_document import ROOT

TOML = (ROOT / "protocols" / "two-days.toml").read_bytes()


class Page:
    """The builder's page with one study open: it sends edits of the version that it shows."""

    def __init__(self, folder: Path, client: TestClient, key: str = "study.toml") -> None:
        self.file = folder / key
        self.data = folder / "sessions"
        self.client = client
        self.key = key
        self.document = self.read()

    def read(self) -> dict[str, Any]:
        self.document = self.client.get("/api/study", params={"key": self.key}).json()
        return self.document

    def post(self, name: str, **body: Any) -> dict[str, Any]:
        response = self.client.post(
            f"/api/{name}", params={"key": self.key}, json={"version": self.document["version"], **body}
        )
        answer: dict[str, Any] = {"status": response.status_code, **response.json()}
        if response.status_code == 200:
            self.document = answer
        return answer

    def edit(self, op: str, *path: str | int, **more: Any) -> dict[str, Any]:
        return self.post("edit", edits=[{"op": op, "path": path, **more}])


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    (tmp_path / "study.toml").write_bytes(TOML)
    app = Starlette(routes=BuilderApi(tmp_path, tmp_path / "sessions").routes())
    with TestClient(app) as client:
        yield Page(tmp_path, client)


def test_a_document_says_what_the_file_says_and_where(page: Page) -> None:
    document = page.document
    assert document["version"] == hashlib.sha256(TOML).hexdigest()
    assert (document["text"].encode(), document["name"], document["mistakes"]) == (TOML, "two-days", [])
    assert document["lines"]["blocks[0].stop_criterion"] == TOML[: TOML.index(b"stop_criterion")].count(b"\n") + 1
    assert document["pay"] == {"currency": "元", "base": 20.0, "per_point": 0.1, "most": 60.0}
    practice = next(part for part in document["parts"] if part["name"] == "practice")
    assert (practice["kind"], practice["path"], practice["title"]) == ("play", ["blocks", 0], "练习")
    assert practice["used_in"] == ["hidden", "shown", "control"]
    assert [(lane["group"], lane["session"]) for lane in document["lanes"]][:3] == [
        ("hidden", "day-1"),
        ("hidden", "day-2"),
        ("shown", "day-1"),
    ]
    assert document["lanes"][4]["replaced"] == {"how": "how-fixed"}
    day_1, day_2 = document["durations"][:2]
    assert day_1["least_min"] > day_2["least_min"] > 1
    assert set(day_2["parts"]) > {"main", "load"} - {"main"}


def test_an_edit_writes_the_file_and_a_mistake_is_said_at_its_field(page: Page) -> None:
    answer = page.edit("set", "blocks", 0, "episodes", value=0)
    assert answer["mistakes"][0] == {
        "path": ["blocks", 0, "episodes"],
        "line": answer["lines"]["blocks[0].episodes"],
        "message": "is 0; an episode count is 1 to 10000",
    }
    assert page.file.read_bytes() == TOML.replace(b"episodes = 12", b"episodes = 0")
    assert answer["durations"] == []
    assert page.edit("set", "blocks", 0, "episodes", value=12)["mistakes"] == []
    assert page.file.read_bytes() == TOML


def test_a_value_that_is_taken_back_is_written_as_it_was(page: Page) -> None:
    page.file.write_bytes(TOML.replace(b"base = 20.0", b"base = 2_0.00 # euro"))
    page.read()
    page.edit("set", "bonus", "base", value=21)
    assert b"base = 21.0 # euro" in page.file.read_bytes()
    page.edit("set", "bonus", "base", value=20)
    assert b"base = 2_0.00 # euro" in page.file.read_bytes()


def test_edits_of_one_request_are_made_together_or_not_at_all(page: Page) -> None:
    edits = [
        {"op": "set", "path": ["study", "theme"], "value": "light"},
        {"op": "remove", "path": ["study", "nothing"]},
    ]
    answer = page.post("edit", edits=edits)
    assert (answer["status"], answer["error"], answer["path"]) == (400, "not_editable", ["study", "nothing"])
    assert page.file.read_bytes() == TOML


def test_a_part_is_added_copied_moved_renamed_and_removed(page: Page) -> None:
    page.edit("duplicate", "blocks", 0, value={"name": "practice-2"})
    assert [block["name"] for block in page.document["tree"]["blocks"]][:2] == ["practice", "practice-2"]
    page.edit("move", "blocks", 1, to=0)
    page.edit("remove", "blocks", 0)
    assert page.file.read_bytes() == TOML
    page.edit("insert", "pages", 0, value={"name": "hello", "text": "One.\nTwo."})
    assert b'[[pages]]\nname = "hello"\ntext = """\nOne.\nTwo."""\n\n[[pages]]' in page.file.read_bytes()
    page.edit("rename", "questions", 2, value="test")
    page.edit("rename", "pages", 2, value="task")
    page.edit("rename", "groups", 2, value="fixed")
    assert page.document["lanes"][0]["parts"][:4] == ["consent", "about-you", "task", "test"]
    assert page.document["tree"]["questions"][2]["return_to"] == "task"
    assert page.document["lanes"][4] | {"path": []} == {
        "group": "fixed",
        "session": "day-1",
        "parts": ["consent", "about-you", "task", "test", "practice", "main", "load", "until-tomorrow"],
        "path": [],
        "replaced": {"task": "how-fixed"},
    }
    assert page.document["mistakes"] == []
    assert page.document["tree"]["blocks"][0]["group_overrides"].keys() == {"shown", "fixed"}


def test_undo_and_redo_go_through_the_files_history_and_survive_a_restart(page: Page) -> None:
    assert not page.document["can_undo"]
    page.edit("set", "study", "theme", value="light")
    light = page.file.read_bytes()
    page.edit("set", "blocks", 0, "episodes", value=8)
    assert (page.post("undo")["can_undo"], page.file.read_bytes()) == (True, light)
    with TestClient(Starlette(routes=BuilderApi(page.file.parent, page.data).routes())) as restarted:
        page.client = restarted
        assert page.read()["can_redo"]
        assert (page.post("undo")["can_undo"], page.file.read_bytes()) == (False, TOML)
        assert page.post("undo")["error"] == "not_there"
        assert (page.post("redo")["can_redo"], page.file.read_bytes()) == (True, light)
        page.edit("set", "study", "theme", value="dark")
        assert not page.document["can_redo"]


def test_a_file_that_was_changed_elsewhere_is_a_conflict_and_nothing_is_lost(page: Page) -> None:
    page.edit("set", "study", "theme", value="light")
    edited_elsewhere = page.file.read_bytes() + b"# by hand\n"
    page.file.write_bytes(edited_elsewhere)
    answer = page.edit("set", "blocks", 0, "episodes", value=8)
    assert (answer["status"], answer["error"]) == (409, "conflict")
    assert answer["document"]["text"].encode() == edited_elsewhere == page.file.read_bytes()
    page.read()
    page.edit("set", "blocks", 0, "episodes", value=8)
    assert page.post("undo")["text"].encode() == edited_elsewhere
    page.file.write_bytes(TOML + b"# again\n")
    page.read()
    assert page.document["can_undo"]
    assert page.post("undo")["text"].encode() == edited_elsewhere
    assert page.post("redo")["text"].encode() == TOML + b"# again\n"


def test_a_page_that_asks_again_learns_only_of_another_version(page: Page) -> None:
    query = {"key": page.key, "version": page.document["version"]}
    assert page.client.get("/api/study", params=query).status_code == 204
    page.file.write_bytes(TOML + b"\n")
    assert page.client.get("/api/study", params=query).json()["version"] != query["version"]


@pytest.mark.parametrize("content", [b"[study\n", b'[study]\nname = "\xff"\n', b"\x00"])
def test_a_file_that_is_no_toml_is_shown_and_can_be_written_anew(page: Page, content: bytes) -> None:
    page.file.write_bytes(content)
    document = page.read()
    assert document["mistakes"]
    assert document["read_only"]
    assert page.edit("set", "study", "theme", value="light")["error"] == "not_editable"
    assert page.file.read_bytes() == content
    if b"\xff" not in content:
        assert page.edit("replace_text", value=TOML.decode())["mistakes"] == []
        assert page.file.read_bytes() == TOML


def test_after_the_first_enrolment_allocation_order_and_measures_stay(page: Page) -> None:
    assert page.document["restrictions"] == {"enrolled": 0, "fields": [], "message": ""}
    take_slot(decode_protocol(TOML), page.data / "two-days")
    restrictions = page.read()["restrictions"]
    assert restrictions["enrolled"] == 1
    assert "new version of the study" in restrictions["message"]
    fields = [field["path"] for field in restrictions["fields"]]
    assert [path for path in fields if path[0] in ("groups", "sessions", "study")] == [
        ["study", "name"],
        ["study", "seed"],
        ["groups"],
        ["sessions"],
    ]
    for op, path, more in [
        ("set", ("study", "seed"), {"value": 1}),
        ("set", ("groups", 0, "allocation_ratio"), {"value": 1}),
        ("remove", ("groups", 1), {}),
        ("move", ("orders", 0, "parts", 0), {"to": 2}),
        ("set", ("exclusions",), {"value": [{"reason": "x", "level": "episode", "measure": "steps", "above": 9}]}),
        ("set", ("study", "participants"), {"value": 10}),
        ("set", ("blocks", 1, "key_map"), {"value": "new"}),
        ("remove", ("blocks", 1), {}),
        ("replace_text", (), {"value": TOML.decode().replace("seed = 20260", "seed = 20261")}),
    ]:
        answer = page.edit(op, *path, **more)
        assert (answer["status"], answer["error"]) == (403, "restricted"), (op, path)
        assert "make a new version of the study" in answer["message"]
        assert page.file.read_bytes() == TOML
    page.edit("set", "pages", 1, "title", value="The task")
    page.edit("set", "study", "participants", value=2000)
    page.edit("move", "blocks", 4, to=1)
    assert page.document["status"] == 200


def test_a_new_version_has_a_name_and_data_of_its_own(page: Page) -> None:
    take_slot(decode_protocol(TOML), page.data / "two-days")
    answer = page.client.post("/api/new", json={"name": "Two days, again", "source_key": page.key})
    assert answer.status_code == 201
    copy = answer.json()
    assert (copy["name"], copy["key"], copy["tree"]["study"]["version"]) == (
        "two-days-again",
        "two-days-again.toml",
        "1.1",
    )
    assert copy["restrictions"]["enrolled"] == 0
    changed = [
        (old, new) for old, new in zip(TOML.decode().split("\n"), copy["text"].split("\n"), strict=True) if old != new
    ]
    assert changed == [('name = "two-days"', 'name = "two-days-again"'), ('version = "1.0"', 'version = "1.1"')]
    version = Page(page.file.parent, page.client, copy["key"])
    version.edit("move", "groups", 2, to=0)
    version.edit("set", "blocks", 0, "episodes", value=6)
    version.edit("remove", "blocks", 4)
    query = {"key": version.key, "with": page.key}
    differences = page.client.get("/api/differences", params=query).json()["differences"]
    summary = [(tuple(difference["path"]), difference["before"], difference["after"]) for difference in differences]
    assert summary[:4] == [
        (("study", "name"), "two-days", "two-days-again"),
        (("study", "version"), "1.0", "1.1"),
        (("groups",), ["hidden", "shown", "control"], ["control", "hidden", "shown"]),
        (("blocks", 0, "episodes"), 12, 6),
    ]
    assert [(path, before["name"], after) for path, before, after in summary[4:]] == [(("blocks", 4), "lava", None)]
    again = page.client.post("/api/new", json={"name": "two-days-again", "source_key": page.key})
    assert (again.status_code, again.json()["error"]) == (409, "exists")


def test_cards_have_the_groups_parts_minutes_and_sessions_of_each_study(page: Page) -> None:
    shutil.copytree(ROOT / "protocols" / "trials", page.file.parent / "trials")
    (page.file.parent / "broken.toml").write_text("[study\n")
    take_slot(decode_protocol(TOML), page.data / "two-days")
    page.edit("set", "about", "title", value="Which key does what?")
    cards = {card["key"]: card for card in page.client.get("/api/studies").json()["studies"]}
    card = cards["study.toml"]
    assert (card["title"], card["language"], card["enrolled"], card["participants"]) == (
        "Which key does what?",
        "zh",
        1,
        1000,
    )
    assert card["groups"] == ["hidden", "shown", "control"]
    assert 10 < card["minutes"][0] < card["minutes"][1]
    assert [part["name"] for part in cards["trials/stroop.toml"]["parts"]] == ["stroop"]
    assert "cannot be read" in cards["broken.toml"]["problem"]
    assert cards["broken.toml"]["mistakes"] == 1
    assert not any(".minihuman-history" in key for key in cards)


def test_a_strangers_worlds_are_neither_loaded_nor_run_before_they_are_trusted(
    page: Page, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("MINIHUMAN_CONFIG", str(tmp_path / "config"))
    (page.file.parent / "stranger_worlds.py").write_text("raise SystemExit('it ran')\n")
    page.edit("set", "blocks", 0, "world", value="stranger_worlds:Maze-v0")
    assert page.document["trusted"] is False
    assert "which you do not trust yet" in page.document["mistakes"][0]["message"]
    report = page.client.get("/api/check", params={"key": page.key}).json()
    assert "which you do not trust yet" in report["mistakes"][0]["message"]


def test_names_of_earlier_versions_are_named_and_left_alone(page: Page) -> None:
    page.file.write_bytes(TOML.replace(b"final_frame_ms = 600", b"hold_ms = 600", 1))
    (old_name,) = page.read()["read_only"]
    assert old_name == {
        "path": ["blocks", 0, "hold_ms"],
        "line": page.document["lines"]["blocks[0].hold_ms"],
        "message": "is now called 'final_frame_ms'",
    }
    assert page.document["mistakes"] == []
    page.edit("set", "blocks", 0, "episodes", value=8)
    assert b"hold_ms = 600" in page.file.read_bytes()


def test_check_says_what_the_command_says(page: Page) -> None:
    report = page.client.get("/api/check", params={"key": page.key}).json()
    assert (report["version"], report["mistakes"]) == (page.document["version"], [])
    assert any("SHA-256" in line for line in report["plan"])
    assert any(line.startswith("outcome of block 'practice'") for line in report["notices"])
    page.edit("set", "blocks", 1, "actions", value=["left", "right", "fly"])
    page.edit("remove", "blocks", 1, "group_overrides")
    (mistake,) = page.client.get("/api/check", params={"key": page.key}).json()["mistakes"]
    assert mistake["path"] == ["blocks", 1, "actions"]
    assert "fly" in mistake["message"]
