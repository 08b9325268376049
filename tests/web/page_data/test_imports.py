"""Episodes that Node played come home: Python finds no difference, finds every changed one, and writes real logs."""

import copy
import csv
import io
import json
import random
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import msgspec
import pytest
from gymnasium.utils.env_checker import data_equivalence

import minihuman
from minihuman.admin.enrolment_entries import SlotTaken
from minihuman.cli.command_line import make_command_line
from minihuman.log.read.session_reader import read_log
from minihuman.web.page_data.imported_slots import require_only_imported
from minihuman.web.page_data.page_episodes import (
    NOT_PROVED,
    PageDataError,
    PageEpisode,
    describe_difference,
    find_order_error,
    name_key,
    read_page_data,
    verify_episode,
)
from minihuman.web.page_rows import PATH, format_page_rows
from minihuman.web.world_pack import pack_worlds, parse_seeds
from minihuman.worlds.catalogue import BABYAI_WORLDS, FIRST_PERSON_WORLDS, GRID_WORLDS
from tests.counts import PATIENCE_S, count
from tests.machine import need

HERE = Path(__file__).parent
SMALL = ["MiniGrid-FourRooms-v0", "MiniGrid-DoorKey-5x5-v0", "BabyAI-GoToLocal-v0", "MiniWorld-OneRoom-v0"]
OTHERS = [
    *(entry.name for entry in GRID_WORLDS[::4] if entry.name != "MiniGrid-GoToObj-Transfer-v0"),
    *(entry.name for entry in BABYAI_WORLDS[::12]),
    *(entry.name for entry in FIRST_PERSON_WORLDS[::4]),
]
FULL = [*SMALL, *(name for name in OTHERS if name not in SMALL)]
WORLDS = count(SMALL, FULL)
EPISODES = count(36, 20_000)
CHANGES = count(40, 1_000)
MAZE = "MiniGrid-WFC-MazeSimple-v0"  # which no page lays out
SEEDS = range(3, 6)
STARTED_UNIX_MS = 1_790_000_000_000


@dataclass(frozen=True)
class Played:
    """What Node played."""

    pack: Path
    trials: list[dict[str, Any]]


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    pack = tmp_path_factory.mktemp("pack")
    assert pack_worlds(pack, SEEDS, [*WORLDS, MAZE]).packed_states
    (pack / "package.json").write_text('{"type": "module"}')
    policies = ("random", "walks", "uses")
    plan = [
        {
            "world": WORLDS[number % len(WORLDS)],
            "seed": SEEDS[number // len(WORLDS) % len(SEEDS)],
            "policy": policies[number % 3],
            "max_steps": 0 if "MiniWorld" in WORLDS[number % len(WORLDS)] else (0, 25)[number % 2],
        }
        for number in range(EPISODES)
    ]
    return Played(pack, json.loads(_run_node("play.mjs", pack, text=json.dumps(plan))))


def _run_node(program: str, pack: Path, *paths: Path, text: str = "") -> str:
    command = [need("node"), *map(str, (HERE / program, pack, *paths))]
    ended = subprocess.run(command, input=text, capture_output=True, text=True, timeout=PATIENCE_S)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


def _difference(trial: dict[str, Any]) -> str:
    """What Python says of an episode; "" if nothing differs."""
    try:
        episode = msgspec.convert(trial, PageEpisode)
        return describe_difference(episode, verify_episode(episode)) or find_order_error([episode])
    except (PageDataError, msgspec.ValidationError) as error:
        return str(error)


def test_a_page_world_resets_steps_saves_and_closes_as_it_says(played: Played) -> None:
    assert _run_node("check_world.mjs", played.pack) == "fine\n"


@pytest.mark.nightly(sample=True)
def test_no_episode_that_the_page_played_differs_in_python(played: Played) -> None:
    assert len(played.trials) == EPISODES
    assert {trial["end"] for trial in played.trials} >= {"terminated", "truncated"}
    differences = [difference for trial in played.trials if (difference := _difference(trial))]
    steps = sum(len(trial["actions"]) for trial in played.trials)
    print(f"{EPISODES} episodes over {len(WORLDS)} worlds, {steps} steps: {len(differences)} differ")
    assert differences == []


Change = Callable[[dict[str, Any], random.Random], None]


def _change_action(trial: dict[str, Any], rng: random.Random) -> None:
    step = rng.randrange(len(trial["actions"]))
    others = [action for action in range(len(trial["key_map"])) if action != trial["actions"][step]]
    trial["actions"][step] = rng.choice(others)


def _change_seed(trial: dict[str, Any], rng: random.Random) -> None:
    trial["seed"] += rng.randint(1, 10_000)


def _observe_play(trial: dict[str, Any]) -> list[Any]:
    """Return what Python's world shows and gives over the actions of a trial."""
    env = gymnasium.make(trial["world"], **trial["options"])
    observations = [env.reset(seed=trial["seed"])[0]]
    observations += [env.step(action)[:4] for action in trial["actions"]]
    env.close()
    return observations


def _change_reward(trial: dict[str, Any], rng: random.Random) -> None:
    trial["rewards"][rng.randrange(len(trial["rewards"]))] += rng.choice([1e-9, 0.5, 1.0])


def _change_return(trial: dict[str, Any], rng: random.Random) -> None:
    trial["reward"] += rng.choice([1e-9, 0.5, 1.0])


def _change_digest(trial: dict[str, Any], rng: random.Random) -> None:
    place = rng.randrange(len(trial["digests"]))
    other = rng.choice([digit for digit in "0123456789abcdef" if digit != trial["digests"][place]])
    trial["digests"] = trial["digests"][:place] + other + trial["digests"][place + 1 :]


def _change_key(trial: dict[str, Any], rng: random.Random) -> None:
    step = rng.randrange(len(trial["keys"]))
    trial["keys"][step] = rng.choice([key for key in "fjdkslaq" if key != trial["keys"][step]])


def _swap_steps(trial: dict[str, Any], rng: random.Random) -> None:
    columns = trial["actions"]
    swaps = [step for step in range(len(columns) - 1) if columns[step] != columns[step + 1]]
    step = rng.choice(swaps)
    for name in ("actions", "keys", "rewards"):
        trial[name][step : step + 2] = reversed(trial[name][step : step + 2])
    parts = [trial["digests"][16 * number : 16 * number + 16] for number in range(len(columns))]
    parts[step : step + 2] = reversed(parts[step : step + 2])
    trial["digests"] = "".join(parts)


def _swap_times(trial: dict[str, Any], rng: random.Random) -> None:
    step = rng.randrange(len(trial["rt_ms"]) - 1)
    trial["rt_ms"][step : step + 2] = reversed(trial["rt_ms"][step : step + 2])


def _change_end(trial: dict[str, Any], rng: random.Random) -> None:
    trial["end"] = rng.choice([end for end in ("terminated", "truncated", "left") if end != trial["end"]])


def _drop_step(trial: dict[str, Any], rng: random.Random) -> None:
    step = rng.randrange(len(trial["actions"]) - 1)
    for name in ("actions", "keys", "rewards", "rt_ms", "held_ms"):
        del trial[name][step]
    trial["digests"] = trial["digests"][: 16 * step] + trial["digests"][16 * step + 16 :]


FOUND: dict[str, Change] = {
    "action": _change_action,
    "seed": _change_seed,
    "reward": _change_reward,
    "return": _change_return,
    "digest": _change_digest,
    "key": _change_key,
    "order of steps": _swap_steps,
    "order of times": _swap_times,
    "end": _change_end,
    "a step that is gone": _drop_step,
}


@pytest.mark.nightly(sample=True)
def test_every_drawn_change_of_what_can_be_proved_is_found(played: Played) -> None:
    rng = random.Random(52)
    long = [trial for trial in played.trials if len(set(trial["actions"])) > 1]
    n_alike = 0
    for number in range(CHANGES):
        name = list(FOUND)[number % len(FOUND)]
        original = rng.choice(long)
        trial = json.loads(json.dumps(original))
        FOUND[name](trial, rng)
        if not _difference(trial):  # two seeds of a world with few layouts may be one world, played alike
            assert name == "seed", (name, trial["world"], trial["seed"])
            assert data_equivalence(_observe_play(trial), _observe_play(original)), (trial["world"], trial["seed"])
            n_alike += 1
    print(
        f"{CHANGES} drawn changes of {len(FOUND)} kinds ({', '.join(FOUND)}): all found but {n_alike} seeds, whose "
        "worlds and plays are the same as with the seed before"
    )


def test_what_cannot_be_proved_is_named(played: Played) -> None:
    trial = json.loads(json.dumps(played.trials[0]))
    trial["rt_ms"] = [t + 0.1 for t in trial["rt_ms"]]
    trial["playing_ms"] += 0.1
    trial["held_ms"][0] = 55
    assert _difference(trial) == ""
    assert "when keys were pressed and for how long" in NOT_PROVED
    trial["key_map"]["q"] = trial["key_map"][trial["keys"][0]]  # a second key of the same action
    trial["keys"][0] = "q"
    assert _difference(trial) == ""
    assert "which of two keys of one action" in NOT_PROVED


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("sources", "0" * 16, "import it with the version of minihuman that packed the worlds"),
        ("world", "lab_worlds:Corridor-v0", "none that a page computes"),
        ("options", {"image": "/etc/passwd"}, "none that a page sets"),
        ("options", {"max_steps": True}, "none that a page sets"),
        ("options", {"max_steps": -4}, "seed 3"),
        ("seed", -1, "a seed is 0 or more"),
        ("rt_ms", [], "rt_ms has 0 entries"),
        ("playing_ms", 1.0, "playing_ms"),
        ("buttons", [4_000], "names a step that the episode does not have"),
        ("reward", float("inf"), "not finite"),
        ("view", "sideways", "view"),
        ("actions", [99] * 10_000, "entries for 10000 actions"),
    ],
)
def test_a_column_that_cannot_be_is_refused_by_name(played: Played, field: str, value: object, said: str) -> None:
    trial = next(dict(trial) for trial in played.trials if trial["seed"] == 3 and "FourRooms" in trial["world"])
    assert said in _difference(trial | {field: value})


def test_data_of_a_hundred_steps_stay_below_five_kilobytes(played: Played) -> None:
    trial = json.loads(json.dumps(next(trial for trial in played.trials if len(trial["actions"]) >= 100)))
    names = dict(zip("fjd", ("ArrowLeft", "ArrowRight", "ArrowUp"), strict=True))
    for name in ("actions", "rt_ms", "held_ms", "rewards"):
        trial[name] = trial[name][:100]
    trial["digests"] = trial["digests"][:1600]
    trial["keys"] = [names.get(key, key) for key in trial["keys"][:100]]
    assert len(json.dumps(trial, separators=(",", ":"))) < 5_000


def _as_csv(trials: list[dict[str, Any]]) -> str:
    """Trials as jsPsych writes them: texts as they are, all else as JSON."""
    stream = io.StringIO()
    writer = csv.DictWriter(stream, [*trials[0]], quoting=csv.QUOTE_ALL)
    writer.writeheader()
    for trial in trials:
        writer.writerow({name: cell if isinstance(cell, str) else json.dumps(cell) for name, cell in trial.items()})
    return stream.getvalue()


@pytest.fixture
def session(played: Played) -> list[dict[str, Any]]:
    """The trials of one participant: one episode of each world, and jsPsych's other trials."""
    texts = {"trial_type": "html-keyboard-response", "trial_index": 0, "rt": 812}
    kept = [{**copy.deepcopy(trial), "trial_index": n} for n, trial in enumerate(played.trials[: len(SMALL)], 1)]
    return [texts, *kept]


def test_jspsych_data_become_a_log_that_verifies_and_says_consistent(
    session: list[dict[str, Any]], tmp_path: Path
) -> None:
    data, study = tmp_path / "p1.json", tmp_path / "sessions" / "online-maze"
    data.write_text(json.dumps(session))
    (imported,) = minihuman.import_page_data(data, study=study)
    assert imported.error is None
    assert "consistent, not witnessed" in imported.text
    lines = list(minihuman.verify(study))
    assert all(line.ok for line in lines), lines
    assert any("consistent, not witnessed" in line.text for line in lines)
    log = minihuman.open_study(study)["sub-01"]
    assert [tuple(episode.recorded.actions) for episode in log.episodes] == [
        tuple(trial["actions"]) for trial in session[1:]
    ]
    assert [episode.reward for episode in log.episodes] == [trial["reward"] for trial in session[1:]]
    people = minihuman.open_study(study).table("participants")
    assert people[["participant", "player", "evidence"]].to_numpy().tolist() == [["sub-01", "human", "consistent"]]
    assert people["started_at"][0].startswith("2026-09-21")
    first = read_log(log.path).episodes[0]
    assert (first.t_ns[1] - first.t_ns[0]) / 1e6 == pytest.approx(session[1]["rt_ms"][0], abs=0.001)
    (again,) = minihuman.import_page_data(data, study=study)
    assert again.text == "imported before; nothing was written"


def test_csv_gives_the_episodes_that_json_gives(session: list[dict[str, Any]], tmp_path: Path) -> None:
    (tmp_path / "p1.json").write_text(json.dumps(session))
    (tmp_path / "p1.csv").write_text(_as_csv(session[1:]))
    assert read_page_data(tmp_path / "p1.csv") == read_page_data(tmp_path / "p1.json")


def test_a_kept_game_verifies_and_a_changed_one_does_not(session: list[dict[str, Any]], tmp_path: Path) -> None:
    game = {"format": "minihuman-game", "version": 1, "episodes": [session[1]]}
    (tmp_path / "game.json").write_text(json.dumps(game))
    assert [line.ok for line in minihuman.verify(tmp_path / "game.json")] == [True, True]
    session[1]["actions"][-1] = (session[1]["actions"][-1] + 1) % 3
    (tmp_path / "game.json").write_text(json.dumps(game))
    (line,) = minihuman.verify(tmp_path / "game.json")
    assert not line.ok
    assert "played again" in line.text or "has action" in line.text


LEVEL = """\
world = "minihuman/Level-v0"
options.mission = "walk to the \\"green\\" square"
options.diagram = '''
WWWWWWWWWW
WW>>    Gg
WWWWWWWWWW
WW      Kb
WWWWWWWWWW
'''
"""


def test_a_game_in_a_drawn_level_verifies_and_becomes_a_log(played: Played, tmp_path: Path) -> None:
    level = Path(minihuman.__file__).parent / "builder" / "page" / "level.js"
    (tmp_path / "game.json").write_text(_run_node("play_level.mjs", played.pack, level, text=LEVEL))
    assert [line.ok for line in minihuman.verify(tmp_path / "game.json")] == [True, True]
    (imported,) = minihuman.import_page_data(tmp_path / "game.json", study=tmp_path / "levels")
    assert imported.error is None
    assert imported.log is not None
    (episode,) = read_log(imported.log).episodes
    assert (episode.outcome, episode.start.mission) == ("goal", 'walk to the "green" square')


def test_an_episode_that_was_left_is_abandoned_and_one_that_ran_out_of_time_is_a_timeout(
    session: list[dict[str, Any]], tmp_path: Path
) -> None:
    def cut(trial: dict[str, Any], end: str, **more: Any) -> dict[str, Any]:
        columns = {name: trial[name][:5] for name in ("actions", "keys", "rewards", "rt_ms", "held_ms")}
        reward, success = sum(columns["rewards"]), False
        whole = {"digests": trial["digests"][:80], "end": end, "reward": reward, "success": success}
        return {**trial, **columns, **whole, "playing_ms": trial["rt_ms"][4] + 500, **more}

    limit_ms = session[1]["rt_ms"][4] + 500
    trials = [cut(session[1], "time_limit", time_limit_ms=limit_ms), cut(session[2], "left")]
    (tmp_path / "p1.json").write_text(json.dumps(trials))
    study = tmp_path / "limits"
    (imported,) = minihuman.import_page_data(tmp_path / "p1.json", study=study)
    assert imported.error is None
    assert imported.log is not None
    episodes = read_log(imported.log).episodes
    assert [(episode.outcome, len(episode.actions)) for episode in episodes] == [("timeout", 5), ("abandoned", 5)]
    assert all(line.ok for line in minihuman.verify(study))


def test_the_command_imports_what_it_can_and_its_status_says_that_a_file_was_refused(
    session: list[dict[str, Any]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "data"
    folder.mkdir()
    (folder / "p1.json").write_text(json.dumps(session))
    session[1]["seed"] = 5 if session[1]["seed"] != 5 else 4
    (folder / "p2.json").write_text(json.dumps(session))
    (folder / "p3.json").write_text("[]")
    with pytest.raises(SystemExit) as ended:
        make_command_line().main(["import", str(folder), "--study", str(tmp_path / "s")], standalone_mode=False)
    printed = capsys.readouterr()
    assert ended.value.code == 1
    assert printed.out.count("consistent, not witnessed") == 1
    assert "p2.json: episode 1" in printed.err
    assert "p3.json has no episodes" in printed.err
    assert [path.name for path in sorted((tmp_path / "s").glob("sub-*"))] == ["sub-01"]


def test_two_trials_in_another_order_are_refused(session: list[dict[str, Any]], tmp_path: Path) -> None:
    session[1], session[2] = session[2], session[1]
    (tmp_path / "p1.json").write_text(json.dumps(session))
    with pytest.raises(PageDataError, match="trial 1 comes after trial 2"):
        read_page_data(tmp_path / "p1.json")


def test_episodes_that_overlap_in_time_are_refused(session: list[dict[str, Any]], tmp_path: Path) -> None:
    session[2]["started_unix_ms"] = session[1]["started_unix_ms"]
    (tmp_path / "p1.json").write_text(json.dumps(session))
    (imported,) = minihuman.import_page_data(tmp_path / "p1.json", study=tmp_path / "s")
    assert imported.error is not None
    assert "began before episode 1 had ended" in imported.text


def test_nothing_is_imported_into_a_study_that_was_run(session: list[dict[str, Any]], tmp_path: Path) -> None:
    (tmp_path / "p1.json").write_text(json.dumps(session))
    protocol = Path(__file__).parents[3] / "protocols" / "demo.toml"
    (log,) = minihuman.simulate(protocol, participants=1, data=tmp_path / "sessions", player="optimal")
    study = log.parents[2]
    (imported,) = minihuman.import_page_data(tmp_path / "p1.json", study=study)
    assert imported.error is not None
    assert "import into a study's folder of its own" in imported.text
    assert minihuman.open_study(study).table("participants")["evidence"].tolist() == ["witnessed"]


def test_verify_actions_names_the_first_step_that_differs(played: Played) -> None:
    trial = next(trial for trial in played.trials if "FourRooms" in trial["world"] and not trial["options"])
    digests = [trial["digests"][at : at + 16] for at in range(0, len(trial["digests"]), 16)]
    verified = minihuman.verify_actions("MiniGrid-FourRooms-v0", trial["seed"], trial["actions"], digests)
    assert verified.ok
    assert (verified.steps, verified.reward) == (len(digests), trial["reward"])
    digests[2] = "0" * 16
    differing = minihuman.verify_actions("MiniGrid-FourRooms-v0", trial["seed"], trial["actions"], digests)
    assert differing.difference.startswith("step 3: digest '0000000000000000', played again")
    assert not differing.ok
    with pytest.raises(ValueError, match="each action has one of both"):
        minihuman.verify_actions("MiniGrid-FourRooms-v0", 3, [0], [])


def test_keys_have_the_names_that_logs_have() -> None:
    named = [name_key(key) for key in ("f", "F", "7", "ArrowLeft", " ", "-", "Escape", "F5", "é", "Unidentified")]
    assert named == ["f", "f", "7", "left", "space", "minus", "escape", "f5", "", ""]


def test_the_numbers_of_the_page_are_those_of_the_rules() -> None:
    assert PATH.read_text(encoding="utf-8") == format_page_rows(), "run `python -m minihuman.web.page_rows`"


def test_packing_refuses_what_no_page_computes_and_seeds_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(minihuman.MinihumanError, match="no such world can be packed"):
        pack_worlds(tmp_path, range(1), ["MiniGrid-Nowhere-v0"])
    with pytest.raises(minihuman.MinihumanError, match="rules are Python"):
        pack_worlds(tmp_path, range(1), ["MiniGrid-GoToObj-Transfer-v0"])
    assert parse_seeds("3-5") == range(3, 6)
    assert parse_seeds("7") == range(7, 8)
    for text in ("5-3", "", "a", "0-99999999"):
        with pytest.raises(minihuman.MinihumanError, match="seeds"):
            parse_seeds(text)


def test_a_study_of_sessions_that_were_imported_in_another_way_is_refused(tmp_path: Path) -> None:
    """A site's records and a trial's data are numbered differently, so that one study never holds both."""
    slots = [SlotTaken("", 1, 0, "sub-01", "all", overridden=False, reason="imported from a site, record 12")]
    require_only_imported(slots, tmp_path, "imported from a site, record ")
    with pytest.raises(PageDataError, match="sub-01, whose session was run here or imported from other data"):
        require_only_imported(slots, tmp_path, "imported from a page, data ")
