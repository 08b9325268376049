"""A study of teams from its protocol to its tables, report, figures, replay and exports."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import minihuman
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.dataset.selection import Selection
from minihuman.errors import AllocationError, ProtocolError
from minihuman.exporters.exporter import export_study
from minihuman.figures.path_figures import session_paths
from minihuman.log.read.session_reader import read_log
from minihuman.replay.frames import render_frames, render_partner_frames
from minihuman.reporting.results import compute_results
from minihuman.runtime.simulated_session import simulate
from minihuman.runtime.team_seating import require_one_process
from minihuman.statistics.units import find_units
from tests.activities.team.study import PEOPLE, WITH_AGENT, team_study
from tests.worlds.teams.overcooked import dynamics, needs_overcooked

pytestmark = pytest.mark.program

WITH_SIMULATED = WITH_AGENT.replace("scripted:random", "simulated:random")
TICKS = 'pace = "real_time"\nstep_period_ms = 100'


def simulated(folder: Path, *, participants: int = 4, **study: object) -> list[Path]:
    protocol = read_protocol(team_study(folder, **study))  # type: ignore[arg-type]
    return list(simulate(protocol, folder, participants=participants, seed=3, player="random"))


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two teams of two people each."""
    folder = tmp_path_factory.mktemp("pairs")
    simulated(folder, world="minihuman/Team-FourRooms-v0")
    return folder / "duet"


@pytest.mark.parametrize(("team", "block"), [(PEOPLE, ""), (PEOPLE, TICKS), (WITH_AGENT, TICKS), (WITH_SIMULATED, "")])
def test_simulated_teams_are_proven_and_the_same_when_simulated_again(tmp_path: Path, team: str, block: str) -> None:
    digests = []
    for name in ("first", "again"):
        folder = tmp_path / name
        folder.mkdir()
        logs = simulated(folder, team=team, block=block)
        assert all(line.ok for line in minihuman.verify(folder)), [line.text for line in minihuman.verify(folder)]
        episodes = [episode for log in logs for episode in read_log(log).episodes]
        assert all(len(episode.team.actions) == len(episode.actions) > 0 for episode in episodes)
        digests.append([(episode.team.team, episode.team.seat, episode.team.digest) for episode in episodes])
    assert digests[0] == digests[1]


def test_a_changed_joint_action_is_found_in_the_team_and_a_withdrawn_seat_is_named(tmp_path: Path, pairs: Path) -> None:
    lines = list(verify_teams(pairs))
    assert len(lines) == 2
    assert all("the same in each log here (seats 0 and 1)" in text for text, _ in lines)
    simulated(tmp_path, participants=2)
    study = tmp_path / "duet"
    withdraw_participant(study, "sub-01", seal=None)
    seat = read_log(study / "sub-02" / "ses-01").episodes[0].team.partner_seats[0]
    lines = list(verify_teams(study))
    assert f"seat {seat} withdrawn" in lines[0][0]
    assert all(good for _, good in lines)
    assert all(line.ok for line in minihuman.verify(study))


def test_tables_say_team_seat_and_partner(tmp_path: Path, pairs: Path) -> None:
    result, _ = export_study("csv", pairs, tmp_path / "csv", Selection())
    assert result.episodes == 8
    teams = pd.read_csv(tmp_path / "csv" / "teams.csv", dtype={"team": str, "digest": str})
    assert set(teams["partner"]) == {"person"}
    assert (teams.groupby(["team", "episode"])["digest"].nunique() == 1).all()
    assert (teams.groupby(["team", "episode"])["seat"].nunique() == 2).all()
    joint = pd.read_csv(tmp_path / "csv" / "joint_steps.csv")
    assert len(joint) == int(teams["joint_steps"].sum())


def test_teams_are_the_unit_of_the_reports_statistics(tmp_path: Path, pairs: Path) -> None:
    frames = {name: minihuman.open_study(pairs).table(name) for name in ("episodes", "blocks", "participants", "teams")}
    [block] = compute_results(
        frames["episodes"], frames["blocks"], frames["participants"], None, frames["teams"]
    ).blocks
    assert block.teams == 2
    assert set(block.measures["n"]) <= {0, 1, 2}
    minihuman.report(pairs, tmp_path / "report")
    assert "2 teams of people" in (tmp_path / "report" / "report.html").read_text(encoding="utf-8")


def test_a_chain_of_teams_is_one_unit() -> None:
    rows = [("a", "one"), ("a", "two"), ("b", "two"), ("b", "three"), ("c", "four"), ("c", "five"), ("d", "six")]
    units = find_units(pd.DataFrame(rows, columns=["team", "participant"]))
    assert units["one"] == units["two"] == units["three"] != units["four"] == units["five"]
    assert "six" not in units


def test_figures_and_replays_show_every_body(tmp_path: Path, pairs: Path) -> None:
    from minihuman.replay.recording import save_recording

    log = read_log(pairs / "sub-01" / "ses-01")
    episode, [other] = log.episodes[0], log.episodes[0].team.partner_seats
    drawn = {artist.get_gid() for ax in session_paths(log).axes for artist in ax.get_children()}
    assert f"path of seat {other}" in drawn
    mine, theirs = render_frames(episode), render_partner_frames(episode, other)
    assert len(mine) == len(theirs) == len(episode.actions) + 1
    assert any(not np.array_equal(one, two) for one, two in zip(mine, theirs, strict=True))
    assert save_recording([log], tmp_path / "a.rrd", with_view=True).stat().st_size > 0


def test_an_export_holds_each_episode_once_with_all_bodies(tmp_path: Path, pairs: Path) -> None:
    result, _ = export_study("pettingzoo", pairs, tmp_path / "out", Selection())
    [folder] = [path for path in (tmp_path / "out").iterdir() if path.is_dir()]
    lines = [json.loads(line) for line in (folder / "episodes.jsonl").read_text(encoding="utf-8").splitlines()]
    assert result.episodes == len(lines) == 4
    for line in lines:
        with np.load(folder / line["observations"]) as seen:
            assert {len(seen[agent]) for agent in line["agents"]} == {len(line["actions"]) + 1}
        people = {agent for agent, seat in zip(line["agents"], line["seats"], strict=True) if seat == "person"}
        assert line["people"].keys() == people
        assert all(person["participant"].startswith("sub-") for person in line["people"].values())


KITCHENS = {  # block: the catalogue's kitchen, and its options
    "small": ("CrampedRoom", ""),
    "ring": ("CoordinationRing", ""),
    "tomatoes": ("CrampedRoom", 'options = { layout = "counter_circuit" }\n'),
    "old": ("CrampedRoom", 'options = { rules = "2019" }\n'),
}


@pytest.fixture(scope="module")
def kitchens(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The trajectories of a study in four kitchens, by file."""
    folder = tmp_path_factory.mktemp("kitchens")
    toml = team_study(folder, world="KITCHEN", max_steps=80, blocks=tuple(KITCHENS)).read_text(encoding="utf-8")
    for world, options in KITCHENS.values():
        toml = toml.replace('"KITCHEN"\n', f'"minihuman/Team-{world}-v0"\n{options}', 1)
    path = folder / "kitchen.toml"
    path.write_text(toml.replace('"left", "right", "stay"', '"up", "right", "interact"'), encoding="utf-8")
    list(simulate(read_protocol(path), folder / "data", participants=2, seed=3, player="random"))
    result, _ = export_study("overcooked", folder / "data" / "duet", folder / "out", Selection())
    assert result.episodes == 8
    return {path.stem: path for path in (folder / "out").glob("*.json")}


def test_a_kitchen_is_exported_in_the_words_of_overcooked_ai(kitchens: dict[str, Path]) -> None:
    files = {name: json.loads(path.read_text(encoding="utf-8")) for name, path in kitchens.items()}
    assert set(files) == {"cramped_room", "coordination_ring", "counter_circuit", "cramped_room_2019"}
    for name, found in files.items():
        assert len(found["ep_lengths"]) == 2
        assert [len(states) for states in found["ep_states"]] == found["ep_lengths"]
        assert {params["layout_name"] for params in found["mdp_params"]} == {name.removesuffix("_2019")}
        assert set(found["rules"]) == {"2019" if name.endswith("2019") else "1.1.0"}
    first = files["cramped_room"]["ep_states"][0][0]
    assert [player["held_object"] for player in first["players"]] == [None, None]
    assert files["cramped_room"]["mdp_params"][0]["terrain"][0] == list("XXPXX")
    orders = files["counter_circuit"]["ep_states"][0][0]
    assert [len(order["ingredients"]) for order in orders["all_orders"]] == [3, 3, 2]
    assert orders["bonus_orders"] == [{"ingredients": ["onion", "tomato"]}]


@needs_overcooked
def test_overcooked_ai_reads_what_was_exported_and_steps_it_to_the_same_states(kitchens: dict[str, Path]) -> None:
    gridworld = dynamics().OvercookedGridworld
    from overcooked_ai_py.agents.benchmarking import AgentEvaluator

    for name, path in kitchens.items():
        mdp = gridworld.from_layout_name(name.removesuffix("_2019"))  # which tells it of recipes, before it reads any
        found = AgentEvaluator.load_traj_from_json(str(path))
        assert [len(states) for states in found["ep_states"]] == found["ep_lengths"] == [80, 80]
        if name.endswith("2019"):  # the old rules are none of 1.1.0's
            continue
        [of_file, _], _ = AgentEvaluator.get_mdps_and_envs_from_trajectories(found)
        assert (of_file.terrain_mtx, of_file.start_all_orders) == (mdp.terrain_mtx, mdp.start_all_orders)
        assert of_file.get_standard_start_state().to_dict() == found["ep_states"][0][0].to_dict()
        for states, actions, rewards in zip(found["ep_states"], found["ep_actions"], found["ep_rewards"], strict=True):
            for step, state in enumerate(states[:-1]):
                after, earned = of_file.get_state_transition(state, actions[step])
                assert (after, sum(earned["sparse_reward_by_agent"])) == (states[step + 1], rewards[step])


def test_people_who_would_not_meet_are_told_so_before_a_slot_is_taken(tmp_path: Path) -> None:
    path = team_study(tmp_path)
    with pytest.raises(AllocationError, match="is for 2 people, who cannot play together on one machine"):
        minihuman.run(path, data=tmp_path)
    assert not (tmp_path / "duet").exists()
    with pytest.raises(AllocationError, match="leave out --workers"):
        require_one_process(read_protocol(path), "in several server processes; leave out --workers")
    require_one_process(read_protocol(team_study(tmp_path, team=WITH_AGENT, name="alone")), "on one machine")


@pytest.mark.parametrize(
    ("team", "block", "complaint"),
    [
        ('seats = ["person"]', "", "has 1 seats; give one for each body"),
        ('seats = ["person", "scripted:random"]', "", "is missing, but an agent can hold a seat"),
        ('seats = ["person", "robot"]\npartner_disclosure = "always"', "", "'robot'; a seat is"),
        (f'{PEOPLE}\nroles = ["cook"]', "", "has 1 for 2 seats"),
        (PEOPLE, "max_episode_s = 10.0", "would end or step each seat by its own clock"),
    ],
)
def test_a_protocol_that_makes_no_team_is_refused(tmp_path: Path, team: str, block: str, complaint: str) -> None:
    with pytest.raises(ProtocolError) as refused:
        read_protocol(team_study(tmp_path, team=team, block=block))
    assert complaint in str(refused.value)
