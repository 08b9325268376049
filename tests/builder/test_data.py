"""What a study has recorded, through the builder's interface: sessions, paths, queries, annotations and exports."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.builder.recorded_data import EXAMPLES
from minihuman.builder.study_api import BuilderApi
from minihuman.dataset.annotations import read_annotations
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.simulated_session import simulate

KEY = {"key": "rooms.toml"}
TOML = """
[study]
name = "rooms"
version = "1"
seed = 4
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a protocol and two recorded sessions."""
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "rooms.toml").write_text(TOML)
    list(simulate(decode_protocol(TOML.encode()), folder / "sessions", participants=2, seed=1, player="random"))
    return folder


@pytest.fixture
def client(recorded: Path) -> Iterator[TestClient]:
    with TestClient(Starlette(routes=BuilderApi(recorded, recorded / "sessions").routes())) as client:
        yield client


def send(client: TestClient, name: str, **content: Any) -> Any:
    return client.post(f"/api/data/{name}", params=KEY, json=content)


def test_sessions_come_with_their_paths_and_the_command_that_replays_them(recorded: Path, client: TestClient) -> None:
    sessions = client.get("/api/data", params=KEY).json()["sessions"]
    first = sessions[0]
    assert [(row["participant"], row["group"], row["state"]) for row in sessions] == [
        ("sub-01", "all", "ended"),
        ("sub-02", "all", "ended"),
    ]
    assert (first["episodes_completed"], first["episodes_planned"], first["notes"]) == (2, 2, [])
    assert first["replay_command"] == f"minihuman replay {recorded / 'sessions' / 'rooms' / first['log']}"
    picture = client.get("/api/data/paths.png", params={**KEY, "log": first["log"]})
    assert picture.content.startswith(b"\x89PNG")
    for log in ("../../rooms.toml", "sub-09/ses-01/sub-09_ses-01.mcap"):  # a name from outside is no path
        assert client.get("/api/data/paths.png", params={**KEY, "log": log}).json()["error"] == "not_there"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.about)
def test_each_example_of_a_query_has_rows(client: TestClient, example: Any) -> None:
    answer = send(client, "query", sql=example.sql).json()
    assert answer["n_rows"] == len(answer["rows"]) >= 1
    assert all(len(row) == len(answer["columns"]) for row in answer["rows"])
    assert answer["command"].startswith("minihuman query ")


def test_a_query_that_is_wrong_or_writes_is_refused_in_the_words_of_the_command(client: TestClient) -> None:
    for sql in ("select nothing from episodes", "drop table episodes", "select * from read_csv('/etc/passwd')"):
        answer = send(client, "query", sql=sql)
        assert (answer.status_code, answer.json()["error"]) == (400, "not_valid")
        assert answer.json()["message"]


def test_a_session_is_excluded_with_a_reason_and_taken_back(recorded: Path, client: TestClient) -> None:
    log = client.get("/api/data", params=KEY).json()["sessions"][0]["log"]
    assert "no reason" in send(client, "annotate", log=log, tag="exclude", note=" ").json()["message"]
    assert "too similar" in send(client, "annotate", log=log, tag="excludes", note="a phone rang").json()["message"]
    answer = send(client, "annotate", log=log, tag="exclude", note="a phone rang").json()
    assert answer["sessions"][0]["notes"] == [{"tag": "exclude", "episode": None, "note": "a phone rang"}]
    sql = "select exclusion_reason from participants where exclusion_reason is not null"
    assert send(client, "query", sql=sql).json()["n_rows"] == 1
    answer = send(client, "annotate", log=log, tag="exclude", note="it was next door", take_back=True).json()
    assert answer["sessions"][0]["notes"] == []
    assert len(read_annotations(recorded / "sessions" / "rooms" / log)) == 2  # nothing is erased


def test_an_export_goes_into_a_new_folder_beside_the_data(recorded: Path, client: TestClient) -> None:
    folders = [send(client, "export", format="csv").json()["folder"] for _ in range(2)]
    assert folders == [str(recorded / "exports" / name) for name in ("rooms-csv", "rooms-csv-2")]
    assert (Path(folders[0]) / "episodes.csv").is_file()
    assert "there is no format '../csv'" in send(client, "export", format="../csv").json()["message"]


def test_a_request_of_another_page_annotates_and_exports_nothing(recorded: Path, client: TestClient) -> None:
    for name in ("annotate", "query", "export"):
        answer = client.post(
            f"/api/data/{name}", params=KEY, json={"format": "csv"}, headers={"sec-fetch-site": "cross-site"}
        )
        assert answer.json()["error"] == "not_trusted"
