"""A study's scorecard: people's stand-ins, players and models on the same levels, as a table and a figure."""

import csv
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from minihuman import simulate
from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset import store
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.store import StudyStore
from minihuman.dataset.table_database import TableDatabase
from minihuman.dataset.tables import select
from minihuman.errors import ReportError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.planning.benchmark import FAMILIES, compose_baseline, parse_players, run_baseline
from minihuman.reporting.scorecard import Costs, _name_players, build_scorecard, write_scorecard
from tests.models.endpoint import KEY, Reply, play, serve_endpoint, text_of
from tests.models.studies import study
from tests.report.reports import write_report

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


def test_answers_stand_side_by_side_and_what_was_typed_is_in_no_table(tmp_path: Path) -> None:
    play_model(tmp_path, study("text"), play)
    list(simulate(tmp_path / "set.toml", participants=4, data=tmp_path, player="human-like"))
    card = build_scorecard([tmp_path / "seat"], draws=50)
    given = {".".join(name): answers for name, answers in card.answers["model:scripted"].items()}
    assert given == {
        "after.hard": "yes: 100% (n = 1)",
        "after.which": "eyes: 100% (n = 1)",
        "after.fun": "1.00 (n = 1)",
        "after.how_much": "1.00 (n = 1)",
        "after.age": "30.00 (n = 1)",
    }
    assert list(card.answers) == ["human-like", "model:scripted"]
    written = write_scorecard(card, tmp_path / "scores")
    (table,) = csv.DictReader((tmp_path / "scores" / "scores_answers.csv").read_text().splitlines()[:2])
    assert (table["questions"], table["item"]) == ("after", "age")
    assert "| after.hard | " in (tmp_path / "scores" / "scores.md").read_text()
    assert not any(b"it was fine" in path.read_bytes() for path in written)


def test_an_unknown_reference_names_who_played(data: Path) -> None:
    with pytest.raises(ReportError, match="human-like, model:scripted, random"):
        build_scorecard([data / "small"], reference="human")


def test_the_report_shows_models_beside_people_counts_none_of_them_and_opens_each_store_once(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[str] = []

    class CountedStore(StudyStore):
        """Notes of which folder it is; nothing else differs."""

        def __init__(self, sessions: StudySessions, **options: Any) -> None:
            opened.append(str(sessions.source.relative_to(data)))
            super().__init__(sessions, **options)

    monkeypatch.setattr(store, "StudyStore", CountedStore)
    files = write_report(select(data / "small"), tmp_path)
    assert opened == ["small", "models/small"], "each store once"
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


@pytest.mark.parametrize("kind", list(FAMILIES))
def test_the_committed_sets_are_what_the_command_writes_and_can_be_played(kind: str) -> None:
    path = Path(__file__).parents[2] / "protocols" / f"baseline-{kind}.toml"
    assert path.read_text(encoding="utf-8") == compose_baseline(kind, 20261124)
    check_worlds(read_protocol(path), str(path))  # which raises where a limit is more than its world has


def test_bench_runs_players_once_and_names_who_cannot_play(tmp_path: Path) -> None:
    (tmp_path / "set.toml").write_text(compose_baseline("first-person", 3, levels=1))
    players = parse_players("optimal=1,exploring=1")
    card = run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    assert [line.player for line in card.players] == ["optimal"]
    assert any("exploring does not play" in note for note in card.notes)
    before = list((tmp_path / "bench").rglob("*.mcap"))
    run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    assert list((tmp_path / "bench").rglob("*.mcap")) == before


PATH = [*["forward"] * 3, "right", *["forward"] * 3]  # to the goal of an empty room


def play_model(folder: Path, text: str, reply: Reply, *, name: str = "scripted") -> None:
    (folder / "set.toml").write_text(text)
    with pytest.MonkeyPatch.context() as patch, serve_endpoint(reply) as endpoint:
        patch.setenv("OPENAI_BASE_URL", endpoint.url)
        patch.setenv("OPENAI_API_KEY", KEY)
        list(simulate(folder / "set.toml", participants=1, data=folder, player=f"model:{name}"))


def test_a_level_that_a_model_did_not_finish_is_a_failure_at_the_limit(tmp_path: Path) -> None:
    """It walks to the goal of the first level, and then says nothing that is an answer."""
    walk = iter(PATH)

    def reply(messages: list[dict[str, Any]], number: int) -> str:
        (legend,) = (line for line in text_of(messages).splitlines() if " = " in line)
        keys = {action: key for key, _, action in (one.partition(" = ") for one in legend.split(", "))}
        return f"Answer: {keys.get(next(walk, ''), 'nothing')}"

    text = SET.replace("[model]", '[model]\nmodality = "text"\ninvalid = "end"')
    play_model(tmp_path, text, reply)
    list(simulate(tmp_path / "set.toml", participants=1, data=tmp_path, player="optimal"))
    card = build_scorecard([tmp_path / "small"], draws=50)
    model = next(line for line in card.players if line.player == "model:scripted")
    assert (model.levels, model.episodes, model.unfinished) == (3, 3, 2)
    assert model.score.success.value == pytest.approx(1 / 3)
    assert any("model:scripted: 2 of 3 levels not finished" in note for note in card.notes)


def test_a_refusal_is_no_failure(data: Path, tmp_path: Path) -> None:
    shutil.copytree(data, tmp_path / "data")
    text = SET.replace("participants = 30", 'participants = 30\nconsent = "Do you agree?"')
    play_model(tmp_path / "data", text, lambda *_: "Answer: decline", name="shy")
    card = build_scorecard([tmp_path / "data" / "small"], draws=50)
    assert "model:shy" not in {line.player for line in card.players}


def test_what_a_model_cost_in_several_studies_is_added_up(tmp_path: Path) -> None:
    for name in ("small", "other"):
        play_model(tmp_path, SET.replace('name = "small"', f'name = "{name}"'), play)
        list(simulate(tmp_path / "set.toml", participants=1, data=tmp_path, player="optimal"))
    card = build_scorecard([tmp_path / "small", tmp_path / "other"], draws=50)
    costs = next(line.costs for line in card.players if line.player == "model:scripted")
    assert (costs.calls, costs.price, costs.currency) == (72, pytest.approx(72 * 1000 / 1e6), "EUR")
    assert costs.add(Costs(price=1.0, currency="USD")).currency == "mixed"
    assert costs.add(Costs()).currency == Costs().add(costs).currency == "EUR"  # a session without a call costs nothing


def test_policies_of_one_file_name_in_two_folders_are_two_players() -> None:
    assert _name_players(["human", "policy:a/p.pt", "policy:b/p.pt"]) == {
        "human": "human",
        "policy:a/p.pt": "policy:a/p.pt",
        "policy:b/p.pt": "policy:b/p.pt",
    }
    assert _name_players(["policy:x/a/p.pt", "policy:x/b/q.pt", "model:org/m"]) == {
        "policy:x/a/p.pt": "policy:p.pt",
        "policy:x/b/q.pt": "policy:q.pt",
        "model:org/m": "model:org/m",
    }


def test_a_level_without_a_known_shortest_path_is_in_no_efficiency(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    table = TableDatabase.table

    def forget(self: Any, name: str, *arguments: Any, **options: Any) -> Any:
        found = table(self, name, *arguments, **options)
        if name != "episodes":
            return found
        frame = found.to_pandas()
        frame.loc[frame["seed"] == 2, ["feasible_steps", "excess_steps", "spl"]] = np.nan
        return pa.Table.from_pandas(frame, preserve_index=False)

    known = build_scorecard([data / "small"], draws=50)
    monkeypatch.setattr(TableDatabase, "table", forget)
    card = build_scorecard([data / "small"], draws=50)
    assert any("1 levels have no known shortest path" in note for note in card.notes)
    people, before = (next(one.score for one in each.players if one.player == "human-like") for each in (card, known))
    assert people.success == before.success
    assert 0 < people.efficiency.value < 1


def test_a_run_that_was_broken_off_is_not_taken_for_a_whole_one(tmp_path: Path) -> None:
    (tmp_path / "set.toml").write_text(compose_baseline("first-person", 3, levels=1))
    players = parse_players("optimal=1")
    run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    (whole,) = (tmp_path / "bench").rglob("*.mcap")
    whole.rename(whole.with_name(f"{whole.name}.part"))
    run_baseline([tmp_path / "set.toml"], tmp_path / "bench", players)
    assert [path.parts[-3] for path in (tmp_path / "bench").rglob("*.mcap")] == ["sub-02"]
