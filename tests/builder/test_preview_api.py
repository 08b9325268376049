"""The routes of previews and trials: who may use them, what they refuse, and what a simulation leaves behind."""

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from minihuman.builder.application import PATH, BuilderApplication
from minihuman.builder.trial_runs import SimulatedTrial
from minihuman.web.server.desk import StartPage
from tests.builder.test_preview import QUIZ
from tests.counts import PATIENCE_S

HOST = "http://127.0.0.1:8000"
PREVIEW = f"{PATH}/api/preview?key=quiz.toml"


@pytest.fixture
def client(tmp_path: Path) -> Iterator[TestClient]:
    """The desk of a folder with a study, with the builder in it."""
    (tmp_path / "quiz.toml").write_text(QUIZ)
    data = tmp_path / "sessions"
    with closing(BuilderApplication(tmp_path, data)) as builder:
        desk = StartPage(tmp_path, data, tmp_path / "outputs", {PATH: builder})
        with TestClient(desk.app(), base_url=f"{HOST}{desk.path}") as client:
            yield client


def test_only_the_desks_own_page_gets_a_preview_or_a_simulation(client: TestClient) -> None:
    for address in (PREVIEW, f"{PATH}/api/simulate?key=quiz.toml"):
        assert client.post(address, json={}, headers={"sec-fetch-site": "cross-site"}).status_code == 403
        assert client.post(address, json={}, headers={"origin": "http://127.0.0.1:9"}).status_code == 403
        assert client.get(address.replace("?key", "?number")).status_code in (404, 405)
    assert client.post(f"{HOST}/{PREVIEW}", json={}).status_code == 404  # without the secret
    assert client.post(PREVIEW, content=b"x" * 20_000).status_code == 403


def test_a_preview_of_what_is_not_there_is_refused_with_the_way_out(client: TestClient) -> None:
    refusal = client.post(PREVIEW.replace("quiz", "../quiz"), json={})
    assert refusal.status_code == 400
    assert "reload the list of studies" in refusal.json()["message"]
    assert client.post(PREVIEW, json={"parts": "how"}).status_code == 400


def test_a_world_is_described_and_drawn_and_a_strangers_is_not_loaded(client: TestClient) -> None:
    facts = client.get(f"{PATH}/api/world?id=minihuman/MiniGrid-DoorKey-5x5-v0").json()
    assert facts["usual_actions"] == ["left", "right", "forward", "pickup", "toggle"]
    assert client.get(f"{PATH}/api/world.png?id=minihuman/MiniGrid-DoorKey-5x5-v0").content.startswith(b"\x89PNG")
    assert client.get(f"{PATH}/api/world?id=os:World-v0").status_code == 404
    pictures = {client.get(f"{PATH}/api/world.png?id={name}").content for name in ("os:World-v0", "other:World-v0")}
    assert len(pictures) == 1  # blank
    assert client.get(f"{PATH}/api/template.png?name=two-groups").content not in pictures


def test_the_page_is_told_where_the_desk_is(client: TestClient) -> None:
    info = client.get(f"{PATH}/api/page").json()
    assert client.get(HOST + info["desk"]).status_code == 200
    assert info["reports"] not in info["desk"]  # a report may run scripts, so it does not know the desk's secret


@pytest.mark.nightly
@pytest.mark.program
def test_twenty_people_are_simulated_apart_from_the_data_and_reported(tmp_path: Path) -> None:
    protocol = tmp_path / "quiz.toml"
    protocol.write_text(QUIZ)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    with closing(SimulatedTrial(0, protocol, "quiz", temporary, tmp_path / "reports")) as trial:
        until_s = time.monotonic() + PATIENCE_S
        while trial.describe().state == "running":
            assert time.monotonic() < until_s
            time.sleep(0.2)
        run = trial.describe()
    assert (run.state, run.progress, run.report) == ("done", 1.0, "quiz-simulated/report.html"), run.output
    assert "Simulated data" in (tmp_path / "reports" / run.report).read_text()
    assert len(list(temporary.rglob("*.mcap"))) == 20
    assert not (tmp_path / "sessions").exists()
