"""Cloning of teams: from each seat's own log to a policy that takes a seat."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import minihuman
from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError, ProtocolError
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from tests.activities.team.partners import browse_study
from tests.activities.team.study import PEOPLE, team_study
from tests.machine import need_module, needs

need_module("learn")
from minihuman.learn.behaviour_cloning import CloneStudy, CloningSettings, clone_study, split_by_participant  # noqa: E402
from minihuman.learn.demonstrations import read_demonstrations, replay_demonstration  # noqa: E402
from minihuman.learn.policy.file import load_policy  # noqa: E402
from minihuman.learn.policy.observation import ObservationEncoder  # noqa: E402

pytestmark = pytest.mark.program

KITCHEN = "minihuman/Team-CrampedRoom-v0"
PLAYED = Selection(outcome=("timeout",))  # a kitchen has no goal
SHOWN = 'key_map = "shown"\nview = "full"'
VIEW = ObservationEncoder(missions=False)


def kitchen_study(folder: Path, team: str = PEOPLE, **more: object) -> Path:
    """The two in a kitchen, with a key for each action that a cook needs."""
    path = team_study(folder, world=KITCHEN, team=team, max_steps=200, block=SHOWN, **more)  # type: ignore[arg-type]
    toml = path.read_text(encoding="utf-8").replace(
        '"left", "right", "stay"', '"up", "down", "left", "right", "interact"'
    )
    path.write_text(toml.replace('"1", "2", "3"', '"1", "2", "3", "4", "5"'), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def cooks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Eight teams of two people who want what the scripted cook does."""
    folder = tmp_path_factory.mktemp("cooks")
    protocol = read_protocol(kitchen_study(folder, participants=16, episodes=5))
    list(simulate(protocol, folder, participants=16, seed=3, player="human-like:lapse=0"))
    return folder / "duet"


@pytest.fixture(scope="module")
def clone(cooks: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The policy file, and its card."""
    out = tmp_path_factory.mktemp("clone") / "clone.pt"
    settings = CloningSettings(batch_size=128, most_epochs=20, patience=4)
    study = CloneStudy(KITCHEN, evaluation_episodes=10, selection=PLAYED, cloning=settings)
    return out, clone_study(cooks, out, study, command="test")


def test_a_demonstration_is_what_its_own_seat_saw_and_did(cooks: Path) -> None:
    demonstrations = read_demonstrations(cooks, KITCHEN, VIEW, PLAYED)
    played = [
        (log, episode) for path in sorted(cooks.rglob("*.mcap")) for log in [read_log(path)] for episode in log.episodes
    ]
    assert len(demonstrations.episodes) == len(played) == 80
    assert "seat" not in demonstrations.options
    for one, (log, episode) in zip(demonstrations.episodes, played, strict=True):
        assert (one.participant, one.team) == (log.plan.participant.id, episode.team.team)
        np.testing.assert_array_equal(one.actions, episode.team.actions[:, episode.team.seat])
        kitchen = minihuman.make_team(KITCHEN)
        kitchen.reset(episode.plan.seed)
        for seen, joint in zip(one.observations, episode.team.actions.tolist(), strict=True):
            np.testing.assert_array_equal(np.moveaxis(seen["image"], 0, -1), kitchen.observation(episode.team.seat))
            kitchen.step(joint)


def test_what_a_program_did_in_a_persons_seat_is_not_cloned(cooks: Path) -> None:
    log = read_log(cooks / "sub-01" / "ses-01")
    episode, world = log.episodes[0], World(KITCHEN, {})
    seat = episode.team.seat
    whole = replay_demonstration(log, episode, world, VIEW.episode_encoder())
    by = {10: "agent", 11: "agent", 20: "late"}  # step: who acted instead
    sources = [list(each) for each in episode.team.sources]
    for step, source in by.items():
        sources[step][seat] = source
    taken = replace(episode, team=replace(episode.team, sources=tuple(map(tuple, sources))))
    own = replay_demonstration(log, taken, world, VIEW.episode_encoder())
    kept = [step for step in range(200) if step not in by]
    np.testing.assert_array_equal(own.actions, whole.actions[kept])
    assert all(one is not two for one, two in zip(own.observations, whole.observations, strict=False))
    for step, seen in zip(kept, own.observations, strict=True):
        np.testing.assert_array_equal(seen["image"], whole.observations[step]["image"])


def test_no_team_is_in_both_halves_of_the_split(cooks: Path) -> None:
    halves = split_by_participant(read_demonstrations(cooks, KITCHEN, VIEW, PLAYED), share=0.2, seed=1)
    teams = [{one.team for one in half.episodes} for half in halves]
    assert [len(each) for each in teams] == [6, 2]
    assert not teams[0] & teams[1]
    assert [len(half.participants) for half in halves] == [12, 4]


def test_clones_earn_most_of_what_the_people_earned(cooks: Path, clone: tuple[Path, str]) -> None:
    earned = np.mean([episode.return_ for path in cooks.rglob("*.mcap") for episode in read_log(path).episodes])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in clone[1].splitlines() if line.startswith("| ")]
    returns = {row[0]: row[2] for row in rows[2:]}
    assert earned >= 40, "two soups: else there is nothing to learn"
    assert float(returns["60"]) >= 0.7 * earned
    assert float(returns["chance"]) <= 0.1 * earned
    assert "in every seat" in clone[1]
    assert load_policy(clone[0])[1].world_options == {}


def test_a_clone_takes_a_seat_beside_a_person_and_the_log_is_proven(tmp_path: Path, clone: tuple[Path, str]) -> None:
    (tmp_path / "clone.pt").write_bytes(clone[0].read_bytes())
    team = 'seats = ["person", "policy:clone.pt"]\npartner_disclosure = "always"'
    path = kitchen_study(tmp_path, team=team)
    list(simulate(read_protocol(path), tmp_path / "data", participants=2, seed=3, player="human-like:lapse=0"))
    lines = list(minihuman.verify(tmp_path / "data"))
    assert all(line.ok for line in lines), [line.text for line in lines]
    episodes = [episode for log in (tmp_path / "data").rglob("*.mcap") for episode in read_log(log).episodes]
    assert {episode.team.partner for episode in episodes} == {"policy:clone.pt"}
    assert all(
        {sources[1 - episode.team.seat] for sources in episode.team.sources} == {"agent"} for episode in episodes
    )
    assert np.mean([episode.return_ for episode in episodes]) >= 40


def test_the_policy_of_one_group_is_read_and_missed_like_one_of_all(tmp_path: Path, clone: tuple[Path, str]) -> None:
    path = kitchen_study(tmp_path)
    override = (
        '[blocks.group_overrides.all.team]\nseats = ["person", "policy:clone.pt"]\npartner_disclosure = "always"\n'
    )
    path.write_text(path.read_text(encoding="utf-8") + override, encoding="utf-8")
    with pytest.raises(ProtocolError, match=r"clone\.pt cannot be read"):
        read_protocol(path)
    (tmp_path / "clone.pt").write_bytes(clone[0].read_bytes())
    [log] = simulate(read_protocol(path), tmp_path / "data", participants=1, seed=3, player="random")
    assert {episode.team.partner for episode in read_log(log).episodes} == {"policy:clone.pt"}


@pytest.mark.nightly
@needs("chromium")
def test_the_study_of_four_partners_plays_in_browsers(tmp_path: Path, clone: tuple[Path, str], capsys: Any) -> None:
    for name in ("clone.pt", "self-play.pt"):
        (tmp_path / name).write_bytes(clone[0].read_bytes())
    browse_study(tmp_path, teams=2, episodes=1, steps=4, at_once=6)
    told = capsys.readouterr().out
    assert "10 logs, 0 lines of verify not as logged" in told
    assert "2 teams of several people proven in all their logs" in told
    assert "person: 4 people, 2 teams, 16 steps" in told
    for partner in ("scripted", "clone", "self-play"):
        assert f"{partner}: 2 people, 2 teams, 8 steps" in told


def test_what_is_for_one_body_is_refused_before_anything_is_written(cooks: Path, tmp_path: Path) -> None:
    study = CloneStudy(KITCHEN, selection=PLAYED, cloning=CloningSettings(mirrored=True))
    with pytest.raises(LearnError, match="remove --mirrored, which needs a world of one body"):
        clone_study(cooks, tmp_path / "clone.pt", study, command="test")
    assert list(tmp_path.iterdir()) == []
