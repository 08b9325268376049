"""A session in worlds of others: log, tables and exports say of each end what its rule says, and no more."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq
import pytest

import tests.worlds.odd_ends  # noqa: F401 - registers the worlds
from minihuman.activities.play.screens import build_feedback_screen
from minihuman.admin.enrolment_entries import SlotTaken, open_enrolment_log
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.recording_quality import PlanOutline
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import NewerLogError, ProtocolError, ReportError
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screen_texts import capitalise
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.outcome_check import check_outcome_rules
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.words import LANGUAGES, InterfaceWords
from minihuman.exporters.exporter import export_study
from minihuman.log.codec import DECODERS, select_decoder
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.planning.power import compute_values
from minihuman.reporting.methods import build_methods
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World

KINDS = {
    "paid": "ended",
    "minus": "ended",
    "array": "goal",
    "array-false": "failure",
    "dictionary": "goal",
    "never-terminates": "goal",
    "never-succeeds": "timeout",
    "vector": "ended",
    "coins": "ended",
}
HEAD = """
[study]
name = "odd-ends"
version = "1"
seed = 4
participants = 4
closing = ""
[keys]
pool = ["1", "2"]
keyboard_check = false
[[groups]]
name = "all"
blocks = {blocks}
"""
BLOCK = """
[[blocks]]
name = "{kind}"
world = "tests/Ending-v0"
options = {{ kind = "{kind}" }}
episodes = 1
actions = ["0", "1"]
max_steps = 9
feedback = "{{outcome}}."
{more}
"""
KEPT = 'record_info = ["coins", "where", "said", "set", "none.of.it"]'


def study(*kinds: str, more: str = "", head: str = HEAD) -> Protocol:
    blocks = "".join(BLOCK.format(kind=kind, more=more or (KEPT if kind == "coins" else "")) for kind in kinds)
    return decode_protocol((head.format(blocks=json.dumps(kinds)) + blocks).encode(), "odd.toml")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    assert [*simulate(study(*KINDS), folder, participants=1, seed=1, player="random")]
    return folder


@pytest.fixture(scope="module")
def log(data: Path) -> SessionLog:
    return read_log(data / "odd-ends/sub-01/ses-01")


def test_the_log_says_of_each_end_what_its_rule_says(log: SessionLog) -> None:
    assert {episode.plan.block_name: episode.outcome for episode in log.episodes} == KINDS
    success = {"goal": True, "failure": False, "timeout": False, "ended": None}
    assert [episode.success for episode in log.episodes] == [success[outcome] for outcome in KINDS.values()]


@pytest.mark.parametrize("language", LANGUAGES)
def test_page_and_desk_say_that_the_episode_is_over(language: str) -> None:
    plan = expand_protocol(study("paid"), enrol_participant(study("paid"), 0))
    episode = RunningEpisode(plan.episodes[0], World(plan.episodes[0].world, {"kind": "paid"}), picture_px=None)
    episode.start(0)
    while episode.outcome is None:
        episode.step(0, 0, key="", key_t_ns=0)
    words = InterfaceWords(language)
    screen = build_feedback_screen(words, plan.parts[0].plan, episode, "", 0.0, 0.0)
    assert screen.body == capitalise(f"{words['outcome.ended']}.")
    assert language != "en" or screen.body == "The episode is over."


def test_the_log_is_proved(log: SessionLog) -> None:
    assert [line for line, is_good in verify_session(log.path) if not is_good] == []


def test_a_reader_of_before_refuses_the_log_in_one_sentence(log: SessionLog, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(DECODERS, 3)
    with pytest.raises(NewerLogError, match=r"written by a newer minihuman .*schema version 3.*reads up to 2.*upgrade"):
        select_decoder({"schema_version": "3"}, log.path)


def test_tables_leave_success_empty_where_no_rule_says(data: Path, tmp_path: Path) -> None:
    export_study("parquet", data / "odd-ends", tmp_path, Selection())
    export_study("csv", data / "odd-ends", tmp_path / "text", Selection())
    (found,) = tmp_path.rglob("episodes.parquet")
    episodes = pq.read_table(found).to_pylist()
    assert {row["block"]: row["outcome"] for row in episodes} == KINDS
    assert {row["block"] for row in episodes if row["success"] is None} == {"paid", "minus", "vector", "coins"}
    (text,) = (tmp_path / "text").rglob("episodes.csv")
    with text.open(newline="", encoding="utf-8") as file:
        assert [row["success"] for row in csv.DictReader(file)].count("") == 4
    (blocks,) = tmp_path.rglob("blocks.parquet")
    shares = {row["block"]: row["success"] for row in pq.read_table(blocks).to_pylist()}
    assert (shares["paid"], shares["array"], shares["never-succeeds"]) == (None, 1.0, 0.0)


def test_what_is_chosen_of_info_is_in_steps(data: Path, tmp_path: Path) -> None:
    export_study("parquet", data / "odd-ends", tmp_path, Selection())
    (found,) = tmp_path.rglob("steps.parquet")
    rows = [row["info"] for row in pq.read_table(found).to_pylist() if row["block"] == "coins"]
    columns = pq.read_table(found).to_pydict()
    assert {value for value in columns["info_coins"] if value is not None} == {7.0}
    assert {value for value in columns["info_where"] if value is not None} == {"[1, 2]"}
    described = json.loads((found.parent / "dictionary.json").read_text(encoding="utf-8"))["steps"]
    assert {name: described[name]["type"] for name in ("info_coins", "info_said")} == {
        "info_coins": "number",
        "info_said": "text",
    }
    assert [json.loads(text) for text in rows] == [{}, {}, {"coins": 7, "said": "oh", "set": None, "where": [1, 2]}]


def frames(folder: Path) -> Iterator[dict[str, object]]:
    for file in sorted(folder.rglob("data/chunk-*/*.parquet")):
        yield from pq.read_table(file).to_pylist()


def test_lerobot_has_no_success_where_no_rule_says(data: Path, tmp_path: Path) -> None:
    pytest.importorskip("av")
    export_study("lerobot", data / "odd-ends", tmp_path, Selection())
    rows = list(frames(tmp_path))
    last = [row["next.success"] for row in rows if row["next.done"]]
    assert sorted(map(str, last)) == sorted(["True"] * 3 + ["False"] * 2 + ["None"] * 4)
    coins = [row for row in rows if row.get("info.coins") is not None]
    assert [row["info.coins"] for row in coins if row["info.coins"] == row["info.coins"]] == [7.0]
    assert {row["info.said"] for row in coins} == {"", "oh"}


def test_minari_keeps_the_outcome_and_what_is_chosen_of_info(data: Path, tmp_path: Path, monkeypatch) -> None:
    minari = pytest.importorskip("minari")
    export_study("minari", data / "odd-ends", tmp_path, Selection())
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))
    found = []
    for name in sorted(minari.list_local_datasets()):
        dataset = minari.load_dataset(name)
        for metadata, episode in zip(
            dataset.storage.get_episode_metadata(dataset.episode_indices), dataset, strict=True
        ):
            found.append(metadata["outcome"])
            if metadata["block"] == "coins":
                assert episode.infos["coins"].tolist()[-1] == 7.0
    assert sorted(found) == sorted(KINDS.values())


def test_what_needs_success_is_refused_where_no_rule_says_it() -> None:
    for more, need in {
        "stop_criterion = { successes = 1, of = 1 }": "stop_criterion",
        "points = { goal = 1 }": "points",
        'design = { name = "staircase", settings = { option = "kind", values = ["paid", "minus"] } }': "staircase",
        'design = { name = "level-replay", settings = { seeds = [1, 2] } }': "level-replay",
    }.items():
        with pytest.raises(ProtocolError, match="no rule says what success is in tests/Ending-v0; state one") as error:
            check_outcome_rules(study("paid", more=more), "odd.toml")
        assert need in str(error.value)
        assert "\n" not in str(error.value)
        check_outcome_rules(study("paid", more=f'{more}\nsuccess = "terminated"'), "odd.toml")
    check_outcome_rules(study("paid", more="points = { per_reward = 1 }"), "odd.toml")
    check_outcome_rules(study("array", more="points = { goal = 1 }"), "odd.toml")


def test_power_says_how_to_state_a_rule_where_success_is_unknown() -> None:
    episodes = pd.DataFrame({"outcome": ["ended"] * 4, "participant": list("aabb"), "steps": 3, "max_steps": 9})
    with pytest.raises(ReportError, match=r"success needs success, but no rule says what success is .* state one"):
        compute_values(episodes, "success")
    assert compute_values(episodes.assign(reward=1.0), "reward").tolist() == [1.0, 1.0]


def test_check_says_which_rule_holds_and_what_is_not_kept() -> None:
    said = "\n".join(check_outcome_rules(study("paid", "array", "coins"), "odd.toml"))
    assert "outcome of block 'paid': unknown: every end is 'ended'" in said
    assert "outcome of block 'array': success where info['is_success'] or info['success'] says so" in said
    assert "block 'array': not kept of the world's info: is_success" in said
    assert "block 'coins': record_info names 'none.of.it', which the world did not say" in said
    assert "block 'coins': info['set'] is {1}, of which a log keeps null" in said


def test_a_key_that_is_no_yes_or_no_is_refused() -> None:
    with pytest.raises(ProtocolError, match=r"success is info\['where'\], which is an array of shape \(2,\)"):
        check_outcome_rules(study("coins", more='success = "info:where"'), "odd.toml")


def test_a_study_that_began_before_keeps_its_rule_and_its_report_says_so(tmp_path: Path) -> None:
    protocol = study("paid")
    with open_enrolment_log(tmp_path / "odd-ends").hold() as register:
        new = plan_next_session(protocol, tmp_path / "elsewhere")
        assert new.outcome_rules == 1
        register.append(
            SlotTaken(new.allocation_sha256 or "", 4, 0, "sub-01", "all", overridden=False, at="2026-11-01")
        )
    (path,) = simulate(protocol, tmp_path, participants=1, seed=1, player="random")
    log = read_log(path)
    assert (log.plan.participant.id, log.plan.outcome_rules) == ("sub-02", 0)
    assert [episode.outcome for episode in log.episodes] == ["goal"]
    assert log.segments[0].facts
    assert [line for line, is_good in verify_session(path) if not is_good] == []
    text = "\n".join(build_methods([PlanOutline.of(log.plan)], [], protocols=[protocol]))
    assert "success if terminated and reward > 0, as for every world when the study began" in text
    assert [*StudySessions(tmp_path / "odd-ends")]
