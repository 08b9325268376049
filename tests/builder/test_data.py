"""What a study has recorded, through the builder's interface: sessions, paths, queries, annotations and exports."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.admin.enrolment_entries import read_enrolment_log
from minihuman.builder.recorded_data import EXAMPLES
from minihuman.builder.study_api import BuilderApi
from minihuman.dataset.annotations import read_annotations
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
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


def test_an_episode_is_replayed_with_its_steps_its_floor_and_what_was_seen(recorded: Path, client: TestClient) -> None:
    log = client.get("/api/data", params=KEY).json()["sessions"][0]["log"]
    place = {**KEY, "log": log}
    details = client.get("/api/data/session", params=place).json()
    assert [(row["number"], row["block"]) for row in details["episodes"]] == [(1, "walk"), (2, "walk")]
    replay = client.get("/api/data/episode", params={**place, "episode": 2}).json()
    episode = read_log(recorded / "sessions" / "rooms" / log).episodes[1]
    assert len(replay["steps"]) == details["episodes"][1]["steps"] + 1 == len(episode.poses)
    assert [step["place"] for step in replay["steps"]] == episode.poses[:, [0, 2]].round(3).tolist()
    assert replay["floor"]["walls"]
    frames = [
        client.get("/api/data/frame.png", params={**place, "episode": 2, "step": step}).content
        for step in (0, len(replay["steps"]) - 1)
    ]
    assert all(frame.startswith(b"\x89PNG") for frame in frames)
    for episode_number, step in ((3, 0), (2, 10_000), ("x", "-1")):
        refused = client.get("/api/data/frame.png", params={**place, "episode": episode_number, "step": step})
        assert (refused.status_code, "episode" in refused.json()["message"]) == (400, True)


def test_a_participant_is_replaced_and_another_withdrawn_each_with_a_reason(tmp_path: Path) -> None:
    (tmp_path / "rooms.toml").write_text(TOML)
    list(simulate(decode_protocol(TOML.encode()), tmp_path / "sessions", participants=2, seed=1, player="random"))
    study = tmp_path / "sessions" / "rooms"
    with TestClient(Starlette(routes=BuilderApi(tmp_path, tmp_path / "sessions").routes())) as client:
        assert (
            "no reason" in send(client, "departure", participant="sub-01", kind="replace", reason=" ").json()["message"]
        )
        assert send(client, "departure", participant="../..", kind="withdraw", reason="x").status_code == 400
        answer = send(client, "departure", participant="sub-01", kind="replace", reason="the bus was late").json()
        assert answer["command"] == f"minihuman replace sub-01 --study={study} '--reason=the bus was late'"
        assert len(answer["recorded"]["sessions"]) == 2  # the data stay
        answer = send(client, "departure", participant="sub-02", kind="withdraw", reason="asked for it").json()
        assert answer["command"].endswith("--erase")
        assert [row["participant"] for row in answer["recorded"]["sessions"]] == ["sub-01"]
    assert not list((study / "sub-02").rglob("*.mcap"))
    reasons = [getattr(line, "reason", "") for line in read_enrolment_log(study)]
    assert {"the bus was late", "asked for it"} <= set(reasons)
