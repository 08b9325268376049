"""A study's scorecard: people's stand-ins, players and models on the same levels, as a table and a figure."""

import csv
from pathlib import Path

import pytest

from minihuman import simulate
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.planning.benchmark import FAMILIES, compose_baseline, parse_players, run_baseline
from minihuman.reporting.build import build_report
from minihuman.reporting.scorecard import build_scorecard, write_scorecard
from tests.models.endpoint import KEY, play, serve_endpoint

pytestmark = pytest.mark.program  # whole studies are simulated

SET = """
[study]
name = "small"
version = "1"
seed = 5
participants = 30
closing = ""
[model]
price_prompt = 1.0
currency = "EUR"
[keys]
keyboard_check = false
pool = ["1", "2", "3"]
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-Empty-6x6-v0"
actions = ["left", "right", "forward"]
max_steps = 12
episodes = 3
seeds = [1, 2, 3]
key_map = "shown"
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scores")
    (folder / "small.toml").write_text(SET)
    with pytest.MonkeyPatch.context() as patch, serve_endpoint(play) as endpoint:
        patch.setenv("OPENAI_BASE_URL", endpoint.url)
        patch.setenv("OPENAI_API_KEY", KEY)
        list(simulate(folder / "small.toml", participants=2, data=folder, player="model:scripted"))
    for player, count in (("human-like", 4), ("random", 2)):
        list(simulate(folder / "small.toml", participants=count, data=folder, player=player))
    return folder


def test_everyone_is_scored_on_the_same_levels(data: Path, tmp_path: Path) -> None:
    card = build_scorecard([data / "small"], draws=200)
    assert card.reference == "human-like (n = 4), in place of people"
    by_name = {line.player: line for line in card.players}
    assert set(by_name) == {"human-like", "random", "model:scripted"}
    assert {line.levels for line in card.players} == {3}
    assert (by_name["model:scripted"].runs, by_name["model:scripted"].costs.calls) == (2, 72)
    assert by_name["model:scripted"].costs.price == pytest.approx(72 * 1000 / 1e6)
    assert by_name["human-like"].score.normalised.value == 1.0
    assert by_name["random"].score.normalised.value == 0.0
    table, page, *figures = write_scorecard(card, tmp_path)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["player"] for row in rows] == [line.player for line in card.players]
    assert float(rows[0]["success"]) == pytest.approx(card.players[0].score.success.value, rel=1e-5)
    assert "0.0720 EUR" in page.read_text()
    assert all(path.stat().st_size > 5_000 for path in figures)


def test_an_unknown_reference_names_who_played(data: Path) -> None:
    with pytest.raises(ReportError, match="human-like, model:scripted, random"):
        build_scorecard([data / "small"], reference="human")


def test_the_report_shows_models_beside_people_and_counts_none_of_them(data: Path, tmp_path: Path) -> None:
    files = build_report(StudySessions(data / "small"), tmp_path)
    assert {"scores.csv", "scores.png"} <= {path.name for path in files}
    page = (tmp_path / "report.html").read_text()
    assert "Models beside people" in page
    participants = (tmp_path / "tables" / "participants.csv").read_text()
    assert "model" not in participants


@pytest.mark.parametrize("kind", list(FAMILIES))
def test_a_baseline_set_is_five_levels_of_each_family_with_fresh_seeds(kind: str) -> None:
    sets = [decode_protocol(compose_baseline(kind, seed).encode()) for seed in (1, 2)]
    assert [len(block.seeds) for block in sets[0].blocks] == [5] * len(FAMILIES[kind])
    seeds = [{seed for block in one.blocks for seed in block.seeds} for one in sets]
    assert not seeds[0] & seeds[1]


def test_bench_runs_players_once_and_names_who_cannot_play(tmp_path: Path) -> None:
    (tmp_path / "set.toml").write_text(compose_baseline("first-person", 3, levels=1))
    players = parse_players("optimal=1,exploring=1")
    card = run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    assert [line.player for line in card.players] == ["optimal"]
    assert any("exploring does not play" in note for note in card.notes)
    before = list((tmp_path / "bench").rglob("*.mcap"))
    run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    assert list((tmp_path / "bench").rglob("*.mcap")) == before
